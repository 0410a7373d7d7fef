"""A run folder from anybody: run.json and what lies beside it, of right and of any values."""

from __future__ import annotations

import io
import json
import os
import random
import shutil
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from safetensors.torch import save_file

from mam_envs.config import EnvConfig
from mam_pipeline.errors import InputError, MamSimError
from mam_policies.collection import Collection, Names
from mam_policies.mlp import MlpPolicy
from mam_policies.run import EnvChoice, RunInfo, held_out
from mam_sim.cli import main
from tests.pipeline.test_fuzz import changed, ours, replaced, usual

INFO = RunInfo(
    "bc", EnvChoice(("nowhere",)), [("agent/qpos", 0, 6, False), ("extra/value", 6, 7, True)],
    6, 5, {"seed": 1}, {"loss": 0.5},
)  # fmt: skip


def saved(folder: Path, **changes: Any) -> Path:
    """A run folder whose run.json has other values."""
    folder.mkdir(exist_ok=True)
    INFO.save(folder)
    file = folder / "run.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **changes}))
    return folder


def env(**changes: Any) -> dict[str, Any]:
    return {"env": {"assets": ["nowhere"], **changes}}


def test_run_pass(tmp_path: Path) -> None:
    assert RunInfo.load(saved(tmp_path)) == INFO
    replace(INFO, results={"loss": float("nan"), "each": [float("inf")]}).save(tmp_path)
    assert RunInfo.load(tmp_path).results == {"loss": None, "each": [None]}


RUN_FAIL: dict[str, Any] = {
    "a list": b"[]", "null": b"null", "a number": b"3", "text": b'"run"', "nothing": b"",
    "deep": b"[" * 100_000, "deep mapping": b'{"a":' * 100_000, "not UTF-8": b'{"a": "\xff"}',
    "nan": b'{"schema": NaN}', "twice": b'{"schema": 1, "schema": 1}', "huge": b" " * (33 << 20),
    "no environment": {"env": None}, "environment a list": {"env": []},
    "environment text": {"env": "panda"}, "schema": {"schema": 2}, "schema text": {"schema": "1"},
    "no algorithm": {"algo": None}, "algorithm elsewhere": {"algo": "../x"},
    "algorithm of a module": {"algo": "os:system"}, "a device": env(assets=["/dev/zero"]),
    "a file as asset": env(assets=[__file__]),
     "algorithm a list": {"algo": ["bc"]},
    "observation a number": {"observation": 3}, "observation null": {"observation": None},
    "a short row": {"observation": [["a", 0]]}, "a row of text": {"observation": ["abcd"]},
    "a row backwards": {"observation": [["a", 5, 2, False]]},
    "a row of nan": {"observation": [["a", "0", "x", 1]]},
    "action": {"action_dim": -1}, "action huge": {"action_dim": 10**12},
    "action text": {"action_dim": "6"}, "config a list": {"config": [1]},
    "results text": {"results": "x"}, "another key": {"hook": "os:system"},
    "robot": env(robot="os:system"), "robot a list": env(robot=[]), "robot path": env(robot="../x"),
    "task": env(task="os:system"), "task a list": env(task=["open"]), "task number": env(task=3),
    "control": env(control_mode="__class__"), "steps": env(max_steps=10**12),
    "steps text": env(max_steps="9"), "no asset": env(assets=[]), "asset text": env(assets="x"),
    "asset nul": env(assets=["a\0b"]), "assets": env(assets=["a"] * 20_000),
    "setting": env(config={"hook": "x"}), "setting type": env(config={"scene": {"wall": "x"}}),
    "picture elsewhere": env(config={"scene": {"background": "/etc/hostname"}}),
    "picture above": env(config={"scene": {"background": "../picture.png"}}),
    "camera": env(config={"scene": {"cameras": {"front": {"width": 10**9}}}}),
}  # fmt: skip


@pytest.mark.parametrize("case", RUN_FAIL)
def test_run_fail(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wrong = RUN_FAIL[case]
    folder = saved(tmp_path / "run", **(wrong if isinstance(wrong, dict) else {}))
    if isinstance(wrong, bytes):
        (folder / "run.json").write_bytes(wrong)
    with pytest.raises(MamSimError) as caught:
        RunInfo.load(folder)
    assert caught.value.exit_code == 2 and len(str(caught.value)) < 2000
    for words in (["eval", str(folder)], ["export", str(folder), "--out", str(tmp_path / "out")]):
        assert main(words) == 2
        said = capsys.readouterr().err
        assert said.startswith("mam-sim: ") and "Traceback" not in said
    assert not (tmp_path / "out").exists()


def test_run_json_that_is_no_file_fail(tmp_path: Path) -> None:
    folder = saved(tmp_path / "run")
    (folder / "run.json").rename(tmp_path / "elsewhere")
    (folder / "run.json").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="outside its folder") as caught:
        RunInfo.load(folder)
    assert "--allow-outside" not in str(caught.value)  # eval and export have no such flag
    (folder / "run.json").unlink()
    (folder / "run.json").mkdir()
    with pytest.raises(InputError, match="no ordinary file"):
        RunInfo.load(folder)


