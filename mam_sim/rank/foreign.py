"""A URDF that we did not write, as an asset that robots can be given: its own file and a card.

The URDF and its meshes are copied as they are: collision shapes, masses and limits are the
author's. The card says what our writer would have said beside them: joints, and where to grasp.
"""

from __future__ import annotations

import shutil
from dataclasses import asdict
from pathlib import Path

import numpy as np

from mam_pipeline.asset.card import Asset, AssetCard, CardGrasp, CardJoint, CardPart
from mam_pipeline.asset.grasps import find_grasps
from mam_pipeline.errors import InputError
from mam_pipeline.formats.urdf.admit import admitted
from mam_pipeline.formats.urdf.read import read_urdf
from mam_sim.batch.inputs import files_of


def foreign_asset(urdf: Path, out: Path) -> Asset:
    """Copy a URDF and its files into the folder `out`, with a card.

    Raises:
        InputError: it is no URDF that can be read, or nothing moves in it.
    """
    articulation = read_urdf(urdf)
    root = admitted(urdf)
    elements = {e.get("name"): e for e in root.findall("joint")}
    joints = []
    for joint in articulation.joints:
        element = elements.get(joint.name)
        if element is None:
            raise InputError(f"{urdf}: joint {joint.name!r} has no element of its name")
        ends: dict[str, str] = {}
        for key in ("parent", "child"):
            end = element.find(key)
            ends[key] = "" if end is None else str(end.get("link"))
        finite = np.isfinite([joint.lower, joint.upper])
        joints.append(
            CardJoint(
                name=joint.name,
                type=str(element.get("type")),  # type: ignore[arg-type]
                subtype="slide" if joint.type == "prismatic" else "hinge",
                axis=joint.axis.tolist(),
                origin=joint.origin.tolist(),
                lower=float(joint.lower) if finite[0] else None,
                upper=float(joint.upper) if finite[1] else None,
                closed=joint.closed,
                open=joint.open,
                friction=joint.friction,
                damping=joint.damping,
                provenance="user",
                parent=ends["parent"],
                child=ends["child"],
            )
        )
    grasps = []
    for grasp in find_grasps(articulation):
        data = asdict(grasp)
        data |= {k: data[k].tolist() for k in ("position", "approach", "closing")}
        grasps.append(CardGrasp(**data))
    shutil.rmtree(out, ignore_errors=True)
    for file in files_of(urdf):
        place = out / file.resolve().relative_to(urdf.parent.resolve())
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, place)
    card = AssetCard(
        name=urdf.stem,
        urdf=urdf.name,
        bounds=articulation.mesh.bounds.tolist(),
        parts=[CardPart(link.name, link.name, link.kind) for link in articulation.links],
        joints=joints,
        grasps=grasps,
        notes=["a URDF of somebody else's, as it is"],
    )
    card.save(out)
    return Asset.load(out)
