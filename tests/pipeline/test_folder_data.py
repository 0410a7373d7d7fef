"""A folder from anybody is data: what its files may say (`..._pass`) and may not (`..._fail`)."""

from __future__ import annotations

import copy
import json
import os
import pickle
import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from mam_pipeline import config_file
from mam_pipeline.errors import ConfigError, InputError, MamSimError
from mam_pipeline.folder_data import (
    asset_settings,
    dataset_folder,
    policy_folder,
    training_settings,
    weights,
)
from mam_pipeline.make_config import EngineConfig, MakeConfig
from mam_pipeline.models.settings import ModelConfig
from tests.pipeline.test_fuzz import changed, ours, replaced, usual

SHAPE = {"type": "STATE", "shape": [9]}
CONFIG: dict[str, Any] = {
    "type": "act", "input_features": {"observation.state": SHAPE},
    "output_features": {"action": {"type": "ACTION", "shape": [8]}}, "device": "cpu",
    "use_peft": False, "push_to_hub": False, "repo_id": None, "pretrained_path": None,
    "normalization_mapping": {"STATE": "MEAN_STD"}, "vision_backbone": "resnet18",
    "pretrained_backbone_weights": None, "dim_model": 16, "n_encoder_layers": 4,
    "feedforward_activation": "relu", "optimizer_lr": 1e-5,
}  # fmt: skip
NORMAL = {"eps": 1e-8, "features": {"action": SHAPE}, "norm_map": {"STATE": "MEAN_STD"}}
BEFORE: dict[str, Any] = {
    "name": "policy_preprocessor",
    "steps": [
        {"registry_name": "rename_observations_processor", "config": {"rename_map": {}}},
        {"registry_name": "device_processor", "config": {"device": "cpu", "float_dtype": None}},
        {"registry_name": "normalizer_processor", "config": NORMAL,
         "state_file": "before.safetensors"},
    ],
}  # fmt: skip
AFTER: dict[str, Any] = {
    "name": "policy_postprocessor",
    "steps": [{"registry_name": "unnormalizer_processor", "config": NORMAL}],
}
NO_WEIGHTS = (2).to_bytes(8, "little") + b"{}"
"""A file of weights that holds none."""


def written(folder: Path, **files: Any) -> Path:
    """A policy folder; `files` by name without suffix go in place of the usual ones."""
    folder.mkdir(exist_ok=True)
    for name in ("model", "before"):
        (folder / f"{name}.safetensors").write_bytes(NO_WEIGHTS)
    usual = {"config": CONFIG, "policy_preprocessor": BEFORE, "policy_postprocessor": AFTER}
    for name, content in {**usual, **files}.items():
        data = content if isinstance(content, bytes) else json.dumps(content).encode()
        (folder / f"{name}.json").write_bytes(data)
    return folder


def test_policy_pass(tmp_path: Path) -> None:
    found = policy_folder(written(tmp_path / "policy"))
    assert found.kind == "act" and "before.safetensors" in found.files
    (tmp_path / "policy" / "train_config.json").write_text("{}")
    (tmp_path / "policy" / "handler.py").write_text("")
    assert policy_folder(tmp_path / "policy").files == found.files  # only what was looked at


def _step(**step: Any) -> dict[str, Any]:
    return {**BEFORE, "steps": [*BEFORE["steps"], step]}


