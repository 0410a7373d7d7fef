"""Generative re-texturing of parts by Hunyuan3D-Paint: new appearance, the same triangles."""

from __future__ import annotations

import base64
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from mam_pipeline.backends import Availability, Retexturer
from mam_pipeline.errors import BackendError, InputError
from mam_pipeline.formats.soup import join
from mam_pipeline.meshio import read_file, save_glb
from mam_pipeline.models import settings
from mam_pipeline.models.image_to_mesh import TENCENT, HunyuanReconstructor, ask_server
from mam_pipeline.types import Articulation, Mesh


class HunyuanRetexturer:
    """A Hunyuan3D-2 (not 2.1) server started with --enable_tex, at MAM_SIM_HUNYUAN3D."""

    @classmethod
    def available(cls) -> Availability:
        """Whether a server is named; whether it was started with --enable_tex shows in use."""
        found = HunyuanReconstructor.available()
        return Availability(found.ok, found.why, found.version, TENCENT)

    def retexture(self, mesh: Mesh, picture: Path) -> Mesh:
        """The mesh with a texture made from `picture`; triangles and their order are unchanged.

        Raises:
            BackendError: the server failed or changed the geometry.
        """
        found = settings.runner(HunyuanReconstructor.variable)
        if found is None or found.url is None:
            raise BackendError(f"{HunyuanReconstructor.variable} is not set; see: mam-sim doctor")
        with tempfile.TemporaryDirectory(prefix="mam-paint-") as scratch:
            sent, came = Path(scratch, "part.glb"), Path(scratch, "painted.glb")
            save_glb(replace(mesh, uv=None, colors=None), sent)
            request = {
                "mesh": base64.b64encode(sent.read_bytes()).decode(),
                "image": base64.b64encode(picture.read_bytes()).decode(),
                "texture": True,
                "seed": 0,
            }
            came.write_bytes(ask_server(found.url, request))
            try:
                content = read_file(came)
            except InputError as error:
                raise BackendError(f"the painted part cannot be read: {error}") from error
        return adopt(mesh, join(content.pieces, content.materials))


def adopt(mesh: Mesh, painted: Mesh) -> Mesh:
    """Our triangles with the painted ones' texture coordinates and materials, corner by corner.

    The painter unwraps anew and so splits vertices; triangle order is kept by it, its scale and
    position are not.

    Raises:
        BackendError: other triangles, or no texture coordinates.
    """
    if painted.uv is None or len(painted.faces) != len(mesh.faces):
        raise BackendError(
            f"the painter sent {len(painted.faces)} triangles for {len(mesh.faces)}"
            + ("" if painted.uv is not None else " and no texture coordinates")
        )
    ours, theirs = (_normalised(m) for m in (mesh, painted))
    if np.abs(ours - theirs).max() > 0.01:
        raise BackendError("the painter moved triangles; its texture cannot be used")
    corners = mesh.faces.reshape(-1)
    return replace(
        mesh,
        vertices=mesh.vertices[corners],
        faces=np.arange(len(corners)).reshape(-1, 3),
        uv=painted.uv[painted.faces.reshape(-1)],
        colors=None,
        materials=painted.materials,
        face_material=painted.face_material,
    )


def retexture_links(
    articulation: Articulation, retexturer: Retexturer, picture: Path, links: tuple[str, ...]
) -> Articulation:
    """Paint the named links each for itself; joints, triangles and all other links stay.

    Raises:
        BackendError: from the retexturer; nothing is changed then.
    """
    mesh = articulation.mesh
    owner = articulation.face_link
    pieces = []
    for i, link in enumerate(articulation.links):
        part = mesh.submesh(owner == i)
        pieces.append(retexturer.retexture(part, picture) if link.name in links else part)
    joined = _concatenate(pieces)
    sizes = np.cumsum([0, *[len(p.faces) for p in pieces]])
    new_links = tuple(
        replace(link, faces=np.arange(sizes[i], sizes[i + 1]))
        for i, link in enumerate(articulation.links)
    )
    return replace(articulation, mesh=joined, links=new_links)


def _normalised(mesh: Mesh) -> np.ndarray:
    corners = mesh.vertices[mesh.faces]
    low, high = mesh.bounds
    return (corners - (low + high) / 2) / max(mesh.diagonal, 1e-12)


def _concatenate(parts: list[Mesh]) -> Mesh:
    offset = material = 0
    faces, owners = [], []
    for part in parts:
        assert part.face_material is not None
        faces.append(part.faces + offset)
        owners.append(part.face_material + material)
        offset += len(part.vertices)
        material += len(part.materials)
    uv = None
    if any(p.uv is not None for p in parts):
        uv = np.concatenate(
            [np.zeros((len(p.vertices), 2), np.float32) if p.uv is None else p.uv for p in parts]
        )
    return Mesh(
        np.concatenate([p.vertices for p in parts]),
        np.concatenate(faces),
        tuple(m for p in parts for m in p.materials),
        np.concatenate(owners),
        uv,
    )
