"""Photo-to-mesh servers and runners, and the painter, against stand-ins with their faults."""

from __future__ import annotations

import base64
import io
import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from mam_sim_models.image_to_mesh import TripoSrReconstructor, ask_server, cut_out
from mam_sim_models.retexture import adopt
from PIL import Image

from mam_pipeline.errors import BackendError, ConfigError, NotThisKind
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.models.retexture import repainted
from mam_pipeline.models.settings import given
from mam_pipeline.models.vlm import told_by
from mam_pipeline.photo.options import PhotoConfig
from mam_pipeline.run import _read_photo
from mam_pipeline.stage_store import StageStore
from mam_pipeline.stages import Stages
from mam_pipeline.types import Articulation, Joint, Link, Mesh, Primitives

GLB = trimesh.creation.box().export(file_type="glb")
Answer = Callable[[str, bytes], tuple[int, str, bytes]]
Boxes = tuple[Mesh, Primitives]


def _server(
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


def _done(model: bytes) -> dict[str, Any]:
    return {"status": "completed", "model_base64": base64.b64encode(model).decode()}


def test_both_dialects_are_polled(
    serve: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MAM_SIM_TIMEOUT", "9")
    url = serve(_server([{"status": "processing"}, {"status": "texturing"}, _done(GLB)]))
    assert ask_server(url, {"image": "x"}) == GLB


def _photo(folder: Path) -> Path:
    """A brown board before a light wall."""
    picture = np.full((200, 300, 3), 235, dtype=np.uint8)
    picture[60:150, 100:200] = (120, 60, 30)
    Image.fromarray(picture).save(folder / "photo.png")
    return folder / "photo.png"


def _hang(*_: object) -> tuple[int, str, bytes]:
    time.sleep(4)
    return 200, "application/json", b"{}"


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (_server([], (404, {"text": "NETWORK ERROR", "error_code": 1})), "404: NETWORK ERROR"),
        (_server([{"status": "processing"}]), "was not done within 1 s"),
        (_server([{"status": "error", "message": "OOM"}]), "failed: OOM"),
        (_server([], (200, {"uid": "../../x"})), "gave no job number"),
        (_server([{"status": "completed", "model_base64": "AAAA"}]), "no GLB"),
        (_server([{"status": "completed", "model_base64": "%%"}]), "no base64"),
        (_server([{"status": "completed"}]), "no GLB"),
        (_server([_done(GLB[:200])]), "half a GLB"),
        (lambda *_: (200, "text/html", b"<html>"), "gave no job number"),
        (lambda *_: (500, "text/plain", b"Internal Server Error"), "500: Internal"),
        (_hang, "gave no answer in time"),
    ],
)
def test_server_faults_are_named(
    serve: Callable[..., str], monkeypatch: pytest.MonkeyPatch, answer: Answer, message: str
) -> None:
    monkeypatch.setenv("MAM_SIM_TIMEOUT", "1")
    with pytest.raises(BackendError) as caught:
        ask_server(serve(answer), {"image": "x"})
    assert message in str(caught.value)


