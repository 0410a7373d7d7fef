"""Hosted reconstructors against stand-ins that answer as each service's pages say."""

from __future__ import annotations

import base64
import io
import json
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from mam_sim_models import hosted_caller
from mam_sim_models.hosted import (
    FAL,
    MESHY,
    TRIPO,
    FalReconstructor,
    TripoReconstructor,
    picture_to_send,
)
from mam_sim_models.hosted_task import HostedTask, Service
from mam_sim_models.image_to_mesh import finish
from PIL import Image

from mam_pipeline import backends
from mam_pipeline.errors import BackendError, ConfigError
from mam_pipeline.models import consent, settings
from mam_pipeline.models.ledger import one_ledger
from mam_pipeline.secrets import Secret
from tests.local_server import Replies, served

GLB = trimesh.creation.box().export(file_type="glb")
PICTURE = b"\x89PNG a photo"
KEY = "key-of-the-user"
Reply = tuple[int, Any]


class StandIn:
    """The three services at once; what was asked, with which key, is in `heard`.

    Attributes:
        states: of the task, one a question, the last for ever. create, result: what to say instead.
        faults: answers to the first questions after the state. mesh: the file that is fetched.
    """

    def __init__(self) -> None:
        self.url = ""
        self.heard: list[tuple[str, str, str]] = []
        self.bodies: list[bytes] = []
        self.states: list[str] = []
        self.create: Reply | None = None
        self.result: Reply | None = None
        self.task: dict[str, Any] = {}
        self.faults: list[Reply] = []
        self.mesh: bytes = GLB
        self.no_path = ""

    def answer(self, method: str, path: str, body: bytes) -> Reply:
        """What a service sends: a status, and JSON or bytes."""
        self.bodies.append(body)
        if path.startswith("/files/"):
            return 200, self.mesh
        if method == "POST":
            if self.create is not None and "upload" not in path:
                return self.create
            return self._created(path, body)
        if self.faults:
            return self.faults.pop(0)
        state = self.states.pop(0) if len(self.states) > 1 else self.states[0]
        return self._state(path, state)

    def _created(self, path: str, body: bytes) -> Reply:
        if path == self.no_path:
            return 404, {"code": 2001, "message": "no such path"}
        if path in ("/upload/sts", "/upload"):
            assert b'name="file"' in body and PICTURE in body
            return 200, {"code": 0, "data": {"image_token": "tok-1"}}
        asked = json.loads(body)
        if path == "/task":
            assert asked["type"] == "image_to_model" and asked["texture"] is True
            assert asked["file"] == {"type": "png", "file_token": "tok-1"}
            return 200, {"code": 0, "data": {"task_id": "t-1"}}
        if path == "/image-to-3d":
            assert asked["should_texture"] is True and asked["topology"] == "triangle"
            assert asked["ai_model"] == "meshy-6" and _sent(asked["image_url"]) == PICTURE
            return 202, {"result": "t-1"}
        assert path == "/fal-ai/hunyuan-3d/v3.1/pro/image-to-3d", path
        assert _sent(asked["input_image_url"]) == PICTURE
        place = f"{self.url}/fal-ai/hunyuan-3d/requests/t-1"
        return 200, {"request_id": "t-1", "response_url": place, "status_url": f"{place}/status"}

    def _state(self, path: str, state: str) -> Reply:
        file = f"{self.url}/files/model.glb?signature=1"
        if path == "/task/t-1":
            done: dict[str, Any] = {"pbr_model": None, "model": file} if state == "success" else {}
            task = {"task_id": "t-1", "status": state, "output": done, **self.task}
            return 200, {"code": 0, "data": task}
        if path == "/image-to-3d/t-1":
            links = {"glb": file, "fbx": file + "x"} if state == "SUCCEEDED" else {}
            told = {
                "id": "t-1",
                "status": state,
                "model_urls": links,
                "task_error": {"message": ""},
            }
            return 200, {**told, **self.task}
        if path == "/fal-ai/hunyuan-3d/requests/t-1/status":
            return 200, {"status": state, "queue_position": 3, **self.task}
        assert path == "/fal-ai/hunyuan-3d/requests/t-1", path
        done = {"model_glb": {"url": file, "content_type": "model/gltf-binary"}}
        return self.result or (200, done)


def _sent(link: str) -> bytes:
    head, _, data = link.partition(",")
    assert head == "data:image/png;base64"
    return base64.b64decode(data)


