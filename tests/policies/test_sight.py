"""Telling from a picture where an object stands, and acting on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

import mam_envs
from mam_envs.config import EnvConfig
from mam_envs.scene.vulkan import vulkan_ok
from mam_pipeline.errors import ConfigError, InputError
from mam_policies.sight.network import FILE, SightNetwork, elsewhere, fit
from mam_policies.sight.pictures import place_of, pose_at


def _squares(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Pictures of a bright square on noise, and where it is."""
    rng = np.random.default_rng(seed)
    pictures = rng.integers(0, 90, (count, 64, 80, 3), dtype=np.uint8)
    at = rng.integers(4, 52, (count, 2))
    for picture, (row, column) in zip(pictures, at):
        picture[row : row + 8, column : column + 8] = 255
    return pictures, at.astype(np.float32)


def test_the_network_learns_places_and_is_kept(tmp_path: Path) -> None:
    pictures, at = _squares(300, 0)
    network = SightNetwork((64, 80), 1, 2)
    frozen = network.kernels["stem"].clone()
    fit(network, pictures, np.zeros((300, 1), np.float32), at, 12, 0)
    assert torch.equal(network.kernels["stem"], frozen)
    network.save(tmp_path)
    shown, where = _squares(40, 1)
    with torch.no_grad():
        told = SightNetwork.load(tmp_path).tell(torch.from_numpy(shown), torch.zeros(40, 1))
    error = np.abs(told.numpy() - where)
    assert np.median(error) < 0.25 * np.median(np.abs(where - at.mean(axis=0)))
    (tmp_path / FILE).write_bytes(b"no")
    with pytest.raises(InputError, match="no file of weights"):
        SightNetwork.load(tmp_path)


def test_backgrounds_change_and_what_is_kept_stays() -> None:
    pictures, _ = _squares(40, 2)
    kept = pictures.min(axis=3) == 255
    moved = elsewhere(pictures, kept, np.random.default_rng(0))
    assert np.array_equal(moved[kept], pictures[kept])
    changed = [np.mean(a != b) > 0.5 for a, b in zip(moved, pictures)]
    assert 25 < sum(changed) < 40  # most, not all


def test_a_place_is_three_numbers(drawer: Path) -> None:
    env = mam_envs.make(drawer)
    env.reset(seed=4)
    layout, pose = env.unwrapped.layout(0), env.unwrapped.planner_state().world_asset
    assert np.abs(place_of(layout, pose)[:2]).max() > 1e-4
    np.testing.assert_allclose(pose_at(layout, place_of(layout, pose)), pose, atol=1e-6)
    env.close()


@pytest.mark.slow
@pytest.mark.display
@pytest.mark.skipif(not vulkan_ok(), reason="cameras need a Vulkan driver")
def test_a_clone_acts_on_pictures(drawer: Path, tmp_path: Path) -> None:
    from mam_policies.algorithms import algorithm
    from mam_policies.evaluate import evaluate_run
    from mam_policies.run import EnvChoice
    from mam_policies.settings import BcRgbConfig

    chance = {"backgrounds": 1.0, "colour": 0.5}
    small = {"cameras": {"front": {"width": 64, "height": 64}}}
    settings = EnvConfig.make({"randomisation": chance, "scene": small})
    choice, run = EnvChoice((str(drawer),), max_steps=120, config=settings), tmp_path / "run"
    config = BcRgbConfig(episodes=2, epochs=1, pictures=20, sight_epochs=1)
    info = algorithm("bc_rgb").train(choice, config, run)
    assert info.algo == "bc_rgb" and info.results["pictures"] == 20
    again = algorithm("bc_rgb").train(choice, config, run)  # from what is there
    assert again.results["sight_loss"] == pytest.approx(info.results["sight_loss"], rel=1e-3)
    found = evaluate_run(run, 1)
    assert found.episodes == 1 and found.each[0].steps > 1
    with pytest.raises(ConfigError, match="one asset at a time"):
        algorithm("bc_rgb").train(EnvChoice((str(drawer), str(drawer))), config, tmp_path / "two")
