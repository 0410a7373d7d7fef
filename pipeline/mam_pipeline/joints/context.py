"""What is measured once per part, before any joint hypothesis is looked at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mam_pipeline.geometry.boxes import Box, aligned_box, minimal_box, principal_axes
from mam_pipeline.geometry.frames import ObjectFrame
from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.geometry.sampling import thin_out, unit
from mam_pipeline.geometry.sweep import ContactSet, SweepScene
from mam_pipeline.types import FloatArray, IntArray, Mesh


@dataclass(frozen=True)
class DirectionThresholds:
    """Directions that are looked at around a part.

    Attributes:
        same: radians: directions closer than this are the same.
        most: directions looked at.
    """

    same: float = float(np.deg2rad(6.0))
    most: int = 9


NEAR_DIRECTIONS = DirectionThresholds()


@dataclass(frozen=True)
class Handle:
    """What sticks out of a part's front.

    Attributes:
        center, half: (3,) its box, in multiples of the part's half extents / in mesh units.
        share: of the part's area. reach: how far it sticks out, mesh unit. 0 when there is none.
    """

    center: FloatArray
    half: FloatArray
    share: float
    reach: float


@dataclass(frozen=True)
class PartContext:
    """A part among static geometry, in the object's frame axes.

    Attributes:
        scene: sweeps of the part. frame: of the whole object.
        box: the part's box: along the object's axes, or the least one if that is much tighter.
        aligned: box along the object's axes.
        contact: contact set at gap + 0.003 diagonals.
        clearance: (6, S) free way of every sample along +x +y +z -x -y -z of the *part box* axes
            until something static, in diagonals; infinite where nothing lies ahead.
        front: (3,) unit direction the part shows to the outside.
        handle: what sticks out in front.
        others: boxes of the other movable parts along this part's box axes, (n, 2, 3) low and
            high; None when they are not known.
    """

    scene: SweepScene
    frame: ObjectFrame
    box: Box
    aligned: Box
    contact: ContactSet
    clearance: FloatArray
    front: FloatArray
    handle: Handle
    others: FloatArray | None = None

    @property
    def exposure(self) -> FloatArray:
        """(6,) share of the part's samples that see the outside along the box directions."""
        return np.asarray((~np.isfinite(self.clearance)).mean(axis=1))

    @property
    def rise(self) -> FloatArray:
        """(3,) the box axis across the front that is most upright, else the longer one."""
        across = [k for k in range(3) if abs(float(self.box.axes[k] @ self.front)) < 0.5]
        up = [abs(float(self.box.axes[k] @ self.frame.up)) for k in across]
        k = across[int(np.argmax(up))]
        if max(up) < 0.3:
            k = across[int(np.argmax(self.box.half[across]))]
        axis = self.box.axes[k]
        return np.asarray(-axis if float(axis @ self.frame.up) < 0 else axis)

    def towards(self, direction: FloatArray) -> int:
        """Row of `clearance` whose direction is nearest to the given one."""
        share = self.box.axes @ direction
        k = int(np.argmax(np.abs(share)))
        return k if share[k] > 0 else k + 3

    def half_along(self, direction: FloatArray) -> float:
        """Half extent of the part's box along a direction, never zero."""
        reach = float(np.abs(self.box.axes @ direction) @ self.box.half)
        return max(reach, 1e-5 * self.diagonal)

    @property
    def diagonal(self) -> float:
        """The object's diagonal, mesh unit."""
        return self.scene.diagonal