@pytest.fixture
def stand_in() -> Iterator[StandIn]:
    """A running stand-in."""
    world = StandIn()

    class Handler(Replies):
        def reply(self, body: bytes) -> tuple[int, str, bytes]:
            world.heard.append((self.command, self.path, self.headers.get("Authorization", "")))
            status, said = world.answer(self.command, self.path, body)
            if isinstance(said, bytes):
                return status, "application/octet-stream", said
            return status, "application/json", json.dumps(said).encode()

    with served(Handler) as world.url:
        yield world


@pytest.fixture(autouse=True)
def home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A user with keys, who has not said yes to anything; a short time limit."""
    for service in (FAL, TRIPO, MESHY):
        monkeypatch.setenv(service.key, KEY)
    for name in ("MAM_SIM_ALLOW_UPLOAD", "MAM_SIM_HOSTED_MODEL", "MAM_SIM_HOSTED_PRICE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("MAM_SIM_MESH_CACHE", str(tmp_path / "meshes"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv("MAM_SIM_TIMEOUT", "9")
    monkeypatch.setattr(hosted_caller, "FIRST_PAUSE", 0.01)
    return tmp_path


@pytest.fixture
def allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The user said --allow-upload."""
    monkeypatch.setenv("MAM_SIM_ALLOW_UPLOAD", "1")


STATES = {
    "fal": ["IN_QUEUE", "IN_PROGRESS", "COMPLETED"],
    "tripo": ["queued", "running", "success"],
    "meshy": ["PENDING", "IN_PROGRESS", "SUCCEEDED"],
}
each = pytest.mark.parametrize("service", [FAL, TRIPO, MESHY], ids=lambda s: str(s.name))


def _task(stand_in: StandIn, service: Service) -> HostedTask:
    stand_in.states = stand_in.states or list(STATES[service.name])
    return HostedTask(replace(service, base=stand_in.url))


@each
def test_a_mesh_is_made_paid_once_and_kept(
    stand_in: StandIn, service: Service, allowed: None
) -> None:
    with one_ledger() as ledger:
        assert _task(stand_in, service).mesh(PICTURE, 0) == GLB
        price = next(iter(service.prices.values()))
        assert ledger.cost == price and service.title in ledger.summary()
    for method, path, key in stand_in.heard:
        at_files = path.startswith("/files/")
        assert at_files or key == f"{service.scheme} {KEY}", (method, path)
    before = len(stand_in.heard)
    with one_ledger() as ledger:
        assert _task(stand_in, service).mesh(PICTURE, 0) == GLB
        assert ledger.cost == 0 and len(stand_in.heard) == before


@each
@pytest.mark.parametrize(
    ("status", "message"),
    [
        (401, "does not accept the key in {key} (401: no)"),
        (402, "the account at {title} has no credit left (402: no)"),
        (403, "{title} refuses this key or account (403: no)"),
        (422, "{title} refused the request (422: no)"),
        (429, "{title} takes no more requests at present (429: no); try again later"),
        (500, "{title} has a fault of its own (500: no)"),
    ],
)
def test_a_refusal_is_one_sentence_without_the_key(
    stand_in: StandIn, service: Service, status: int, message: str, allowed: None
) -> None:
    said: dict[str, Any] = {
        "fal": {"detail": [{"loc": ["body"], "msg": "no", "type": "x"}]},
        "tripo": {"code": 2010, "message": "no", "suggestion": "Please purchase more credit"},
        "meshy": {"message": "no"},
    }
    stand_in.create = status, said[service.name]
    with one_ledger() as ledger, pytest.raises(BackendError) as caught:
        _task(stand_in, service).mesh(PICTURE, 0)
    assert message.format(title=service.title, key=service.key) in str(caught.value)
    assert KEY not in str(caught.value) and ledger.cost == 0
    assert caught.value.exit_code == 2
    assert sum(m == "POST" and "upload" not in p for m, p, _ in stand_in.heard) == 1


@each
def test_a_failed_task_says_why_and_may_be_tried_anew(
    stand_in: StandIn, service: Service, allowed: None
) -> None:
    stand_in.states = [{"fal": "COMPLETED", "tripo": "failed", "meshy": "FAILED"}[service.name]]
    said: dict[str, dict[str, Any]] = {
        "fal": {"error": "the picture is too dark"},
        "tripo": {"error_code": 1001, "error_msg": "the picture is too dark"},
        "meshy": {"task_error": {"message": "the picture is too dark"}},
    }
    stand_in.task = said[service.name]
    for _ in range(2):
        with pytest.raises(BackendError, match=r"task at .* failed: the picture is too dark"):
            _task(stand_in, service).mesh(PICTURE, 0)
    posts = [p for m, p, _ in stand_in.heard if m == "POST" and "upload" not in p]
    assert len(posts) == 2


