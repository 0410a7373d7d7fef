"""Does the engine find the same when an object stands another way?

    python benchmarks/turned_inputs.py DATASET [--degrees 0 37 90 180] [--jobs 2] [--seed 0]

Every object of a folder of ground-truth URDFs is turned about the vertical before the engine sees
it, and scored against its truth, turned alike. Prints the totals of `mam-sim bench` for each turn.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import tyro
from common import save
from mam_sim_bench.config import BenchConfig
from mam_sim_bench.runner import Task, find_tasks, run_bench
from mam_sim_bench.table import summarise
from tyro.conf import Positional

from mam_pipeline.geometry.front import moved
from mam_pipeline.make_config import EngineConfig
from mam_world.ground_truth import GroundTruth


@dataclass(frozen=True)
class Turned(Task):
    """An object turned by `degrees` about the vertical."""

    degrees: float = 0.0

    def load(self) -> GroundTruth:
        """Read the truth and turn it."""
        truth = super().load()
        turn = np.eye(4)
        c, s = np.cos(np.radians(self.degrees)), np.sin(np.radians(self.degrees))
        turn[:2, :2] = [[c, -s], [s, c]]
        made = moved(truth.truth_articulation(), turn)
        return replace(truth, mesh=made.mesh, links=made.links, joints=made.joints)


def main(
    dataset: Positional[str],
    /,
    degrees: tuple[float, ...] = (0, 37, 90, 180),
    jobs: int = 1,
    seed: int = 0,
    out: Path | None = None,
) -> None:
    """Print a line per turn.

    Args:
        dataset: folder of ground-truth URDFs. degrees: turns. jobs: processes. seed: engine's.
        out: JSON file for the totals.
    """
    tasks = find_tasks(dataset)
    config = BenchConfig(engine=EngineConfig(seed=seed), execute=False)
    rows = []
    for angle in degrees:
        turned = [Turned(t.id, t.category, t.source, t.seed, angle) for t in tasks]
        row = summarise("total", run_bench(turned, config, jobs=jobs))
        rows.append({"degrees": angle, **asdict(row)})
        pivot = np.nan if row.pivot is None else row.pivot
        print(f"turned by {angle:g} degrees: {row.objects} objects, mIoU {row.miou:.3f}, "
              f"count {row.count:.3f}, type error {row.type_error:.3f}, axis {row.axis:.3f} rad, "
              f"pivot {pivot:.3f}", flush=True)  # fmt: skip
    save(out, rows)


if __name__ == "__main__":
    tyro.cli(main)
