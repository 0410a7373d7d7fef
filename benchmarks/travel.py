"""Ranges that the engine gives to joints whose part and line are known, against the true ranges.

    python benchmarks/travel.py DATASET [--out FILE.json]

Every joint of every object is given to the rule for limits with its true part, axis and opening
direction, and with nothing on how far such joints usually go. So what differs from the truth is
what the sweep takes for an obstacle, and the rule's plain caps (a quarter turn, 0.8 of a drawer).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from common import save
from tyro.conf import Positional

from mam_pipeline.joints.limits import Surroundings, embedded_limits
from mam_pipeline.types import Articulation, Joint
from mam_world.ground_truth import list_objects, read_object


@dataclass(frozen=True)
class Row:
    """One joint; angles in rad, lengths in m.

    Attributes:
        true, found: way from rest towards open. share: of the way that the rule wanted.
        stuck: the true way is free, and less than a quarter of it was found.
    """

    object: str
    joint: str
    kind: str
    true: float
    found: float
    share: float
    rule: str
    stuck: bool


def measured(name: str, truth: Articulation, joint: Joint) -> Row:
    """The range of one joint by the engine's rule."""
    part = np.concatenate([truth.links[i].faces for i in truth.carried_links(joint)])
    static = np.setdiff1d(np.arange(len(truth.mesh.faces)), part)
    sign = 1.0 if joint.upper >= -joint.lower else -1.0
    true = min(max(sign * joint.upper, sign * joint.lower), 2.0 * np.pi)
    around = Surroundings.of(truth.mesh, part, static)
    movable = {j.child for j in truth.joints if j.type != "fixed"}
    owner = truth.face_link
    fixed = static[~np.isin(owner[static], sorted(movable - {joint.parent}))]
    found = embedded_limits(
        around, joint.subtype, sign * joint.axis, joint.origin,
        alone=lambda: Surroundings.of(truth.mesh, part, fixed),
    )  # fmt: skip
    way = min(found.upper, 2.0 * np.pi)
    return Row(name, joint.name, joint.type, true, way, found.share, found.rule, way < 0.25 * true)


def main(dataset: Positional[Path], /, only: tuple[str, ...] = (), out: Path | None = None) -> None:
    """Measure every joint and print what is stuck.

    Args:
        dataset: folder of ground-truth URDFs. only: these objects. out: JSON file for the rows.
    """
    rows = []
    for name, category, urdf in list_objects(dataset):
        if only and name not in only:
            continue
        truth = read_object(urdf, name, category).truth_articulation()
        for joint in truth.joints:
            if joint.type != "fixed":
                rows.append(measured(name, truth, joint))
                r = rows[-1]
                print(
                    f"{r.object:<34} {r.joint:<10} {r.kind:<10} true {r.true:.3f}  "
                    f"found {r.found:.3f}  share {r.share:.2f}  {r.rule}{'  STUCK' * r.stuck}",
                    flush=True,
                )
    covered = [min(r.found, r.true) / max(r.found, r.true, 1e-9) for r in rows]
    result = {
        "joints": len(rows),
        "overlap of ranges": round(float(np.mean(covered)), 4),
        "stuck": sum(r.stuck for r in rows),
    }
    print(result)
    save(out, {**result, "rows": [vars(r) for r in rows]})


if __name__ == "__main__":
    tyro.cli(main)
