"""Learning curves of reinforcement learning: held-out success at every checkpoint, several seeds.

    python benchmarks/rl_curve.py ASSET --joint NAME --seeds 0 1 2 --steps 12288 --keep FOLDER
        --out FILE --picture docs/ppo_drawer.png

At each checkpoint the actor's mean action is tried at the same unseen poses. Seeds that the JSON
file already has are not trained again.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import torch
import tyro
from common import load, save

from mam_policies.algorithms.ppo import Ppo
from mam_policies.algorithms.sac import Sac
from mam_policies.evaluate import HELD_OUT, evaluate
from mam_policies.mlp import MlpActor, MlpPolicy
from mam_policies.run import EnvChoice


@dataclass
class Settings:
    """What is trained.

    Attributes:
        keep: folder for the runs. out: JSON file for the rows. picture: of the curves.
        warm: expert episodes cloned first. every: steps between tests of `episodes` poses.
    """

    joint: str | None = None
    algo: Literal["ppo", "sac"] = "ppo"
    seeds: tuple[int, ...] = (0, 1, 2)
    steps: int = 12_288
    warm: int = 2
    every: int = 4096
    episodes: int = 20
    max_steps: int = 120
    keep: Path = Path("rl_curve")
    out: Path | None = None
    picture: Path | None = None


def learn(asset: str, seed: int, settings: Settings) -> dict[str, Any]:
    """Train one seed; rows of (steps, successes, episodes, seconds so far)."""
    learner = {"ppo": Ppo, "sac": Sac}[settings.algo]()
    choice = EnvChoice(
        (asset,), settings.joint, control_mode=learner.control_mode, max_steps=settings.max_steps
    )
    config = learner.Config(
        steps=settings.steps, seed=seed, episodes=settings.warm, save_every=settings.every
    )
    rows: list[tuple[int, int, int, float]] = []
    started, testing = time.process_time(), 0.0

    def test(steps: int, policy: MlpPolicy) -> None:
        nonlocal testing
        began, actor = time.process_time(), MlpActor(policy)

        def begin(_env: Any) -> Any:
            actor.reset()
            return actor.act

        found = evaluate(choice, begin, settings.episodes, HELD_OUT)
        testing += time.process_time() - began
        spent = round(time.process_time() - started - testing, 1)
        rows.append((steps, found.successes, found.episodes, spent))
        print(f"{settings.algo} seed {seed}: {steps} steps, {spent} s, {found.line()}", flush=True)

    run = settings.keep / f"{settings.algo}-{seed}"
    info = learner.train(choice, config, run, on_checkpoint=test)
    test(int(info.results["steps"]), MlpPolicy.load(run))
    return {"algo": settings.algo, "seed": seed, "rows": rows, "config": info.config}


def draw(found: list[dict[str, Any]], file: Path) -> None:
    """Success against environment steps, one line per seed."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(5.2, 3.2), dpi=130)
    for k, item in enumerate(found):
        steps, rates = zip(*((row[0], 100 * row[1] / row[2]) for row in item["rows"]))
        name = f"{item['algo'].upper()}, seed {item['seed']}"
        axes.plot(steps, rates, marker="o", markersize=3 + k, linewidth=1.4, label=name)
    axes.set_xlabel("environment steps")
    axes.set_ylabel(f"success at {found[0]['rows'][0][2]} unseen poses, %")
    axes.set_ylim(-3, 103)
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right", fontsize=8)
    figure.tight_layout()
    figure.savefig(file)


def main(asset: tyro.conf.Positional[str], /, settings: Settings) -> None:
    """Train what is missing, print rows, draw the picture."""
    torch.set_num_threads(1)
    found: list[dict[str, Any]] = load(settings.out) or []
    for seed in settings.seeds:
        if not any(f["seed"] == seed and f["algo"] == settings.algo for f in found):
            found.append(learn(asset, seed, settings))
            save(settings.out, found)
    if settings.picture is not None:
        draw(found, settings.picture)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
