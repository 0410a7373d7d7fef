"""Writing an asset folder: URDF, visuals, collision pieces and the card, all or nothing."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mam_pipeline import folders
from mam_pipeline.asset.card import Asset, AssetCard, CardGrasp, CardJoint, CardPart
from mam_pipeline.asset.collision import collision_shapes
from mam_pipeline.asset.dynamics import with_dynamics
from mam_pipeline.asset.grasps import find_grasps
from mam_pipeline.asset.inertia import link_inertials
from mam_pipeline.asset.visuals import VisualFormat, write_visuals
from mam_pipeline.errors import NotPhysicalError
from mam_pipeline.formats.urdf.write import hull_text, link_origins, urdf_text
from mam_pipeline.geometry.stand_in import lightened
from mam_pipeline.types import (
    Articulation,
    CollisionShape,
    DormantPart,
    Inertial,
    Joint,
)

LONGEST_NAME = 100
"""Characters of a link's or joint's name; names of files are made of it."""


def write_asset(
    articulation: Articulation,
    out: str | Path,
    *,
    name: str,
    source: Mapping[str, Any] | None = None,
    source_to_asset: ArrayLike | None = None,
    metres_per_unit: float = 1.0,
    metres_per_unit_source: str = "assumed",
    placement: Sequence[Mapping[str, Any]] = (),
    collision: Mapping[str, Sequence[CollisionShape]] | None = None,
    backends: Mapping[str, Any] | None = None,
    seconds: Mapping[str, float] | None = None,
    notes: Sequence[str] = (),
    visuals: VisualFormat = "obj",
    thing: str = "",
    unconfirmed: str = "",
) -> Asset:
    """Write the folder `out`, replacing an asset that was there; a killed run leaves no half.

    Args:
        articulation: in the asset frame (metres, Z up, front towards -X, floor z = 0).
        out: the folder.
        name: of the asset.
        source: {path, sha256, kind} of the input.
        source_to_asset: (4, 4) file coordinates to asset frame, scale included.
        metres_per_unit, metres_per_unit_source: the scale and who said so. placement: decisions on
            up, unit and front, for the card.
        collision: pieces by link name (asset frame); computed for links that it leaves out.
        backends, seconds, notes, unconfirmed: for the card.
        visuals: format of the visual meshes; OBJ is what every simulator reads.
        thing: the kind of object, by the table of kinds; its masses, and what keeps its parts
            closed, are those of such things.

    Raises:
        NotPhysicalError: a link without surface, or numbers that are not finite.
    """
    out = Path(out)
    began = time.perf_counter()
    articulation = _valid(articulation)
    light = lightened(articulation)  # what is felt; what is seen keeps every triangle
    grasps = articulation.grasps or find_grasps(light)
    articulation, light = with_fixed(articulation), with_fixed(light)
    inertials = link_inertials(light, thing)
    light = with_dynamics(light, inertials, thing)
    pieces = {k: list(v) for k, v in (collision or {}).items()}
    if any(link.name not in pieces for link in light.links):
        pieces = {**collision_shapes(light, skip=frozenset(pieces)), **pieces}
    articulation = replace(articulation, joints=light.joints, grasps=grasps)
    with folders.new_folder(out) as work:
        (work / "visual").mkdir()
        (work / "collision").mkdir()
        written = write_visuals(articulation, work, visuals)
        shapes = _write_collision(articulation, pieces, work)
        text = urdf_text(articulation, inertials, written.files, shapes, _identifier(name))
        (work / "object.urdf").write_text(text, encoding="utf-8")
        card = _card(articulation, inertials, written.handles)
        card = replace(
            card,
            name=name,
            source=dict(source or {}),
            source_to_asset=_matrix(source_to_asset),
            metres_per_unit=float(metres_per_unit),
            metres_per_unit_source=metres_per_unit_source,
            placement=[dict(decision) for decision in placement],
            backends=dict(backends or {}),
            seconds={**(seconds or {}), "write": round(time.perf_counter() - began, 3)},
            notes=[*notes, *written.notes],
            unconfirmed=unconfirmed,
        )
        card.save(work)
    return Asset(out.resolve(), card)


def _valid(articulation: Articulation) -> Articulation:
    """Names that files and simulators take, and numbers that are finite."""
    if not np.isfinite(articulation.mesh.vertices).all():
        raise NotPhysicalError("the mesh has vertices that are not finite numbers")
    all_links = [*articulation.links, *(d.link for d in articulation.dormant)]
    all_joints = [*articulation.joints, *(d.joint for d in articulation.dormant)]
    names = _unique([link.name for link in all_links], "link")
    links = [replace(link, name=n) for link, n in zip(all_links, names)]
    joint_names = _unique([j.name for j in all_joints], "joint")
    old_joint = {j.name: n for j, n in zip(all_joints, joint_names)}
    joints = []
    for joint, joint_name in zip(all_joints, joint_names):
        length = float(np.linalg.norm(joint.axis))
        known = np.isfinite([*joint.axis, *joint.origin]).all() and length > 1e-6
        if not known or np.isnan([joint.lower, joint.upper]).any():
            raise NotPhysicalError(f"joint {joint.name!r} has no finite axis, origin or limits")
        if joint.type != "continuous" and not joint.upper >= joint.lower:
            raise NotPhysicalError(
                f"joint {joint.name!r} has limits {joint.lower:.4g} > {joint.upper:.4g}"
            )
        follows = joint.coupling
        if follows is not None:
            follows = replace(follows, joint=old_joint[follows.joint])
        axis = joint.axis / length
        joints.append(replace(joint, name=joint_name, axis=axis, coupling=follows))
    old_link = {link.name: n for link, n in zip(articulation.links, names)}
    grasps = tuple(
        replace(g, joint=old_joint.get(g.joint, g.joint), link=old_link.get(g.link, g.link))
        for g in articulation.grasps
    )
    n, m = len(articulation.links), len(articulation.joints)
    return replace(
        articulation, links=tuple(links[:n]), joints=tuple(joints[:m]), grasps=grasps,
        dormant=tuple(map(DormantPart, links[n:], joints[m:])),
    )  # fmt: skip


def with_fixed(articulation: Articulation) -> Articulation:
    """The articulation in which every dormant part is a link of its own behind a fixed joint."""
    if not articulation.dormant:
        return articulation
    taken = np.concatenate([d.link.faces for d in articulation.dormant])
    links = [replace(k, faces=np.setdiff1d(k.faces, taken)) for k in articulation.links]
    joints = list(articulation.joints)
    for part in articulation.dormant:
        joint = replace(part.joint, type="fixed", child=len(links), lower=0.0, upper=0.0)
        joints.append(joint)
        links.append(part.link)
    return replace(articulation, links=tuple(links), joints=tuple(joints))


def _write_collision(
    articulation: Articulation, pieces: Mapping[str, Sequence[CollisionShape]], folder: Path
) -> dict[str, list[tuple[CollisionShape, str]]]:
    """Convex pieces as OBJ files in the link frame; primitives stay in the URDF."""
    origins = link_origins(articulation)
    out: dict[str, list[tuple[CollisionShape, str]]] = {}
    for i, link in enumerate(articulation.links):
        out[link.name] = []
        for k, shape in enumerate(pieces.get(link.name, ())):
            file = ""
            if shape.kind == "convex":
                file = f"collision/{link.name}_{k:02d}.obj"
                (folder / file).write_text(hull_text(shape, origins[i]), encoding="ascii")
            out[link.name].append((shape, file))
    return out


def _card(
    articulation: Articulation, inertials: Sequence[Inertial], handles: Mapping[str, list[str]]
) -> AssetCard:
    links = articulation.links
    parts = [
        CardPart(
            link.name,
            link.name,
            link.kind,
            list(link.primitives),
            body.mass,
            body.mass_range,
            handles[link.name],
            body.material,
            body.friction,
            body.restitution,
        )
        for link, body in zip(links, inertials)
    ]
    wanted = {f.name for f in fields(CardJoint)}

    def row(joint: Joint, child: str) -> CardJoint:
        data = {k: v for k, v in vars(joint).items() if k in wanted}
        data |= {"parent": links[joint.parent].name, "child": child}
        data |= {"axis": joint.axis.tolist(), "origin": joint.origin.tolist()}
        data |= {k: v if np.isfinite(v) else None for k, v in _limits(joint).items()}
        data["evidence"] = dict(joint.evidence)
        return CardJoint(**data)

    joints = [row(j, links[j.child].name) for j in articulation.joints if not j.dormant]
    dormant = [row(d.joint, d.link.name) for d in articulation.dormant]
    grasps = []
    for grasp in articulation.grasps:
        data = asdict(grasp)
        data |= {k: data[k].tolist() for k in ("position", "approach", "closing")}
        grasps.append(CardGrasp(**data))
    bounds = articulation.mesh.bounds.tolist()
    return AssetCard(
        name="", bounds=bounds, parts=parts, joints=joints, dormant=dormant, grasps=grasps
    )


def _limits(joint: Joint) -> dict[str, float]:
    return {"lower": joint.lower, "upper": joint.upper}


def _matrix(given: ArrayLike | None) -> list[list[float]]:
    matrix = np.eye(4) if given is None else np.asarray(given, dtype=float).reshape(4, 4)
    return [[float(x) for x in row] for row in matrix]


def _identifier(name: str) -> str:
    clean = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_") or "object"
    return f"object_{clean}" if clean[0].isdigit() else clean


def _unique(names: Sequence[str], default: str) -> list[str]:
    seen: set[str] = set()
    out = []
    for name in names:
        base = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_")[:LONGEST_NAME] or default
        if base[0].isdigit():  # USD and MATLAB take no such name
            base = f"{default}_{base}"
        candidate, k = base, 1
        while candidate.lower() in seen:  # file systems may not tell cases apart
            candidate, k = f"{base}_{k}", k + 1
        seen.add(candidate.lower())
        out.append(candidate)
    return out
