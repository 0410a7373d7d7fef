"""The wheel in an empty environment: what `pip install mam-sim` gives, on a Python we support.

It is the other one where there is one: this run has the first. pip must reach its package index.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh

ROOT = Path(__file__).resolve().parents[2]
SUPPORTED = ("3.11", "3.12")

pytestmark = pytest.mark.slow


def _interpreter(version: str) -> str | None:
    """A working interpreter of that version, with its venv module; None where there is none."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    base = getattr(sys, "_base_executable", sys.executable)
    found = sorted(pyenv.glob(f"{version}.*/bin/python"))
    for python in (base, shutil.which(f"python{version}"), *map(str, found)):
        code = f"import sys, ensurepip; assert '%d.%d' % sys.version_info[:2] == '{version}'"
        if python and not subprocess.run([python, "-c", code], capture_output=True).returncode:
            return python
    return None


def _run(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command that does not see this checkout."""
    env = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True)
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project's wheel, built from a copy so that no build folder is left in the checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    copy = folder / "source"
    leave = shutil.ignore_patterns(".*", "build", "*.egg-info", "__pycache__", "tests", "docs")
    shutil.copytree(ROOT, copy, ignore=leave)
    _run(sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", ".", copy, cwd=folder)
    return next(folder.glob("mam_sim-*.whl"))


def test_the_wheel_makes_an_asset_in_an_empty_environment(wheel: Path, tmp_path: Path) -> None:
    mine = f"{sys.version_info.major}.{sys.version_info.minor}"
    python = next(filter(None, map(_interpreter, sorted(SUPPORTED, key=mine.__eq__))))
    _run(python, "-m", "venv", tmp_path / "venv", cwd=tmp_path)
    bin_folder = tmp_path / "venv" / "bin"
    _run(
        *(bin_folder / "python", "-m", "pip", "install", "--quiet"),
        *("-c", ROOT / "constraints.txt", wheel),
        cwd=tmp_path,
    )
    _run(bin_folder / "python", "-m", "pip", "check", cwd=tmp_path)

    body = trimesh.creation.box((0.4, 0.5, 0.6))
    door = trimesh.creation.box((0.02, 0.46, 0.5)).apply_translation((-0.215, 0, 0))
    handle = trimesh.creation.box((0.04, 0.02, 0.2)).apply_translation((-0.245, 0.2, 0))
    trimesh.Scene([body, door, handle]).export(tmp_path / "box.glb")

    done = _run(bin_folder / "mam-sim", "articulate", "box.glb", "--out", "box", cwd=tmp_path)
    assert "mam-sim[sim]" in done.stdout + done.stderr
    card = json.loads((tmp_path / "box" / "asset.json").read_text())
    assert [joint["type"] for joint in card["joints"]] == ["revolute"]
    assert card["checks"]["executability"] == {"passed": True, "driven": False, "reasons": []}

    command: list[str | Path] = [bin_folder / "mam-sim", "make-env", "box.glb", "--out", "env"]
    refused = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert refused.returncode == 2 and "mam-sim[sim]" in refused.stderr
    assert not (tmp_path / "env").exists()
    shutil.rmtree(tmp_path / "venv")  # 1.9 GB
