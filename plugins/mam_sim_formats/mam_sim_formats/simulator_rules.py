"""What one simulator would refuse or ignore of an MJCF or a USD file, which is read as it is.

An MJCF is compiled by MuJoCo, a USD file composed by OpenUSD; no file outside its folder is opened.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from mam_pipeline import thresholds as limits
from mam_pipeline.check.profiles import Profile, is_identifier
from mam_pipeline.check.report import Finding
from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door
from mam_pipeline.formats.mjcf_files import check_counts
from mam_pipeline.formats.xml_file import parse_xml
from mam_pipeline.optional import require
from mam_sim_formats.usd_layers import check_layers

_MIMIC = {"newton": "NewtonMimicAPI", "isaac": "PhysxMimicJointAPI"}


def mjcf_findings(path: Path, name: str, profile: Profile) -> Iterator[Finding]:
    """Findings about an MJCF; InputError where MuJoCo does not take it."""
    require(f"{path.name}: reading MJCF", "mujoco")
    import mujoco

    _stay_inside(path, path.parent, Door(path.parent), set())
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise InputError("MuJoCo says: " + " ".join(str(error).split())) from error
    if profile.identifiers:
        names = [model.body(i).name for i in range(1, model.nbody)]
        yield from _bad_names([*names, *(model.joint(i).name for i in range(model.njnt))])
    for i in range(model.nbody):
        body = model.body(i)
        first, count = int(model.body_geomadr[i]), int(model.body_geomnum[i])
        solid = [g for g in range(first, first + count)
                 if model.geom_contype[g] or model.geom_conaffinity[g]]  # fmt: skip
        yield from _too_many(body.name, len(solid), profile)
        for g in solid:
            mesh = int(model.geom_dataid[g])
            if model.geom_type[g] != mujoco.mjtGeom.mjGEOM_MESH or model.mesh_graphadr[mesh] < 0:
                continue
            corners = int(model.mesh_graph[model.mesh_graphadr[mesh]])
            if 0 < profile.max_hull_points < corners:
                text = f"its hull has {corners} vertices; the GPU takes {profile.max_hull_points}"
                yield Finding(
                    "hull_points", model.mesh(mesh).name, text, warning=not profile.refuses
                )
    moved = [model.joint(i) for i in range(model.njnt)]
    if not moved:
        yield Finding("no_joint", path.name, "no joint moves")
    for joint in moved:
        if joint.type == mujoco.mjtJoint.mjJNT_SLIDE and not model.jnt_limited[joint.id]:
            text = "a slide without a range goes on for ever"
            yield Finding("bad_limits", joint.name, text, warning=True)


def _stay_inside(path: Path, main: Path, door: Door, seen: set[Path]) -> None:
    """Look up every file that an MJCF names, and those that it includes, before MuJoCo does."""
    if path in seen:
        return
    seen.add(path)
    root = parse_xml(path, limits.MAX_XML_BYTES)
    check_counts(root, path)
    folders = {main}
    for compiler in root.iter("compiler"):
        folders |= {main / compiler.get(k, "") for k in ("assetdir", "meshdir", "texturedir")}
    for element in root.iter():
        for key, told in element.attrib.items():
            if not key.startswith("file") or not told:
                continue
            for folder in folders:  # a name that leads nowhere from one is meant from another
                there = (folder / told).exists()
                file = door.find(told, path, folder) if there else None
                if file is not None and file.suffix.lower() == ".xml":
                    _stay_inside(file, main, door, seen)


def usd_findings(path: Path, name: str, profile: Profile) -> Iterator[Finding]:
    """Findings about a USD file; InputError where OpenUSD does not take it."""
    require(f"{path.name}: reading USD", "pxr")
    from pxr import Tf, Usd, UsdGeom, UsdPhysics

    try:
        check_layers(path, Door(path.parent))
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise InputError(f"OpenUSD says: {str(error).strip().splitlines()[-1]}") from error
    told = {
        "default prim": bool(stage.GetDefaultPrim()),
        "metersPerUnit": UsdGeom.StageHasAuthoredMetersPerUnit(stage),
        "upAxis": stage.HasAuthoredMetadata("upAxis"),
    }
    for what in [k for k, said in told.items() if not said]:
        yield Finding("usd_metadata", path.name, f"it names no {what}; a simulator takes its own")
    prims = list(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
    joints = [p for p in prims if p.IsA(UsdPhysics.Joint)]
    moving = [p for p in joints
              if p.IsA(UsdPhysics.RevoluteJoint) or p.IsA(UsdPhysics.PrismaticJoint)]  # fmt: skip
    bodies = [p for p in prims if p.HasAPI(UsdPhysics.RigidBodyAPI)]
    if not moving:
        yield Finding("no_joint", path.name, "no joint is revolute or prismatic")
    roots = [p for p in prims if p.HasAPI(UsdPhysics.ArticulationRootAPI)]
    if moving and len(roots) != 1:
        text = f"{len(roots)} articulation roots; with one, its joints are solved together"
        yield Finding("articulation_root", path.name, text)
    for joint in joints:
        if not UsdPhysics.Joint(joint).GetBody1Rel().GetTargets():
            yield Finding("bad_tree", str(joint.GetPath()), "the joint moves no body (body1)")
    for joint in moving:
        yield from _usd_joint(joint, name)
    for body in bodies:
        inside = list(Usd.PrimRange(body, Usd.TraverseInstanceProxies()))
        solid = [p for p in inside if p.HasAPI(UsdPhysics.CollisionAPI)]
        where = str(body.GetPath())
        yield from _too_many(where, len(solid), profile)
        mass = UsdPhysics.MassAPI(body)
        has_mass = body.HasAPI(UsdPhysics.MassAPI) and (mass.GetMassAttr().Get() or 0) > 0
        if not has_mass and not solid:
            yield Finding("no_inertia", where, "it has neither a mass nor a collider to tell it")
        tensor = np.array(mass.GetDiagonalInertiaAttr().Get() or (0, 0, 0), dtype=float)
        if 2 * tensor.max() > tensor.sum() * (1 + 1e-6):
            text = "its inertia breaks the triangle inequality: no body has it"
            yield Finding("inertia_impossible", where, text, warning=True)
        for prim in solid:
            form = UsdPhysics.MeshCollisionAPI(prim).GetApproximationAttr().Get()
            if prim.IsA(UsdGeom.Mesh) and form in (None, "none"):
                text = "its triangles cannot collide on a moving body; its hull will"
                yield Finding("concave_collision", str(prim.GetPath()), text, warning=True)


def _usd_joint(joint: Any, name: str) -> Iterator[Finding]:
    where = str(joint.GetPath())
    low, high = (joint.GetAttribute(f"physics:{k}Limit").Get() for k in ("lower", "upper"))
    if low is not None and high is not None and low >= high:
        yield Finding("bad_limits", where, f"its limits {low:g} and {high:g} leave it no way")
    applied = {str(s).split(":")[0] for s in joint.GetAppliedSchemas()}
    if applied & set(_MIMIC.values()) and _MIMIC.get(name) not in applied:
        text = (
            f"its coupling is written in {', '.join(sorted(applied & set(_MIMIC.values())))} only"
        )
        yield Finding("mimic_ignored", where, text)


def _bad_names(names: list[str]) -> Iterator[Finding]:
    for name in names:
        if not is_identifier(name):
            text = "a name must begin with a letter and hold letters, digits and _ only"
            yield Finding("name_invalid", name or "(no name)", text)


def _too_many(where: str, count: int, profile: Profile) -> Iterator[Finding]:
    if 0 < profile.max_hulls < count:
        text = f"{count} collision shapes; the GPU takes {profile.max_hulls} a body"
        yield Finding("hull_count", where, text)
