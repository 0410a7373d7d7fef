"""Pictures of an articulation while its joints move from closed to open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.render.mesh_pictures import posed, render_mesh
from mam_pipeline.types import Articulation, FloatArray, Joint, Mesh


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
        return posed(articulation, {j.name: value_at(j, share) for j in articulation.joints})

    ends = np.stack([at(s).bounds for s in (0.0, 0.5, 1.0)])
    frame = np.stack([ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)])
    return [render_mesh(_framed(at(s), frame), size, azimuth, elevation) for s in shares]


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
