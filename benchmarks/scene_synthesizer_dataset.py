"""Objects of scene-synthesizer as a ground-truth dataset: an independent generator.

    pip install scene-synthesizer==1.15.0    (in an environment of its own)
    python benchmarks/scene_synthesizer_dataset.py FOLDER [--each 32] [--first 100]
    mam-sim bench FOLDER

Cabinets, refrigerators, ranges, dishwashers, microwaves, sinks, hand wheels, machines and switches
of a package under the Apache licence, with random sizes. Fifteen kinds, `--each` objects of each;
the same seeds give the same objects.
"""

from __future__ import annotations

import argparse
import csv
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scene_synthesizer import Scene
from scene_synthesizer import procedural_assets as assets

Make = Callable[[np.random.Generator, int], Any]
FRONTS = ("door_right", "door_left", "drawer", "closed", "open")
SHARES = (0.25, 0.25, 0.35, 0.1, 0.05)


def random_of(kind: Any) -> Make:
    """The package's own random object of a class."""
    return lambda _rng, seed: kind.random(seed=seed)


def resized(
    kind: Any, names: str, low: float = 0.75, high: float = 1.3, **drawn: Callable[..., Any]
) -> Make:
    """An object with values `drawn`, whose named lengths are its defaults times random factors."""
    defaults = inspect.signature(kind.__init__).parameters

    def make(rng: np.random.Generator, _seed: int) -> Any:
        values = {name: draw(rng) for name, draw in drawn.items()}
        sizes = {n: float(defaults[n].default * rng.uniform(low, high)) for n in names.split()}
        return kind(**sizes, **values)

    return make


def coin(rng: np.random.Generator) -> bool:
    """Heads or tails."""
    return bool(rng.random() < 0.5)


def cabinet(rng: np.random.Generator, _seed: int) -> Any:
    """A grid of fronts, sometimes with one wide front on top."""
    rows, columns = int(rng.integers(1, 4)), int(rng.integers(1, 4))
    mask = np.arange(rows * columns).reshape(rows, columns)
    if coin(rng) and rows > 1:
        mask[0, :] = mask[0, 0]
    mask = np.unique(mask, return_inverse=True)[1].reshape(rows, columns)
    types = [str(rng.choice(FRONTS, p=SHARES)) for _ in range(int(mask.max()) + 1)]
    if all(t in ("closed", "open") for t in types):
        types[0] = "drawer"
    return assets.CabinetAsset(
        width=rng.uniform(0.4, 1.6), depth=rng.uniform(0.3, 0.7), height=rng.uniform(0.4, 1.9),
        compartment_mask=mask, compartment_types=types,
    )  # fmt: skip


def lever_switch(rng: np.random.Generator, _seed: int) -> Any:
    """A lever on a plate."""
    return assets.LeverSwitchAsset(
        lever_length=rng.uniform(0.04, 0.3), lever=str(rng.choice(["box", "cylinder"])),
        tip=str(rng.choice(["cylinder", "sphere", "box"])),
        tip_size=rng.uniform(0.01, 0.05) if coin(rng) else None,
        base=str(rng.choice(["box", "cylinder"])),
    )  # fmt: skip


def safety_switch(rng: np.random.Generator, _seed: int) -> Any:
    """A box with a lever at its side."""
    return assets.SafetySwitchAsset(
        fuse_box_width=rng.uniform(0.2, 0.5), fuse_box_depth=rng.uniform(0.1, 0.25),
        fuse_box_height=rng.uniform(0.3, 0.8), lever_length=rng.uniform(0.1, 0.3),
        lever_right_of_box=coin(rng),
    )  # fmt: skip


def recursive_cabinet(rng: np.random.Generator, seed: int) -> Any:
    """A cabinet that is divided again and again."""
    return assets.RecursivelyPartitionedCabinetAsset(
        width=rng.uniform(0.5, 1.6), depth=rng.uniform(0.3, 0.7), height=rng.uniform(0.5, 1.8),
        split_prob=rng.uniform(0.6, 1.0), split_decay=rng.uniform(0.5, 0.75), seed=seed,
    )  # fmt: skip


KINDS: dict[str, Make] = {
    "base_cabinet": random_of(assets.BaseCabinetAsset),
    "dishwasher": random_of(assets.DishwasherAsset),
    "range": random_of(assets.RangeAsset),
    "refrigerator": random_of(assets.RefrigeratorAsset),
    "sink_cabinet": random_of(assets.SinkCabinetAsset),
    "wall_cabinet": random_of(assets.WallCabinetAsset),
    "refrigerator2": resized(
        assets.RefrigeratorAsset, "width depth height freezer_compartment_height handle_length "
        "handle_thickness handle_depth", handle_left=coin, handle_vertical=coin,
    ),
    "microwave": resized(
        assets.MicrowaveAsset, "width depth height display_panel_width handle_depth "
        "handle_thickness", handle_left=coin,
    ),
    "cnc_machine": resized(
        assets.CNCMachineAsset, "width depth height handle_length handle_thickness handle_depth"
    ),
    "hand_wheel": resized(
        assets.HandWheelAsset, "radius rim_width spoke_width hub_height hub_radius", 0.6, 1.6,
        num_spokes=lambda rng: int(rng.integers(2, 7)),
        handle_height=lambda rng: float(rng.choice([0, 0.03])),
    ),
    "kitchen_island": resized(assets.KitchenIslandAsset, "width depth height depth_storage"),
    "cabinet": cabinet, "lever_switch": lever_switch, "safety_switch": safety_switch,
    "recursive_cabinet": recursive_cabinet,
}  # fmt: skip


def main() -> None:
    """Write the dataset with its MANIFEST.csv."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--each", type=int, default=32, help="objects of each kind")
    parser.add_argument("--first", type=int, default=100, help="first seed")
    chosen = parser.parse_args()
    chosen.folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for kind, make in KINDS.items():
        for seed in range(chosen.first, chosen.first + chosen.each):
            name = f"{kind}_{seed:04d}"
            try:
                made = make(np.random.default_rng([seed, len(kind)]), seed)
            except (TypeError, ValueError):  # the package refuses some combinations
                continue
            scene = Scene.single_object_scene(made)
            (chosen.folder / name).mkdir(exist_ok=True)
            scene.export(str(chosen.folder / name / "object.urdf"))
            rows.append((name, kind))
    with (chosen.folder / "MANIFEST.csv").open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows([("id", "category"), *rows])
    print(f"{len(rows)} objects in {chosen.folder}")


if __name__ == "__main__":
    main()
