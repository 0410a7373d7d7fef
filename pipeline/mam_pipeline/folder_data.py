"""What the files of a folder may cause: an asset, a run, a policy, a dataset from anybody.

A folder holds data. It may say numbers, names that our own tables know, and names of ordinary files
below it; everything that reads one asks here. What else it wishes (a class to import, a model to
fetch, a file elsewhere, a place to send something to) is refused with a sentence that says what
was wished. Endpoints, keys, folders, hints and commands come from the user alone: the command line,
`--config` and the environment.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from mam_pipeline import config_file
from mam_pipeline.edited import (
    STRICT,
    Document,
    Index,
    Place,
    Range,
    Share,
    read_json,
    shown,
    validated,
)
from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.formats.door import Door
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.optional import require


def _stays_below(name: str) -> str:
    """A name that may become a part of a path."""
    if ".." in name.split("/"):
        raise ValueError(f"must not lead upwards, as {name!r} does")
    return name


WEIGHTS = ".safetensors"
"""Suffix of the one kind of file that weights are read from; it holds numbers alone."""
Name = Annotated[
    str, Field(pattern=r"^[\w.:-][\w .:/-]{0,199}$"), AfterValidator(_stays_below)
]  # fmt: skip
Device = Annotated[str, Field(pattern=r"^(cpu|mps|xpu|cuda(:\d{1,2})?)$")]
Sizes = Annotated[list[Annotated[int, Range(1, 100_000)]], Field(max_length=4)]


@dataclass(frozen=True)
class FolderLimits:
    """How large what a policy folder describes may be.

    Attributes:
        size: greatest integer that decides a size. layers: most layers of one kind.
        steps: most steps of a pipeline. entries: most entries of a list or mapping.
    """

    size: int = 100_000
    layers: int = 128
    steps: int = 32
    entries: int = 4096


LIMITS = FolderLimits()


@dataclass(frozen=True)
class Feature:
    """An input or output of a policy: what it is, and its shape."""

    __pydantic_config__ = STRICT
    type: Literal["STATE", "VISUAL", "ENV", "ACTION", "REWARD", "LANGUAGE"]
    shape: Sizes


Norm = Literal["MEAN_STD", "MIN_MAX", "IDENTITY", "QUANTILES", "QUANTILE10"]


@dataclass(frozen=True)
class _Nothing:
    """A step without settings."""

    __pydantic_config__ = STRICT


@dataclass(frozen=True)
class _Rename:
    __pydantic_config__ = STRICT
    rename_map: dict[Name, Name] = field(default_factory=dict)


@dataclass(frozen=True)
class _Device:
    __pydantic_config__ = STRICT
    device: Device = "cpu"
    float_dtype: Literal["float16", "float32", "float64", "bfloat16", "half", "float",
                         "double"] | None = None  # fmt: skip


@dataclass(frozen=True)
class _Normalise:
    __pydantic_config__ = STRICT
    features: dict[Name, Feature] = field(default_factory=dict)
    norm_map: dict[str, Norm] = field(default_factory=dict)
    eps: Share = 1e-8
    normalize_observation_keys: list[Name] | None = None


@dataclass(frozen=True)
class _Tokens:
    __pydantic_config__ = STRICT
    tokenizer_name: str
    max_length: Annotated[int, Range(1, 4096)] = 48
    task_key: Literal["task"] = "task"
    padding_side: Literal["left", "right"] = "right"
    padding: Literal["longest", "max_length"] = "longest"
    truncation: bool = True


STEPS: dict[str, type[Any]] = {
    "rename_observations_processor": _Rename,
    "to_batch_processor": _Nothing,
    "device_processor": _Device,
    "normalizer_processor": _Normalise,
    "unnormalizer_processor": _Normalise,
    "smolvla_new_line_processor": _Nothing,
    "tokenizer_processor": _Tokens,
}
"""Steps of LeRobot's pipelines that a policy folder may name, and what each may be told."""
POLICIES = ("act", "diffusion", "smolvla", "mam_sim")
"""Types of policies that are read from a folder."""
MODELS = tuple(f"HuggingFaceTB/SmolVLM2-{size}" for size in (
    "256M-Video-Instruct", "500M-Video-Instruct", "2.2B-Instruct",
))  # fmt: skip
"""Models of the Hub that a policy may be built on; no folder chooses another."""
_TEXTS = {
    "type": r"act|diffusion|smolvla|mam_sim|STATE|VISUAL|ENV|ACTION|REWARD|LANGUAGE|revolute|"
    r"prismatic|continuous|fixed|adamw?|sgd|multi_adam|diffuser|cosine_decay_with_warmup",
    "device": r"cpu|mps|xpu|cuda(:\d{1,2})?",
    "repo_id": r"[\w.-]{1,96}/[\w.-]{1,96}",
    "license": r"[\w.-]{1,60}",
    "tags": r"[\w.: -]{1,60}",
    "pretrained_path": r"lerobot/smolvla_base",
    "vision_backbone": r"resnet(18|34|50|101|152)",
    "pretrained_backbone_weights": r"ResNet(18|34|50|101|152)_Weights\.(IMAGENET1K_V[12]|DEFAULT)",
    "vlm_model_name": "|".join(re.escape(name) for name in MODELS),
    "feedforward_activation": "relu|gelu|glu",
    "noise_scheduler_type": "DDPM|DDIM",
    "beta_schedule": "linear|scaled_linear|squaredcos_cap_v2|sigmoid",
    "scheduler_name": "cosine|cosine_with_restarts|linear|polynomial|constant|constant_with_warmup",
    "prediction_type": "epsilon|sample|v_prediction",
    "attention_mode": "cross_attn|self_attn",
    "pad_language_to": "longest|max_length",
    "compile_mode": "default|reduce-overhead|max-autotune(-no-cudagraphs)?",
    "prefix_attention_schedule": "ZEROS|ONES|LINEAR|EXP",
    "squash": "none|clip|tanh",
    "activation": "relu|tanh",
    **dict.fromkeys(("VISUAL", "STATE", "ENV", "ACTION", "REWARD", "LANGUAGE"),
                    "MEAN_STD|MIN_MAX|IDENTITY|QUANTILES|QUANTILE10"),
    **dict.fromkeys(("name", "joints", "observation", "state_names", "action_names"),
                    r"[\w.:-][\w .:/-]{0,199}"),
}  # fmt: skip
"""Texts that a policy's config.json may hold, by key; every other text is a wish and refused."""
_UNUSED = ("optimizer_", "scheduler_")
"""Beginnings of keys that matter to training alone."""
_SIZE = re.compile("size|dim|heads|horizon|chunk")
"""Part of the keys whose whole numbers are at least 1."""
_LEAST = {"num_expert_layers": -1, "prefix_length": -1}
"""Least whole number by key, where -1 stands for a default; of all others it is 0."""
_HERE = {"auto", "geometric", "embedded", "none", "init", "lm", "nelder-mead"}
"""Backends that work on this machine alone; what an asset was made with may be used again."""


