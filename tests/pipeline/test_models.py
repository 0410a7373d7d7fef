"""Model adapters against stand-ins that speak the real protocols, faults included."""

from __future__ import annotations

import base64
import io
import json
import sys
import threading
import zipfile
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from PIL import Image, ImageDraw, ImageFont

from mam_pipeline import backends
from mam_pipeline.backends import KinematicPrior
from mam_pipeline.errors import BackendError, ConfigError, HintNeeded
from mam_pipeline.models import external, questions, views
from mam_pipeline.models.image_to_mesh import ask_server
from mam_pipeline.models.kinematic_masks import prior_from_masks
from mam_pipeline.models.p3sam import P3SamSegmenter, heal
from mam_pipeline.models.retexture import adopt
from mam_pipeline.models.sp4d import REFERENCE, STEP, FilePrior, prior_from_frames
from mam_pipeline.models.vlm import FileReasoner, VlmReasoner
from mam_pipeline.types import Mesh, Primitives

Answer = Callable[[str, bytes], tuple[int, str, bytes]]


def _boxes() -> tuple[Mesh, Primitives]:
    """A body, a door before it and a knob on the door: three primitives."""
    parts = [
        trimesh.creation.box(
            (0.4, 0.5, 0.6), trimesh.transformations.translation_matrix((0, 0, 0.3))
        ),
        trimesh.creation.box(
            (0.02, 0.46, 0.5), trimesh.transformations.translation_matrix((-0.215, 0, 0.3))
        ),
        trimesh.creation.box(
            (0.04, 0.05, 0.05), trimesh.transformations.translation_matrix((-0.245, 0.18, 0.3))
        ),
    ]
    parts = [p.subdivide().subdivide() for p in parts]
    labels = np.concatenate([np.full(len(p.faces), i) for i, p in enumerate(parts)])
    joined = trimesh.util.concatenate(parts)
    return Mesh(joined.vertices, joined.faces), Primitives(labels)


@pytest.fixture
def serve() -> Iterator[Callable[[Answer], str]]:
    """Start a loopback server that answers every request with a function of path and body."""
    running = []

    def start(answer: Answer) -> str:
        class Handler(BaseHTTPRequestHandler):
            def _do(self) -> None:
                length = int(self.headers.get("Content-Length") or 0)
                status, kind, body = answer(self.path, self.rfile.read(length))
                self.send_response(status)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            do_GET = do_POST = _do

            def log_message(self, *_: Any) -> None:
                pass

        server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        running.append(server)
        return f"http://127.0.0.1:{server.server_port}"

    yield start
    for server in running:
        server.shutdown()
        server.server_close()


def _zip(**files: np.ndarray) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, array in files.items():
            data = io.BytesIO()
            np.save(data, array)
            archive.writestr(f"{name}.npy", data.getvalue())
    return out.getvalue()


# ---------------------------------------------------------------- P3-SAM


