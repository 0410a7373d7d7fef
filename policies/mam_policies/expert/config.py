"""Settings of the scripted expert: speeds, waits, and when it calls a grasp slipped."""

from __future__ import annotations

from dataclasses import dataclass

from mam_envs.replanning import TILTS


@dataclass(frozen=True, kw_only=True)
class ExpertConfig:
    """Steps are control steps, 20 a second; shares of a speed are of the robot's `step`."""

    tilts: tuple[int, ...] = TILTS
    """Angles between the hand and the part's surface that are tried, degrees."""
    move_speed: float = 0.8
    """Share of the arm's speed on the way to the part."""
    approach_speed: float = 0.35
    """Share of the arm's speed on the last way to the grasp."""
    follow_speed: float = 0.5
    """Share of the arm's speed, at most, while the joint moves."""
    hand_speed: float = 0.012
    """Metres per step at which the hand drags the part."""
    push_speed: float = 0.007
    """Metres per step where it only pushes: what is struck runs ahead, without contact."""
    longest: int = 90
    """Steps that the joint's way may take, whatever its length."""
    pause_steps: int = 4
    """Steps in which the arm catches up with its target before it closes or pushes: fingers that
    close 5 mm too early close beside a shallow pull."""
    lag: float = 0.1
    """Radians that a joint may still be off when the hand closes; a slow controller lags."""
    catch_up: int = 25
    """Steps that it is waited for."""
    close_steps: int = 6
    """Steps in which the hand closes."""
    settle_steps: int = 25
    """Steps at the end of the way; a third of them for turn_to, half after a correction."""
    release_steps: int = 14
    """Steps in which the hand opens."""
    retreat_steps: int = 14
    """Steps in which the hand backs off before another try."""
    retreat_length: float = 0.09
    """Metres that it backs off."""
    corrections: int = 3
    """Times that a hand which has come to its end goes on by what the joint still lacks."""
    give: float = 0.006
    """Metres that a pulling arm stays behind its target."""
    give_share: float = 0.08
    """The same as a share of the whole way; the greater of both is added to a correction."""
    short: float = 0.06
    """Ways of fewer metres than this at the hand may be lost in that give."""
    slip: float = 0.3
    """Share of the whole way that the joint may lag behind the hand before it counts as slipped."""
    slip_length: float = 0.03
    """Metres at the hand below which a lag is the arm's give, not a slip."""
    bearable: float = 5.0
    """Newtons across the joint's motion to which the hand does not give way."""
    compliance: float = 0.0001
    """Metres per step and newton by which it gives way."""
    most_offset: float = 0.05
    """Metres, at most, between the hand and its planned place."""
    most_turn: float = 0.25
    """Radians, at most, between an arm joint and its planned value."""
    strained: float = 0.6
    """Share of the force that the robot is trusted with; above it, across the joint's motion, the
    hand waits until it has given way."""
    card_tries: int = 2
    """After so many grasps that slipped, those on the part's surface come first."""
    drive_speed: float = 0.6
    """Metres per second, at most, of a base that drives."""
    turn_speed: float = 1.5
    """Radians per second, at most, at which it turns."""
    drive_ease: float = 1.5
    """Metres per second by which its speed changes in a second, at most."""
    turn_ease: float = 4.0
    """Radians per second by which its turning changes in a second, at most."""
    drive_gain: float = 3.0
    """Speed per metre or radian that is left."""
    drive_near: float = 0.01
    """Metres from its place at which it has arrived."""
    drive_aim: float = 0.01
    """Radians from a direction at which it has turned far enough."""
    longest_drive: int = 200
    """Steps after which a drive is given up."""
