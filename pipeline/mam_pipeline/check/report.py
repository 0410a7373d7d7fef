"""What a check found: clauses that hold or not, figures per joint, and reason codes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

REASONS: dict[str, str] = {
    "xml_unreadable": "the URDF is not well-formed XML, or too large",
    "xml_entities": "the XML declares a document type or entities, which are never expanded",
    "bad_tree": "links and joints form no single tree",
    "bad_joint": "a joint's type, axis or origin is unusable",
    "bad_limits": "a joint's limits are missing, reversed, empty or not finite",
    "limits_degrees": "a revolute joint's limits are whole numbers of many turns (a warning)",
    "axis_length": "an axis is no unit vector, and some loaders scale by it (a warning)",
    "no_friction": "a joint has neither friction nor damping (a warning)",
    "bad_inertia": "a mass or inertia is zero, not finite, not positive definite or impossible",
    "no_inertia": "a moving link has no inertial element",
    "no_collision": "a moving link has no collision shape",
    "no_joint": "nothing moves",
    "no_surface": "no link has a surface",
    "mesh_missing": "a mesh file does not exist",
    "mesh_outside": "a file that the URDF or a mesh names lies outside the URDF's folder",
    "mesh_path": "a file is named by package://, file:// or an absolute path (a warning)",
    "texture_missing": "a picture or material file of a mesh does not exist (a warning)",
    "card_differs": "asset.json says of the URDF what the URDF does not say",
    "mesh_unreadable": "a mesh file cannot be read",
    "too_large": "more links, shapes, faces or bytes than a check will read",
    "not_finite": "a number is NaN or infinite",
    "load_failed": "SAPIEN does not load it",
    "penetration": "a part runs into another within its range",
    "detached": "a sliding part loses contact, or leaves its channel, within its range",
    "mid_air": "a part rests far from everything that could hold it (a warning)",
    "off_axis": "a hinge line is not on both bodies, or misses the middle of a wheel or knob",
    "askew": "an axis lies beside the direction along which the part and its body are built",
    "exchanged": "a body hangs on its own part: parent and child are exchanged",
    "cavity_filled": "a collision piece fills space in which another part moves",
    "collision_off": "a body collides far from where it is seen",
    "frozen": "a joint cannot be driven to the ends of its range",
    "drift": "the base moves",
    "exploded": "velocities grow without bound, or the state becomes NaN",
    "sags": "a joint does not hold its pose under gravity",
    "no_return": "a joint does not come back to its rest pose",
    "not_finished": "more joints than the check drives with its budget of simulated steps",
    "name_invalid": "a link or joint name is not one that the simulator takes",
    "hull_count": "a body has more convex pieces than the simulator takes",
    "hull_points": "a convex piece has more vertices than the simulator takes; it is simplified",
    "hull_faces": "a convex piece has more faces than a GPU takes",
    "face_points": "a face of a convex piece has more corners than a GPU takes",
    "concave_collision": "a concave collision mesh collides as its convex hull",
    "inertia_impossible": "an inertia breaks the triangle inequality: no body has it",
    "inertial_turned": "the rotation of an inertial frame is ignored",
    "inertial_missing": "a link without an inertial element is dropped",
    "mesh_format": "the simulator does not read a mesh of this format",
    "several_objects": "the simulator reads the first object of a mesh file only",
    "negative_scale": "a mesh is mirrored by a negative scale",
    "mimic_ignored": "a mimic joint is not coupled",
    "effort_missing": "a joint has no effort or velocity limit",
    "friction_ignored": "joint friction is not read",
    "friction_refused": "the simulator has no joint friction, and refuses a file with some",
    "tag_refused": "the simulator refuses an element or attribute that it does not know",
    "joint_type": "the simulator has no joint of this type",
    "file_format": "the simulator does not read files of this format, or loses much of them",
    "file_unreadable": "MuJoCo or OpenUSD does not read the file",
    "usd_metadata": "a USD file leaves its unit, its up axis or its default prim open",
    "articulation_root": "a USD file has no articulation root, or several",
}
CLAUSES = ("lint", "loads", "base", "reach", "penetration", "contact", "stable", "hold", "return")


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong; `warning` ones do not fail the check."""

    code: str
    where: str
    message: str
    warning: bool = False


@dataclass(frozen=True)
class JointReport:
    """Figures of one joint; shares are of the diagonal (lengths) or of the range (motion).

    `askew` is an angle in radians. How the part handles: `breakaway` (N or N m) is the least force
    that starts it from closed towards open, `tilt_closed` and `tilt_half` (degrees) are the tilts
    of the whole object up to which the closed and the half-open part stay, `let_go` (m/s or rad/s)
    is the speed of the part that is let go half-open.

    None where a figure was not measured. `after` names the joints that must be open first, as the
    door in front of a drawer; all others are closed while a joint is tested.
    """

    name: str
    type: str
    lower: float | None
    upper: float | None
    reached: float | None = None
    penetration: float | None = None
    penetration_at: float | None = None
    gap: float | None = None
    line_gap: float | None = None
    askew: float | None = None
    filled: float | None = None
    hold_drift: float | None = None
    return_error: float | None = None
    top_speed: float | None = None
    breakaway: float | None = None
    tilt_closed: float | None = None
    tilt_half: float | None = None
    let_go: float | None = None
    apart: float = 0.0
    after: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True)
class CheckReport:
    """The verdict; `clauses` maps each of CLAUSES to holds (True), fails or None (not tested)."""

    path: str
    passed: bool
    clauses: Mapping[str, bool | None]
    joints: tuple[JointReport, ...]
    findings: tuple[Finding, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    picture: str | None = None

    @property
    def driven(self) -> bool:
        """Whether the joints were driven in the simulator too."""
        return self.clauses["loads"] is not None

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reason codes of everything that failed, each once, in order of discovery."""
        codes = [f.code for f in self.findings if not f.warning]
        codes += [code for joint in self.joints for code in joint.reasons]
        return tuple(dict.fromkeys(codes))

    def as_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        data = asdict(self)
        data["clauses"] = dict(self.clauses)
        data["reasons"] = list(self.reasons)
        return data

    def for_card(self) -> dict[str, Any]:
        """What an asset's card keeps of it, as `executability`."""
        failing = [
            {"joint": j.name, "reasons": list(j.reasons), "at": j.penetration_at}
            for j in self.joints
            if j.reasons
        ]
        measured = [
            {"joint": j.name, "breakaway": j.breakaway, "let_go": j.let_go,
             "tilt_closed": j.tilt_closed, "tilt_half": j.tilt_half}
            for j in self.joints
            if j.tilt_closed is not None
        ]  # fmt: skip
        faults = [
            {"where": f.where, "code": f.code, "message": f.message}
            for f in self.findings
            if not f.warning
        ]
        return {
            "passed": self.passed,
            "driven": self.driven,
            "reasons": list(self.reasons),
            **({"joints": failing} if failing else {}),
            **({"measured": measured} if measured else {}),
            **({"findings": faults} if faults else {}),
        }