def test_tripo_takes_the_photo_at_either_of_its_paths(stand_in: StandIn, allowed: None) -> None:
    stand_in.no_path = "/upload/sts"
    assert _task(stand_in, TRIPO).mesh(PICTURE, 0) == GLB
    assert [p for m, p, _ in stand_in.heard if m == "POST"] == ["/upload/sts", "/upload", "/task"]


def test_a_model_that_failed_behind_the_queue(stand_in: StandIn, allowed: None) -> None:
    stand_in.result = 422, {"detail": [{"msg": "could not load the image", "type": "file"}]}
    with pytest.raises(BackendError, match=r"failed: .*could not load the image"):
        _task(stand_in, FAL).mesh(PICTURE, 0)


@each
def test_a_task_that_takes_too_long_is_gone_on_with(
    stand_in: StandIn, service: Service, allowed: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MAM_SIM_TIMEOUT", "0.5")
    stand_in.states = [STATES[service.name][1]]
    with pytest.raises(BackendError, match=r"not done within 0.5 s .*goes on with task t-1"):
        _task(stand_in, service).mesh(PICTURE, 0)
    stand_in.states = []
    monkeypatch.setenv("MAM_SIM_TIMEOUT", "9")
    before = len(stand_in.heard)
    with one_ledger() as ledger:
        assert _task(stand_in, service).mesh(PICTURE, 0) == GLB
        assert ledger.cost == 0
    assert all(m == "GET" for m, _, _ in stand_in.heard[before:])


@each
def test_too_many_questions_and_faults_are_waited_out(
    stand_in: StandIn, service: Service, allowed: None
) -> None:
    stand_in.faults = [(429, {}), (503, b"<html>"), (429, {})]
    assert _task(stand_in, service).mesh(PICTURE, 0) == GLB
    stand_in.faults = [(500, {})] * hosted_caller.FAULTS
    with pytest.raises(BackendError, match="fault of its own"):
        _task(stand_in, service).mesh(PICTURE, 1)


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (b"PK\x03\x04 a zip", "sent a model that is no GLB"),
        (b"", "sent a model that is no GLB"),
        (GLB[:200], "sent half a GLB"),
        (GLB + bytes(3000), "sends more than"),
    ],
)
def test_what_is_no_glb_is_refused(
    stand_in: StandIn,
    mesh: bytes,
    message: str,
    allowed: None,
    monkeypatch: pytest.MonkeyPatch,
    home: Path,
) -> None:
    monkeypatch.setattr(hosted_caller, "MOST_MESH", len(GLB) + 1000)
    stand_in.mesh = mesh
    with pytest.raises(BackendError, match=message):
        _task(stand_in, MESHY).mesh(PICTURE, 0)
    assert not list((home / "meshes").glob("*.glb"))


