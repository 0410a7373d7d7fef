"""Which reason of the check is mended by what: one table, in the order of the work."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from mam_pipeline.mend import bodies, files, joints, motion, tree
from mam_pipeline.mend.work import Work


@dataclass(frozen=True)
class Repair:
    """What is done about one reason.

    Attributes:
        text: in words, for the reference. work: does it, for a copy and the reason, all over.
        asked: only where the reason, or a simulator that has it, was named: the object is sound
            without.
        moving: it needs the figures of a check that came as far as moving the parts; it is taken
            back where the check finds more afterwards than before.
    """

    text: str
    work: Callable[[Work, str], None]
    asked: bool = False
    moving: bool = False


REPAIRS: Mapping[str, Repair] = {
    "bad_tree": Repair(
        "the second of two names gets a number, an end that is spelled otherwise the link's name, "
        "a missing parent an empty link, a second root a fixed joint", tree.tree,
    ),
    "name_invalid": Repair("letters, digits and _, wherever the name stands", tree.identifiers),
    "mesh_outside": Repair("with `--allow-outside`: copied into the folder", files.inside),
    "mesh_path": Repair("a relative name", files.relative),
    "mesh_missing": Repair(
        "the file of that name in another case, place or format; else the link's shapes of the "
        "other kind", files.missing,
    ),
    "texture_missing": Repair("the picture of that name, copied beside", files.pictures),
    "not_finite": Repair(
        "faces without finite corners go; limits, damping and effort that are no number go",
        files.finite,
    ),
    "negative_scale": Repair("the mesh is mirrored", files.readable),
    "mesh_format": Repair(
        "written anew as OBJ", files.readable, asked=True
    ),
    "several_objects": Repair(
        "one object a file", files.readable, asked=True
    ),
    "bad_joint": Repair(
        "types of other formats, a zero axis, commas, a scale of one number, negative damping, "
        "couplings to nothing",
        joints.joint,
    ),
    "axis_length": Repair("a unit vector", joints.unit_axes),
    "limits_degrees": Repair("radians", joints.degrees),
    "bad_limits": Repair(
        "exchanged where they are reversed; measured where there are none; a slide without any "
        "that hangs on nothing is a robot's free base, and fixed", joints.limits
    ),
    "effort_missing": Repair("100 N or N m, 2 m/s or rad/s", joints.effort),
    "bad_inertia": Repair(
        "the mass that it has, spread as its surface is; without one, by the material",
        bodies.inertia,
    ),
    "no_inertia": Repair("as `bad_inertia`", bodies.inertia),
    "inertial_missing": Repair("as `bad_inertia`", bodies.inertia),
    "inertia_impossible": Repair("the least growth that a body can have", bodies.inertia),
    "inertial_turned": Repair("the rotation goes into the tensor", bodies.straight_inertial),
    "no_collision": Repair("convex pieces of what is seen", bodies.no_collision),
    "hull_points": Repair("a hull of fewer points", bodies.fewer_points),
    "hull_faces": Repair("as `hull_points`", bodies.fewer_points),
    "face_points": Repair("as `hull_points`", bodies.fewer_points),
    "hull_count": Repair("convex pieces of what is seen", bodies.rebuild),
    "concave_collision": Repair(
        "convex pieces that leave its hollow open", bodies.concave, asked=True
    ),
    "no_friction": Repair("friction and damping by what the part weighs", joints.friction),
    "friction_refused": Repair("the friction goes, the damping stays", joints.strict, asked=True),
    "tag_refused": Repair("the element or attribute goes", joints.strict, asked=True),
    "exchanged": Repair(
        "the body holds its part, where both stand; the axis is turned about", motion.turn_round,
        moving=True,
    ),
    "penetration": Repair(
        "a range that ends before it, or opens the other way where only that is free",
        motion.clear_way, moving=True,
    ),
    "detached": Repair("a range that ends before it", motion.in_guide, moving=True),
    "sags": Repair(
        "friction that holds what the part weighs", joints.friction, moving=True
    ),
    **{
        reason: Repair("convex pieces that leave hollows open", motion.pieces, moving=True)
        for reason in ("cavity_filled", "collision_off", "exploded", "drift")
    },
    "frozen": Repair(
        "convex pieces that leave hollows open; then pairs that overlap at rest, or hang on each "
        "other through a link without a shape, are named in an SRDF; then the range that a drive "
        "reaches", motion.pieces, moving=True,
    ),
    "no_return": Repair("as `frozen`", motion.pieces, moving=True),
}  # fmt: skip

LATER = (
    (("frozen", "no_return", "exploded", "sags", "drift"), motion.exclusions),
    (("frozen", "no_return"), motion.driven_way),
)
"""What is tried next where a reason is left after its repair."""
