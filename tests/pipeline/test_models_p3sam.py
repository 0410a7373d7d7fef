"""P3-SAM's adapter and the runner contract against stand-ins, faults included."""

from __future__ import annotations

import io
import json
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mam_sim_models import external
from mam_sim_models.p3sam import P3SamSegmenter, heal

from mam_pipeline import backends
from mam_pipeline.errors import BackendError
from mam_pipeline.types import Mesh, Primitives

Boxes = tuple[Mesh, Primitives]


def _zip(**files: np.ndarray) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, array in files.items():
            data = io.BytesIO()
            np.save(data, array, allow_pickle=array.dtype == object)
            archive.writestr(f"{name}.npy", data.getvalue())
    return out.getvalue()


def test_faces_and_ids_survive_and_unassigned_faces_are_healed(
    serve: Callable[..., str], monkeypatch: pytest.MonkeyPatch, boxes: Boxes
) -> None:
    mesh, truth = boxes
    ids = truth.labels.copy() + 5
    ids[::7] = -1
    ids[3] = -2
    seen: dict[str, Any] = {}

    def answer(path: str, body: bytes) -> tuple[int, str, bytes]:
        archive = zipfile.ZipFile(io.BytesIO(body))
        seen.update(json.loads(archive.read("request.json")), path=path)
        assert archive.read("mesh.obj").count(b"\nf ") >= len(mesh.faces) - 1
        return 200, "application/zip", _zip(face_ids=ids)

    monkeypatch.setenv("MAM_SIM_P3SAM", serve(answer))
    monkeypatch.setenv("MAM_SIM_P3SAM_PROMPTS", "123")
    found = P3SamSegmenter().segment(mesh, seed=4)
    assert seen["path"] == "/segment" and seen["seed"] == 4 and seen["prompt_num"] == 123
    assert np.array_equal(found.labels, truth.labels)


def test_ids_of_other_faces_come_back_by_centroid(
    serve: Callable[..., str], monkeypatch: pytest.MonkeyPatch, boxes: Boxes
) -> None:
    mesh, truth = boxes
    order = np.random.default_rng(0).permutation(len(mesh.faces))[:-20]
    centroids = mesh.vertices[mesh.faces].mean(axis=1)[order]
    body = _zip(face_ids=truth.labels[order], centroids=centroids)
    monkeypatch.setenv("MAM_SIM_P3SAM", serve(lambda *_: (200, "application/zip", body)))
    found = P3SamSegmenter().segment(mesh)
    assert np.mean(found.labels == truth.labels) > 0.99


def test_healing_leaves_islands_alone(boxes: Boxes) -> None:
    mesh, truth = boxes
    ids = truth.labels.copy()
    ids[truth.labels == 2] = -1  # the whole knob is unassigned
    healed = heal(mesh, ids)
    knob = np.unique(healed[truth.labels == 2])
    assert len(knob) == 1 and knob[0] not in (0, 1)
    with pytest.raises(BackendError, match="assigned no face at all"):
        heal(mesh, np.full(len(mesh.faces), -2))


@pytest.mark.parametrize(
    ("status", "body", "message"),
    [
        (500, b"CUDA out of memory", "answered 500: CUDA out of memory"),
        (404, b"", "answered 404"),
        (200, b"PK\x03\x04 half an answ", "half an answer"),
        (200, b"", "half an answer"),
        (200, _zip(other=np.zeros(3)), "wrote no face_ids.npy"),
        (200, _zip(face_ids=np.zeros(3, dtype=np.int64)), "sent 3 face ids for"),
        (200, _zip(face_ids=np.zeros(3)), "wrote ids of type float64"),
        (200, _zip(face_ids=np.array([{"a": 1}], dtype=object)), "cannot be read"),
        (200, _zip(face_ids=np.zeros(4, int), centroids=np.zeros((3, 3))), "4 ids with centroids"),
    ],
)
def test_faults_over_http_are_named(
    serve: Callable[..., str],
    monkeypatch: pytest.MonkeyPatch,
    boxes: Boxes,
    status: int,
    body: bytes,
    message: str,
) -> None:
    monkeypatch.setenv("MAM_SIM_P3SAM", serve(lambda *_: (status, "application/zip", body)))
    with pytest.raises(BackendError) as caught:
        P3SamSegmenter().segment(boxes[0])
    assert message in str(caught.value)


def test_a_server_that_hangs_or_is_not_there(
    serve: Callable[..., str], monkeypatch: pytest.MonkeyPatch, boxes: Boxes
) -> None:
    def hang(*_: object) -> tuple[int, str, bytes]:
        time.sleep(3)
        return 200, "application/zip", b""

    monkeypatch.setenv("MAM_SIM_TIMEOUT", "0.3")
    monkeypatch.setenv("MAM_SIM_P3SAM", serve(hang))
    with pytest.raises(BackendError, match=r"no answer within 0.3 s"):
        P3SamSegmenter().segment(boxes[0])
    monkeypatch.setenv("MAM_SIM_P3SAM", "http://127.0.0.1:9")
    with pytest.raises(BackendError, match="cannot be reached"):
        P3SamSegmenter().segment(boxes[0])


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("sys.stderr.write('no CUDA device\\n'); sys.exit(3)", "status 3: no CUDA device"),
        ("time.sleep(30)", "gave no answer within 1 s"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "most likely for memory"),
        ("pass", "wrote no face_ids.npy"),
        ("(out / 'face_ids.npy').write_bytes(b'junk')", "cannot be read"),
    ],
)
def test_a_command_that_fails_is_named_with_what_it_said(
    script: Callable[[str], str],
    monkeypatch: pytest.MonkeyPatch,
    boxes: Boxes,
    code: str,
    message: str,
) -> None:
    monkeypatch.setenv("MAM_SIM_P3SAM", script(code))
    if "sleep" in code:
        monkeypatch.setenv("MAM_SIM_TIMEOUT", "1")
    with pytest.raises(BackendError) as caught:
        P3SamSegmenter().segment(boxes[0])
    assert message in str(caught.value)


def test_pickles_and_paths_from_a_stranger_are_refused(tmp_path: Path) -> None:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("../evil.txt", "x")
    with pytest.raises(BackendError, match="outside its folder"):
        external.unpack(out.getvalue(), tmp_path / "in", "the server")
    assert not (tmp_path / "evil.txt").exists()


def test_an_explicit_backend_never_falls_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MAM_SIM_P3SAM", raising=False)
    with pytest.raises(BackendError, match="set MAM_SIM_P3SAM"):
        backends.load("segmenter", "p3sam")
    assert backends.load("segmenter")[0] == "geometric"
    monkeypatch.setenv("MAM_SIM_P3SAM", "/nowhere/python run.py")
    with pytest.raises(BackendError, match="not an executable"):
        backends.load("segmenter", "p3sam")
