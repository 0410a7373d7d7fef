"""Pictures of an articulation while its joints move from closed to open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.render.mesh_pictures import palette, posed, render_mesh
from mam_pipeline.types import Articulation, FloatArray, Joint, Mesh, coupled


def motion_pictures(
    articulation: Articulation,
    shares: Sequence[float],
    size: tuple[int, int] = (360, 360),
    azimuth: float = -35.0,
    elevation: float = 25.0,
) -> list[NDArray[np.uint8]]:
    """One picture per share of the way from closed to open, all from the same camera.

    Args:
        shares: 0 is closed, 1 is open; all joints move together.
        size: (width, height) in pixels.
        azimuth: degrees from the front towards the viewer's right.
        elevation: degrees above the horizon.

    Returns:
        (H, W, 3) RGB pictures.
    """

    def at(share: float) -> Mesh:
        return posed(articulation, _values(articulation, share))

    frame = _frame([at(s) for s in (0.0, 0.5, 1.0)])
    return [render_mesh(_framed(at(s), frame), size, azimuth, elevation) for s in shares]


def joint_pictures(
    articulation: Articulation, joint: Joint, size: tuple[int, int], azimuth: float = -35.0,
    elevation: float = 25.0,
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:  # fmt: skip
    """A joint closed, what it carries in colour, and open; the others are closed.

    Args:
        size: (width, height) in pixels. azimuth, elevation: degrees, as of `motion_pictures`.

    Returns:
        Two (H, W, 3) RGB pictures from one camera.
    """
    closed = _values(articulation, 0.0)
    own = {joint.name: value_at(joint, 1.0)}
    couplings = {j.name: j.coupling for j in articulation.joints}
    shut, opened = (posed(articulation, q) for q in (closed, closed | coupled(own, couplings)))
    carried = np.isin(articulation.face_link, articulation.carried_links(joint))
    colors = palette(np.append(carried, [0, 0]))  # `_framed` adds two faces
    frame = _frame([shut, opened])
    return (
        render_mesh(_framed(shut, frame), size, azimuth, elevation, face_colors=colors),
        render_mesh(_framed(opened, frame), size, azimuth, elevation),
    )


def _values(articulation: Articulation, share: float) -> dict[str, float]:
    return {j.name: value_at(j, share) for j in articulation.joints}


def _frame(meshes: Sequence[Mesh]) -> FloatArray:
    """(2, 3) the box around all."""
    ends = np.stack([mesh.bounds for mesh in meshes])
    return np.stack([ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)])


def there_and_back(frames: int) -> list[float]:
    """Shares of one opening and closing that starts and ends slowly."""
    turn = np.linspace(0.0, 2.0 * np.pi, frames, endpoint=False)
    return [float(s) for s in 0.5 - 0.5 * np.cos(turn)]


def value_at(joint: Joint, share: float) -> float:
    """Joint value a share of the way from closed to open; free joints make a full turn."""
    if joint.type == "fixed":
        return 0.0
    if not np.isfinite([joint.lower, joint.upper]).all():
        return 2.0 * np.pi * share
    closed, opened = joint.closed, joint.open
    if abs(opened - closed) < 1e-9:
        closed, opened = (joint.lower, joint.upper)
        if abs(joint.lower) > abs(joint.upper):
            closed, opened = opened, closed
    return closed + (opened - closed) * share


def _framed(mesh: Mesh, bounds: FloatArray) -> Mesh:
    """The mesh with two faces of no area at the corners of `bounds`, so that the camera stays."""
    corners = np.repeat(bounds, 3, axis=0)
    count = len(mesh.vertices)
    assert mesh.face_material is not None and mesh.face_group is not None
    return replace(
        mesh,
        vertices=np.concatenate([mesh.vertices, corners]),
        faces=np.concatenate([mesh.faces, count + np.arange(6).reshape(2, 3)]),
        face_material=np.concatenate([mesh.face_material, [0, 0]]),
        face_group=np.concatenate([mesh.face_group, [0, 0]]),
        uv=None if mesh.uv is None else np.concatenate([mesh.uv, np.zeros((6, 2), np.float32)]),
        colors=None
        if mesh.colors is None
        else np.concatenate([mesh.colors, np.zeros((6, 4), np.uint8)]),
    )
