"""An articulation in which fewer parts move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mam_pipeline.types import Articulation, DormantPart, Link


def put_to_sleep(articulation: Articulation, why: Mapping[str, str]) -> Articulation:
    """The articulation in which some joints are dormant, and those that follow them.

    Args:
        why: the reason in words, by the joint's name.
    """
    why = {
        j.name: f"it follows {j.coupling.joint}"
        for j in articulation.joints if j.coupling is not None and j.coupling.joint in why
    } | dict(why)  # fmt: skip
    asleep = [j for j in articulation.joints if j.name in why]
    host = list(range(len(articulation.links)))
    for joint in asleep:  # parents come first
        host[joint.child] = host[joint.parent]
    held: dict[int, list[Link]] = {h: [] for h in sorted(set(host))}
    for link, h in zip(articulation.links, host):
        held[h].append(link)
    number = {h: k for k, h in enumerate(held)}
    new = [number[h] for h in host]
    links = tuple(
        replace(
            articulation.links[h],
            faces=np.sort(np.concatenate([link.faces for link in own])),
            primitives=tuple(sorted(p for link in own for p in link.primitives)),
        )
        for h, own in held.items()
    )
    joints = tuple(
        replace(j, parent=new[j.parent], child=new[j.child])
        for j in articulation.joints if j.name not in why
    )  # fmt: skip
    before = [replace(d, joint=replace(d.joint, parent=new[d.joint.parent]))
              for d in articulation.dormant]  # fmt: skip
    others = [d.link.faces for d in articulation.dormant]
    inside = np.concatenate(others) if others else np.zeros(0, dtype=np.int64)
    bodies = [replace(k, faces=np.setdiff1d(k.faces, inside)) for k in articulation.links]
    more = [
        DormantPart(
            bodies[j.child],
            replace(j, parent=new[j.parent], child=-1, coupling=None, dormant=why[j.name]),
        )
        for j in asleep
    ]
    grasps = tuple(g for g in articulation.grasps if g.joint not in why)
    return replace(articulation, links=links, joints=joints, grasps=grasps,
                   dormant=(*before, *more))  # fmt: skip
