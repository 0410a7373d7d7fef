"""An asset folder read back as an Articulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mam_pipeline.asset.card import Asset, CardJoint
from mam_pipeline.formats.urdf.read import read_bodies
from mam_pipeline.formats.urdf.tree import carrier
from mam_pipeline.types import Articulation, DormantPart, Grasp, Joint, Link


def read_asset(asset: Asset) -> Articulation:
    """An asset folder of ours as an Articulation: geometry from the URDF, the rest from the card.

    Face order is by link, not that of the source mesh; what is fixed to a link is part of it, and
    so are dormant parts.
    """
    bare = read_bodies(asset.urdf_path)
    index = {link.name: i for i, link in enumerate(bare.links)}
    kinds = {part.link: part.kind for part in asset.card.parts}
    fixed = {card.child: card for card in asset.card.joints if card.type == "fixed"}
    asleep = {card.child: replace(card, type="fixed") for card in asset.card.dormant}

    def joint(card: CardJoint) -> Joint:
        parent = index[carrier(card.parent, fixed | asleep)]
        fields = {**vars(card), "parent": parent, "child": index.get(card.child, -1)}
        del fields["origins"]  # words for readers of the card
        fields["lower"] = -np.inf if card.lower is None else card.lower
        fields["upper"] = np.inf if card.upper is None else card.upper
        return Joint(**fields)

    def part(card: CardJoint) -> DormantPart:
        group = list(bare.mesh.group_names).index(card.child)
        faces = np.flatnonzero(bare.mesh.face_group == group)
        return DormantPart(Link(card.child, kinds.get(card.child, "part"), faces), joint(card))

    joints = [joint(card) for card in asset.card.joints if card.child not in fixed]
    links = tuple(replace(link, kind=kinds.get(link.name, link.kind)) for link in bare.links)
    grasps = tuple(Grasp(**vars(g)) for g in asset.card.grasps)
    dormant = tuple(part(card) for card in asset.card.dormant)
    return Articulation(bare.mesh, links, tuple(joints), grasps, dormant)
