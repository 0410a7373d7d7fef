"""The Python interface, from a mesh to an environment, on one small object."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import mam_sim
import mam_world as world
from mam_pipeline import config_file
from mam_pipeline.asset.card import Asset
from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.formats.mesh_files import save_glb
from mam_sim.cli import verb_class
from mam_sim.options import parse

pytestmark = pytest.mark.sim


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Asset:
    folder = tmp_path_factory.mktemp("api")
    save_glb(world.make_object("chest", 3, world.Style()).static, folder / "chest.glb")
    hints = folder / "hints.yaml"
    hints.write_text("parts: [{name: drawer, primitives: [1], joint: {subtype: slide}}]\n")
    return mam_sim.make_asset(folder / "chest.glb", folder / "chest", height=0.9, hints=hints)


def test_a_mesh_becomes_an_asset_that_passes(made: Asset) -> None:
    low, high = np.asarray(made.card.bounds)
    assert high[2] - low[2] == pytest.approx(0.9, abs=0.02)
    report = mam_sim.check(made)
    assert report.passed and [j.name for j in report.joints] == [j.name for j in made.card.joints]


def test_an_environment_steps_with_the_settings_that_were_given(made: Asset) -> None:
    joint = made.card.joints[0].name
    env = mam_sim.make_env(made, joint, config={"reward": {"reach": 0.0}}, obs_mode="state")
    try:
        env.reset(seed=0)
        _, reward, *_ = env.step(env.action_space.sample())
        assert np.isfinite(np.asarray(reward, dtype=float)).all()
        assert env.unwrapped.config.reward.reach == 0.0
        assert env.unwrapped.layout().goals[0].joint == joint
    finally:
        env.close()


def test_the_settings_lie_beside_the_asset_and_make_it_again(made: Asset, tmp_path: Path) -> None:
    file = made.folder / "stages" / "config.yaml"
    args = ["x.glb", "--out", "a", "--config", str(file)]
    got = parse(verb_class("articulate"), "mam-sim articulate", args)
    assert got.pipeline.height == 0.9  # type: ignore[attr-defined]
    assert config_file.plain({"pipeline": got.pipeline}) == config_file.read(file)  # type: ignore[attr-defined]


def test_wrong_settings_and_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="make_asset: there is no setting 'heigth'"):
        mam_sim.make_asset(tmp_path / "a.glb", tmp_path / "a", heigth=1)
    with pytest.raises(InputError, match="no such file"):
        mam_sim.make_asset(tmp_path / "a.glb", tmp_path / "a")
    with pytest.raises(AttributeError, match="no attribute 'mak_asset'"):
        _ = mam_sim.mak_asset


def test_the_import_is_light() -> None:
    code = "import sys, mam_sim; print([m for m in ('numpy', 'torch', 'tyro') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