def read(folder: Path, name: str, missing: str = "") -> Document:
    """The JSON document in an ordinary file of a folder.

    Args:
        missing: what is said where there is none.

    Raises:
        InputError: it is missing, no ordinary file, a link out of the folder, or no JSON.
    """
    return read_json(file_of(folder, name, missing))


def file_of(folder: Path, name: str, missing: str = "") -> Path:
    """An ordinary file below a folder, links followed.

    Raises:
        InputError: it is missing, no ordinary file, or a link out of the folder.
    """
    door = Door(folder, "copy it into the folder")
    found = door.find(name, folder / name, folder)
    if found is None:
        raise InputError(missing or f"{folder} holds no {name}")
    return found


@dataclass(frozen=True)
class PolicyFolder:
    """A LeRobot policy folder that wishes nothing but numbers.

    Attributes:
        kind: its type, one of POLICIES. inputs: what it sees, by name.
        files: names of the files that make it up.
    """

    folder: Path
    kind: str
    inputs: Mapping[str, Feature]
    files: tuple[str, ...]


@dataclass(frozen=True)
class _Features:
    """What goes into a policy and what comes out, by name; None and {} are taken from its data."""

    input_features: dict[Name, Feature] | None = None
    output_features: dict[Name, Feature] | None = None


def policy_folder(folder: Path) -> PolicyFolder:
    """Look through a policy folder before LeRobot reads it.

    Raises:
        InputError: it is no policy, or wishes something that no folder may; the sentence says what.
    """
    model = f"model{WEIGHTS}"
    weights(folder, model, f"{folder} holds no policy of LeRobot (no {model})")
    document = read(folder, "config.json")
    config = document.values
    if not isinstance(config, dict):
        raise document.wrong((), f"must hold names and values, not {shown(config)}")
    kind = config.get("type")
    if kind not in POLICIES:
        raise document.wrong(("type",), f"must be one of {', '.join(POLICIES)}, not {shown(kind)}")
    _plain(config, (), document)
    features: _Features = validated(_Features, document)
    if config.get("use_peft"):
        raise document.wrong(("use_peft",), "wishes adapters of another folder; none are read")
    files = [model, "config.json"]
    for part in ("policy_preprocessor", "policy_postprocessor"):
        files += [f"{part}.json", *_pipeline(folder, f"{part}.json")]
    return PolicyFolder(folder, str(kind), features.input_features or {}, tuple(files))


