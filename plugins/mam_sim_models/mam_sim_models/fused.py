"""A learned reconstructor's fused mesh: brought to the box that the photo shows, cut along panels.

Such a mesh is one shell without gaps, in a frame and scale of its own. The box fitted to the photo
gives yaw, scale and where each panel lies; the shell is split along the panels' borders within a
front slab, so that every drawer front and door becomes a part of its own, its handle included.
What lies behind the cuts is made later, by the asset's interiors.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.errors import ConfigError
from mam_pipeline.hints import HintBox, HintJoint, HintPart, Hints
from mam_pipeline.types import FloatArray, Mesh
from mam_sim_models.split import split_mesh

BODY = "learned_body"
SLAB = 0.018  # metres behind a panel's face that go with it
SWAP = 1.25  # how much better the swapped footprint must fit before it is believed
FORWARD = -np.pi / 2  # turn about Z that brings glTF's front (+Z, after Y up to Z up: -Y) to -X


def align_to_box(mesh: Mesh, hints: Hints, forward: float = FORWARD) -> Mesh:
    """Turn and scale an upright mesh (Z up) onto the body's box of the hints.

    The footprint's least rectangle gives yaw up to quarter turns; of these the one is taken that
    is nearest to `forward` and whose width over depth fits the photo's box. Scale is uniform, by
    height; the mesh stands on the floor, its footprint centred.

    Raises:
        ConfigError: the hints hold no body box.
    """
    body = body_box(hints)
    rectangle = cv2.minAreaRect(mesh.vertices[:, :2].astype(np.float32))
    turn = -np.deg2rad(rectangle[2])
    depth, width, height = body.size
    wish = np.log(width / depth)
    best: tuple[float, FloatArray] | None = None
    for quarter in (0, 1, -1, 2):
        angle = turn + quarter * np.pi / 2
        c, s = np.cos(angle), np.sin(angle)
        matrix = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
        size = np.ptp(mesh.vertices @ matrix[:3, :3].T, axis=0)
        wrapped = (angle - forward + np.pi) % (2 * np.pi) - np.pi
        cost = abs(np.log(size[1] / size[0]) - wish) / np.log(SWAP) + abs(wrapped) / (np.pi / 2)
        if best is None or cost < best[0]:
            best = float(cost), matrix
    assert best is not None  # four turns were tried
    turned = mesh.vertices @ best[1][:3, :3].T
    low, high = turned.min(axis=0), turned.max(axis=0)
    top = body.center[2] + height / 2
    scale = top / max(float(high[2] - low[2]), 1e-9)
    middle = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    place = np.diag([scale, scale, scale, 1.0]) @ best[1]
    place[:3, 3] = -scale * middle
    return mesh.transformed(place)


def body_of(hints: Hints) -> HintBox | None:
    """The box of the part of kind body, if the hints hold one."""
    boxes = (p.box for p in hints.parts if p.kind == "body")
    return next((box for box in boxes if box is not None), None)


def body_box(hints: Hints) -> HintBox:
    """The box of the part of kind body.

    Raises:
        ConfigError: there is none.
    """
    box = body_of(hints)
    if box is None:
        raise ConfigError("the photo's hints hold no box of the body")
    return box


def cut_panels(mesh: Mesh, hints: Hints) -> tuple[Mesh, Hints]:
    """Cut an aligned fused mesh along the photo's panels.

    Returns:
        The mesh with one group per panel and one for the rest, and hints whose parts name these
        groups, with boxes, hinge lines and handles moved onto the mesh.
    """
    box = body_box(hints)
    movable = [p for p in hints.parts if p.box is not None and p.joint is not None and p.parent]
    to_mesh = _box_map(mesh, box)
    regions = {}
    for part in movable:
        assert part.box is not None  # chosen above
        low, high = _moved_box(part.box, to_mesh)
        face = _panel_face(mesh, low, high)
        regions[part.name] = (low[1], high[1], low[2], high[2], face + SLAB)
    for y0, y1, z0, z1, back in regions.values():
        for axis, at in ((1, y0), (1, y1), (2, z0), (2, z1), (0, back)):
            corners = mesh.vertices[mesh.faces]
            least, most = corners.min(axis=1), corners.max(axis=1)
            near = (least[:, 0] <= back) & (most[:, 1] >= y0) & (least[:, 1] <= y1)
            near &= (most[:, 2] >= z0) & (least[:, 2] <= z1)
            mesh = split_mesh(mesh, axis, at, near)
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    group = np.zeros(len(mesh.faces), dtype=np.int64)
    names = [BODY]
    for name, (y0, y1, z0, z1, back) in regions.items():
        inside = (middle[:, 1] > y0) & (middle[:, 1] < y1) & (middle[:, 0] < back)
        inside &= (middle[:, 2] > z0) & (middle[:, 2] < z1)
        if inside.any():
            group[inside] = len(names)
            names.append(f"{name}_skin")
    cut = replace(mesh, face_group=group, group_names=tuple(names))
    parts = [_moved_part(p, to_mesh, names) for p in hints.parts]
    return cut, replace(hints, parts=tuple(p for p in parts if p is not None))


def _box_map(mesh: Mesh, box: HintBox) -> tuple[FloatArray, FloatArray]:
    """Scale and shift per axis that carry the photo's body box onto the mesh's own box.

    The mesh's front is where most of its forward-facing area lies: handles stand proud of it.
    """
    low, high = mesh.bounds
    center, size = np.array(box.center), np.array(box.size)
    front = _forward_plane(mesh, np.ones(len(mesh.faces), bool), float(low[0]))
    target_low = np.array([front, low[1], low[2] + (center[2] - size[2] / 2)])
    scale = (high - target_low) / size
    return scale, target_low - scale * (center - size / 2)


def _forward_plane(mesh: Mesh, which: NDArray[np.bool_], otherwise: float) -> float:
    """Area-weighted median x of the foremost faces among `which` that look towards -X."""
    corners = mesh.vertices[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    area = np.linalg.norm(normal, axis=1)
    x = corners[:, :, 0].mean(axis=1)
    low, high = mesh.bounds[:, 0]
    ahead = which & (normal[:, 0] < -0.8 * np.maximum(area, 1e-12))
    ahead &= x < low + 0.35 * (high - low)  # not the insides of a back wall
    if not ahead.any():
        return otherwise
    order = np.argsort(x[ahead])
    total = np.cumsum(area[ahead][order])
    return float(x[ahead][order][np.searchsorted(total, total[-1] / 2)])


def _panel_face(mesh: Mesh, low: FloatArray, high: FloatArray) -> float:
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    inside = ((middle > low) & (middle < high))[:, 1:].all(axis=1)
    return _forward_plane(mesh, inside, float(low[0]))


def _moved_box(
    box: HintBox, to_mesh: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    scale, shift = to_mesh
    center, half = np.array(box.center), np.array(box.size) / 2
    return scale * (center - half) + shift, scale * (center + half) + shift


def _moved_part(
    part: HintPart, to_mesh: tuple[FloatArray, FloatArray], names: list[str]
) -> HintPart | None:
    scale, shift = to_mesh
    if part.kind == "body":
        return replace(part, nodes=(BODY,), box=_as_box(part.box, to_mesh))
    if f"{part.name}_skin" not in names:
        return None
    joint = part.joint
    if joint is not None:
        joint = _moved_joint(joint, scale, shift)
    return replace(
        part,
        nodes=(f"{part.name}_skin",),
        box=_as_box(part.box, to_mesh),
        handle=_as_box(part.handle, to_mesh),
        joint=joint,
    )


def _moved_joint(joint: HintJoint, scale: FloatArray, shift: FloatArray) -> HintJoint:
    origin = None
    if joint.origin is not None:
        moved = scale * np.array(joint.origin) + shift
        origin = (float(moved[0]), float(moved[1]), float(moved[2]))
    upper = joint.upper
    if joint.subtype == "slide" and upper is not None:
        upper = float(upper * scale[0])
    return replace(joint, origin=origin, upper=upper)


def _as_box(box: HintBox | None, to_mesh: tuple[FloatArray, FloatArray]) -> HintBox | None:
    if box is None:
        return None
    low, high = _moved_box(box, to_mesh)
    center, size = (low + high) / 2, high - low
    return HintBox(
        (float(center[0]), float(center[1]), float(center[2])),
        (float(size[0]), float(size[1]), float(size[2])),
    )


def cut_from_photo(mesh: Mesh, hints: Hints) -> tuple[Mesh, Hints]:
    """A learned, upright mesh to one that is scaled, turned and cut as the photo's hints say.

    Hints without a moving part leave the mesh whole: it is aligned only, and named as the body.
    """
    return cut_panels(align_to_box(mesh, hints), hints)
