"""A triangle soup in Open3D's ray caster on the CPU: what every picture here is made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from mam_pipeline.types import FloatArray, IntArray

_tensor: Any = o3d.core.Tensor  # its stubs know no NumPy


@dataclass(frozen=True)
class Seen:
    """First hits of n rays, m of which hit something.

    Attributes:
        hit: (n,) whether a ray hits. rays: (m, 3) those that do.
        at: (m, 3) where. face: (m,) which triangle. uv: (m, 2) where on it.
        normal: (m, 3) unit, turned towards the eye.
    """

    hit: NDArray[np.bool_]
    rays: FloatArray
    at: FloatArray
    face: IntArray
    uv: FloatArray
    normal: FloatArray


class Tracer:
    """Casts rays at triangles; one thread, since runs are parallel over processes."""

    def __init__(self, vertices: FloatArray, faces: IntArray) -> None:
        """Take (V, 3) vertices and (F, 3) faces."""
        self._scene: Any = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._scene.add_triangles(
            _tensor(vertices.astype(np.float32)), _tensor(faces.astype(np.uint32))
        )

    def cast(self, origin: FloatArray, rays: FloatArray) -> Seen:
        """First hits of rays (n, 3) from one eye (3,)."""
        found = self._scene.cast_rays(_bundle(origin, rays))
        distance = found["t_hit"].numpy().astype(np.float64)
        hit = np.isfinite(distance)
        normal = found["primitive_normals"].numpy()[hit].astype(np.float64)
        normal *= -np.sign(np.einsum("ij,ij->i", normal, rays[hit]))[:, None]
        face = found["primitive_ids"].numpy()[hit].astype(np.int64)
        at = origin + rays[hit] * distance[hit, None]
        return Seen(hit, rays[hit], at, face, found["primitive_uvs"].numpy()[hit], normal)

    def distance(self, start: FloatArray, rays: FloatArray) -> FloatArray:
        """(n,) how far rays (n, 3) from (n, 3) go in multiples of themselves; inf: no hit."""
        found = self._scene.cast_rays(_bundle(start, rays))
        return np.asarray(found["t_hit"].numpy().astype(np.float64))

    def blocked(
        self, start: FloatArray, rays: FloatArray, reach: float = np.inf
    ) -> NDArray[np.bool_]:
        """(n,) whether rays from (n, 3) hit anything within `reach` multiples of themselves."""
        found = self._scene.test_occlusions(_bundle(start, rays), tfar=float(reach))
        return np.asarray(found.numpy(), dtype=np.bool_)


def camera_rays(forward: FloatArray, half: float, width: int, height: int) -> FloatArray:
    """Unit rays (H * W, 3) of an upright pinhole camera, row by row from the top.

    Args:
        forward: (3,) unit vector from the eye.
        half: half a pixel's side on the image plane at distance 1.
    """
    right = np.cross(forward, [0, 0, 1.0])
    size = np.linalg.norm(right)
    right = right / size if size > 1e-6 else np.array([0, -1.0, 0])
    up = np.cross(right, forward)
    x = (2 * np.arange(width) + 1 - width) * half
    y = (height - 1 - 2 * np.arange(height)) * half
    rays = (forward + x[None, :, None] * right + y[:, None, None] * up).reshape(-1, 3)
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def _bundle(start: FloatArray, rays: FloatArray) -> Any:
    start = np.broadcast_to(start, rays.shape)
    return _tensor(np.concatenate([start, rays], axis=1).astype(np.float32))
