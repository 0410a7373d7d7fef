"""The runners that we ship: TripoSR's and TripoSG's steps, and the server for any of them."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import requests
import trimesh
from mam_sim_models import external
from mam_sim_models.runners import tripo
from PIL import Image

from mam_pipeline.errors import BackendError

RUNNERS = Path(tripo.__file__).parent

TORCH = """
import contextlib
class cuda:
    is_available = staticmethod(lambda: False)
no_grad = contextlib.nullcontext
float16, float32 = "half", "single"
class Generator:
    def __init__(self, device): assert device == "cpu"
    def manual_seed(self, seed): return seed
"""
TSR = """
import numpy as np, trimesh
class TSR:
    class renderer:
        set_chunk_size = staticmethod(lambda size: None)
    @classmethod
    def from_pretrained(cls, name, config_name, weight_name): return cls()
    def to(self, device): assert device == "cpu"
    def __call__(self, pictures, device):
        self.picture = pictures[0]
        return "codes"
    def extract_mesh(self, codes, colours, resolution):
        assert codes == "codes" and colours is True and resolution == 256
        self.picture.save("seen.png")
        mesh = trimesh.creation.box((1, 2, 3))  # Z up; its front looks along +X
        knob = trimesh.creation.box((0.1, 0.1, 0.1))
        knob.apply_translation((0.5, 0.8, 1.2))  # on the front, right and high
        return [trimesh.util.concatenate([mesh, knob])]
"""
TRIPOSG = """
import trimesh
class TripoSGPipeline:
    @classmethod
    def from_pretrained(cls, place): return cls()
    def to(self, device, kind):
        assert (device, kind) == ("cpu", "single")
        return self
    def __call__(self, image, generator, num_inference_steps, guidance_scale):
        assert generator == 7
        image.save("seen.png")
        box = trimesh.creation.box((1, 2, 3))
        self.samples = [(box.vertices, box.faces)]
        return self
"""


def _photo(folder: Path) -> Path:
    """A red board, 60 wide and 30 high, in a corner of a transparent picture."""
    picture = np.zeros((100, 200, 4), dtype=np.uint8)
    picture[10:40, 20:80] = (200, 10, 10, 255)
    folder.mkdir()
    Image.fromarray(picture).save(folder / "image.png")
    (folder / "request.json").write_text(json.dumps({"image": "image.png", "seed": 7}))
    return folder


def _run(model: str, folder: Path, home: str) -> subprocess.CompletedProcess[str]:
    """Run the runner with stand-ins for torch and the model."""
    modules = folder / "modules"
    (modules / "tsr").mkdir(parents=True)
    (modules / "triposg" / "pipelines").mkdir(parents=True)
    (modules / "torch.py").write_text(TORCH)
    (modules / "tsr" / "system.py").write_text(TSR)
    (modules / "triposg" / "pipelines" / "pipeline_triposg.py").write_text(TRIPOSG)
    (folder / "out").mkdir()
    command = [sys.executable, str(RUNNERS / "tripo.py"), model, "--task", "reconstruct"]
    command += ["--input", str(folder / "in"), "--output", str(folder / "out")]
    place = {"TRIPOSR_HOME": "", "TRIPOSG_HOME": "", home: str(modules)}
    return subprocess.run(
        command, capture_output=True, text=True, cwd=folder, env={**os.environ, **place}
    )


def test_triposr_sees_the_object_on_grey_and_its_mesh_stands_upright(tmp_path: Path) -> None:
    _photo(tmp_path / "in")
    done = _run("triposr", tmp_path, "TRIPOSR_HOME")
    assert done.returncode == 0, done.stderr
    seen = np.asarray(Image.open(tmp_path / "seen.png"))
    assert seen.shape == (71, 71, 3)  # 60 / 0.85
    red = np.argwhere(seen[..., 0] > 180)
    assert np.ptp(red, axis=0).tolist() == [29, 59] and abs(red.mean(axis=0) - 35).max() <= 0.5
    assert (seen[0, 0] == 127).all()
    mesh = trimesh.load(tmp_path / "out" / "mesh.glb", force="mesh", process=False)
    assert isinstance(mesh, trimesh.Trimesh)
    np.testing.assert_allclose(np.ptp(mesh.vertices[:8], axis=0), (2, 3, 1), atol=1e-6)
    knob = mesh.vertices[8:].mean(axis=0)  # glTF: right of the picture, high, in front
    np.testing.assert_allclose(knob, (0.8, 1.2, 0.5), atol=1e-6)
    assert mesh.volume > 0  # not mirrored


def test_triposg_sees_the_object_on_white(tmp_path: Path) -> None:
    _photo(tmp_path / "in")
    done = _run("triposg", tmp_path, "TRIPOSG_HOME")
    assert done.returncode == 0, done.stderr
    seen = np.asarray(Image.open(tmp_path / "seen.png"))
    assert seen.shape == (72, 72, 3) and (seen[0, 0] == 255).all()  # a tenth on either side
    mesh = trimesh.load(tmp_path / "out" / "mesh.glb", force="mesh", process=False)
    assert isinstance(mesh, trimesh.Trimesh)
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), (1, 2, 3), atol=1e-6)


def test_each_model_has_a_home_of_its_own(tmp_path: Path) -> None:
    _photo(tmp_path / "in")
    done = _run("triposr", tmp_path, "TRIPOSG_HOME")
    assert done.returncode == 1 and "TRIPOSR_HOME must name the checkout" in done.stderr


def test_an_empty_picture_is_refused() -> None:
    with pytest.raises(SystemExit, match="nothing is left"):
        tripo.framed(Image.new("RGBA", (9, 9)), 1.2, (255, 255, 255))


@pytest.fixture
def server(script: Callable[[str], str]) -> Iterator[Callable[[str], str]]:
    """Start our server with a runner of the given code; gives its URL."""
    running: list[subprocess.Popen[str]] = []

    def start(code: str) -> str:
        command = [sys.executable, str(RUNNERS / "serve.py"), "--port", "0", *script(code).split()]
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        running.append(process)
        assert process.stderr is not None
        found = re.search(r"http://\S+", process.stderr.readline())
        assert found
        return found[0]

    yield start
    for process in running:
        process.terminate()
        process.wait()
        assert process.stderr is not None
        process.stderr.close()


def test_a_runner_behind_our_server(
    server: Callable[[str], str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    url = server(
        "request = json.loads((inbox / 'request.json').read_text())\n"
        "if request['seed'] == 13: sys.exit('out of memory')\n"
        "(out / 'deep').mkdir()\n"
        "(out / 'deep' / 'mesh.obj').write_bytes((inbox / 'image.png').read_bytes())"
    )
    monkeypatch.setenv("MAM_SIM_TRIPOSR", url)
    monkeypatch.setenv("MAM_SIM_TIMEOUT", "30")
    inbox = tmp_path / "in"
    inbox.mkdir()
    (inbox / "image.png").write_bytes(b"a picture")
    external.call("MAM_SIM_TRIPOSR", "reconstruct", {"seed": 1}, inbox, tmp_path / "out")
    assert (tmp_path / "out" / "deep" / "mesh.obj").read_bytes() == b"a picture"
    with pytest.raises(BackendError, match=r"answered 500: status 1: out of memory"):
        external.call("MAM_SIM_TRIPOSR", "reconstruct", {"seed": 13}, inbox, tmp_path / "out")
    assert requests.post(f"{url}/reconstruct", data=b"no zip").status_code == 400
    assert requests.post(f"{url}/a/b", data=b"").status_code == 404