def test_a_picture_of_the_run_goes_with_it_pass(tmp_path: Path) -> None:
    picture = tmp_path / "wall.PNG"
    picture.write_bytes(b"picture")
    scene = replace(EnvConfig().scene, background=str(picture))
    config = replace(EnvConfig(), scene=scene)
    run = tmp_path / "run"
    run.mkdir()
    replace(INFO, env=replace(INFO.env, config=config)).save(run)
    picture.unlink()
    found = RunInfo.load(run)
    assert found.env.config.scene.background == str(run / "background.png")
    found.save(run)
    assert RunInfo.load(run) == found and (run / "background.png").read_bytes() == b"picture"


def test_split_pass(tmp_path: Path) -> None:
    (tmp_path / "split.json").write_text('{"train": ["a"], "held_out": ["b", "c"]}')
    assert held_out(tmp_path) == ("b", "c")


@pytest.mark.parametrize("content", [
    b"[]", b"null", b'{"held_out": ["a"]}', b'{"train": [], "held_out": "abc"}',
    b'{"train": [], "held_out": [1]}', b"[" * 100_000, b"\xff",
])  # fmt: skip
def test_split_fail(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "split.json").write_bytes(content)
    with pytest.raises(InputError):
        held_out(tmp_path)


SIZES = MlpPolicy(7, 6, 5, hidden=(4,)).sizes


def weights(folder: Path, sizes: Any) -> Path:
    """A policy whose header says other sizes than its weights have."""
    state = MlpPolicy(7, 6, 5, hidden=(4,)).state_dict()
    text = sizes if isinstance(sizes, str) else json.dumps(sizes)
    save_file(state, folder / "policy.safetensors", {"sizes": text})
    return folder


def test_weights_pass(tmp_path: Path) -> None:
    policy = MlpPolicy.load(weights(tmp_path, SIZES))
    assert policy.sizes == SIZES
    assert policy.actions(torch.zeros(1, 7), torch.zeros(1)).shape == (1, 1, 6)


@pytest.mark.parametrize("sizes", [
    [], None, "[" * 100_000, "NaN", {**SIZES, "hidden": [10**9]}, {**SIZES, "hidden": [99_999] * 9},
    {**SIZES, "hidden": 4}, {**SIZES, "obs_dim": "7"}, {**SIZES, "arm_joints": -1},
    {**SIZES, "inputs": [0, 1, 2, 3, 4, 5, 99]}, {**SIZES, "marks": [7]}, {**SIZES, "hook": "x"},
    {**SIZES, "squash": "os.system"}, {k: v for k, v in SIZES.items() if k != "obs_dim"},
])  # fmt: skip
def test_weights_fail(sizes: Any, tmp_path: Path) -> None:
    with pytest.raises(MamSimError) as caught:
        MlpPolicy.load(weights(tmp_path, sizes))
    assert caught.value.exit_code == 2 and "\n" not in str(caught.value)


