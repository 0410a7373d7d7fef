"""Masses of generated objects beside those that are published for products of the same kind.

    python benchmarks/masses.py --seeds 20 --out docs/results/masses.json

The published figures are ranges from pages for buyers and movers, in kilograms; objects outside
the sizes in metres that a product of that kind has are left out.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mam_pipeline.asset.inertia import link_inertials
from mam_pipeline.evidence.read import named_size
from mam_world import make_object


@dataclass(frozen=True)
class Product:
    """A kind of product: `category` of the world, size bounds (metres), published range (kg)."""

    name: str
    category: str
    smallest: float
    largest: float
    low: float
    high: float
    source: str


PRODUCTS = (
    Product("small chest or nightstand", "nightstand", 0.4, 0.75, 14, 36,
            "engineerfix.com, three-drawer chest, 30 to 80 lb"),
    Product("dresser", "chest_of_drawers", 0.8, 1.4, 32, 68,
            "engineerfix.com, six-drawer dresser, 70 to 150 lb"),
    Product("base cabinet", "cabinet_one_door", 0.6, 1.0, 34, 45,
            "cabinetskitchen.net, base cabinet, 75 to 100 lb"),
    Product("countertop microwave", "microwave", 0.4, 0.65, 9, 23,
            "ovencookguy.com, 20 to 50 lb"),
    Product("built-in dishwasher", "dishwasher", 0.75, 0.95, 27, 50,
            "dishwasherusa.com and homegeargeek.com, 60 to 110 lb"),
    Product("front-loading washer", "washer_front", 0.8, 1.0, 60, 80,
            "homeownercosts.co.uk, with its concrete weight"),
)  # fmt: skip


def main() -> None:
    """Print a line per kind, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    head = ["git", "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(head, capture_output=True, text=True).stdout.strip()
    rows = []
    for product in PRODUCTS:
        masses, thing = [], named_size(product.category.replace("_", " "))[0]
        for seed in range(args.seeds):
            made = make_object(product.category, seed).articulation
            size = float((made.mesh.bounds[1] - made.mesh.bounds[0]).max())
            if product.smallest <= size <= product.largest:
                masses.append(sum(body.mass for body in link_inertials(made, thing)))
        values = {
            "objects": len(masses),
            "ours, median kg": round(float(np.median(masses)), 1) if masses else None,
            "ours, kg": f"{min(masses):.0f} to {max(masses):.0f}" if masses else "",
            "published, kg": f"{product.low:g} to {product.high:g}",
            "source": product.source,
        }
        print(product.name, values)
        rows.append({
            "id": product.category, "name": product.name, "values": values,
            "command": f"python benchmarks/masses.py --seeds {args.seeds}", "commit": commit,
            "machine": f"{os.cpu_count()} cores, no GPU",
        })  # fmt: skip
    columns = {"objects": "d", "ours, median kg": ".1f", "ours, kg": "s", "published, kg": "s",
               "source": "s"}  # fmt: skip
    paths = ["world", "pipeline/mam_pipeline/asset", "pipeline/mam_pipeline/evidence/kinds.yaml"]
    title = "Masses beside published ones"
    table = {"title": title, "columns": columns, "paths": paths, "rows": rows}
    if args.out is not None:
        args.out.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
