"""Gradio Spaces: the real client against a stand-in that speaks Gradio's protocol."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import trimesh
from mam_sim_models.space import SpaceReconstructor, ask_space, call_of, urls
from PIL import Image

from mam_pipeline import backends
from mam_pipeline.errors import BackendError, ConfigError
from mam_pipeline.models import settings

GLB = trimesh.creation.box().export(file_type="glb")
Answer = Callable[[str, bytes], tuple[int, str, bytes]]


def _parameter(name: str, component: str, default: bool = False) -> dict[str, Any]:
    return {
        "label": name, "parameter_name": name, "parameter_has_default": default,
        "parameter_default": 5 if default else None, "component": component,
        "type": {"type": "string"}, "python_type": {"type": "str", "description": ""},
        "example_input": "x",
    }  # fmt: skip


def _api() -> dict[str, Any]:
    """Hunyuan3D's: two endpoints make files of pictures, one does not."""
    given = [
        _parameter("caption", "Textbox"),
        _parameter("image", "Image"),
        _parameter("mv_image_back", "Image"),
        _parameter("steps", "Slider", True),
        _parameter("seed", "Slider", True),
    ]
    made = [_parameter("value", "File"), _parameter("html", "Html")]
    return {
        "named_endpoints": {
            "/shape_generation": {"parameters": given, "returns": made},
            "/generation_all": {"parameters": given, "returns": [made[0], *made]},
            "/remove_background": {"parameters": given, "returns": [_parameter("x", "Image")]},
        },
        "unnamed_endpoints": {},
    }


def test_the_endpoint_is_found_by_what_it_takes_and_gives() -> None:
    api = _api()
    with pytest.raises(BackendError, match="these do: /shape_generation, /generation_all; name"):
        call_of(api, "the Space x", "PICTURE", 7)
    with settings.given({"MAM_SIM_SPACE_API": "generation_all"}):
        name, arguments = call_of(api, "the Space x", "PICTURE", 7)
    assert name == "/generation_all"
    assert arguments == {"caption": None, "image": "PICTURE", "mv_image_back": None, "seed": 7}
    with (
        settings.given({"MAM_SIM_SPACE_API": "/remove_background"}),
        pytest.raises(BackendError, match="has no endpoint /remove_background that makes a mesh"),
    ):
        call_of(api, "the Space x", "PICTURE", 7)
    del api["named_endpoints"]["/shape_generation"], api["named_endpoints"]["/generation_all"]
    with pytest.raises(BackendError, match=r"must have one that makes a mesh .*; none does$"):
        call_of(api, "the Space x", "PICTURE", 7)


def test_files_are_found_wherever_they_stand() -> None:
    file = {"path": "/tmp/a.glb", "url": "http://x/a.glb", "meta": {"_type": "gradio.FileData"}}
    update = {"value": {**file, "url": "http://x/b.glb"}, "__type__": "update"}
    assert list(urls((file, "<div>", {"n": 1}, [update], "http://x/c.glb", None))) == [
        "http://x/a.glb", "http://x/b.glb", "http://x/c.glb",
    ]  # fmt: skip


class Space:
    """A Gradio app with one endpoint, as gradio_client 2 asks for it.

    Attributes:
        output: the answer's data, or None for `error`. picture: what was uploaded.
    """

    def __init__(self) -> None:
        self.url, self.picture, self.error = "", b"", "no GPU is left"
        self.output: list[Any] | None = None
        self.called: dict[str, Any] = {}
        self.mesh = GLB

    def __call__(self, path: str, body: bytes) -> tuple[int, str, bytes]:
        path = path.partition("?")[0].removeprefix("/gradio_api")
        kind = "application/json"
        if path == "/config":
            return 200, kind, json.dumps(self.config()).encode()
        if path == "/info":
            return 200, kind, json.dumps(self.api()).encode()
        if path == "/upload":
            self.picture = body.split(b"\r\n\r\n", 1)[1].rsplit(b"\r\n--", 1)[0]
            return 200, kind, b'["/tmp/gradio/photo.png"]'
        if path == "/queue/join":
            self.called = json.loads(body)
            return 200, kind, b'{"event_id": "e1"}'
        if path == "/queue/data":
            done: dict[str, Any] = {"msg": "process_completed", "event_id": "e1"}
            done["success"] = self.output is not None
            done["output"] = {"error": self.error} if self.output is None else {"data": self.output}
            lines = [{"msg": "process_starts", "event_id": "e1"}, done, {"msg": "close_stream"}]
            said = "".join(f"data: {json.dumps(line)}\n\n" for line in lines)
            return 200, "text/event-stream", said.encode()
        if path.startswith("/file="):
            return 200, "model/gltf-binary", self.mesh
        return 404, kind, b"{}"

    def api(self) -> dict[str, Any]:
        """Of the one endpoint."""
        whole = _api()["named_endpoints"]
        whole["/shape_generation"]["parameters"].pop(2)
        return {
            "named_endpoints": {"/shape_generation": whole["/shape_generation"]},
            "unnamed_endpoints": {},
        }

    def config(self) -> dict[str, Any]:
        """What a Gradio 6 app says of itself."""
        kinds = ["textbox", "image", "slider", "slider", "file", "html"]
        parts = [
            {"id": i, "type": kind, "props": {"name": kind}, "skip_api": False, "key": None,
             "api_info": {"type": "string"}, "api_info_as_input": {"type": "string"},
             "api_info_as_output": {"type": "string"}, "component_class_id": kind}
            for i, kind in enumerate(kinds)
        ]  # fmt: skip
        call = {
            "id": 0, "targets": [], "inputs": [0, 1, 2, 3], "outputs": [4, 5],
            "backend_fn": True, "js": None, "queue": True, "api_name": "shape_generation",
            "api_visibility": "public", "scroll_to_output": False, "show_progress": "full",
            "batch": False, "max_batch_size": 4, "cancels": [], "connection": "sse",
            "types": {"generator": False, "cancel": False}, "show_api": True,
        }  # fmt: skip
        return {
            "version": "6.31.0", "api_prefix": "/gradio_api", "mode": "blocks", "app_id": 1,
            "components": parts, "dependencies": [call], "protocol": "sse_v3", "root": self.url,
            "is_space": False, "space_id": None, "enable_queue": True, "username": None,
        }  # fmt: skip


