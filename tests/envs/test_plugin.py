"""examples/plugin, installed as a user would: all that it adds is found and works."""

from __future__ import annotations

import importlib
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import trimesh

import mam_envs
from mam_envs.robots import ROBOTS, robot_spec
from mam_envs.tasks import TASKS, task_class
from mam_pipeline import backends
from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.formats.mesh_files import load_mesh
from mam_pipeline.formats.readers import reader_of
from mam_pipeline.formats.suffixes import mesh_suffixes
from mam_pipeline.make_config import EngineConfig
from mam_pipeline.run import kind_of
from mam_pipeline.stages import articulate_mesh
from mam_policies.algorithms import algorithm
from mam_policies.evaluate import evaluate_run
from mam_policies.expert import Expert, run_episode
from mam_policies.run import EnvChoice
from mam_sim.verbs.doctor import _plugins
from mam_world import make_object

ROOT = Path(__file__).resolve().parents[2]
PLUGIN = ROOT / "examples" / "plugin"


@pytest.fixture(scope="module", autouse=True)
def installed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The plug-in, built and installed into a folder of its own that Python then looks into."""
    folder = tmp_path_factory.mktemp("plugin")
    source, target = folder / "source", folder / "installed"
    shutil.copytree(PLUGIN, source)
    command = [
        sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation",
        "--no-index", "--target", str(target), str(source),
    ]  # fmt: skip
    made = subprocess.run(command, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    sys.path.insert(0, str(target))
    importlib.invalidate_caches()
    yield
    sys.path.remove(str(target))


@pytest.fixture(scope="module")
def env(drawer: Path) -> Iterator[Any]:
    made = gym.make(
        mam_envs.ENV_ID, asset=drawer, robot_uids="koch", task="open_and_keep", scale=0.6,
        control_mode="pd_joint_pos", reward_mode="dense", success={"keep_steps": 10},
        randomisation={"position": 0.0, "yaw": 0.0},
    )  # fmt: skip
    yield made
    made.close()


def test_its_names_are_listed_with_the_built_in_ones() -> None:
    assert list(ROBOTS.targets())[-1] == "koch" and list(TASKS.targets())[-1] == "open_and_keep"
    assert "connected" in backends.names("segmenter")
    with pytest.raises(ConfigError, match="did you mean 'open_and_keep'"):
        task_class(["open_and_kep"])


def test_doctor_lists_it_and_says_what_is_broken(monkeypatch: pytest.MonkeyPatch) -> None:
    found = {f.name: f for f in _plugins()}
    assert {"robot koch", "task open_and_keep"} <= set(found)
    assert all(f.ok for f in found.values())
    monkeypatch.setitem(sys.modules, "example_plugin.task", None)  # as if its import failed
    broken = {f.name: f for f in _plugins()}["task open_and_keep"]
    assert not broken.ok and broken.state.startswith("broken: the task 'open_and_keep'")


def test_its_robot_fits_its_urdf_and_reaches_what_it_says() -> None:
    spec = robot_spec("koch")
    low, high = spec.chain.limits.T
    q = np.random.default_rng(0).uniform(low, high, (4000, 5))
    _, position, _ = spec.chain.forward(q)
    farthest = float(np.linalg.norm(position[:, :2], axis=1).max())
    assert 0.9 * farthest < spec.reach * 1.35 and spec.reach < farthest


def test_its_robot_does_its_task(env: Any) -> None:
    episode = run_episode(env, Expert(env), seed=0, record=True)
    assert episode.success, episode.reason
    kept = [int(info["kept_steps"][0]) for info in episode.records["info"]]
    done = [bool(info["success"][0]) for info in episode.records["info"]]
    assert kept[-1] == 10 and done == [k >= 10 for k in kept]
    first = kept.index(1)  # where `open` alone would have ended
    assert float(episode.records["info"][first]["progress"][0]) >= 1.0


def test_its_settings_terms_and_observations_are_the_environments(env: Any) -> None:
    _, info = env.reset(seed=0)
    names = [row[0] for row in env.unwrapped.observation_layout()]
    assert names[-1] == "extra/privileged/kept"
    *_, info = env.step(env.action_space.sample())
    assert "reward/keep" in info
    assert env.unwrapped.config.success.keep_steps == 10


def test_its_segmenter_gives_one_primitive_per_connected_surface() -> None:
    mesh = make_object("cabinet_one_door", 3).static
    run = articulate_mesh(mesh, config=EngineConfig(segmenter="connected"))
    assert run.used["segmenter"] == "connected" and run.primitives.method == "connected"
    assert run.primitives.count > 3 and len(run.primitives.labels) == len(mesh.faces)
    assert run.articulation.joints


def test_its_algorithm_learns_from_the_expert(drawer: Path, tmp_path: Path) -> None:
    learner = algorithm("nearest")
    choice = EnvChoice((str(drawer),), max_steps=120)
    info = learner.train(choice, learner.Config(episodes=6, neighbours=2), tmp_path)
    assert info.results["demonstrations"] == 6
    found = evaluate_run(tmp_path, 3)  # finds the algorithm by its name in run.json
    assert found.successes >= 2


def test_its_reader_reads_its_files_in_a_process_of_its_own(tmp_path: Path) -> None:
    file = tmp_path / "box.TRI"
    box = trimesh.creation.box((900, 500, 700))
    np.savetxt(file, box.triangles.reshape(-1, 9))
    got = load_mesh(file)
    assert kind_of(file) == "mesh" and len(got.mesh.faces) == 12
    assert np.ptp(got.mesh.bounds, axis=0) == pytest.approx([0.9, 0.5, 0.7])
    file.write_text("1 2 3\nfour\n")
    with pytest.raises(InputError, match=r"box\.TRI: every line needs nine numbers"):
        load_mesh(file)
    assert mesh_suffixes()[-1] == ".tri" and reader_of(".tri").apart(file)  # type: ignore[union-attr]


@pytest.mark.parametrize("page", ["robot", "task", "algorithm", "segmenter", "reader"])
def test_the_documents_show_its_code(page: str) -> None:
    text = (ROOT / "docs" / "extend" / f"{page}.md").read_text(encoding="utf-8")
    shown = re.findall(r'```\w+ title="(examples/plugin/[^"]+)"\n(.*?)```', text, flags=re.S)
    assert shown
    for file, code in shown:
        source = (ROOT / file).read_text(encoding="utf-8")
        for part in code.split("...\n"):  # where a page leaves something out
            assert part.strip() in source, f"{page}.md shows other code than {file}:\n{part}"