STEPS_FAIL: dict[str, tuple[Any, str]] = {
    "class": (_step(**{"class": "subprocess.Popen", "config": {"args": "x"}}), "subprocess.Popen"),
    "class and name": (_step(**{"registry_name": "device_processor", "class": "os.system"}),
                       "os.system"),
    "unlisted": (_step(registry_name="reward_classifier_processor"), "reward_classifier"),
    "plug-in": (_step(registry_name="my_plugin_step"), "my_plugin_step"),
    "no name": (_step(config={}), "None"),
    "name no text": (_step(registry_name=["device_processor"]), "device_processor"),
    "path up": (_step(registry_name="normalizer_processor", state_file="../x.safetensors"),
                "beside it"),
    "absolute": (_step(registry_name="normalizer_processor", state_file="/x.safetensors"),
                 "beside it"),
    "pickle": (_step(registry_name="normalizer_processor", state_file="x.pt"), "beside it"),
    "not there": (_step(registry_name="normalizer_processor", state_file="x.safetensors"),
                  "holds no x.safetensors"),
    "tokenizer": (_step(registry_name="tokenizer_processor",
                        config={"tokenizer_name": "evil/model"}), "evil/model"),
    "tokenizer here": (_step(registry_name="tokenizer_processor",
                             config={"tokenizer_name": "./folder"}), "folder"),
    "remote code": (_step(registry_name="tokenizer_processor",
                          config={"tokenizer_name": "x", "trust_remote_code": True}),
                    "trust_remote_code"),
    "setting": (_step(registry_name="to_batch_processor", config={"callback": "x"}), "callback"),
    "device": (_step(registry_name="device_processor", config={"device": "meta"}), "device"),
    "more keys": (_step(registry_name="to_batch_processor", module="os"), "module"),
    "hooks": ({**BEFORE, "before_step_hooks": ["os.system"]}, "before_step_hooks"),
    "a list": ([], "steps"),
    "null": (None, "steps"),
    "steps a mapping": ({"steps": {}}, "steps"),
    "a step of text": ({"steps": ["device_processor"]}, "step"),
    "many": ({"steps": [{"registry_name": "to_batch_processor"}] * 1000}, "at most"),
    "not UTF-8": (b'{"steps": "\xff"}', "UTF-8"),
    "deep": (b"[" * 100_000, "nested too deep"),
    "twice": (b'{"steps": [], "steps": []}', "twice"),
}  # fmt: skip


@pytest.mark.parametrize("case", STEPS_FAIL)
@pytest.mark.parametrize("part", ["policy_preprocessor", "policy_postprocessor"])
def test_pipeline_fail(part: str, case: str, tmp_path: Path) -> None:
    content, words = STEPS_FAIL[case]
    with pytest.raises(InputError, match=words) as caught:
        policy_folder(written(tmp_path / "policy", **{part: content}))
    assert caught.value.exit_code == 2 and len(str(caught.value)) < 2000


CONFIG_FAIL: dict[str, tuple[Any, str]] = {
    "type": ({**CONFIG, "type": "groot"}, "groot"),
    "type of ours in a list": ({**CONFIG, "type": ["act"]}, "type"),
    "weights elsewhere": ({**CONFIG, "pretrained_path": "/home/x/model"}, "pretrained_path"),
    "weights of the Hub": ({**CONFIG, "pretrained_path": "evil/model"}, "pretrained_path"),
    "torchvision": ({**CONFIG, "pretrained_backbone_weights": "https://x/y"}, "https"),
    "backbone": ({**CONFIG, "vision_backbone": "resnet18.__class__"}, "vision_backbone"),
    "language model": ({**CONFIG, "type": "smolvla", "vlm_model_name": "evil/vlm"}, "evil/vlm"),
    "language model here": ({**CONFIG, "type": "smolvla", "vlm_model_name": "../vlm"}, "vlm"),
    "adapters": ({**CONFIG, "use_peft": True}, "adapters"),
    "another key": ({**CONFIG, "auto_map": {"AutoConfig": "evil.Config"}}, "evil.Config"),
    "target": ({**CONFIG, "_target_": "os.system"}, "os.system"),
    "activation": ({**CONFIG, "feedforward_activation": "eval"}, "eval"),
    "normal": ({**CONFIG, "normalization_mapping": {"STATE": "__import__"}}, "__import__"),
    "huge": ({**CONFIG, "dim_model": 10**12}, "from 1 to 100000"),
    "negative": ({**CONFIG, "chunk_size": -5}, "from 1 to 100000, not -5"),
    "no size": ({**CONFIG, "n_heads": 0}, "from 1 to"),
    "layers": ({**CONFIG, "n_encoder_layers": 10**5}, "from 0 to 128"),
    "negative layers": ({**CONFIG, "n_encoder_layers": -1}, "from 0 to 128"),
    "a list": ([CONFIG], "names and values"),
    "null": (None, "names and values"),
    "nan": (b'{"type": "act", "dropout": NaN}', "NaN"),
    "deep": (b'{"a":' * 50_000, "nested too deep"),
}  # fmt: skip


