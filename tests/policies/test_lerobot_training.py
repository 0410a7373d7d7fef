"""LeRobot's own learners on our demonstrations: trained, resumed, evaluated, exported, run."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

os.environ["HF_HUB_OFFLINE"] = "1"  # before LeRobot is imported

from mam_envs.scene.vulkan import vulkan_ok
from mam_pipeline.errors import ConfigError
from mam_policies.algorithms.lerobot_policies import Act, Diffusion, LeRobotConfig, SmolVla
from mam_policies.evaluate import evaluate_run
from mam_policies.lerobot.export import export_run
from mam_policies.lerobot.export_readme import rolls_out
from mam_policies.run import EnvChoice, RunInfo
from tests.policies.lerobot_commands import run_readme

SMALL = {
    "act": (
        "--policy.dim_model=32", "--policy.n_heads=2", "--policy.dim_feedforward=32",
        "--policy.n_encoder_layers=1", "--policy.chunk_size=8", "--policy.n_action_steps=8",
    ),
    "diffusion": (
        "--policy.down_dims=[16,32]", "--policy.diffusion_step_embed_dim=16",
        "--policy.num_train_timesteps=4", "--policy.horizon=8", "--policy.n_action_steps=4",
        "--policy.crop_shape=null", "--policy.drop_n_last_frames=1",
    ),
}  # fmt: skip


def test_smolvla_says_that_it_needs_weights(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--download"):
        SmolVla().train(EnvChoice(("nowhere",)), LeRobotConfig(), tmp_path)


@pytest.mark.slow  # LeRobot's training, three times
def test_diffusion_on_the_privileged_state_with_a_round(drawer: Path, tmp_path: Path) -> None:
    """Two steps, then the policy acts, then two more on demonstrations and its own episode."""
    choice = EnvChoice((str(drawer),), max_steps=100)
    config = LeRobotConfig(
        steps=2, batch=2, episodes=1, cameras=False, rounds=1, round_episodes=1,
        more=SMALL["diffusion"],
    )  # fmt: skip
    info = Diffusion().train(choice, config, tmp_path)
    assert info.algo == "diffusion" and RunInfo.load(tmp_path).results["demonstrations"] == 1
    left = [p.name for p in (tmp_path / "lerobot" / "checkpoints").glob("[0-9]*")]
    assert [int(name) for name in left] == [2]  # of two, which are gigabytes each in earnest
    both = json.loads((tmp_path / "data_1" / "meta" / "info.json").read_text())
    assert both["total_episodes"] == 2
    features = json.loads((tmp_path / "policy" / "config.json").read_text())["input_features"]
    assert set(features) == {"observation.state", "observation.environment_state"}

    # the same command goes on: from the last checkpoint where more steps are asked for
    kept = (tmp_path / "demos" / "attempts" / "000000.npz").read_bytes()
    Diffusion().train(choice, replace(config, rounds=0), tmp_path)
    assert (tmp_path / "demos" / "attempts" / "000000.npz").read_bytes() == kept

    export_run(tmp_path, tmp_path / "out")
    assert "no real arm can run" in (tmp_path / "out" / "README.md").read_text()


@pytest.mark.slow  # pictures on a CPU, and LeRobot's training
@pytest.mark.skipif(not vulkan_ok(), reason="cameras need a Vulkan driver")
def test_act_sees_cameras_and_motors_only(
    drawer: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("lerobot_robot_mam_sim", reason="scripts/setup.sh installs the plug-ins")
    choice = EnvChoice((str(drawer),), max_steps=100)
    config = LeRobotConfig(steps=1, batch=1, episodes=1, more=SMALL["act"])
    run, out = tmp_path / "run", tmp_path / "out"
    Act().train(choice, config, run)
    features = json.loads((run / "policy" / "config.json").read_text())["input_features"]
    assert set(features) == {"observation.state", "observation.images.front"}
    saved = RunInfo.load(run)
    replace(saved, env=replace(choice, max_steps=3)).save(run)
    assert evaluate_run(run, 1).episodes == 1

    export_run(run, out)
    readme = (out / "README.md").read_text()
    assert "--robot.pictures=true" in readme and "`front` 128 x 128" in readme
    run_readme(
        monkeypatch, out, "eval", tmp_path, "--policy.device=cpu", "--env.episode_length=3",
        "--eval.n_episodes=1", "--output_dir=eval",
    )  # fmt: skip
    found = json.loads((tmp_path / "eval" / "eval_info.json").read_text())
    assert found["overall"]["n_episodes"] == 1
    run_readme(
        monkeypatch, out, "rollout" if rolls_out() else "record", tmp_path, "--policy.device=cpu",
        "--dataset.num_episodes=1", "--dataset.episode_time_s=2",
    )  # fmt: skip
    assert json.loads((tmp_path / "episodes.jsonl").read_text().splitlines()[0])["steps"] > 0