def test_a_server_that_is_not_there() -> None:
    with pytest.raises(BackendError, match="cannot be reached"):
        ask_server("http://127.0.0.1:9", {})


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("pass", "wrote no mesh.glb"),
        ("(out / 'mesh.glb').write_bytes(b'glTF')", "unusable mesh"),
        ("sys.stderr.write('torch.OutOfMemoryError'); sys.exit(1)", "OutOfMemoryError"),
    ],
)
def test_runner_faults_are_named(
    script: Callable[[str], str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    code: str,
    message: str,
) -> None:
    photo = _photo(tmp_path)
    monkeypatch.setenv("MAM_SIM_TRIPOSR", script(code))
    with pytest.raises(BackendError) as caught:
        TripoSrReconstructor().reconstruct(photo, {})
    assert message in str(caught.value)


def test_a_runner_makes_a_mesh_of_the_asked_height(
    script: Callable[[str], str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    photo = _photo(tmp_path)
    (tmp_path / "box.glb").write_bytes(GLB)
    source = str(tmp_path / "box.glb")
    code = f"(out / 'mesh.glb').write_bytes(pathlib.Path({source!r}).read_bytes())"
    monkeypatch.setenv("MAM_SIM_TRIPOSR", script(code))
    made = TripoSrReconstructor().reconstruct(photo, {"height": 0.5})
    assert np.ptp(made.mesh.bounds[:, 2]) == pytest.approx(0.5)


def test_a_learned_shell_is_cut_along_the_panels_of_its_photo(
    script: Callable[[str], str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    photo = Path(__file__).parents[2] / "examples" / "nightstand.jpg"
    trimesh.creation.box((0.9, 1.1, 0.76)).subdivide().export(tmp_path / "shell.glb")
    source = str(tmp_path / "shell.glb")
    code = f"(out / 'mesh.glb').write_bytes(pathlib.Path({source!r}).read_bytes())"
    monkeypatch.setenv("MAM_SIM_TRIPOSR", script(code))
    made = TripoSrReconstructor().reconstruct(photo, {"height": 0.7})
    size = np.ptp(made.mesh.bounds, axis=0)
    assert size[2] == pytest.approx(0.7)
    assert size[1] == pytest.approx(0.7 * 0.9 / 1.1)  # the shell's own proportions
    names = [f"drawer_{k}_skin" for k in range(3)]
    assert list(made.mesh.group_names[1:]) == names
    assert [p.nodes[0] for p in made.hints.parts[1:]] == names
    assert made.confidence["cuboid"] == "high" and "overlay" in made.pictures
    assert "3 parts cut" in made.summary


@pytest.mark.parametrize(
    ("category", "what", "word"),
    [
        ("washing_machine", None, "washer"),
        ("fridge", "toaster oven", "oven"),
        ("drawer_unit", None, "filingcabinet"),
        (None, None, None),
    ],
)
def test_the_category_is_the_engines_word_for_a_learned_shell(
    script: Callable[[str], str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    category: str | None,
    what: str | None,
    word: str | None,
) -> None:
    (tmp_path / "box.glb").write_bytes(GLB)
    source = str(tmp_path / "box.glb")
    code = f"(out / 'mesh.glb').write_bytes(pathlib.Path({source!r}).read_bytes())"
    monkeypatch.setenv("MAM_SIM_TRIPOSR", script(code))
    config = MakeConfig(
        height=0.5, what=what, reconstructor="triposr", photo=PhotoConfig(category=category)
    )
    stages = Stages(config.engine, None, StageStore(tmp_path / "stages"))
    read = _read_photo(_photo(tmp_path), config, stages, None)
    assert read.shell
    assert [o.word for o in read.spec.objects] == ([word] if word else [])


def test_what_a_model_sees_on_a_photo_is_the_word_for_the_mesh_of_another(
    script: Callable[[str], str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "box.glb").write_bytes(GLB)
    source = str(tmp_path / "box.glb")
    code = f"(out / 'mesh.glb').write_bytes(pathlib.Path({source!r}).read_bytes())"
    monkeypatch.setenv("MAM_SIM_TRIPOSR", script(code))
    answer = tmp_path / "questions" / "photo" / "answer.json"
    answer.parent.mkdir(parents=True)
    answer.write_text(json.dumps({"in_scope": False, "what": "a white kettle with a lid"}))
    config = MakeConfig(height=0.2, reconstructor="triposr", photo=PhotoConfig(reader="file"))
    stages = Stages(config.engine, None, StageStore(tmp_path / "stages"))
    with given({"MAM_SIM_QUESTIONS": str(tmp_path / "questions")}):
        read = _read_photo(_photo(tmp_path), config, stages, None)
        assert [(o.word, o.said.origin) for o in read.spec.objects] == [
            ("kettle", "language model")
        ]
        assert read.spec.objects[0].said.certainty < 1.0  # it weighs, and is not obeyed
        assert any("as a language model says: 'a white kettle" in note for note in read.notes)
        assert "may show: kettle" in told_by(read.spec, {}) and "user" not in told_by(read.spec, {})
        named = _read_photo(_photo(tmp_path), replace(config, what="lamp"), stages, None)
        assert [o.said.origin for o in named.spec.objects] == ["user", "language model"]
        assert "the photo shows a white kettle with a lid" in read.notes[0]
        with pytest.raises(NotThisKind, match="--reconstructor"):
            _read_photo(_photo(tmp_path), replace(config, reconstructor="auto"), stages, None)


def test_the_object_is_cut_out_of_its_photo(tmp_path: Path) -> None:
    photo = _photo(tmp_path)
    alpha = np.asarray(cut_out(photo, {}))[..., 3]
    assert alpha.shape == (200, 300)
    assert alpha[70:140, 110:190].min() > 200 and alpha[:40].max() < 50
    mask = np.zeros((200, 300), dtype=np.uint8)
    mask[:, 150:] = 255
    Image.fromarray(mask).save(tmp_path / "mask.png")
    alpha = np.asarray(cut_out(photo, {"mask": tmp_path / "mask.png"}))[..., 3]
    assert alpha[:, :140].max() == 0 and alpha[:, 160:].min() == 255


def test_painted_parts_keep_their_triangles(boxes: Boxes) -> None:
    mesh, _ = boxes
    corners = mesh.faces.reshape(-1)
    painted = Mesh(
        mesh.vertices[corners] * 3 + 1,
        np.arange(len(corners)).reshape(-1, 3),
        uv=np.random.default_rng(0).random((len(corners), 2)).astype(np.float32),
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


class Painter:
    """A Hunyuan3D-2 server with --enable_tex and an image endpoint, both in one."""

    def __init__(self) -> None:
        self.painted: list[bytes] = []
        self.prompts: list[str] = []
        self.model = b""

    def __call__(self, path: str, body: bytes) -> tuple[int, str, bytes]:
        kind = "application/json"
        if path == "/v1/images/generations":
            self.prompts.append(json.loads(body)["prompt"])
            picture = base64.b64encode(_png()).decode()
            return 200, kind, json.dumps({"created": 0, "data": [{"b64_json": picture}]}).encode()
        if path == "/send":
            request = json.loads(body)
            assert request["texture"] and set(request) == {"mesh", "image", "texture", "seed"}
            sent = base64.b64decode(request["mesh"])
            self.painted.append(base64.b64decode(request["image"]))
            part: Any = trimesh.load(io.BytesIO(sent), file_type="glb", force="mesh", process=False)
            self.bounds = part.bounds
            part.unmerge_vertices()  # as an unwrapping painter does
            uv = np.random.default_rng(0).random((len(part.vertices), 2))
            material = trimesh.visual.material.PBRMaterial(
                baseColorTexture=Image.new("RGB", (8, 8), "brown")
            )
            part.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
            self.model = part.export(file_type="glb")
            return 200, kind, b'{"uid": "a1"}'
        return 200, kind, json.dumps(_done(self.model)).encode()


def _png() -> bytes:
    out = io.BytesIO()
    Image.new("RGB", (8, 8), "brown").save(out, format="PNG")
    return out.getvalue()


def test_one_part_is_repainted_by_picture_or_words(
    serve: Callable[..., str], monkeypatch: pytest.MonkeyPatch, boxes: Boxes, tmp_path: Path
) -> None:
    pytest.importorskip("openai", reason="the vlm extra is not installed")
    mesh, primitives = boxes
    links = tuple(
        Link(name, name, np.flatnonzero(primitives.labels == i))
        for i, name in enumerate(("body", "door", "knob"))
    )
    joints = tuple(
        Joint(f"j{i}", "fixed", "fixed", 0, i, np.array([0, 0, 1.0]), np.zeros(3), 0, 0)
        for i in (1, 2)
    )
    before = Articulation(mesh, links, joints)
    painter = Painter()
    url = serve(painter)
    picture = tmp_path / "wood.png"
    picture.write_bytes(_png())
    monkeypatch.delenv("OPENAI_BASE_URL", raising=False)
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    monkeypatch.delenv("MAM_SIM_HUNYUAN3D", raising=False)
    with pytest.raises(ConfigError, match="no part 'lid'; there are body, door, knob"):
        repainted(before, {"lid": str(picture)})
    with pytest.raises(BackendError, match="no retexturer is available"):
        repainted(before, {"door": str(picture)})
    monkeypatch.setenv("MAM_SIM_HUNYUAN3D", url)
    with pytest.raises(BackendError, match="image endpoint"):
        repainted(before, {"door": "walnut"})
    monkeypatch.setenv("OPENAI_BASE_URL", url + "/v1")
    after, used = repainted(before, {"door": str(picture), "knob": "brushed brass"})
    assert used == "hunyuan3d" and painter.painted == [_png(), _png()]
    assert len(painter.prompts) == 1 and "brushed brass" in painter.prompts[0]
    for one, two in zip(before.links, after.links):
        np.testing.assert_allclose(
            after.mesh.vertices[after.mesh.faces[two.faces]],
            mesh.vertices[mesh.faces[one.faces]],
        )
    low, high = painter.bounds  # upright, and its front towards the painter
    np.testing.assert_allclose(high - low, (0.05, 0.05, 0.04), atol=1e-6)
    assert after.mesh.face_material is not None
    textured = [m.image is not None for m in after.mesh.materials]
    kinds = [textured[after.mesh.face_material[link.faces[0]]] for link in after.links]
    assert kinds == [False, True, True]
