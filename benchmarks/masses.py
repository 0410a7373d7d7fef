"""Masses and opening forces of generated objects beside those that makers and standards publish.

    python benchmarks/masses.py --out docs/results/masses.json
    python benchmarks/masses.py --half set        # the products that may set the table of kinds

The published figures are in masses.yaml. For each product, generated objects of its kind and nearly
its size are scaled to its largest side; an object's mass is a range on its card, from which
randomisation draws, and the published mass should lie in it. A joint's friction, as a force at its
farthest point, and what keeps it closed besides, should lie in the published range of opening
forces. Parts that a latch or a gasket holds shut are counted apart: the table of catches
(asset/matter.yaml) was set by the lower end of the same ranges, so these rows say that the assets
have what it says, not that it was foreseen.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
import yaml
from world_objects import thing_of

from mam_pipeline.asset.dynamics import gravity_load, rubbing, with_dynamics
from mam_pipeline.asset.inertia import link_inertials
from mam_pipeline.geometry.front import moved
from mam_pipeline.holding import Catch
from mam_pipeline.types import Articulation
from mam_world import make_object

DATA = Path(__file__).with_suffix(".yaml")
PATHS = ["world", "pipeline/mam_pipeline/asset", "pipeline/mam_pipeline/evidence/kinds.yaml"]
COMMAND = "python benchmarks/masses.py"


@dataclass(frozen=True)
class Sample:
    """Which generated objects stand for a product.

    Attributes:
        seeds: that are tried. objects: at most. size: factor between an object's largest side and
            the product's, up to which it is scaled to it.
    """

    seeds: int = 40
    objects: int = 6
    size: float = 1.25


SAMPLE = Sample()


def main(out: Path | None = None, half: Literal["measured", "set"] = "measured") -> None:
    """Print a line per kind and per force, and write the table of those measured.

    Args:
        out: JSON file. half: which products: those that only measure, or those that may set.
    """
    data = yaml.safe_load(DATA.read_text(encoding="utf-8"))
    known: dict[str, list[tuple[float, Articulation]]] = {}
    masses = [_mass(name, row, known, half) for name, row in data["masses"].items()]
    forces = [_force(name, row) for name, row in data["forces"].items()] if half != "set" else []
    for row in (*masses, *forces):
        print(row["name"], row["values"], flush=True)
    _print("products", [v for row in masses for v in row.pop("within")])
    for held in (False, True):
        within = [row["values"]["within"] == "1 of 1" for row in forces if row["held"] is held]
        _print("forces, held shut by a latch or gasket" if held else "forces", within)
    for row in forces:
        del row["held"]
    if out is not None:
        columns = {"ours": "s", "published": "s", "within": "s", "source": "s"}
        title = "Masses and opening forces beside published ones"
        table = {"title": title, "columns": columns, "paths": PATHS, "rows": masses + forces}
        out.write_text(json.dumps(table, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _short(value: float) -> str:
    """Two digits, without an exponent."""
    return f"{float(f'{value:.2g}'):g}"


def _print(what: str, within: list[bool]) -> None:
    if within:
        print(f"{what}: {sum(within)} of {len(within)} within ({np.mean(within):.0%})")


def _mass(
    name: str, row: dict[str, Any], known: dict[str, list[tuple[float, Articulation]]], half: str
) -> dict[str, Any]:
    """A row of one kind: ours and published, for each product of a half."""
    products = row["products"][1 if half == "measured" else 0 :: 2]
    ours, within = [], []
    for _, size, mass in products:
        found = list(_weighed(row["categories"], row.get("thing"), size, known))
        low, usual, high = np.median(found, axis=0)
        ours.append(f"{_short(usual)} ({_short(low)} to {_short(high)})")
        within.append(bool(low <= mass <= high))
    values = {
        "ours": ", ".join(ours) + " kg",
        "published": ", ".join(f"{mass:g}" for *_, mass in products) + " kg",
        "within": f"{sum(within)} of {len(within)}",
        "source": "; ".join(str(product) for product, *_ in products),
    }
    return {**_row(row["categories"][0], name, values), "within": within}


def _weighed(
    categories: list[str], thing: str | None, size: float,
    known: dict[str, list[tuple[float, Articulation]]],
) -> Iterator[tuple[float, float, float]]:  # fmt: skip
    """Least, usual and most mass of objects of a size, kg."""
    count = 0
    for category in categories:
        if category not in known:
            known[category] = [_made(category, seed) for seed in range(SAMPLE.seeds)]
        for side, made in known[category]:
            if max(side / size, size / side) > SAMPLE.size or count == SAMPLE.objects:
                continue
            count += 1
            whole = moved(made, np.diag([size / side] * 3 + [1.0]))
            bodies = link_inertials(whole, thing or thing_of(category))
            ranges = [b.mass_range or (b.mass, b.mass) for b in bodies]
            yield (
                sum(r[0] for r in ranges), sum(b.mass for b in bodies), sum(r[1] for r in ranges)
            )  # fmt: skip


def _made(category: str, seed: int) -> tuple[float, Articulation]:
    made = make_object(category, seed).articulation
    low, high = made.mesh.bounds
    return float((high - low).max()), made


def _force(name: str, row: dict[str, Any]) -> dict[str, Any]:
    """A row of one kind of joint: from the easiest to the stiffest, N at its farthest point."""
    lows, usual, highs = [], [], []
    for seed in range(SAMPLE.objects):
        made = make_object(row["category"], seed).articulation
        bodies = link_inertials(made, thing_of(row["category"]))
        for joint in with_dynamics(made, bodies, thing_of(row["category"])).joints:
            if made.links[joint.child].kind != row["part"]:
                continue
            arm = gravity_load(made, joint, bodies)[2]
            friction, between = rubbing(joint)
            catch = joint.catch or Catch()
            caught = catch.force_range if any(catch.force_range) else (catch.force, catch.force)
            lows.append((between[0] + caught[0]) / arm)
            usual.append((friction + catch.force) / arm)
            highs.append((between[1] + caught[1]) / arm)
    low, middle, high = (float(np.median(x)) for x in (lows, usual, highs))
    least, most = row["force"]
    values = {
        "ours": f"{middle:.2g} ({low:.2g} to {high:.2g}) N",
        "published": f"{least:g} to {most:g} N",
        "within": f"{int(least <= middle <= most)} of 1",
        "source": row["source"],
    }
    held = f", held by a {row['held']}" if "held" in row else ""
    found = _row(f"{row['category']} {row['part']}", name + held, values)
    return {**found, "held": bool(held)}


def _row(id_: str, name: str, values: dict[str, str]) -> dict[str, Any]:
    head = ["git", "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(head, capture_output=True, text=True).stdout.strip()
    return {
        "id": id_, "name": name, "values": values, "command": COMMAND, "commit": commit,
        "machine": f"{os.cpu_count()} cores, no GPU",
    }  # fmt: skip


if __name__ == "__main__":
    tyro.cli(main)
