"""An asset folder read back as an Articulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mam_pipeline.asset.card import Asset
from mam_pipeline.formats.urdf.read import read_urdf
from mam_pipeline.formats.urdf.tree import carrier
from mam_pipeline.types import Articulation, Grasp, Joint


def read_asset(asset: Asset) -> Articulation:
    """An asset folder of ours as an Articulation: geometry from the URDF, the rest from the card.

    Face order is by link, not that of the source mesh; what is fixed to a link is part of it.
    """
    bare = read_urdf(asset.urdf_path)
    index = {link.name: i for i, link in enumerate(bare.links)}
    kinds = {part.link: part.kind for part in asset.card.parts}
    fixed = {card.child: card for card in asset.card.joints if card.type == "fixed"}
    joints = []
    for card in asset.card.joints:
        if card.child in fixed:
            continue
        parent = index[carrier(card.parent, fixed)]
        fields = {**vars(card), "parent": parent, "child": index[card.child]}
        fields["lower"] = -np.inf if card.lower is None else card.lower
        fields["upper"] = np.inf if card.upper is None else card.upper
        joints.append(Joint(**fields))
    links = tuple(replace(link, kind=kinds.get(link.name, link.kind)) for link in bare.links)
    grasps = tuple(Grasp(**vars(g)) for g in asset.card.grasps)
    return Articulation(bare.mesh, links, tuple(joints), grasps)