@pytest.mark.parametrize("case", CONFIG_FAIL)
def test_config_fail(case: str, tmp_path: Path) -> None:
    content, words = CONFIG_FAIL[case]
    with pytest.raises(InputError, match=words):
        policy_folder(written(tmp_path / "policy", config=content))


def test_a_folder_that_is_named_as_a_known_model_fail(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "HuggingFaceTB/SmolVLM2-500M-Video-Instruct"
    config = {**CONFIG, "type": "smolvla", "vlm_model_name": name}
    policy = written(tmp_path / "policy", config=config)
    monkeypatch.chdir(tmp_path)
    assert policy_folder(policy).kind == "smolvla"
    (tmp_path / name).mkdir(parents=True)
    with pytest.raises(InputError, match="a folder here has that name"):
        policy_folder(policy)


ONE = b'{"a": {"dtype": "F32", "shape": [1], "data_offsets": [0, 4]}}'
HUGE = ONE.replace(b"[1]", b"[99999, 99999]").replace(b"[0, 4]", b"[0, 39999200004]")
WEIGHTS_FAIL = {
    "nothing": b"", "a pickle": pickle.dumps([1, 2, 3]), "a program": b"import os\n" * 9,
    "a header of 2^64-1": (2**64 - 1).to_bytes(8, "little") + ONE,
    "a header beyond the file": (10**6).to_bytes(8, "little") + ONE,
    "less than it says": len(ONE).to_bytes(8, "little") + ONE + bytes(3),
    "more than it says": len(ONE).to_bytes(8, "little") + ONE + bytes(5),
    "a huge tensor": len(HUGE).to_bytes(8, "little") + HUGE + bytes(4),
}  # fmt: skip


@pytest.mark.parametrize("case", WEIGHTS_FAIL)
@pytest.mark.parametrize("name", ["model.safetensors", "before.safetensors"])
def test_weights_fail(name: str, case: str, tmp_path: Path) -> None:
    policy = written(tmp_path / "policy")
    (policy / name).write_bytes(WEIGHTS_FAIL[case])
    with pytest.raises(InputError, match=f"{name} is no file of weights"):
        policy_folder(policy)


def test_weights_pass(tmp_path: Path) -> None:
    (tmp_path / "a.safetensors").write_bytes(len(ONE).to_bytes(8, "little") + ONE + bytes(4))
    assert weights(tmp_path, "a.safetensors") == tmp_path / "a.safetensors"


TRAINED: dict[str, Any] = {
    "policy": CONFIG, "scheduler": None, "output_dir": "/elsewhere",
    "optimizer": {"type": "adamw", "lr": 1e-5, "betas": [0.9, 0.999]},
    "dataset": {"repo_id": "evil/data", "root": "/elsewhere"}, "wandb": {"enable": True},
    "env": {"type": "gym_manipulator", "discover_packages_path": "evil.package"},
}  # fmt: skip


def test_training_that_goes_on_pass(tmp_path: Path) -> None:
    """Where to read, write and send comes from the command line that goes on alone."""
    kept = training_settings(written(tmp_path / "policy", train_config=TRAINED))
    assert kept == {k: TRAINED[k] for k in ("policy", "optimizer", "scheduler")}


@pytest.mark.parametrize(("change", "words"), [
    ({"policy": {**CONFIG, "type": "diffusion"}}, "must be act"),
    ({"policy": {**CONFIG, "pretrained_path": "evil/model"}}, "evil/model"),
    ({"policy": {**CONFIG, "_target_": "os.system"}}, "os.system"), ({"policy": None}, "names and"),
    ({"optimizer": {"type": "evil.Optimizer"}}, "evil.Optimizer"),
    ({"optimizer": [1]}, "names and values"), ({"scheduler": {"type": "os.system"}}, "os.system"),
])  # fmt: skip
def test_training_that_goes_on_fail(change: dict[str, Any], words: str, tmp_path: Path) -> None:
    policy = written(tmp_path / "policy", train_config={**TRAINED, **change})
    with pytest.raises(InputError, match=words):
        training_settings(policy)


INFO: dict[str, Any] = {
    "codebase_version": "v3.0", "fps": 20, "total_episodes": 1, "chunks_size": 1000,
    "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet", "video_path": None,
    "features": {"action": {"dtype": "float32", "shape": [8], "names": None}},
}  # fmt: skip


def dataset(folder: Path, info: Any) -> Path:
    (folder / "meta").mkdir(parents=True, exist_ok=True)
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    return folder


def test_dataset_pass(tmp_path: Path) -> None:
    assert dataset_folder(dataset(tmp_path, INFO)).features["action"].shape == [8]


DATASET_FAIL: dict[str, Any] = {
    "a list": [], "null": None, "version": {**INFO, "codebase_version": "v2.1"},
    "path elsewhere": {**INFO, "data_path": "/elsewhere/{chunk_index}"},
    "path upwards": {**INFO, "data_path": "../{chunk_index}"},
    "path of an attribute": {**INFO, "video_path": "{video_key.__class__}"},
    "name upwards": {**INFO, "features": {"a/../../x": INFO["features"]["action"]}},
    "shape": {**INFO, "features": {"a": {"dtype": "float32", "shape": [10**12]}}},
    "shape below 1": {**INFO, "features": {"a": {"dtype": "float32", "shape": [-5]}}},
    "features a list": {**INFO, "features": ["a"]}, "frames": {**INFO, "fps": 0},
}  # fmt: skip


@pytest.mark.parametrize("case", DATASET_FAIL)
def test_dataset_fail(case: str, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        dataset_folder(dataset(tmp_path, DATASET_FAIL[case]))


@usual
@given(seed=st.integers(0, 2**32))
def test_a_dataset_of_any_values(seed: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    rng = random.Random(seed)
    folder = dataset(tmp_path_factory.getbasetemp() / "fuzz_dataset", replaced(INFO, rng))
    file = folder / "meta" / "info.json"
    if rng.random() < 0.5:
        file.write_bytes(changed(file.read_bytes(), rng))
    found = ours(lambda: dataset_folder(folder))
    assert found is None or all(".." not in name.split("/") for name in found.features)


def test_a_dataset_that_holds_no_files_fail(tmp_path: Path) -> None:
    (dataset(tmp_path / "data", INFO) / "data").mkdir()
    pipe = tmp_path / "data" / "data" / "file-000.parquet"
    os.mkfifo(pipe)
    with pytest.raises(InputError, match="no ordinary file"):
        dataset_folder(tmp_path / "data")
    pipe.unlink()
    pipe.symlink_to(tmp_path)
    with pytest.raises(InputError, match="outside its folder"):
        dataset_folder(tmp_path / "data")


@pytest.mark.parametrize("name", ["model.safetensors", "config.json", "before.safetensors",
                                  "policy_postprocessor.json"])  # fmt: skip
def test_a_link_out_of_the_folder_fail(name: str, tmp_path: Path) -> None:
    policy = written(tmp_path / "policy")
    (policy / name).rename(tmp_path / "elsewhere")
    (policy / name).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="outside its folder"):
        policy_folder(policy)
    (policy / name).unlink()
    (tmp_path / "elsewhere").rename(policy / "kept")
    (policy / name).symlink_to("kept")
    assert policy_folder(policy).kind == "act"


@usual
@given(seed=st.integers(0, 2**32))
def test_a_policy_folder_of_any_values(seed: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    rng = random.Random(seed)
    parts = {"config": CONFIG, "policy_preprocessor": BEFORE, "policy_postprocessor": AFTER}
    name = rng.choice(list(parts))
    data = json.dumps(replaced(parts[name], rng)).encode()
    data = changed(data, rng) if rng.random() < 0.5 else data
    folder = written(tmp_path_factory.getbasetemp() / "fuzz_policy", **{name: data})
    ours(lambda: policy_folder(folder))


def asset(folder: Path, config: Any) -> Path:
    """An asset folder as far as its settings go."""
    (folder / "stages").mkdir(parents=True, exist_ok=True)
    content = config if isinstance(config, bytes) else yaml.safe_dump(config_file.plain(config))
    data = content if isinstance(content, bytes) else content.encode()
    (folder / "stages" / "config.yaml").write_bytes(data)
    return folder


def kept(**changes: Any) -> dict[str, Any]:
    """What an asset keeps of its settings."""
    return {"pipeline": replace(MakeConfig(), **changes)}


def test_settings_of_an_asset_pass(tmp_path: Path) -> None:
    """What decides the geometry is used again; everything else is the user's."""
    mine = MakeConfig(hints=Path("mine.yaml"), models=ModelConfig(vlm_url="http://mine"))
    engine = EngineConfig(solver="lm", seed=3)
    found = asset_settings(asset(tmp_path, kept(height=1.5, up="y", engine=engine)), mine)
    assert (found.height, found.up, found.engine.solver, found.engine.seed) == (1.5, "y", "lm", 3)
    assert (found.hints, found.models) == (mine.hints, mine.models)
    assert asset_settings(tmp_path / "no asset", mine) is mine


HOSTILE = MakeConfig(
    hints=Path("/elsewhere/hints.yaml"), allow_outside=True, retexture={"body": "/elsewhere.png"},
    models=ModelConfig(
        questions=Path("/elsewhere"), vlm_url="http://stranger", space="stranger/space",
        prior_file=Path("/elsewhere"), allow_upload=True, max_cost=1e6, vlm_model="dear",
    ),
)  # fmt: skip


def test_where_to_send_read_and_write_fail(tmp_path: Path) -> None:
    found = asset_settings(asset(tmp_path, {"pipeline": HOSTILE}), MakeConfig())
    assert found == MakeConfig()
    photo = replace(MakeConfig().photo, mask=Path("/elsewhere"), reader="vlm", width=0.5)
    found = asset_settings(asset(tmp_path, kept(photo=photo)), MakeConfig())
    assert (found.photo.mask, found.photo.reader, found.photo.width) == (None, "auto", 0.5)


@pytest.mark.parametrize(("role", "name"), [
    ("reasoner", "vlm"), ("reasoner", "file"), ("prior", "sp4d"), ("prior", "file"),
    ("segmenter", "p3sam"), ("reconstructor", "fal"), ("reconstructor", "space"),
])  # fmt: skip
def test_a_backend_that_asks_others_fail(role: str, name: str, tmp_path: Path) -> None:
    wish: dict[str, Any] = {role: name}
    change = wish if role == "reconstructor" else {"engine": EngineConfig(**wish)}
    folder = asset(tmp_path, kept(**change))
    with pytest.raises(ConfigError, match=f"wishes the {role} '{name}'.*--{role} {name}"):
        asset_settings(folder, MakeConfig())
    named = replace(MakeConfig(), **change)
    assert asset_settings(folder, named) == named  # the user asked for it


@pytest.mark.parametrize("content", [
    b"[]", b"pipeline: 3", b"\xff", b"pipeline: {solver: lm}", b"a: &x [*x]",
    b"pipeline: !!python/x", b"pipeline: {engine: {reasoner: os:system}}", b"{" * 5000,
    b"pipeline: {height: -1}",
])  # fmt: skip
def test_settings_that_are_none_fail(content: bytes, tmp_path: Path) -> None:
    with pytest.raises(MamSimError) as caught:
        asset_settings(asset(tmp_path, content), MakeConfig())
    assert caught.value.exit_code == 2


def test_settings_behind_a_link_fail(tmp_path: Path) -> None:
    folder = asset(tmp_path / "asset", kept())
    file = folder / "stages" / "config.yaml"
    file.rename(tmp_path / "elsewhere.yaml")
    file.symlink_to(tmp_path / "elsewhere.yaml")
    with pytest.raises(InputError, match="outside its folder"):
        asset_settings(folder, MakeConfig())


@usual
@given(seed=st.integers(0, 2**32))
def test_settings_of_an_asset_of_any_values(
    seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    rng = random.Random(seed)
    told = replaced(config_file.plain({"pipeline": copy.deepcopy(HOSTILE)}), rng)
    text = yaml.safe_dump(told, sort_keys=False).encode()
    data = changed(text, rng) if rng.random() < 0.5 else text
    folder = asset(tmp_path_factory.getbasetemp() / "fuzz_settings", data)
    found = ours(lambda: asset_settings(folder, MakeConfig()))
    assert found is None or (found.models == ModelConfig() and found.hints is None)
