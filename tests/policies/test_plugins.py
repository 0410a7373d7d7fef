"""Both LeRobot plug-ins as wheels: they build, say who made them, and hold what they import."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from email.message import Message
from email.parser import Parser
from pathlib import Path

import pytest

PLUGINS = Path(__file__).parents[2] / "plugins"
TYPES = {
    "lerobot_policy_mam_sim": (
        "from lerobot.configs.policies import PreTrainedConfig as Config\n"
        "from lerobot.envs.configs import EnvConfig\n"
        "assert 'mam_sim' in EnvConfig.get_known_choices()\n"
    ),
    "lerobot_robot_mam_sim": "from lerobot.robots.config import RobotConfig as Config\n",
}


def _wheel(name: str, folder: Path) -> zipfile.ZipFile:
    """Build a plug-in from a copy, so that nothing is written into the repository."""
    source = folder / "source"
    unwanted = shutil.ignore_patterns("build", "*.egg-info", "__pycache__")
    shutil.copytree(PLUGINS / name, source, ignore=unwanted)
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*command, "--wheel-dir", str(folder), str(source)], check=True)
    (file,) = folder.glob("*.whl")
    return zipfile.ZipFile(file)


def _metadata(wheel: zipfile.ZipFile) -> Message:
    (file,) = (n for n in wheel.namelist() if n.endswith(".dist-info/METADATA"))
    return Parser().parsestr(wheel.read(file).decode())


@pytest.mark.slow  # builds a wheel and imports LeRobot
@pytest.mark.parametrize("name", TYPES)
def test_the_wheel_is_whole(name: str, tmp_path: Path) -> None:
    pytest.importorskip("lerobot")
    wheel = _wheel(name, tmp_path)
    files = (p.relative_to(PLUGINS / name) for p in (PLUGINS / name).rglob("*.py"))
    modules = {p.as_posix() for p in files if p.parts[0] != "build"}
    assert modules | {f"{name}/py.typed"} <= set(wheel.namelist())

    said = _metadata(wheel)
    # LeRobot finds plug-ins among the installed packages by this very name
    assert said["Name"] == name
    assert said["License-Expression"] == "Apache-2.0" and said["Author"]
    urls = dict(line.split(", ", 1) for line in said.get_all("Project-URL", []))
    assert {"Homepage", "Repository", "Issues"} <= set(urls)
    assert said["Requires-Dist"].startswith("mam-sim[lerobot]")
    readme = said.get_payload()
    assert isinstance(readme, str) and f"pip install {name}" in readme

    wheel.extractall(tmp_path / "installed")
    code = (
        f"import sys; sys.path.insert(0, {str(tmp_path / 'installed')!r})\n"
        f"import {name}\n"
        f"assert {name}.__file__.startswith({str(tmp_path)!r})\n"
        f"{TYPES[name]}"
        "assert 'mam_sim' in Config.get_known_choices()\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