def test_answers_that_make_no_sense(
    stand_in: StandIn, allowed: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    stand_in.create = 200, {"result": "../../etc"}
    with pytest.raises(BackendError, match="no number of a task"):
        _task(stand_in, MESHY).mesh(PICTURE, 0)
    stand_in.create = 200, b"<html>"
    with pytest.raises(BackendError, match="no JSON object"):
        _task(stand_in, MESHY).mesh(PICTURE, 0)
    stand_in.create, stand_in.task = None, {"model_urls": {"glb": "https://elsewhere.test/x.glb"}}
    with pytest.raises(BackendError, match="which is not fetched"):
        _task(stand_in, MESHY).mesh(PICTURE, 0)
    stand_in.task = {"model_urls": None}
    with pytest.raises(BackendError, match="names no GLB"):
        _task(stand_in, MESHY).mesh(PICTURE, 0)
    with pytest.raises(BackendError, match="Meshy cannot be reached"):
        HostedTask(replace(MESHY, base="http://127.0.0.1:9")).mesh(b"another", 0)


def test_nothing_is_sent_without_a_yes_a_key_and_a_price_below_the_cap(
    stand_in: StandIn, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ConfigError, match=r"fal.ai gets this photo .*\$0.375.*--allow-upload"):
        _task(stand_in, FAL).mesh(PICTURE, 0)
    consent.remember("fal.ai")
    consent.remember("Tripo")
    assert consent.allowed("fal.ai") and consent.allowed("Tripo") and not consent.allowed("Meshy")
    with settings.given({"MAM_SIM_MAX_COST": "0.3"}):
        with one_ledger(), pytest.raises(BackendError, match=r"may cost \$0.375, which passes"):
            _task(stand_in, FAL).mesh(PICTURE, 0)
        stand_in.states = []
        with one_ledger() as ledger:
            assert _task(stand_in, TRIPO).mesh(PICTURE, 0) == GLB
            assert ledger.cost == 0.3
    count = len(stand_in.heard)
    with (
        settings.given({"MAM_SIM_HOSTED_MODEL": "fal-ai/new"}),
        pytest.raises(ConfigError, match="MAM_SIM_HOSTED_PRICE"),
    ):
        _task(stand_in, FAL).mesh(PICTURE, 0)
    monkeypatch.delenv("FAL_KEY")
    with pytest.raises(BackendError, match="'fal' cannot run here: set FAL_KEY"):
        backends.load("reconstructor", "fal")
    monkeypatch.setenv("FAL_KEY", "schl\u00fcssel")
    assert FalReconstructor.available().why == "FAL_KEY is no key"
    assert len(stand_in.heard) == count


def test_what_is_sent_is_small_and_holds_the_object_alone(tmp_path: Path) -> None:
    picture = np.full((1500, 3000, 3), 235, dtype=np.uint8)
    picture[300:1200, 900:2100] = (120, 60, 30)
    mask = np.zeros((1500, 3000), dtype=np.uint8)
    mask[300:1200, 900:2100] = 255
    picture[mask == 0] = (10, 200, 10)  # whatever else is in the room
    Image.fromarray(picture).save(tmp_path / "photo.png")
    Image.fromarray(mask).save(tmp_path / "mask.png")
    data = picture_to_send(tmp_path / "photo.png", {"mask": tmp_path / "mask.png"})
    sent = np.asarray(Image.open(io.BytesIO(data)))
    assert sent.shape == (512, 1024, 4)
    assert (sent[sent[..., 3] == 0][:, :3] == 255).all()
    assert abs(sent[256, 512].astype(int) - (120, 60, 30, 255)).max() < 3


def test_a_service_is_a_reconstructor(
    stand_in: StandIn, allowed: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    shell = trimesh.creation.box((0.4, 1.0, 0.8))  # glTF: its front, +X, is 0.8 wide
    shell.apply_translation((0, 0.5, 0))
    knob = trimesh.creation.box((0.05, 0.05, 0.05))
    knob.apply_translation((0.22, 0.5, 0.3))  # on the front, to the left as one looks at it
    whole: Any = trimesh.util.concatenate([shell, knob])
    stand_in.mesh = whole.export(file_type="glb")
    stand_in.states = list(STATES["tripo"])
    monkeypatch.setattr(TripoReconstructor, "service", replace(TRIPO, base=stand_in.url))
    monkeypatch.setattr("mam_sim_models.hosted.picture_to_send", lambda *_: PICTURE)
    picture = np.full((200, 300, 3), 235, dtype=np.uint8)
    picture[60:150, 100:200] = (120, 60, 30)
    Image.fromarray(picture).save(tmp_path / "photo.png")
    name, backend = backends.load("reconstructor", "tripo")
    made = backend.reconstruct(tmp_path / "photo.png", {"height": 0.5})
    assert name == "tripo" and "tripo: 24 faces" in made.summary
    assert np.ptp(made.mesh.bounds[:, 2]) == pytest.approx(0.5)
    middle = made.mesh.vertices[8:].mean(axis=0) / 0.5
    np.testing.assert_allclose(middle[1], -0.22 + 0.0125, atol=0.02)  # glTF's +Z is our -Y
    assert abs(abs(middle[0]) - 0.3) < 0.02
    assert backends.maker("reconstructor", "tripo").options.endswith("v2.5-20250123")


def test_a_mesh_without_quarters_stays(tmp_path: Path) -> None:
    Image.new("RGB", (64, 64), "white").save(tmp_path / "photo.png")
    box = trimesh.creation.box((2.0, 1.0, 1.0)).export(file_type="glb")
    plain = finish(box, ".glb", tmp_path / "photo.png", {"height": 1.0}, "x")
    turned = finish(box, ".glb", tmp_path / "photo.png", {"height": 1.0}, "x", 1)
    np.testing.assert_allclose(np.ptp(plain.mesh.bounds, axis=0), (2, 1, 1))
    np.testing.assert_allclose(np.ptp(turned.mesh.bounds, axis=0), (1, 2, 1))


def test_pauses_grow_and_end_with_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    rests: list[float] = []
    monkeypatch.setenv("MAM_SIM_TIMEOUT", "900")
    monkeypatch.setattr(hosted_caller, "FIRST_PAUSE", 2.0)
    monkeypatch.setattr(time, "sleep", rests.append)
    caller = hosted_caller.Caller("x", "http://127.0.0.1:9", Secret(""), "Key", "X")
    for _ in range(8):
        caller.wait()
    assert rests[0] == 2 and rests == sorted(rests) and rests[-1] == 15
    caller.deadline = time.monotonic() + 1
    caller.wait()
    assert rests[-1] <= 1
