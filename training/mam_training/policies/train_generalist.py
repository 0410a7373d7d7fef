"""Trains a policy that opens parts of one kind on objects it has not seen, on generated ones.

    python -m mam_training.policies.train_generalist configs/train/generalist_drawer.yaml

Objects of several categories are generated; those on which an environment takes a part of the kind
are given to `mam-sim train`, which clones the scripted expert. What ships is the run: run.json and
the network. No real object is seen.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mam_envs.config import EnvConfig
from mam_envs.robots import robot_spec
from mam_envs.scene.layout import arrange
from mam_pipeline import folders
from mam_pipeline.asset.card import Asset
from mam_pipeline.digests import file_digest
from mam_pipeline.errors import ConfigError, MamSimError
from mam_policies.run import EnvChoice
from mam_sim.cli import main as mam_sim
from mam_training import manifest
from mam_training.command import configured
from mam_world.dataset import write_dataset


@dataclass(frozen=True)
class GeneralistTraining:
    """Settings of the training.

    Attributes:
        kind: of the parts to open: drawer or door. categories: of the generated objects.
        count: objects of each. seed: of the first; objects, demonstrations and network follow.
        episodes: demonstrations. hidden: widths of the network. epochs: passes over them.
        rounds, round_episodes: of DAgger.
        cache: folder for objects and demonstrations; what is there is used again.
        out: folder for the weights.
    """

    kind: str = "drawer"
    categories: tuple[str, ...] = (
        "chest_of_drawers", "nightstand", "filing_cabinet", "desk", "table_with_drawers",
        "dressing_table", "coffee_table", "box_drawer", "storage_mixed", "cabinet_nested_drawers",
        "sideboard", "tool_cabinet", "bed_storage", "kitchen_run",
    )  # fmt: skip
    count: int = 12
    seed: int = 7000
    episodes: int = 600
    hidden: tuple[int, ...] = (384, 384)
    epochs: int = 40
    rounds: int = 2
    round_episodes: int = 100
    cache: Path = Path("build/generalist-drawer")
    out: Path = Path("build/weights/policies/generalist-drawer")


def objects(config: GeneralistTraining) -> list[Path]:
    """Asset folders with a part of the kind that moves, generated where they are not there yet."""
    out = []
    for category in config.categories:
        folder = config.cache / "objects" / category
        if not folder.is_dir():
            write_dataset(category, config.count, config.seed, folder, textures=False)
        found = [file.parent for file in sorted(folder.glob("*/asset.json"))]
        out += [asset for asset in found if moving(Asset.load(asset), config.kind)]
    return out


def moving(asset: Asset, kind: str) -> set[str]:
    """Names of the joints that move a part of a kind."""
    links = {part.link for part in asset.card.parts if part.kind == kind}
    return {joint.name for joint in asset.card.joints if joint.child in links}


def fits(folder: Path, kind: str) -> bool:
    """Whether the joint that an environment takes there moves a part of the kind."""
    asset = Asset.load(folder)
    try:
        layout = arrange(asset, None, "open", robot_spec(EnvChoice.robot), "auto", EnvConfig())
    except MamSimError:
        return False
    return layout.goals[0].joint in moving(asset, kind)


def train(config: GeneralistTraining, assets: Sequence[Path]) -> Path:
    """Train; the run folder.

    Raises:
        ConfigError: training failed; its own words were printed.
    """
    run = config.cache / "run"
    words: dict[str, object] = {
        "--task": "open", "--episodes": config.episodes, "--epochs": config.epochs,
        "--rounds": config.rounds, "--round-episodes": config.round_episodes,
        "--seed": config.seed, "--test": 0, "--out": run,
    }  # fmt: skip
    flags = [str(word) for pair in words.items() for word in pair]
    flags += ["--hidden", *map(str, config.hidden), "--env.observation.articulation"]
    if mam_sim(["train", *map(str, assets), *flags]):
        raise ConfigError("the training failed")
    return run


def main(argv: Sequence[str] | None = None) -> None:
    """Generate, train, keep."""
    config = configured(GeneralistTraining(), argv)
    assets = [asset for asset in objects(config) if fits(asset, config.kind)]
    print(f"{len(assets)} objects with a {config.kind} to open")
    run = train(config, assets)
    config.out.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(run / "policy.safetensors", config.out / "policy.safetensors")
    kept = json.loads((run / "run.json").read_text(encoding="utf-8"))
    learned = len(kept["env"]["assets"])
    kept["env"]["assets"] = [f"{learned} generated objects"]
    folders.write_text(config.out / "run.json", json.dumps(kept, indent=1) + "\n")
    rows = (file_digest(folder / "static.glb").encode() for folder in assets)
    manifest.write(
        config.out,
        "python -m mam_training.policies.train_generalist "
        f"configs/train/generalist_{config.kind}.yaml",
        config,
        {"objects": config.seed, "training": config.seed},
        {"objects": learned, "sha256": manifest.data_digest(rows)},
        [manifest.GENERATED],
    )
    print(kept["results"])


if __name__ == "__main__":
    main()