def test_p3sam_over_http_keeps_faces_and_heals(
    serve: Callable[[Answer], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh, truth = _boxes()
    ids = truth.labels.copy() + 5
    ids[::7] = -1
    ids[3] = -2
    seen: dict[str, Any] = {}

    def answer(path: str, body: bytes) -> tuple[int, str, bytes]:
        archive = zipfile.ZipFile(io.BytesIO(body))
        seen.update(json.loads(archive.read("request.json")), path=path)
        assert archive.read("mesh.obj").count(b"\nf ") + 0 >= len(mesh.faces) - 1
        return 200, "application/zip", _zip(face_ids=ids)

    monkeypatch.setenv("MAM_SIM_P3SAM", serve(answer))
    monkeypatch.setenv("MAM_SIM_P3SAM_PROMPTS", "123")
    found = P3SamSegmenter().segment(mesh, seed=4)
    assert seen["path"] == "/segment" and seen["seed"] == 4 and seen["prompt_num"] == 123
    assert np.array_equal(found.labels, truth.labels)


def test_p3sam_ids_of_other_faces_come_back_by_centroid(
    serve: Callable[[Answer], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh, truth = _boxes()
    order = np.random.default_rng(0).permutation(len(mesh.faces))[:-20]
    centroids = mesh.vertices[mesh.faces].mean(axis=1)[order]
    body = _zip(face_ids=truth.labels[order], centroids=centroids)
    monkeypatch.setenv("MAM_SIM_P3SAM", serve(lambda *_: (200, "application/zip", body)))
    found = P3SamSegmenter().segment(mesh)
    assert np.mean(found.labels == truth.labels) > 0.99


@pytest.mark.parametrize(
    ("status", "body", "message"),
    [
        (500, b"CUDA out of memory", "answered 500: CUDA out of memory"),
        (404, b"", "answered 404"),
        (200, b"PK\x03\x04 half an answ", "half an answer"),
        (200, _zip(other=np.zeros(3)), "wrote no face_ids.npy"),
        (200, _zip(face_ids=np.zeros(3, dtype=np.int64)), "sent 3 face ids for"),
        (200, _zip(face_ids=np.zeros(3)), "wrote ids of type float64"),
    ],
)
def test_p3sam_faults_are_named(
    serve: Callable[[Answer], str],
    monkeypatch: pytest.MonkeyPatch,
    status: int,
    body: bytes,
    message: str,
) -> None:
    monkeypatch.setenv("MAM_SIM_P3SAM", serve(lambda *_: (status, "application/zip", body)))
    with pytest.raises(BackendError) as caught:
        P3SamSegmenter().segment(_boxes()[0])
    assert message in str(caught.value)


def test_pickles_and_paths_from_a_stranger_are_refused(tmp_path: Path) -> None:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("../evil.txt", "x")
    with pytest.raises(BackendError, match="outside its folder"):
        external.unpack(out.getvalue(), tmp_path / "in", "the server")
    assert not (tmp_path / "evil.txt").exists()


def _script(folder: Path, code: str) -> str:
    path = folder / "runner.py"
    head = (
        "import sys, time, pathlib\nout = pathlib.Path(sys.argv[sys.argv.index('--output') + 1])\n"
    )
    path.write_text(head + code)
    return f"{sys.executable} {path}"


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("sys.stderr.write('no CUDA device\\n'); sys.exit(3)", "status 3: no CUDA device"),
        ("time.sleep(30)", "gave no answer within 0.5 s"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "most likely for memory"),
        ("pass", "wrote no face_ids.npy"),
        ("(out / 'face_ids.npy').write_bytes(b'junk')", "cannot be read"),
    ],
)
def test_a_command_that_fails_is_named_with_what_it_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, message: str
) -> None:
    monkeypatch.setenv("MAM_SIM_P3SAM", _script(tmp_path, code))
    if "sleep" in code:
        monkeypatch.setenv("MAM_SIM_TIMEOUT", "0.5")
    with pytest.raises(BackendError) as caught:
        P3SamSegmenter().segment(_boxes()[0])
    assert message in str(caught.value)


def test_an_explicit_backend_never_falls_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MAM_SIM_P3SAM", raising=False)
    with pytest.raises(BackendError, match="set MAM_SIM_P3SAM"):
        backends.load("segmenter", "p3sam")
    assert backends.load("segmenter")[0] == "geometric"
    monkeypatch.setenv("MAM_SIM_P3SAM", "/nowhere/python run.py")
    with pytest.raises(BackendError, match="not an executable"):
        backends.load("segmenter", "p3sam")


def test_healing_leaves_islands_alone() -> None:
    mesh, truth = _boxes()
    ids = truth.labels.copy()
    ids[truth.labels == 2] = -1  # the whole knob is unassigned
    healed = heal(mesh, ids)
    knob = np.unique(healed[truth.labels == 2])
    assert len(knob) == 1 and knob[0] not in (0, 1)


# ---------------------------------------------------------------- SP4D


def _sp4d_frames(mesh: Mesh, primitives: Primitives, sense: int, size: int = 96) -> np.ndarray:
    """What SP4D would send for this object: colour halves and a smooth part colour code."""
    azimuth, elevation = REFERENCE
    around = [(azimuth + sense * STEP * k, elevation) for k in range(1, 13)]
    cast = views.look(mesh, around, size, distance=1.75, fov=np.radians(34))
    code = np.array([[40, 90, 200], [220, 60, 40], [220, 60, 40]], dtype=np.uint8)
    rng = np.random.default_rng(0)
    rows = []
    for view in cast:
        grey = np.full((primitives.count, 3), 150, dtype=np.uint8)
        left = views.paint(view, primitives.labels, grey)
        ids = view.ids(primitives.labels)
        right = np.where(ids[..., None] >= 0, code[np.maximum(ids, 0)].astype(int), 255)
        noise = rng.integers(-6, 7, right.shape) * (ids[..., None] >= 0)
        rows.append(np.concatenate([left, np.clip(right + noise, 0, 255).astype(np.uint8)], axis=1))
    return np.repeat(np.stack(rows)[None], 2, axis=0)


@pytest.mark.parametrize("sense", [1, -1])
def test_sp4d_cameras_and_colours_are_found(sense: int) -> None:
    mesh, primitives = _boxes()
    prior = prior_from_frames(mesh, primitives, _sp4d_frames(mesh, primitives, sense), seed=0)
    assert prior.evidence["silhouette_iou"] > 0.85
    assert prior.affinity[1, 2] > 0.8 > 0.4 > prior.affinity[0, 1]
    assert prior.mobility[0] < 0.3 < 0.7 < prior.mobility[2]


def test_sp4d_views_of_another_object_are_refused() -> None:
    mesh, primitives = _boxes()
    rod = trimesh.creation.box((0.02, 0.02, 1.0))
    other = Mesh(rod.vertices, rod.faces)
    frames = _sp4d_frames(other, Primitives(np.zeros(len(rod.faces), dtype=int)), 1)
    with pytest.raises(BackendError, match="do not show this object"):
        prior_from_frames(mesh, primitives, frames, seed=0)


def test_masks_from_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, primitives = _boxes()
    around = [(-30.0, 10.0), (30.0, 10.0)]
    cast = views.look(mesh, around, 64)
    masks = np.stack([np.minimum(v.ids(primitives.labels), 1) for v in cast])
    monkeypatch.setenv("MAM_SIM_PRIOR_FILE", str(tmp_path))
    with pytest.raises(ConfigError, match="holds no kinematic masks"):
        FilePrior().observe(mesh, primitives)
    angles = np.asarray(around)
    np.savez(tmp_path / "masks.npz", masks=masks, azimuth=angles[:, 0], elevation=angles[:, 1])
    prior = FilePrior().observe(mesh, primitives)
    same = prior_from_masks(cast, masks, primitives, "file")
    np.testing.assert_allclose(prior.affinity, same.affinity)
    assert prior.affinity[1, 2] > 0.9 > 0.3 > prior.affinity[0, 1]


# ---------------------------------------------------------------- questions and answers

GROUPING = {
    "parts": [
        {"name": "body", "kind": "body", "is_base": True, "pieces": [0], "confidence": 0.9},
        {"name": "door", "kind": "door", "is_base": False, "pieces": [1, 2], "confidence": 0.8},
    ]
}
MOUNTING = {
    "mounts": [
        {
            "name": "door",
            "parent": "body",
            "motion": "hinge",
            "confidence": 0.9,
            "second_best": "slide",
        }
    ]
}


def _chat(text: str) -> bytes:
    return json.dumps(
        {
            "id": "x",
            "object": "chat.completion",
            "created": 0,
            "model": "m",
            "choices": [
                {
                    "index": 0,
                    "finish_reason": "stop",
                    "message": {"role": "assistant", "content": text},
                }
            ],
            "usage": {"prompt_tokens": 1000, "completion_tokens": 100, "total_tokens": 1100},
        }
    ).encode()


class Endpoint:
    """Answers chat completions from a list and remembers what it was asked."""

    def __init__(self, answers: list[tuple[int, str]]) -> None:
        self.answers, self.asked = answers, []  # type: ignore[var-annotated]

    def __call__(self, path: str, body: bytes) -> tuple[int, str, bytes]:
        assert path.endswith("/chat/completions")
        self.asked.append(json.loads(body))
        status, text = self.answers[min(len(self.asked), len(self.answers)) - 1]
        if status != 200:
            return status, "application/json", json.dumps({"error": {"message": text}}).encode()
        return 200, "application/json", _chat(text)


@pytest.fixture
def endpoint(
    serve: Callable[[Answer], str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Callable[[list[tuple[int, str]]], Endpoint]:
    def start(answers: list[tuple[int, str]]) -> Endpoint:
        pytest.importorskip("openai", reason="the vlm extra is not installed")
        made = Endpoint(answers)
        monkeypatch.setenv("OPENAI_BASE_URL", serve(made) + "/v1")
        monkeypatch.setenv("OPENAI_API_KEY", "sk-secret-of-the-user")
        monkeypatch.setenv("MAM_SIM_VLM_CACHE", str(tmp_path / "answers"))
        monkeypatch.setenv("MAM_SIM_VLM_MODEL", "gpt-4o")
        return made

    return start


def test_two_questions_make_a_tree_and_the_cache_repeats_it(
    endpoint: Callable[[list[tuple[int, str]]], Endpoint], tmp_path: Path
) -> None:
    server = endpoint([(200, json.dumps(GROUPING)), (200, json.dumps(MOUNTING))])
    mesh, primitives = _boxes()
    tree = VlmReasoner().reason(mesh, primitives, None)
    assert [n.name for n in tree.nodes] == ["body", "door"]
    assert tree.nodes[1].primitives == (1, 2) and tree.nodes[1].subtype == "hinge"
    first = server.asked[0]
    assert first["temperature"] == 0 and first["response_format"]["type"] == "json_schema"
    pictures = [c for c in first["messages"][1]["content"] if c["type"] == "image_url"]
    assert len(pictures) == 8
    again = VlmReasoner().reason(mesh, primitives, None)
    assert len(server.asked) == 2 and again.nodes[1].name == "door"
    kept = "".join(p.read_text() for p in (tmp_path / "answers").iterdir())
    assert "sk-secret" not in kept


def test_a_faulty_answer_is_asked_again_with_the_fault(
    endpoint: Callable[[list[tuple[int, str]]], Endpoint],
) -> None:
    bad = {"parts": [{**GROUPING["parts"][0], "pieces": [0, 1]}]}
    answers = ["no json", json.dumps(bad), json.dumps(GROUPING), json.dumps(MOUNTING)]
    server = endpoint([(200, a) for a in answers])
    tree = VlmReasoner().reason(*_boxes(), None)
    assert len(tree.nodes) == 2
    assert "pieces [2] are in no part" in server.asked[2]["messages"][-1]["content"]


@pytest.mark.parametrize(
    "answer",
    [
        {"parts": [{**GROUPING["parts"][0], "name": "../../etc/passwd"}]},
        {"parts": [{**GROUPING["parts"][0], "pieces": list(range(100000))}]},
        {"parts": [{**GROUPING["parts"][0], "code": "import os"}]},
        {"parts": []},
    ],
)
def test_malicious_answers_are_refused_by_the_schema(
    endpoint: Callable[[list[tuple[int, str]]], Endpoint], answer: dict[str, Any]
) -> None:
    server = endpoint([(200, json.dumps(answer))])
    with pytest.raises(BackendError, match="no usable answer to 1_grouping after 2 repairs"):
        VlmReasoner().reason(*_boxes(), None)
    assert len(server.asked) == 4


def test_a_contradiction_is_challenged_once(
    endpoint: Callable[[list[tuple[int, str]]], Endpoint],
) -> None:
    affinity = np.eye(3)
    prior = KinematicPrior(np.array([0.0, 0.01, 0.01]), affinity)
    server = endpoint(
        [(200, json.dumps(GROUPING)), (200, json.dumps(GROUPING)), (200, json.dumps(MOUNTING))]
    )
    VlmReasoner().reason(*_boxes(), prior)
    assert len(server.asked) == 3
    assert "unable to move" in server.asked[1]["messages"][-1]["content"]


def test_old_endpoints_and_hard_errors(
    endpoint: Callable[[list[tuple[int, str]]], Endpoint],
) -> None:
    server = endpoint(
        [
            (400, "unknown field response_format"),
            (200, json.dumps(GROUPING)),
            (200, json.dumps(MOUNTING)),
        ]
    )
    assert len(VlmReasoner().reason(*_boxes(), None).nodes) == 2
    assert "response_format" not in server.asked[1]
    endpoint([(401, "bad key")])
    with pytest.raises(BackendError, match="bad key") as caught:
        VlmReasoner().reason(*_boxes(), KinematicPrior(np.ones(3), np.ones((3, 3))))
    assert "sk-secret" not in str(caught.value)


def test_busy_endpoints_are_tried_again(
    endpoint: Callable[[list[tuple[int, str]]], Endpoint],
) -> None:
    server = endpoint(
        [
            (429, "slow down"),
            (503, "busy"),
            (200, json.dumps(GROUPING)),
            (200, json.dumps(MOUNTING)),
        ]
    )
    assert len(VlmReasoner().reason(*_boxes(), None).nodes) == 2
    assert len(server.asked) == 4


def test_spending_stops_at_the_cap(
    endpoint: Callable[[list[tuple[int, str]]], Endpoint], monkeypatch: pytest.MonkeyPatch
) -> None:
    server = endpoint([(200, json.dumps(GROUPING)), (200, json.dumps(MOUNTING))])
    monkeypatch.setenv("MAM_SIM_MAX_COST", "0.003")
    with pytest.raises(BackendError, match=r"reaches the cap of \$0.00"):
        VlmReasoner().reason(*_boxes(), None)
    assert len(server.asked) == 1


def test_few_images_are_combined(
    endpoint: Callable[[list[tuple[int, str]]], Endpoint], monkeypatch: pytest.MonkeyPatch
) -> None:
    server = endpoint([(200, json.dumps(GROUPING)), (200, json.dumps(MOUNTING))])
    monkeypatch.setenv("MAM_SIM_VLM_IMAGES", "1")
    VlmReasoner().reason(*_boxes(), None)
    content = server.asked[0]["messages"][1]["content"]
    urls = [c["image_url"]["url"] for c in content if c["type"] == "image_url"]
    assert len(urls) == 1
    data = np.frombuffer(base64.b64decode(urls[0].split(",")[1]), dtype=np.uint8)
    assert max(cv2.imdecode(data, cv2.IMREAD_COLOR).shape) <= 2048


def test_questions_in_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MAM_SIM_QUESTIONS", str(tmp_path))
    mesh, primitives = _boxes()
    with pytest.raises(HintNeeded, match="answer the question in"):
        FileReasoner().reason(mesh, primitives, None)
    assert (tmp_path / "1_grouping" / "view_0.png").is_file()
    assert "0, 1, 2" in (tmp_path / "1_grouping" / "question.md").read_text()
    (tmp_path / "1_grouping" / "answer.json").write_text(json.dumps(GROUPING))
    with pytest.raises(HintNeeded, match="2_tree"):
        FileReasoner().reason(mesh, primitives, None)
    (tmp_path / "2_tree" / "answer.json").write_text(json.dumps(MOUNTING))
    assert FileReasoner().reason(mesh, primitives, None).nodes[1].subtype == "hinge"


def test_mountings_that_are_no_tree_are_named() -> None:
    row = {"motion": "hinge", "confidence": 1.0, "second_best": "fixed"}
    loop = questions.Mounting.model_validate(
        {"mounts": [{**row, "name": "a", "parent": "b"}, {**row, "name": "b", "parent": "a"}]}
    )
    assert "mounted on itself" in questions.faults_of_mounting(loop, ["base", "a", "b"], "base")


def test_tags_do_not_cover_each_other() -> None:
    image = Image.new("RGB", (200, 200), "white")
    taken: list[tuple[float, float, float, float]] = []
    font = ImageFont.load_default(size=12)
    for tag in range(12):  # all of them want the same place
        views._place(ImageDraw.Draw(image), font, str(tag), (100, 100), taken, image.size)
    assert len(taken) == 12
    for i, one in enumerate(taken):
        assert min(one) >= 0 and max(one) < 200
        assert not any(views._overlap(one, other) for other in taken[:i])
    mesh, primitives = _boxes()
    view = views.look(mesh, [(-35, 20)], 256)[0]
    bare = views.paint(view, primitives.labels, views.distinct_colors(3))
    tagged = views.paint(view, primitives.labels, views.distinct_colors(3), [0, 1, 2])
    assert (bare != tagged).any(axis=-1).sum() > 300


# ---------------------------------------------------------------- Hunyuan3D

GLB = trimesh.creation.box().export(file_type="glb")


def _hunyuan(
    statuses: list[dict[str, Any]], send: tuple[int, Any] = (200, {"uid": "ab-1"})
) -> Answer:
    left = iter(statuses)
    last: dict[str, Any] = {}

    def answer(path: str, body: bytes) -> tuple[int, str, bytes]:
        nonlocal last
        if path == "/send":
            return send[0], "application/json", json.dumps(send[1]).encode()
        assert path == "/status/ab-1"
        last = next(left, last)
        return 200, "application/json", json.dumps(last).encode()

    return answer


def test_hunyuan_polls_both_dialects(
    serve: Callable[[Answer], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MAM_SIM_TIMEOUT", "5")
    done = {"status": "completed", "model_base64": base64.b64encode(GLB).decode()}
    url = serve(_hunyuan([{"status": "processing"}, {"status": "texturing"}, done]))
    assert ask_server(url, {"image": "x"}) == GLB


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (_hunyuan([], (404, {"text": "NETWORK ERROR", "error_code": 1})), "404: NETWORK ERROR"),
        (_hunyuan([{"status": "processing"}]), "was not done within 1 s"),
        (_hunyuan([{"status": "error", "message": "OOM"}]), "failed: OOM"),
        (_hunyuan([], (200, {"uid": "../../x"})), "gave no job number"),
        (_hunyuan([{"status": "completed", "model_base64": "AAAA"}]), "no GLB"),
        (
            _hunyuan(
                [{"status": "completed", "model_base64": base64.b64encode(GLB[:200]).decode()}]
            ),
            "half a GLB",
        ),
        (lambda *_: (200, "text/html", b"<html>"), "gave no job number"),
    ],
)
def test_hunyuan_faults_are_named(
    serve: Callable[[Answer], str],
    monkeypatch: pytest.MonkeyPatch,
    answer: Answer,
    message: str,
) -> None:
    monkeypatch.setenv("MAM_SIM_TIMEOUT", "1")
    with pytest.raises(BackendError) as caught:
        ask_server(serve(answer), {"image": "x"})
    assert message in str(caught.value)


def test_painted_parts_keep_their_triangles() -> None:
    mesh, _ = _boxes()
    corners = mesh.faces.reshape(-1)
    painted = Mesh(
        mesh.vertices[corners] * 3 + 1,
        np.arange(len(corners)).reshape(-1, 3),
        uv=np.random.default_rng(0).random((len(corners), 2)),
    )
    result = adopt(mesh, painted)
    np.testing.assert_array_equal(result.vertices[result.faces], mesh.vertices[mesh.faces])
    assert result.uv is not None and painted.uv is not None
    np.testing.assert_array_equal(result.uv, painted.uv)
    with pytest.raises(BackendError, match="triangles for"):
        adopt(mesh, painted.submesh(np.arange(10)))
    shuffled = painted.submesh(np.random.default_rng(1).permutation(len(painted.faces)))
    with pytest.raises(BackendError, match="moved triangles"):
        adopt(mesh, shuffled)