def part_context(
    mesh: Mesh,
    part_faces: IntArray,
    static_faces: IntArray,
    frame: ObjectFrame,
    *,
    parent_faces: IntArray | None = None,
    others: Sequence[IntArray] | None = None,
    seed: int = 0,
    samples: int = 110,
    static_samples: int = 170,
) -> PartContext:
    """Measure a part.

    Args:
        part_faces: of the moving part with everything it carries. static_faces: all that does
            not move with it. parent_faces: where contact is looked for (default: static).
        others: faces of each of the other movable parts, if they are known.
    """
    scene = SweepScene(
        mesh, part_faces, static_faces,
        samples=samples, static_samples=static_samples, contact_samples=900, seed=seed,
        chord=np.deg2rad(15.0),
    )  # fmt: skip
    vertices = mesh.vertices[np.unique(mesh.faces[part_faces])]
    aligned = aligned_box(vertices, frame.axes)
    least = minimal_box(vertices, directions=10)
    turned = np.degrees(np.arccos(np.clip(np.abs(least.axes @ frame.axes.T).max(axis=1), 0, 1)))
    box = least if least.volume < 0.8 * aligned.volume and turned.max() > 6.0 else aligned
    if parent_faces is None or len(parent_faces) in (0, len(static_faces)):
        contact = scene.contact()
    else:
        contact = _contact(scene, mesh, parent_faces)
    clearance = _clearance(scene, box)
    front = _front(box, (~np.isfinite(clearance)).mean(axis=1), frame, scene)
    boxes = None
    if others is not None:
        found = [mesh.vertices[np.unique(mesh.faces[f])] @ box.axes.T for f in others if len(f)]
        boxes = np.array([[v.min(axis=0), v.max(axis=0)] for v in found]).reshape(-1, 2, 3)
    return PartContext(
        scene, frame, box, aligned, contact, clearance, front, _handle(scene, box, front), boxes
    )


def _contact(scene: SweepScene, mesh: Mesh, parent_faces: IntArray) -> ContactSet:
    """Contact with the parent only, at gap + 0.003 diagonals."""
    near = RayScene(mesh.vertices, mesh.faces[parent_faces]).closest(scene.dense.points)
    gap = float(near.distance.min(initial=np.inf))
    tau = gap + 0.003 * scene.diagonal
    mask = near.distance < tau
    keep = np.flatnonzero(mask)[thin_out(int(mask.sum()), 2000)]
    return ContactSet(
        scene.dense.points[keep], near.points[keep], near.normals[keep], gap, tau,
        float(mask.mean()) if len(mask) else 0.0,
    )  # fmt: skip


def _clearance(scene: SweepScene, box: Box) -> FloatArray:
    """Free way (6, S) of the samples along the box directions, in diagonals.

    Rays start a little behind the sample, so that what touches it counts as being at no distance.
    """
    directions = np.concatenate([box.axes, -box.axes]) * scene.diagonal
    n = len(scene.points)
    back = 0.002
    origins = (scene.points[None] - back * directions[:, None]).reshape(-1, 3)
    hits = scene.static_scene.first_hits(origins, np.repeat(directions, n, axis=0))
    return np.asarray(np.maximum(hits.t.reshape(6, n) - back, 0.0))


def _front(box: Box, exposure: FloatArray, frame: ObjectFrame, scene: SweepScene) -> FloatArray:
    """Direction that the part's broad side shows to the outside.

    Broad and well-seen directions score; being on that side of the object breaks ties.
    """
    sides = np.array([box.half[1] * box.half[2], box.half[0] * box.half[2],
                      box.half[0] * box.half[1]])  # fmt: skip
    broad = np.tile(sides / max(sides.max(), 1e-300), 2)
    object_center = (0.5 * (frame.low + frame.high)) @ frame.axes
    directions = np.concatenate([box.axes, -box.axes])
    aside = directions @ (box.center - object_center) / frame.diagonal
    upward = directions @ frame.up
    # A cabinet without a top shows its drawers from above: only what is topmost faces up.
    below = frame.high[2] - float((scene.dense.points @ frame.up).max())
    buried = (upward > 0.7) & (below > 0.015 * frame.diagonal)
    score = broad * (0.2 + exposure) * np.where(buried, 0.3, 1.0) + 1.0 * aside
    score = score - 0.5 * np.maximum(-upward, 0.0)
    return np.asarray(directions[int(np.argmax(score))])


def _handle(scene: SweepScene, box: Box, front: FloatArray) -> Handle:
    """Find what sticks out beyond the largest area that faces the front."""
    dense = scene.dense
    height = (dense.points - box.center) @ front
    facing = np.abs(dense.normals @ front) > 0.9
    nothing = Handle(np.zeros(3), np.zeros(3), 0.0, 0.0)
    if facing.sum() < 10:
        return nothing
    step = 0.004 * scene.diagonal
    bins = np.round((height[facing] - height.min()) / step).astype(int)
    mass = np.bincount(bins)
    # The foremost plane with a fair share of the facing area is the front of the panel.
    plane = height.min() + float(np.flatnonzero(mass >= 0.4 * mass.max())[-1]) * step
    ahead = height > plane + 0.006 * scene.diagonal
    if ahead.sum() < 3:
        return nothing
    points = dense.points[ahead]
    local = box.local(points)
    low, high = local.min(axis=0), local.max(axis=0)
    return Handle(
        0.5 * (low + high),
        0.5 * (high - low) * box.half,
        float(ahead.mean()),
        float(height.max() - plane),
    )