@pytest.fixture
def space(serve: Callable[[Answer], str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Space:
    """A running Space on this machine, and where its meshes are kept."""
    pytest.importorskip("gradio_client", reason="the space extra is not installed")
    made = Space()
    made.url = serve(made)
    file = f"{made.url}/gradio_api/file=/tmp/white_mesh.glb"
    made.output = [{"value": {"path": "/tmp/white_mesh.glb", "url": file}}, "<div>"]
    monkeypatch.setenv("MAM_SIM_SPACE", made.url)
    monkeypatch.setenv("MAM_SIM_MESH_CACHE", str(tmp_path / "meshes"))
    monkeypatch.setenv("MAM_SIM_TIMEOUT", "20")
    for name in ("MAM_SIM_SPACE_API", "MAM_SIM_ALLOW_UPLOAD", "HF_TOKEN"):
        monkeypatch.delenv(name, raising=False)
    return made


def test_a_space_makes_a_mesh(space: Space, tmp_path: Path) -> None:
    Image.new("RGB", (64, 64), "brown").save(tmp_path / "photo.png")
    name, backend = backends.load("reconstructor", "space")
    made = backend.reconstruct(tmp_path / "photo.png", {"height": 0.5, "seed": 7})
    assert name == "space" and "space: 12 faces" in made.summary
    assert Image.open(io.BytesIO(space.picture)).size == (64, 64)
    caption, picture, steps, seed = space.called["data"]
    assert (caption, steps, seed) == (None, 5, 7) and picture["path"].endswith("photo.png")


def test_what_goes_wrong_at_a_space_is_one_sentence(
    space: Space, monkeypatch: pytest.MonkeyPatch
) -> None:
    space.mesh = b"PK"
    with pytest.raises(BackendError, match="no GLB"):
        ask_space(space.url, b"x", 0)
    space.output = ["https://127.0.0.1/x.glb"]
    with pytest.raises(BackendError, match="which is not fetched"):
        ask_space(space.url, b"x", 0)
    space.output = [{"path": "/tmp/mesh.obj", "url": f"{space.url}/mesh.obj"}]
    with pytest.raises(BackendError, match="gave no GLB"):
        ask_space(space.url, b"x", 0)
    space.output = None
    with pytest.raises(BackendError, match=r"failed: no GPU is left$"):
        ask_space(space.url, b"x", 0)
    with pytest.raises(BackendError, match=r"the Space http://127.0.0.1:9 failed: .*refused"):
        ask_space("http://127.0.0.1:9", b"x", 0)


def test_a_space_elsewhere_needs_a_yes_and_the_package(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("MAM_SIM_SPACE", raising=False)
    monkeypatch.delenv("MAM_SIM_ALLOW_UPLOAD", raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setenv("MAM_SIM_MESH_CACHE", str(tmp_path))
    assert "--space OWNER/NAME" in SpaceReconstructor.available().why
    monkeypatch.setenv("MAM_SIM_SPACE", "owner/name")
    monkeypatch.setattr("mam_sim_models.space.has", lambda *_: False)
    assert "pip install gradio_client" in SpaceReconstructor.available().why
    Image.new("RGB", (64, 64), "brown").save(tmp_path / "photo.png")
    with pytest.raises(ConfigError, match=r"the Space owner/name gets this photo.*--allow-upload"):
        SpaceReconstructor().reconstruct(tmp_path / "photo.png", {})
