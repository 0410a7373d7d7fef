"""A file from a stranger executes nothing: poisoned checkpoints, weights, zips."""

from __future__ import annotations

import io
import json
import pickle
import zipfile
from pathlib import Path

import pytest
import torch

from mam_pipeline.errors import ConfigError, InputError
from mam_policies.algorithms.bc import BcConfig, fit
from mam_policies.algorithms.sb3_checkpoint import load_checkpoint
from mam_policies.algorithms.sb3_zip import algorithm_of, load_sb3
from mam_policies.demonstrations import Demonstration
from mam_policies.evaluate import evaluate_zip
from mam_policies.mlp import MlpPolicy
from mam_policies.run import EnvChoice
from mam_sim.cli import main as mam_sim


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
    with pytest.raises(InputError, match="not a policy"):
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
