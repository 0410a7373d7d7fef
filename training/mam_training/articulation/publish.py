"""A trained network as files: weights in half precision, and what describes its inputs."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file

from mam_training.articulation.fit import Trained
from mam_training.articulation.items import columns, object_words, part_words
from mam_training.articulation.model import PartNetwork, Shape


def publish(trained: Trained, folder: Path) -> None:
    """Write network.safetensors and network.json: columns and their scales, sizes, known words."""
    folder.mkdir(parents=True, exist_ok=True)
    weights = {k: v.half().contiguous() for k, v in trained.net.state_dict().items()}
    save_file(weights, str(folder / "network.safetensors"))
    scales = [[[round(float(x), 6) for x in row] for row in scale] for scale in trained.scales]
    about = {
        "shape": asdict(trained.net.shape), "primitive_columns": list(columns()[0]),
        "pair_columns": list(columns()[1]), "primitive_scale": scales[0], "pair_scale": scales[1],
        "object_words": list(object_words()), "part_words": list(part_words()),
    }  # fmt: skip
    (folder / "network.json").write_text(json.dumps(about) + "\n", encoding="utf-8")


def published(folder: Path) -> PartNetwork:
    """The network that `publish` wrote."""
    about = json.loads((folder / "network.json").read_text(encoding="utf-8"))
    net = PartNetwork(Shape(**about["shape"]))
    found = load_file(str(folder / "network.safetensors"))
    net.load_state_dict({k: v.to(torch.float32) for k, v in found.items()})
    return net.eval()
