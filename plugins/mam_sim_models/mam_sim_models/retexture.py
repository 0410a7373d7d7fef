"""Generative re-texturing of parts by Hunyuan3D-Paint: new appearance, the same triangles."""

from __future__ import annotations

import base64
from dataclasses import replace
from pathlib import Path

import numpy as np

from mam_pipeline.backends import Availability
from mam_pipeline.errors import BackendError, InputError
from mam_pipeline.folders import Scratch
from mam_pipeline.formats.mesh_files import read_file, save_glb
from mam_pipeline.formats.soup import join
from mam_pipeline.types import Mesh
from mam_sim_models import external
from mam_sim_models.image_to_mesh import TENCENT, HunyuanReconstructor, ask_server

# the painter looks at +Z with Y up, our front faces -X with Z up
PAINTER_T_ASSET = np.array(
    [[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)


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
        found = external.runner(HunyuanReconstructor.variable)
        if found is None or found.url is None:
            raise BackendError(f"{HunyuanReconstructor.variable} is not set; see: mam-sim doctor")
        with Scratch() as scratch:
            sent, came = Path(scratch, "part.glb"), Path(scratch, "painted.glb")
            bare = Mesh(mesh.vertices, mesh.faces).transformed(PAINTER_T_ASSET)
            save_glb(bare, sent, up="z")  # turned already; one material keeps the order of faces
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
        painted = join(content.pieces, content.materials)
        return adopt(mesh, painted.transformed(PAINTER_T_ASSET.T))


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


def _normalised(mesh: Mesh) -> np.ndarray:
    corners = mesh.vertices[mesh.faces]
    low, high = mesh.bounds
    return (corners - (low + high) / 2) / max(mesh.diagonal, 1e-12)
