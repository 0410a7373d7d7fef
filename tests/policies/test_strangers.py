"""A file from a stranger executes nothing: poisoned checkpoints, weights, zips."""

from __future__ import annotations

import io
import json
import os
import pickle
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest
import torch

from mam_pipeline.errors import ConfigError, InputError
from mam_policies.algorithms.bc import BcConfig, fit
from mam_policies.algorithms.sb3_checkpoint import load_checkpoint
from mam_policies.algorithms.sb3_zip import algorithm_of, load_sb3
from mam_policies.demonstrations import Demonstration
from mam_policies.evaluate import evaluate_zip
from mam_policies.mlp import MlpPolicy
from mam_policies.run import EnvChoice, RunInfo
from mam_sim.cli import main as mam_sim
from tests.pipeline.test_folder_data import BEFORE, CONFIG, NORMAL, written


class Poison:
    """Creates a file when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return Path.touch, (self.mark,)  # type: ignore[return-value]


def test_the_poison_works(tmp_path: Path) -> None:
    pickle.loads(pickle.dumps(Poison(tmp_path / "mark")))
    assert (tmp_path / "mark").exists()


def test_poisoned_checkpoints_are_refused(tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    state = {"steps": 1, "policy": {}, "parameters": Poison(mark)}
    torch.save(state, tmp_path / "last.pt")
    with pytest.raises(InputError, match="not a checkpoint"):
        load_checkpoint(tmp_path)
    demo = Demonstration(torch.zeros(5, 6).numpy(), torch.zeros(5, 3).numpy())
    with pytest.raises(InputError, match="not a checkpoint"):
        fit(MlpPolicy(6, 3, 2, hidden=(4,)), [demo], BcConfig(epochs=1), tmp_path)
    assert not mark.exists()


def test_poisoned_weights_are_refused(tmp_path: Path) -> None:
    torch.save(Poison(tmp_path / "mark"), tmp_path / "policy.safetensors")
    with pytest.raises(InputError, match="no file of weights"):
        MlpPolicy.load(tmp_path)
    assert not (tmp_path / "mark").exists()


def _zip(file: Path, mark: Path) -> Path:
    """What SB3's save() writes, with a pickle in it that runs code."""
    rest = io.BytesIO()
    torch.save(Poison(mark), rest)
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("data", json.dumps({"n_epochs": 10, "policy_class": {":type:": "x"}}))
        archive.writestr("policy.pth", rest.getvalue())
    return file


def test_zips_need_the_flag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = _zip(tmp_path / "model.zip", tmp_path / "mark")
    assert algorithm_of(file) == "PPO"
    with pytest.raises(ConfigError, match="--trust"):
        load_sb3(file, trust=False)
    with pytest.raises(ConfigError, match="--trust"):
        evaluate_zip(file, EnvChoice(("nowhere",)))
    assert mam_sim(["eval", str(file)]) == 2
    assert "--asset" in capsys.readouterr().err
    assert not (tmp_path / "mark").exists()


def test_other_files_are_named(tmp_path: Path) -> None:
    file = tmp_path / "model.zip"
    file.write_bytes(b"no zip")
    with pytest.raises(InputError, match="no zip of stable-baselines3"):
        algorithm_of(file)


def _stranger(folder: Path, asset: Path, mark: Path, **run: object) -> Path:
    """A run of LeRobot's act whose files wish to run a program that makes `mark`."""
    choice = EnvChoice((str(asset),), max_steps=20)
    RunInfo("act", choice, [("agent/qpos", 0, 9, False)], 8, 7).save(folder)
    file = folder / "run.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **run}))
    program = [sys.executable, "-c", f"open({str(mark)!r}, 'w')"]
    step = {"class": "subprocess.Popen", "config": {"args": program}}
    wish = {"type": "gym_manipulator", "discover_packages_path": "foreign"}
    (folder / "foreign.py").write_text(f"open({str(mark)!r}, 'w')\n")
    written(
        folder / "policy", policy_preprocessor={**BEFORE, "steps": [step]},
        train_config={"env": wish, "policy": {"type": "foreign", "_target_": "foreign.main"}},
    )  # fmt: skip
    return folder


