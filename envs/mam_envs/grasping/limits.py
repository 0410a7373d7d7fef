"""When a hand may grasp, and how far grasps are searched for: every number of this package."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class GraspLimits:
    """What a grasp must keep to.

    Attributes:
        waypoints: joint values along the joint's path at which the hand's pose is computed.
        back_off: metres of straight motion along the approach before the grasp.
        dip: metres that the hand's surface points may dip into the object at the grasp.
        clearance: metres that the palm had better keep from everything, and the fingers from what
            does not move: arms err. tight: cost of a grasp where they do not.
        narrow: metres by which fingers open wider than a handle where there is little room.
        shallow: least depth of a recessed pull or rim that fingers can hook, metres.
        board_tilt: degrees that the fingers may be tilted against a board's faces.
        capacity: least pull that fingers on a rim or board must bear, over the squeeze (a hand
            squeezes with 40 N).
        lags: shares of the part's turn that a hand may follow which pivots round a bar.
        friction: between fingertip and part: a little less than the mean of ManiSkill's rubber
            (2.0) and the smoothest material of a part (0.4), which is what the simulator uses.
        patch: metres by which a soft fingertip's contacts may differ in height.
        pad: half the width of a fingertip that counts, metres.
    """

    waypoints: int = 14
    back_off: float = 0.10
    dip: float = 0.003
    clearance: float = 0.005
    tight: float = 1.0
    narrow: float = 0.015
    shallow: float = 0.006
    board_tilt: float = 25.0
    capacity: float = 0.5
    lags: tuple[float, ...] = (1.0, 0.6, 0.25)
    friction: float = 1.0
    patch: float = 0.0015
    pad: float = 0.007


@dataclass(frozen=True)
class SurfaceSearch:
    """How a part's surface is searched for grasps that its card does not name.

    Attributes:
        samples: points on the moving links.
        depth: metres that the fingertips reach behind a free edge.
        room: metres by which fingers open wider than what they grasp.
        directions: approaches that are tried round a normal.
        pinches, hooks, pushes: grasps of each kind that are kept.
        leans: angle (radians) by which hooked fingers lean away from the face that they drag, since
            a palm is wide, and how far (metres) before the face's point they then begin.
        catch: metres from the middle of the fingers within which they meet what they drag.
        tries: so many are compared with the object in full: of the cheapest few, all may stand too
            close to a corner.
    """

    samples: int = 600
    depth: float = 0.012
    room: float = 0.008
    directions: int = 8
    pinches: int = 18
    hooks: int = 12
    pushes: int = 8
    leans: tuple[tuple[float, float], ...] = ((0.0, 0.0), (0.3, 0.01), (0.6, 0.01), (0.6, 0.025))
    catch: float = 0.03
    tries: int = 400


LIMITS = GraspLimits()
SEARCH = SurfaceSearch()