def _pipeline(folder: Path, name: str) -> Iterator[str]:
    """Names of the weights of a pipeline whose steps are all ours."""
    document = read(folder, name)
    values = document.values
    if not isinstance(values, dict) or not isinstance(values.get("steps"), list):
        raise document.wrong(("steps",), "must be a list of steps")
    if set(values) - {"name", "steps"}:
        raise document.wrong((), f"may hold name and steps, not {shown(sorted(values))}")
    if len(values["steps"]) > LIMITS.steps:
        raise document.wrong(("steps",), f"must have at most {LIMITS.steps} entries")
    if not isinstance(values.get("name", ""), str):
        raise document.wrong(("name",), "must be text")
    for i, step in enumerate(values["steps"]):
        place: Place = ("steps", i)
        if not isinstance(step, dict):
            raise document.wrong(place, f"must be a step, not {shown(step)}")
        wished = step.get("class", step.get("registry_name"))
        if "class" in step or not isinstance(wished, str) or wished not in STEPS:
            known = ", ".join(STEPS)
            raise document.wrong(
                place, f"wishes {shown(wished)} to be run; a policy folder may name: {known}"
            )
        unknown = sorted(set(step) - {"registry_name", "config", "state_file"})
        if unknown:
            raise document.wrong(place, f"has no setting {shown(unknown[0])}")
        part = Document(step.get("config", {}), f"{document.source}: {wished}", {}, InputError)
        told = validated(STEPS[wished], part)
        if isinstance(told, _Tokens):
            _known_model(told.tokenizer_name, part, ("tokenizer_name",))
        if "state_file" in step:
            yield _weights(folder, step["state_file"], document, (*place, "state_file"))


def weights(folder: Path, name: str, missing: str = "") -> Path:
    """A file of weights in a folder, whose header says no more than it holds.

    Args:
        missing: what is said where there is none.

    Raises:
        InputError: see `file_of`; or it is none, whatever its name.
        MissingExtra: the package that reads such files is not installed.
    """
    file = file_of(folder, name, missing)
    require("a policy's weights", "safetensors")
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(file, "np"):
            return file
    except (SafetensorError, OSError, ValueError) as error:
        why = " ".join(str(error).split())[:200]
        raise InputError(f"{file} is no file of weights in safetensors' format: {why}") from error


def _weights(folder: Path, name: Any, document: Document, place: Place) -> str:
    """A name of a file of weights that lies in the folder itself."""
    bare = isinstance(name, str) and Path(name).name == name and name.endswith(WEIGHTS)
    if not bare:
        raise document.wrong(place, f"must name a file *{WEIGHTS} beside it, not {shown(name)}")
    return weights(folder, name).name


def _known_model(name: str, document: Document, place: Place) -> None:
    """Refuse a model that is not of MODELS, or whose name means a folder here."""
    if name not in MODELS or Path(name).exists():
        where = " (a folder here has that name)" if name in MODELS else ""
        raise document.wrong(
            place, f"wishes the model {shown(name)}{where}; known are {', '.join(MODELS)}"
        )


def training_settings(folder: Path) -> dict[str, Any]:
    """What training that goes on takes from a checkpoint: policy, optimiser and its schedule.

    Everything else in its train_config.json (data, places, services, packages to import) comes from
    the command line that goes on.

    Args:
        folder: the checkpoint's policy folder.

    Raises:
        InputError: it wishes something that no folder may; the sentence says what.
    """
    found = policy_folder(folder)
    document = read(folder, "train_config.json")
    if not isinstance(document.values, dict):
        raise document.wrong((), f"must hold names and values, not {shown(document.values)}")
    kept: dict[str, Any] = {
        key: document.values.get(key) for key in ("policy", "optimizer", "scheduler")
    }
    for key, value in kept.items():
        if not isinstance(value, dict) and (key != "scheduler" or value is not None):
            raise document.wrong((key,), f"must hold names and values, not {shown(value)}")
        _plain(value, (key,), document)
    if kept["policy"].get("type") != found.kind:
        raise document.wrong(("policy", "type"), f"must be {found.kind}, as in config.json")
    return kept


@dataclass(frozen=True)
class _Column:
    dtype: Name
    shape: Sizes
    names: Any = None