def directions_of(context: PartContext) -> list[FloatArray]:
    """Distinct candidate directions: object axes, tight box axes, contact and part principal axes.

    Contact normals enter through their mean plane (the contact's smallest principal direction).
    """
    found: list[FloatArray] = [np.array(a) for a in context.frame.axes]
    extra: list[FloatArray] = [] if context.box is context.aligned else list(context.box.axes)
    points = context.contact.points
    if len(points) >= 8:
        axes, values = principal_axes(points)
        if values[0] > 4.0 * values[1]:
            extra.append(axes[0])
        if values[1] > 4.0 * values[2]:
            extra.append(axes[2])
    else:  # held at a spot or two, as a globe between its pins
        extra += _between_pins(context)
    if context.frame.trend is not None:
        extra.append(context.frame.trend)
        extra.append(np.asarray(np.cross(context.frame.up, context.frame.trend)))
    part_axes, spread = principal_axes(context.scene.points)
    if spread[0] > 1.5 * spread[1]:
        extra.append(part_axes[0])
    if spread[1] > 1.5 * spread[2]:
        extra.append(part_axes[2])
    for axis in extra:
        if all(abs(float(unit(axis) @ a)) < np.cos(NEAR_DIRECTIONS.same) for a in found):
            found.append(unit(axis))
    return found[: NEAR_DIRECTIONS.most]


def _between_pins(context: PartContext) -> list[FloatArray]:
    """From the spot that is nearest to what stands still to the nearest one opposite it."""
    points = context.scene.dense.points - context.box.center
    distance = context.scene.static_scene.distance(context.scene.dense.points)
    first = points[int(np.argmin(distance))]
    opposite = np.flatnonzero(points @ first < -0.5 * float(first @ first))
    if len(opposite) == 0 or not first.any():
        return []
    return [points[opposite[int(np.argmin(distance[opposite]))]] - first]


def revolute_lines(context: PartContext, axis: FloatArray) -> list[FloatArray]:
    """Points (3,) where a line along `axis` may pierce the part: box grid, contact, centres."""
    base = context.box.axes if any(
        abs(float(axis @ a)) > np.cos(NEAR_DIRECTIONS.same) for a in context.box.axes
    ) else _plane_axes(axis, context.frame.axes)  # fmt: skip
    cross = [a for a in base if abs(float(axis @ a)) < 0.5][:2]
    points = context.scene.points
    local = np.stack([points @ c for c in cross], axis=1)
    low, high = local.min(axis=0), local.max(axis=0)
    middle = 0.5 * (low + high)
    spots = [np.array([u, w]) for u in (low[0], middle[0], high[0])
             for w in (low[1], middle[1], high[1])]  # fmt: skip
    spots.append(local.mean(axis=0))
    contact = context.contact.points
    if len(contact) >= 3:
        flat = np.stack([contact @ c for c in cross], axis=1)
        spots.append(flat.mean(axis=0))
        spots.append(0.5 * (flat.min(axis=0) + flat.max(axis=0)))
        k = int(np.argmax(np.ptp(flat, axis=0)))
        cut = 0.1 * np.ptp(flat[:, k])
        spots.append(flat[flat[:, k] <= flat[:, k].min() + cut].mean(axis=0))
        spots.append(flat[flat[:, k] >= flat[:, k].max() - cut].mean(axis=0))
    keep: list[FloatArray] = []
    for s in spots:
        if all(np.linalg.norm(s - other) > 0.009 * context.diagonal for other in keep):
            keep.append(s)
    height = float(context.box.center @ axis) * axis
    return [s[0] * cross[0] + s[1] * cross[1] + height for s in keep]


def _plane_axes(axis: FloatArray, frame: FloatArray) -> FloatArray:
    """Rows (3, 3): two directions perpendicular to `axis`, as level and upright as can be; axis."""
    reference = frame[int(np.argmin(np.abs(frame @ axis)))]
    u = unit(np.cross(axis, reference))
    return np.stack([u, unit(np.cross(axis, u)), axis])
