"""When an asset counts as executable: what the solver aims at and `mam-sim check` tests."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Thresholds:
    """Lengths with the suffix `_share` are shares of the object's bounding-box diagonal.

    Attributes:
        base_drift: how far the base may move while joints are driven, metres.
        reach_share: part of each joint's range that driving must reach, at both ends.
        penetration_share: depth over the sweep beyond that at rest.
        penetration_area: share of the part's area that must be that deep before it counts; a few
            samples that graze an edge are no collision.
        gap_share: detachment, beyond the gap at rest; also of a slide from the end of its channel.
        apart_share: distance of a part from all else at rest; a mount may not be modelled.
        askew_angle: from an axis to the direction along which part and body are built, radians.
        hold_seconds, hold_share: how long a pose must be held, and within which part of the range.
        return_share: how near to the rest pose, as a part of the range, driving back must come.
        max_turn_speed, max_slide_speed: anything faster is an explosion; rad/s, m/s.
        filled_share: how deep a moving part's own surface may lie inside another link's collision
            piece where that link's mesh is not solid.
        filled_area: share of the moving part's area that must lie so.
        exchanged_size: how many times a part's box may be as large as that of what it hangs on;
            wheels and knobs are not asked.
        exchanged_around: share of what it hangs on that a larger slide may have inside its box.
        collision_reach: how far a body's collision pieces may reach beyond the box of its surface.
    """

    base_drift: float = 1e-3
    reach_share: float = 0.95
    penetration_share: float = 0.005
    penetration_area: float = 0.004
    gap_share: float = 0.02
    apart_share: float = 0.1
    askew_angle: float = 0.026
    hold_seconds: float = 2.0
    hold_share: float = 0.02
    return_share: float = 0.02
    max_turn_speed: float = 60.0
    max_slide_speed: float = 20.0
    filled_share: float = 0.01
    filled_area: float = 0.02
    exchanged_size: float = 6.0
    exchanged_around: float = 0.75
    collision_reach: float = 0.1


THRESHOLDS = Thresholds()


@dataclass(frozen=True)
class HandlingRule:
    """How breakaway force and tilt are searched for.

    Attributes:
        steps: of the simulator in one trial. moves: a joint moves that is faster than friction
            creeps by this factor. rounds: of halving what is not known yet.
        beyond: the most that is pushed, over what friction and gravity alone ask for.
        least: what nobody feels, N or N m. tilt: the most that is tilted, degrees.
    """

    steps: int = 20
    moves: float = 1.5
    rounds: int = 7
    beyond: float = 2.0
    least: float = 0.02
    tilt: float = 45.0


HANDLING = HandlingRule()

MAX_XML_BYTES = 10 << 20
MAX_MESH_BYTES = 256 << 20
MAX_LINKS = 300
MAX_SHAPES = 20_000
MAX_FACES = 3_000_000
MAX_SWEEP = 200_000_000
"""Faces times moving joints: the offline sweep passes every face for every joint."""
MAX_DRIVE = 10_000_000
"""Simulated steps times joints; driving stops there and says so (70 joints are driven to the end).
No clock decides anything: a slow or busy machine gives the same answer."""
