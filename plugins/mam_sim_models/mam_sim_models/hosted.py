"""Image-to-mesh services with a key: fal.ai's queue, Tripo's and Meshy's task interfaces."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from PIL import Image

from mam_pipeline.backends import Availability, Reconstruction
from mam_pipeline.errors import BackendError
from mam_pipeline.models.consent import Offer
from mam_sim_models.hosted_caller import Caller, Refused, dig
from mam_sim_models.hosted_task import HostedTask, Service, availability
from mam_sim_models.image_to_mesh import cut_out, finish, png

SIDE = 1024  # pixels of the longer side of what is sent; the models look at less


def picture_to_send(photo: Path, options: Mapping[str, Any]) -> bytes:
    """The object as a PNG, without what lies around it where that is known, without metadata."""
    image = cut_out(photo, options)
    image.thumbnail((SIDE, SIDE), Image.Resampling.LANCZOS)
    clean = Image.new("RGBA", image.size, (255, 255, 255, 0))
    clean.paste(image, mask=image.getchannel("A").point(lambda a: 255 if a else 0))
    return png(clean)


class _HostedReconstructor:
    """A service as a reconstructor."""

    service: Service

    @classmethod
    def available(cls) -> Availability:
        """Whether the key is there; nobody is asked."""
        return availability(cls.service)

    @classmethod
    def options(cls) -> str:
        """The model, which decides the mesh."""
        return cls.service.model()

    @classmethod
    def offer(cls) -> Offer:
        """Who gets the photo, and the price."""
        return cls.service.offer()

    def reconstruct(self, photo: Path, options: Mapping[str, Any]) -> Reconstruction:
        """Photo to mesh by the service.

        Raises:
            ConfigError: no consent, or an unknown price. BackendError: the cap, or any failure.
        """
        seed = int(options.get("seed", 0))
        data = HostedTask(self.service).mesh(picture_to_send(photo, options), seed)
        name, quarters = self.service.name, self.service.quarters
        return finish(data, ".glb", photo, options, name, quarters)


def _data_uri(picture: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(picture).decode()


def _start_fal(caller: Caller, model: str, picture: bytes, seed: int) -> Any:
    request: dict[str, Any] = {"input_image_url": _data_uri(picture)}
    if model.startswith(("fal-ai/hunyuan3d/", "fal-ai/hunyuan3d-v21")):
        request |= {"textured_mesh": True, "seed": seed}
    if "/rapid/" in model:  # with a texture it makes no GLB
        request |= {"enable_geometry": True}
    return caller.post(f"/{model}", json=request).get("request_id")


def _start_tripo(caller: Caller, model: str, picture: bytes, seed: int) -> Any:
    file = {"file": ("photo.png", picture, "image/png")}
    try:
        sent = caller.post("/upload/sts", files=file)
    except Refused:  # its pages name this path, its own client the other
        sent = caller.post("/upload", files=file)
    token = dig(sent, "data.image_token")
    if not token:
        raise BackendError(f"{caller.title} took the photo but gave no token for it")
    request = {
        "type": "image_to_model",
        "model_version": model,
        "file": {"type": "png", "file_token": token},
        "texture": True,
        "pbr": False,
        "model_seed": seed,
    }
    return dig(caller.post("/task", json=request), "data.task_id")


def _start_meshy(caller: Caller, model: str, picture: bytes, seed: int) -> Any:
    request = {
        "image_url": _data_uri(picture),
        "ai_model": model,
        "should_texture": True,
        "should_remesh": True,
        "topology": "triangle",
        "target_polycount": 100_000,
    }
    return caller.post("/image-to-3d", json=request).get("result")


FAL = Service(
    "fal", "fal.ai", "https://queue.fal.run", "FAL_KEY", "Key", "https://fal.ai/dashboard/keys",
    "fal.ai's terms, and Tencent's of the model",
    # its pages, 2026; Hunyuan3D 2 asks three times its $0.16 for a texture, rapid gives shape alone
    {
        "fal-ai/hunyuan-3d/v3.1/pro/image-to-3d": 0.375,
        "fal-ai/hunyuan-3d/v3.1/rapid/image-to-3d": 0.225,
        "fal-ai/hunyuan3d/v2": 0.48,
    },
    _start_fal, "/{app}/requests/{task}/status", "/{app}/requests/{task}",
    "status", "COMPLETED", frozenset({"IN_QUEUE", "IN_PROGRESS"}),
    ("model_glb.url", "model_urls.glb.url", "model_mesh.url"), ("error",),
)  # fmt: skip
TRIPO = Service(
    "tripo", "Tripo", "https://api.tripo3d.ai/v2/openapi", "TRIPO_API_KEY", "Bearer",
    "https://platform.tripo3d.ai/api-keys", "Tripo's terms",
    # 30 credits with a texture, 100 credits a dollar
    {"v2.5-20250123": 0.30, "v3.0-20250812": 0.30},
    _start_tripo, "/task/{task}", "/task/{task}",
    "data.status", "success", frozenset({"queued", "running"}),
    ("data.output.pbr_model", "data.output.model", "data.output.base_model"),
    ("data.error_msg",), quarters=-1,  # its fronts look along +X
)  # fmt: skip
MESHY = Service(
    "meshy", "Meshy", "https://api.meshy.ai/openapi/v1", "MESHY_API_KEY", "Bearer",
    "https://www.meshy.ai/settings/api", "Meshy's terms",
    # 30 and 15 credits with a texture, about $0.02 a credit
    {"meshy-6": 0.60, "meshy-5": 0.30},
    _start_meshy, "/image-to-3d/{task}", "/image-to-3d/{task}",
    "status", "SUCCEEDED", frozenset({"PENDING", "IN_PROGRESS"}),
    ("model_urls.glb",), ("task_error.message",),
)  # fmt: skip


class FalReconstructor(_HostedReconstructor):
    """Hunyuan3D at fal.ai."""

    service = FAL


class TripoReconstructor(_HostedReconstructor):
    """Tripo's own service."""

    service = TRIPO


class MeshyReconstructor(_HostedReconstructor):
    """Meshy's own service."""

    service = MESHY


SERVICES = (FAL, TRIPO, MESHY)
