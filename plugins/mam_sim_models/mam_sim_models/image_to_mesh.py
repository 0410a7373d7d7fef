"""Learned reconstructors of your own: Hunyuan3D over HTTP, TripoSR and TripoSG through runners.

Whatever mesh comes back is one shell in a frame of its own: it is turned and scaled onto the box
that the embedded reconstructor fits to the same photo, and cut along the panels that it read there.
"""

from __future__ import annotations

import base64
import io
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image

from mam_pipeline.backends import Availability, Reconstruction
from mam_pipeline.errors import BackendError, HintNeeded, InputError, MamSimError
from mam_pipeline.folders import Scratch
from mam_pipeline.formats.mesh_files import load_mesh
from mam_pipeline.hints import Hints
from mam_pipeline.models import settings
from mam_pipeline.secrets import bare_url, masked
from mam_sim_models import external
from mam_sim_models.fused import body_of, cut_from_photo

TENCENT = "Tencent community licence: not in the EU, the UK and South Korea, outputs included"


class HunyuanReconstructor:
    """The API server of Hunyuan3D-2 or 2.1 at MAM_SIM_HUNYUAN3D."""

    variable = "MAM_SIM_HUNYUAN3D"

    @classmethod
    def available(cls) -> Availability:
        """Whether a server is named."""
        found = external.runner(cls.variable)
        if found is None or found.url is None:
            why = f"set {cls.variable} to the server's URL (docs/guides/foundation-models.md)"
            return Availability(False, why, "", TENCENT)
        return Availability(True, "", bare_url(found.url), TENCENT)

    def reconstruct(self, photo: Path, options: Mapping[str, Any]) -> Reconstruction:
        """Photo to mesh by the server; see the module's text for what happens to the mesh.

        Raises:
            BackendError: unreachable, an error, no end within the time limit, or no GLB.
        """
        found = external.runner(self.variable)
        if found is None or found.url is None:
            raise BackendError(f"{self.variable} is not set; see: mam-sim doctor")
        request = {
            "image": base64.b64encode(png(cut_out(photo, options))).decode(),
            # a server of 2.1 never says "completed" of a mesh without a texture
            "texture": settings.text("MAM_SIM_HUNYUAN3D_TEXTURE", "1") != "0",
            "seed": int(options.get("seed", 0)),
            "octree_resolution": 256,
            "num_inference_steps": 5,
            "guidance_scale": 5.0,
            "face_count": 40000,
        }
        data = ask_server(found.url, request)
        return finish(data, ".glb", photo, options, "hunyuan3d")


class _RunnerReconstructor:
    """A model behind a command or our zip protocol: image.png in, mesh.glb or mesh.obj out."""

    variable = ""
    licence = ""
    page = ""
    name = ""

    @classmethod
    def available(cls) -> Availability:
        """Whether a runner is named."""
        return external.availability(cls.variable, cls.licence, cls.page)

    def reconstruct(self, photo: Path, options: Mapping[str, Any]) -> Reconstruction:
        """Photo to mesh; raises BackendError where the runner fails."""
        with Scratch() as scratch:
            inbox, outbox = Path(scratch, "in"), Path(scratch, "out")
            inbox.mkdir()
            cut_out(photo, options).save(inbox / "image.png")
            request = {"image": "image.png", "seed": int(options.get("seed", 0))}
            external.call(self.variable, "reconstruct", request, inbox, outbox)
            for suffix in (".glb", ".obj"):
                if (outbox / f"mesh{suffix}").is_file():
                    data = (outbox / f"mesh{suffix}").read_bytes()
                    return finish(data, suffix, photo, options, self.name)
            raise BackendError(f"{self.name} ended without an error but wrote no mesh.glb")


class TripoSrReconstructor(_RunnerReconstructor):
    """TripoSR: MIT, runs on a CPU too."""

    variable, name, page = "MAM_SIM_TRIPOSR", "triposr", "docs/guides/foundation-models.md"
    licence = "MIT"


class TripoSgReconstructor(_RunnerReconstructor):
    """TripoSG: MIT code and weights; its default matting (RMBG-1.4) has terms of its own."""

    variable, name, page = "MAM_SIM_TRIPOSG", "triposg", "docs/guides/foundation-models.md"
    licence = "MIT; RMBG-1.4, if used, has BRIA's terms"


def cut_out(photo: Path, options: Mapping[str, Any]) -> Image.Image:
    """The photo with everything but the object transparent, as RGBA.

    The object is what the user's mask, the picture's own alpha, or a plain backdrop says; with none
    of them the picture stays whole, and the model's own matting decides.
    """
    from mam_pipeline.photo.image import read_photo
    from mam_pipeline.photo.mask import plain_backdrop, told_mask

    picture = read_photo(photo)
    user = options.get("mask")
    mask = told_mask(picture, None if user is None else Path(user))
    if mask is None:
        mask = plain_backdrop(picture.small)
    h, w = picture.rgb.shape[:2]
    if mask is None or not 0.02 < np.mean(mask) < 0.98:
        mask = np.ones((h, w))
    alpha = cv2.resize(np.asarray(mask, np.float32), (w, h), interpolation=cv2.INTER_LINEAR)
    opaque = np.clip(alpha * 255, 0, 255).astype(np.uint8)
    return Image.fromarray(np.dstack([picture.rgb, opaque]))


def png(image: Image.Image) -> bytes:
    """A picture as a PNG file."""
    out = io.BytesIO()
    image.save(out, format="PNG")
    return out.getvalue()


