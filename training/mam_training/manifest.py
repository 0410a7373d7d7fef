"""What made a folder of weights: `manifest.json`, written beside them by the trainer.

A manifest holds the command, the config, the seeds, the sources of the training data and its
digest, the code's version, the versions of the libraries and a digest of every file. Weights that
no command makes again say so: `reproducible` is false, and `why` tells what is known of them.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from mam_pipeline import config_file
from mam_pipeline.digests import file_digest
from mam_pipeline.weights import MANIFEST as NAME

GENERATED = "generated"  # the procedural world, in `trained_on`
UNKNOWN = "unknown"  # code outside git
DIRTY = "-dirty"  # ending of code with changes that are in no commit
LIBRARIES = ("numpy", "scipy", "lightgbm", "scikit-learn", "torch", "opencv-python-headless")


def data_digest(pieces: Iterable[bytes]) -> str:
    """SHA-256 of training data, given in a fixed order."""
    digest = hashlib.sha256()
    for piece in pieces:
        digest.update(len(piece).to_bytes(8, "little") + piece)
    return digest.hexdigest()


def write(
    folder: Path, command: str, config: Any, seeds: Mapping[str, int], data: Mapping[str, Any],
    trained_on: Sequence[str],
) -> Path:  # fmt: skip
    """Write the manifest of all files in a folder of weights that were just made.

    Args:
        command: that makes them again, as one would type it. config: a dataclass, resolved.
        data: what they were trained on: numbers, and its `sha256`.
        trained_on: the sources of that data (`GENERATED`, names of datasets); results on
            a source say by it whether a model had seen it.
    """
    said = {
        "reproducible": True,
        "command": command,
        "config": _told(config),
        "seeds": dict(seeds),
        "data": dict(data),
        "trained_on": list(trained_on),
        "code": code_version(),
        "libraries": library_versions(),
        "files": {p.name: file_digest(p) for p in _files(folder)},
    }
    path = folder / NAME
    path.write_text(json.dumps(said, indent=1) + "\n", encoding="utf-8")
    return path


def _told(config: Any) -> dict[str, Any]:
    """The config's values; paths as they are from the folder that the command is typed in."""
    told = {k: v for k, v in config_file.plain(config).items() if k not in ("out", "cache")}
    paths: dict[str, Any] = {}
    for name, value in vars(config).items():
        if isinstance(value, Path):
            paths[name] = os.path.relpath(value)
        elif isinstance(value, tuple) and any(isinstance(v, Path) for v in value):
            paths[name] = [os.path.relpath(v) for v in value]
    return {k: paths.get(k, v) for k, v in told.items()}


def faults(folder: Path) -> list[str]:
    """What is wrong with the manifest of a folder of weights, as sentences; none if it is right."""
    path = folder / NAME
    if not path.is_file():
        return [f"{folder} has no {NAME}"]
    said = json.loads(path.read_text(encoding="utf-8"))
    out = []
    if said.get("reproducible") is True:
        needed = ("command", "config", "seeds", "data", "code", "libraries")
        out += [f"{path} does not say its {key}" for key in needed if not said.get(key)]
    elif not said.get("why"):
        out.append(f"{path} says neither how to make the weights again nor why that cannot be done")
    if not said.get("trained_on"):
        out.append(f"{path} does not say its trained_on")
    listed = said.get("files", {})
    there = {p.name: p for p in _files(folder)}
    out += [f"{path} names {n}, which is not there" for n in listed if n not in there]
    out += [f"{path} does not name {n}" for n in there if n not in listed]
    out += [
        f"{there[n]} is not the file that {path} describes" for n, digest in listed.items()
        if n in there and file_digest(there[n]) != digest
    ]  # fmt: skip
    return out


def library_versions() -> dict[str, str]:
    """Versions of the libraries that weights depend on, as far as they are installed."""
    out = {}
    for name in LIBRARIES:
        try:
            out[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return out


def code_version() -> str:
    """The commit of the code, with "-dirty" where files differ from it; "unknown" outside git."""
    found = subprocess.run(
        ["git", "describe", "--always", f"--dirty={DIRTY}"],
        capture_output=True, text=True, check=False, cwd=Path(__file__).parent,
    )  # fmt: skip
    return found.stdout.strip() or UNKNOWN


def _files(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.is_file() and p.name != NAME)