@usual
@given(seed=st.integers(0, 2**32))
def test_a_run_of_any_values(seed: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    rng, folder = random.Random(seed), saved(tmp_path_factory.getbasetemp() / "fuzz_run")
    file = folder / "run.json"
    data = json.dumps(replaced(json.loads(file.read_text()), rng)).encode()
    file.write_bytes(changed(data, rng) if rng.random() < 0.5 else data)
    ours(lambda: RunInfo.load(folder))


@usual
@given(seed=st.integers(0, 2**32))
def test_weights_of_any_sizes(seed: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    rng, folder = random.Random(seed), tmp_path_factory.getbasetemp() / "fuzz_weights"
    folder.mkdir(exist_ok=True)
    weights(folder, replaced(SIZES, rng))
    file = folder / "policy.safetensors"
    if rng.random() < 0.5:
        file.write_bytes(changed(file.read_bytes(), rng))
    ours(lambda: MlpPolicy.load(folder))


def collected(folder: Path, claim: bytes, names: bytes) -> Path:
    """A folder of demonstrations as far as its two claims go."""
    (folder / "attempts").mkdir(parents=True)
    (folder / "collect.json").write_bytes(claim)
    (folder / "attempts" / "names.json").write_bytes(names)
    return folder


CLAIM, NAMES = (
    b'{"collect": {}, "env": {}, "asset": "a"}',
    b'{"state": ["q"], "action": ["q"], "environment": []}',
)
OUTCOME: dict[str, Any] = {
    "seed": 0, "success": True, "steps": 2, "joint": "j", "task": "open", "reason": ""
}  # fmt: skip
FRAMES: dict[str, Any] = {
    "targets": np.zeros((2, 1)), "obs/state": np.zeros((3, 4)), "rewards": np.zeros(2),
    "images/front": np.zeros((3, 4, 4, 3), np.uint8),
}  # fmt: skip


def attempted(folder: Path, outcome: Any = OUTCOME, **frames: Any) -> Path:
    """A collection of one attempt; `frames` go in place of the usual ones."""
    collected(folder, CLAIM, NAMES)
    data = outcome if isinstance(outcome, bytes) else json.dumps(outcome).encode()
    (folder / "attempts" / "000000.json").write_bytes(data)
    np.savez_compressed(folder / "attempts" / "000000.npz", **{**FRAMES, **frames})
    return folder


def test_collection_pass(tmp_path: Path) -> None:
    found = Collection.load(attempted(tmp_path / "c"))
    assert found.names == Names(("q",), ("q",), ())
    ((track, rewards),) = found.tracks()
    assert track.state.shape == (2, 1) and track.images["front"].shape == (2, 4, 4, 3)
    assert track.success and len(rewards) == 2


@pytest.mark.parametrize(("claim", "names"), [
    (b"[]", NAMES), (b"{}", NAMES), (b'{"collect": [], "env": {}, "asset": "a"}', NAMES),
    (b'{"collect": {}, "env": 3, "asset": "a"}', NAMES), (CLAIM, b"[]"), (CLAIM, b"{}"),
    (CLAIM, b'{"state": 3}'), (b"\xff", NAMES),
])  # fmt: skip
def test_collection_fail(claim: bytes, names: bytes, tmp_path: Path) -> None:
    with pytest.raises(MamSimError) as caught:
        print(Collection.load(collected(tmp_path / "c", claim, names)).names)
    assert caught.value.exit_code == 2


ATTEMPT_FAIL: dict[str, Any] = {
    "a list": {"outcome": []}, "null": {"outcome": None}, "text": {"outcome": b"hello"},
    "deep": {"outcome": b"[" * 100_000}, "not UTF-8": {"outcome": b"\xff"},
    "success text": {"outcome": {**OUTCOME, "success": "yes"}},
    "seed text": {"outcome": {**OUTCOME, "seed": "0"}},
    "no task": {"outcome": {k: v for k, v in OUTCOME.items() if k != "task"}},
    "another key": {"outcome": {**OUTCOME, "hook": "os:system"}},
    "a program": {"targets": np.array([[len]], dtype=object)},
    "words": {"targets": np.array([["a"], ["b"]])}, "one number": {"targets": np.zeros(())},
    "nan": {"targets": np.full((2, 1), np.nan)}, "wide": {"targets": np.zeros((2, 9))},
    "few states": {"obs/state": np.zeros((1, 4))}, "no states": {"obs/state": np.zeros((3, 0))},
    "rewards": {"rewards": np.zeros((5, 5))}, "pictures": {"images/front": np.zeros((3, 4, 4, 3))},
}  # fmt: skip


@pytest.mark.parametrize("case", ATTEMPT_FAIL)
def test_attempt_fail(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = attempted(tmp_path / "c", **ATTEMPT_FAIL[case])
    with pytest.raises(InputError, match="000000"):
        list(Collection.load(folder).tracks())
    assert main(["export", str(folder), "--out", str(tmp_path / "out"), "--quiet"]) == 2
    said = capsys.readouterr().err
    assert said.count("mam-sim: ") == 1 and "Traceback" not in said
    assert not (tmp_path / "out").exists()


def test_attempt_that_claims_more_than_it_holds_fail(tmp_path: Path) -> None:
    folder = attempted(tmp_path / "c")
    file = folder / "attempts" / "000000.npz"
    head = io.BytesIO()
    shape = {"descr": "<f8", "fortran_order": False, "shape": (10**12, 1)}
    np.lib.format.write_array_header_1_0(head, shape)
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("targets.npy", head.getvalue())
    with pytest.raises(InputError, match="claims 1000000000000 entries"):
        list(Collection.load(folder).tracks())
    file.unlink()
    os.mkfifo(file)
    with pytest.raises(InputError, match="no ordinary file"):
        list(Collection.load(folder).tracks())


@usual
@given(seed=st.integers(0, 2**32))
def test_a_collection_of_any_values(seed: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    rng, folder = random.Random(seed), tmp_path_factory.getbasetemp() / "fuzz_collection"
    shutil.rmtree(folder, ignore_errors=True)
    attempted(folder)
    file = folder / rng.choice(["collect.json", *(f"attempts/{n}" for n in (
        "names.json", "000000.json", "000000.npz"))])  # fmt: skip
    data = file.read_bytes()
    if file.suffix == ".json" and rng.random() < 0.5:
        data = json.dumps(replaced(json.loads(data), rng)).encode()
    file.write_bytes(changed(data, rng))
    ours(lambda: list(Collection.load(folder).tracks()))