def ask_server(url: str, request: Mapping[str, Any]) -> bytes:
    """POST /send and poll /status/{uid}; both dialects (2.0 and 2.1). Returns a GLB.

    The server reports no failure while a job runs (a failed one stays "processing" for ever), so
    the client's own time limit ends it. Errors come as HTTP 404 with a text.

    Raises:
        BackendError: see above.
    """
    import requests

    limit = settings.number("MAM_SIM_TIMEOUT", 900)
    deadline = time.monotonic() + limit
    job = _json(lambda: requests.post(f"{url}/send", json=request, timeout=(10, limit)), url)
    uid = job.get("uid")
    if not isinstance(uid, str) or not uid.replace("-", "").isalnum():
        raise BackendError(f"{url} gave no job number: {masked(str(job))[:200]}")
    pause = min(2.0, limit / 10)
    while time.monotonic() < deadline:
        state = _json(lambda: requests.get(f"{url}/status/{uid}", timeout=(10, 60)), url)
        status = state.get("status")
        if status == "completed":
            return _glb(state.get("model_base64"), url)
        if status == "error" or status not in ("processing", "texturing", "pending"):
            said = state.get("message") or state.get("text") or status
            raise BackendError(f"{url} failed: {said}")
        time.sleep(pause)
    raise BackendError(f"{url} was not done within {limit:g} s (MAM_SIM_TIMEOUT)")


def _json(send, url: str) -> dict[str, Any]:  # type: ignore[no-untyped-def]
    import requests

    try:
        answer = send()
    except requests.Timeout as error:
        raise BackendError(f"{url} gave no answer in time") from error
    except requests.RequestException as error:
        raise BackendError(f"{url} cannot be reached: {error}") from error
    try:
        body = answer.json()
    except ValueError:
        body = {}
    if answer.status_code >= 400:
        said = body.get("text") if isinstance(body, dict) else None
        raise BackendError(
            f"{url} answered {answer.status_code}: {said or masked(answer.text)[:300]}"
        )
    if not isinstance(body, dict):
        raise BackendError(f"{url} sent no JSON object")
    return body


def _glb(text: Any, url: str) -> bytes:
    try:
        data = base64.b64decode(text or "", validate=True)
    except (ValueError, TypeError) as error:
        raise BackendError(f"{url} sent a model that is no base64") from error
    return whole_glb(data, url)


def whole_glb(data: bytes, whence: str) -> bytes:
    """The bytes themselves; raises BackendError where they are no GLB, or half of one."""
    if data[:4] != b"glTF":
        raise BackendError(f"{whence} sent a model that is no GLB")
    if int.from_bytes(data[8:12], "little") != len(data):
        raise BackendError(f"{whence} sent half a GLB")
    return data


def finish(
    data: bytes,
    suffix: str,
    photo: Path,
    options: Mapping[str, Any],
    name: str,
    quarters: int = 0,
) -> Reconstruction:
    """Onto the photo's box, cut along its panels; only scaled where the photo shows no box.

    Args:
        data: the mesh file, Y up. suffix: its kind.
        quarters: turns of 90 degrees about the vertical, counter-clockwise seen from above, that
            bring its front to glTF's +Z.

    Raises:
        BackendError: the mesh cannot be used.
    """
    with Scratch() as scratch:
        file = Path(scratch, f"mesh{suffix}")
        file.write_bytes(data)
        try:
            mesh = load_mesh(file, up="y").mesh
        except InputError as error:
            raise BackendError(f"{name} made an unusable mesh: {error}") from error
    if quarters:
        turn = np.eye(4)
        turn[:2, :2] = np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), quarters % 4)
        mesh = mesh.transformed(turn)
    found, sure = _measured(photo, options)
    note = f"{name}: {len(mesh.faces)} faces"
    if found is None or body_of(found.hints) is None:
        height = options.get("height")
        tall = max(float(np.ptp(mesh.bounds[:, 2])), 1e-9)
        mesh = mesh.transformed(np.diag([*[float(height or 0.8) / tall] * 3, 1.0]))
        note += f", {float(height or 0.8):.2f} m high; no box was found in the photo: not cut"
        return Reconstruction(mesh, Hints(), summary=note, assumed=() if height else ("scale",))
    hints = found.hints
    if not sure:  # the box is believed, its panels are not
        hints = replace(hints, parts=tuple(p for p in hints.parts if p.kind == "body"))
    mesh, hints = cut_from_photo(mesh, hints)
    parts = len(mesh.group_names) - 1
    note += f", {float(np.ptp(mesh.bounds[:, 2])):.2f} m high, turned onto the photo's box"
    note += f"; {parts} parts cut along its panels" if parts else "; its panels are uncertain"
    if not parts:
        mesh, hints = replace(mesh, face_group=None, group_names=()), Hints()
    return Reconstruction(
        mesh, hints, found.confidence, note, found.assumed, found.pictures, found.details
    )


def _measured(photo: Path, options: Mapping[str, Any]) -> tuple[Reconstruction | None, bool]:
    """What the embedded reconstructor found on the photo, and whether its panels are believed.

    None where it found no box that it believes: scale and parts then come from elsewhere.
    """
    from mam_pipeline.photo.reconstruct import EmbeddedReconstructor

    embedded = EmbeddedReconstructor()
    try:
        return embedded.reconstruct(photo, options), True
    except HintNeeded:
        unsure = embedded.reconstruct(photo, {**options, "accept_low_confidence": True})
        return (None if unsure.confidence["cuboid"] == "low" else unsure), False
    except MamSimError:
        return None, False