@pytest.mark.parametrize(("run", "words"), [
    ({}, "wishes 'subprocess.Popen' to be run; a policy folder may name: "),
    ({"algo": "../x"}, "no algorithm named '../x'"),
    ({"env": {"assets": ["/dev/zero"]}}, "must name an asset folder, which '/dev/zero' is not"),
])  # fmt: skip
@pytest.mark.parametrize("verb", ["eval", "export"])
def test_a_stranger_s_run_does_nothing(
    verb: str, run: dict[str, object], words: str, drawer: Path, tmp_path: Path
) -> None:
    """The command line itself: one sentence, status 2, and no file anywhere that was not there."""
    folder, mark = tmp_path / "run", tmp_path / "mark"
    folder.mkdir()
    _stranger(folder, drawer, mark, **run)
    before = sorted(tmp_path.rglob("*"))
    more = ["--out", str(tmp_path / "out.json" if verb == "eval" else tmp_path / "out")]
    done = subprocess.run(
        [sys.executable, "-m", "mam_sim.cli", verb, str(folder), *more, "--quiet"],
        capture_output=True, text=True, timeout=120, cwd=folder,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
    )  # fmt: skip
    said = [line for line in done.stderr.splitlines() if line.startswith("mam-sim: ")]
    assert done.returncode == 2 and len(said) == 1 and words in said[0], done.stderr
    assert not mark.exists() and sorted(tmp_path.rglob("*")) == before


UPWARDS = {"registry_name": "normalizer_processor", "config": NORMAL, "state_file": "../x.pt"}
FOLDERS: dict[str, tuple[dict[str, Any], str]] = {
    "a class": ({"policy_preprocessor": {**BEFORE, "steps": [{"class": "subprocess.Popen"}]}},
                "wishes 'subprocess.Popen' to be run"),
    "a path upwards": ({"policy_postprocessor": {"steps": [UPWARDS]}}, "beside it, not '../x.pt'"),
    "a model elsewhere": ({"config": {**CONFIG, "pretrained_path": "../x"}}, "wishes '../x'"),
    "a type of list": ({"config": {**CONFIG, "type": ["act"]}}, "type must be one of"),
    "inputs of list": ({"config": {**CONFIG, "input_features": [1]}}, "input_features must hold"),
    "a pickle": ({}, "model.safetensors is no file of weights"),
}  # fmt: skip


@pytest.mark.parametrize("case", FOLDERS)
def test_a_stranger_s_policy_folder_does_nothing(
    case: str, drawer: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A bare folder of LeRobot, given to every verb that takes a policy."""
    files, words = FOLDERS[case]
    folder, mark = str(written(tmp_path / "policy", **files)), tmp_path / "mark"
    if case == "a pickle":
        (tmp_path / "policy" / "model.safetensors").write_bytes(pickle.dumps(Poison(mark)))
    before = sorted(tmp_path.rglob("*"))
    out, setup = str(tmp_path / "out"), ["--setup", str(tmp_path / "setup")]
    for line in (
        ["eval", folder, "--asset", str(drawer), "--episodes", "1"],
        ["export", folder, "--out", out], ["export", folder, "--to", "lerobot", "--out", out],
        ["deploy", folder, *setup, "--hold-key", "never"], ["perceive", folder, *setup],
        ["calibrate", folder, *setup], ["park", folder, *setup, "--hold-key", "never"],
    ):  # fmt: skip
        assert mam_sim(line) == 2
        said = capsys.readouterr().err.splitlines()
        assert len(said) == 1 and said[0].startswith("mam-sim: "), line
        assert line[0] != "eval" or words in said[0]
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.slow  # starts the simulator and LeRobot
@pytest.mark.parametrize(("sizes", "words"), [
    ({"observation.state": (6,)}, r"observation.state of (6,), which is (9,) here"),
    ({"observation.images.wrist": (3, 24, 32)}, r"which is missing here"),
    ({"action": (6,)}, r"action of (6,), which is (8,) here"),
])  # fmt: skip
def test_a_policy_of_another_robot_is_refused(
    sizes: dict[str, tuple[int, ...]], words: str, drawer: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    from lerobot.configs.types import FeatureType, PolicyFeature
    from lerobot.policies.act.configuration_act import ACTConfig
    from lerobot.policies.act.modeling_act import ACTPolicy
    from lerobot.policies.factory import make_pre_post_processors

    kinds = {"action": FeatureType.ACTION, "observation.state": FeatureType.STATE,
             "observation.environment_state": FeatureType.ENV}  # fmt: skip
    ours = {"action": (8,), "observation.state": (9,), "observation.environment_state": (12,)}
    features = {
        name: PolicyFeature(kinds.get(name, FeatureType.VISUAL), shape)
        for name, shape in {**ours, **sizes}.items()
    }
    tiny: Any = {
        "dim_model": 16, "n_heads": 2, "dim_feedforward": 16, "latent_dim": 4, "chunk_size": 4,
        "n_action_steps": 4, "n_encoder_layers": 1, "n_vae_encoder_layers": 1, "device": "cpu",
        "pretrained_backbone_weights": None,
    }  # fmt: skip
    output = {"action": features.pop("action")}
    config = ACTConfig(input_features=features, output_features=output, **tiny)
    ACTPolicy(config).save_pretrained(tmp_path)
    for pipeline in make_pre_post_processors(config):
        pipeline.save_pretrained(tmp_path)
    assert mam_sim(["eval", str(tmp_path), "--asset", str(drawer), "--episodes", "1"]) == 2
    assert words in capsys.readouterr().err
