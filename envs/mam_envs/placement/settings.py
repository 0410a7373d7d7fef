"""How a place for the robot is searched for: every number of this package."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PlacementSearch:
    """Bases that are tried, and when one is good enough.

    Attributes:
        table_lifts: heights of the robot's stand over the object's, metres, in the order of trial;
            where negative the object is lifted.
        floor_lifts: the same for robots that drive on the floor.
        shares: distances from base to handle, over the arm's reach.
        angles: directions round the handle, degrees from straight in front of it.
        enough: share of displaced object poses at which a grasp is taken without trying others.
        floor: a wide slab at the object's foot that is thinner than this (metres) is a floor to
            stand on.
        tight: cost of a metre by which a base is too near to where a displaced object's parts pass.
        groups: places on the part's surface that are tried in turn.
        pivoting: cost of a hand that does not turn with the part at all: a bar that turns between
            the fingers may jam there.
        looked_at: so many of the cheapest paths are compared with the object in full.
        above_ground: metres that the arm keeps above the ground: it sags under what it pulls.
        arm_room: share of the arm's reach that its links keep from each other, and its foot from
            the object while its part moves: it lags behind its targets.
        position_tolerance: error at which inverse kinematics has reached a pose, metres.
        drive_step, drive_turn: metres and degrees between the poses at which a drive is looked at.
        drive_room: metres that it keeps from the object: it arrives a centimetre or two beside
            its place.
        seed: of the first guesses of inverse kinematics.
    """

    table_lifts: tuple[float, ...] = (0.0, 0.15, -0.15, 0.3, -0.3, 0.5, -0.5, 0.75, 1.0, 1.3)
    floor_lifts: tuple[float, ...] = (0.0, -0.3, -0.6)
    shares: tuple[float, ...] = (0.78, 0.62, 0.92, 0.48)
    angles: tuple[float, ...] = (0.0, 25.0, -25.0, 50.0, -50.0, 75.0, -75.0)
    enough: float = 0.5
    floor: float = 0.06
    tight: float = 10.0
    groups: int = 3
    pivoting: float = 1.0
    looked_at: int = 180
    above_ground: float = 0.008
    arm_room: float = 0.0125
    position_tolerance: float = 0.004
    drive_step: float = 0.05
    drive_turn: float = 8.0
    drive_room: float = 0.03
    seed: int = 20240601


PLACEMENT = PlacementSearch()