@dataclass(frozen=True)
class DatasetFolder:
    """meta/info.json of a LeRobot dataset, as far as it decides what is read.

    Attributes:
        features: columns by name. fps: frames per second.
    """

    codebase_version: Literal["v3.0"]
    features: Annotated[dict[Name, _Column], Field(max_length=1000)]
    data_path: Literal["data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"]
    video_path: Literal[
        "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
    ] | None = None  # fmt: skip
    fps: Annotated[int, Range(1, 1000)] = 20
    total_episodes: Index = 0
    robot_type: Name | None = None


def dataset_folder(folder: Path) -> DatasetFolder:
    """Look through a LeRobot dataset before LeRobot reads it.

    Raises:
        InputError: it is none, names other files than LeRobot does, or holds what is no file.
    """
    missing = f"{folder} is no LeRobot dataset; make one with: mam-sim collect ASSET"
    found: DatasetFolder = validated(DatasetFolder, read(folder, "meta/info.json", missing))
    for here, inside, names in os.walk(folder):  # follows no links
        for path in (Path(here, name) for name in (*inside, *names)):
            if path.is_symlink() or not path.is_dir():
                file_of(folder, str(path.relative_to(folder)))
    return found


def _plain(value: Any, place: Place, document: Document) -> None:
    """Refuse text that is not of `_TEXTS`, and sizes beyond all use."""
    key = next((step for step in reversed(place) if isinstance(step, str)), "")
    if isinstance(value, dict | list) and len(value) > LIMITS.entries:
        raise document.wrong(place, f"must have at most {LIMITS.entries} entries")
    if isinstance(value, dict):
        for name, inner in value.items():
            if not re.fullmatch(r"[\w.:-][\w .:/-]{0,199}", name):
                raise document.wrong(place, f"has the name {shown(name)}, which is none")
            _plain(inner, (*place, name), document)
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            _plain(inner, (*place, i), document)
    elif isinstance(value, str):
        if not re.fullmatch(_TEXTS.get(key, r"(?!)"), value):
            raise document.wrong(
                place,
                f"wishes {shown(value)}, which a policy folder may not; it may hold {_may(key)}",
            )
        if key == "vlm_model_name":
            _known_model(value, document, place)
    elif isinstance(value, int) and not key.startswith(_UNUSED):
        least = 1 if _SIZE.search(key) else _LEAST.get(key, 0)
        most = LIMITS.layers if "layers" in key else LIMITS.size
        if not isinstance(value, bool) and not least <= value <= most:
            raise document.wrong(place, f"must be from {least} to {most}, not {shown(value)}")


def _may(key: str) -> str:
    """What a text of config.json may be, in words."""
    said = _TEXTS.get(key, "")
    return said.replace("\\", "").replace("|", ", ") if said and "[" not in said else (
        "names alone there" if said else "no text there"
    )  # fmt: skip


def asset_settings(asset: Path, config: MakeConfig) -> MakeConfig:
    """How an asset is made again: what decides its geometry as kept in it, the rest by the user.

    Up axis, size, what the object is, rules and seed come from the folder. Where to send, read or
    write never does: models, hints, mask, reader, new appearance and files outside are `config`'s.

    Args:
        asset: the folder; without stages/config.yaml the settings are `config`.
        config: the user's own.

    Raises:
        InputError: that file is a link out of the folder. ConfigError: an unknown setting, or a
            backend that asks somebody else and that the user has not named.
    """
    source = Door(asset).find("stages/config.yaml", asset / "asset.json", asset)
    if source is None:
        return config
    kept = config_file.read(source).get("pipeline", {})
    then = config_file.fill(MakeConfig(), kept, source)
    named: dict[str, Any] = {
        role: _backend(then.engine, config.engine, role, source)
        for role in ("segmenter", "prior", "reasoner", "solver")
    }
    engine = replace(then.engine, **named)
    reconstructor = _backend(then, config, "reconstructor", source)
    photo = replace(then.photo, mask=config.photo.mask, reader=config.photo.reader)
    made = replace(
        then, engine=engine, reconstructor=reconstructor, photo=photo, hints=config.hints,
        allow_outside=config.allow_outside, retexture=config.retexture, models=config.models,
    )  # fmt: skip
    made.check()
    return made


def _backend(then: Any, now: Any, role: str, source: Path) -> str:
    """The user's choice, else the asset's where it works on this machine alone."""
    mine, kept = str(getattr(now, role)), str(getattr(then, role))
    if mine != "auto":
        return mine
    if kept not in _HERE:
        raise ConfigError(
            f"{source} wishes the {role} {shown(kept)}, which may ask others or read elsewhere; "
            f"add --{role} {kept} if you want that, or --{role} embedded".replace(
                "--segmenter embedded", "--segmenter geometric"
            )
        )
    return kept
