"""Repairs of bodies: mass and inertia, and convex pieces that collide."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import trimesh
import yourdfpy
from scipy.spatial import ConvexHull

from mam_pipeline.asset.collision import collision_shapes
from mam_pipeline.asset.decompose import Chunk, hull_volume
from mam_pipeline.asset.inertia import MIN_MASS, link_inertials
from mam_pipeline.asset.matter import made_alike
from mam_pipeline.asset.shapes import few_points, shape_around
from mam_pipeline.check.model import CheckModel
from mam_pipeline.check.profiles import (
    ENTRIES,
    HULLS,
    PROFILES,
    lack,
    tensor_of,
    too_fine,
    turn_of,
)
from mam_pipeline.errors import MamSimError
from mam_pipeline.evidence.names import object_of
from mam_pipeline.evidence.spec import Said
from mam_pipeline.formats.urdf.geometry import shape_triangles
from mam_pipeline.formats.urdf.read import read_bodies
from mam_pipeline.formats.urdf.tree import UrdfTree
from mam_pipeline.formats.urdf.write import collision_element, hull_text, numbers
from mam_pipeline.geometry.stand_in import lightened
from mam_pipeline.geometry.surface import hull_of
from mam_pipeline.mend.work import Work, attribute, child, counted, number, pose_of, short
from mam_pipeline.types import Articulation, CollisionShape, FloatArray, Inertial, Link, Mesh


@dataclass(frozen=True)
class BodyRules:
    """How bodies are mended.

    Attributes:
        ball: metres: radius of what stands for a body of which nothing is seen.
        growth: share of the largest moment by which the others may grow together.
    """

    ball: float = 0.02
    growth: float = 0.5


RULES = BodyRules()


def inertia(work: Work, reason: str = "bad_inertia") -> None:
    """Mass properties from the surface of a link and what such things are made of.

    A mass that is one is kept; a tensor that breaks the triangle inequality by little grows.
    """
    inertials = None
    for name, link in _moved(work):
        element = link.find("inertial")
        mass = number(attribute(element, "mass", "value")) if element is not None else None
        mass = mass if mass is not None and mass > 0 else None
        tensor = None if element is None else tensor_of(element)
        good = tensor is not None and np.linalg.eigvalsh(tensor)[0] > 0
        if mass is not None and tensor is not None and good and lack(tensor) <= 0.0:
            continue
        told = "" if element is None else attribute(element, "mass", "value")
        before = "no inertial" if element is None else f"mass {told or 'none'}, {_moments(tensor)}"
        if element is not None and mass is not None and tensor is not None and good:
            after = _grown(element, tensor)
            if after is not None:
                why = "the least growth to moments that a body can have"
                work.change(reason, name, before, after, why)
                continue
        if (element is None) != (reason in ("no_inertia", "inertial_missing")):
            continue
        inertials = _measured(work) if inertials is None else inertials
        found = inertials.get(name)
        if found is None:
            own = MIN_MASS if mass is None else mass
            made = Inertial(own, np.zeros(3), np.eye(3) * 0.4 * own * RULES.ball**2)
            why = f"nothing of it is seen: a ball of {100 * RULES.ball:g} cm"
        else:
            made = found if mass is None else replace(
                found, mass=mass, inertia=found.inertia * mass / found.mass)  # fmt: skip
            why = f"from its surface: {found.material}"
            why = why if mass is None else "its mass, spread as its surface is"
        _write_inertial(link, made)
        after = f"mass {made.mass:.4g} kg, {_moments(made.inertia)}"
        work.change(reason, name, before, after, why)


def _moved(work: Work) -> Iterator[tuple[str, ET.Element]]:
    """Links that some joint moves, or that are fixed to one that is."""
    holds = {attribute(j, "child", "link"): j for j in work.joints.values()}
    for name, link in work.links.items():
        at, seen = name, set[str]()
        while at in holds and holds[at].get("type") == "fixed" and at not in seen:
            seen.add(at)
            at = attribute(holds[at], "parent", "link")
        if at in holds:
            yield name, link


def _grown(element: ET.Element, tensor: FloatArray) -> str | None:
    """Grow a tensor to one that a body can have; None where it is too far from one."""
    values, axes = np.linalg.eigh(tensor)
    missing = values[2] - values[0] - values[1]
    if missing > RULES.growth * values[2]:
        return None
    values[:2] += 0.5001 * missing
    _write_tensor(element, axes @ np.diag(values) @ axes.T)
    return _moments(np.diag(values))


def _moments(tensor: FloatArray | None) -> str:
    """The principal moments of inertia of a tensor (3, 3), in words."""
    if tensor is None:
        return "no moments"
    return f"moments {short(np.linalg.eigvalsh(tensor))} kg m2"


def _measured(work: Work) -> dict[str, Inertial]:
    """Mass properties of every link that shows a surface, in its own frame."""
    work.save()
    try:
        mesh, tree = read_bodies(work.urdf).mesh, UrdfTree.read(work.urdf)
    except MamSimError:
        return {}
    assert mesh.face_group is not None
    links = [Link(n, _kind(n), np.flatnonzero(mesh.face_group == i))
             for i, n in enumerate(mesh.group_names)]  # fmt: skip
    links.sort(key=lambda link: tree.carrier(link.name) != tree.root)  # a machine is in its body
    bodies = link_inertials(lightened(Articulation(mesh, tuple(links), ())), _thing(work))
    out = {}
    for link, body in zip(links, bodies):
        frame = tree.frames[link.name]
        turn, place = frame[:3, :3], frame[:3, 3]
        out[link.name] = replace(
            body, center=turn.T @ (body.center - place), inertia=turn.T @ body.inertia @ turn
        )
    return out


def _thing(work: Work) -> str:
    """The kind of object that the robot's name, the file's or its folder's says; "" for none."""
    names = (work.root.get("name") or "", work.source.stem, work.source.absolute().parent.name)
    found = (object_of(name, Said("file name", name)) for name in names)
    return next((one.word for one in found if one is not None), "")


def _kind(name: str) -> str:
    """What a name says that the link is made of."""
    words = re.split(r"[^a-z]+", name.lower())
    return next((w for w in words if w in made_alike()), "body")


def _write_inertial(link: ET.Element, body: Inertial) -> None:
    for old in link.findall("inertial"):
        link.remove(old)
    element = ET.Element("inertial")
    link.insert(0, element)
    ET.SubElement(element, "origin", xyz=numbers(body.center), rpy="0 0 0")
    ET.SubElement(element, "mass", value=numbers([body.mass]))
    _write_tensor(element, body.inertia)


def _write_tensor(element: ET.Element, tensor: FloatArray) -> None:
    target = child(element, "inertia")
    for key, (i, k) in ENTRIES.items():
        target.set(key, numbers([tensor[i, k]]))


def straight_inertial(work: Work, reason: str = "inertial_turned") -> None:
    """Inertial frames that are not turned: the rotation goes into the tensor."""
    for name, link in work.links.items():
        element = link.find("inertial")
        turn = None if element is None else turn_of(element)
        tensor = None if element is None else tensor_of(element)
        if element is None or turn is None or tensor is None:
            continue
        before = attribute(element, "origin", "rpy")
        child(element, "origin").set("rpy", "0 0 0")
        _write_tensor(element, turn @ tensor @ turn.T)
        why = "the same body: the rotation is in the tensor, where all read it"
        work.change(reason, name, f"rpy {before}", "rpy 0 0 0", why)


def body_inertials(work: Work, model: CheckModel) -> list[Inertial]:
    """Mass properties of every body of the model by the URDF's own inertials, root frame."""
    tree = UrdfTree.read(work.urdf)
    index = {link.name: i for i, link in enumerate(model.articulation.links)}
    parts: list[list[Inertial]] = [[] for _ in index]
    for link in tree.robot.links:
        owner = tree.body_of(link.name, index) if link.name in tree.frames else None
        own = link.inertial
        if owner is None or own is None or not own.mass or own.inertia is None:
            continue
        frame = tree.frames[link.name] @ (np.eye(4) if own.origin is None else own.origin)
        turned = frame[:3, :3] @ own.inertia @ frame[:3, :3].T
        parts[index[owner]].append(Inertial(own.mass, frame[:3, 3], turned))
    return [_together(some) for some in parts]


def _together(parts: list[Inertial]) -> Inertial:
    mass = sum(p.mass for p in parts)
    if mass <= 0.0:
        return Inertial(MIN_MASS, np.zeros(3), np.eye(3) * MIN_MASS * 1e-4)
    center = sum((p.mass * p.center for p in parts), np.zeros(3)) / mass
    tensor = np.zeros((3, 3))
    for p in parts:
        r = p.center - center
        tensor += p.inertia + p.mass * (r @ r * np.eye(3) - np.outer(r, r))
    return Inertial(mass, center, tensor)


def rebuild(
    work: Work,
    reason: str,
    wanted: set[str] | None = None,
    why: str = "from what is seen of it",
) -> None:
    """Convex pieces of bodies, made anew from what is seen of them.

    Args:
        wanted: names of bodies of the model; None for all.
    """
    model = work.model()
    if model is None:
        return
    light = lightened(model.articulation)
    skip = frozenset(k.name for k in light.links if wanted is not None and k.name not in wanted)
    made = collision_shapes(light, skip=skip)
    tree = UrdfTree.read(work.urdf)
    index = {link.name: i for i, link in enumerate(light.links)}
    for name, shapes in made.items():
        if not shapes:
            continue
        members = [n for n in tree.frames if tree.body_of(n, index) == name]
        before = 0
        for member in members:
            for old in work.links[member].findall("collision"):
                work.links[member].remove(old)
                before += 1
        back: FloatArray = np.asarray(np.linalg.inv(tree.frames[name]), dtype=np.float64)
        _write_pieces(work, work.links[name], name, [_moved_shape(s, back) for s in shapes])
        work.change(
            reason, name, counted(before, "collision shape"), counted(len(shapes), "piece"), why
        )


def _moved_shape(shape: CollisionShape, pose: FloatArray) -> CollisionShape:
    points = shape.vertices @ pose[:3, :3].T + pose[:3, 3]
    own = shape.pose if shape.kind == "convex" else pose @ shape.pose
    return replace(shape, pose=own, vertices=points)


def _write_pieces(
    work: Work, link: ET.Element, name: str, shapes: list[CollisionShape],
    origin: ET.Element | None = None,
) -> None:  # fmt: skip
    """Add pieces to a link: in its frame, or in that of the element whose `origin` is given."""
    stem = re.sub(r"\W", "_", name, flags=re.ASCII)
    for shape in shapes:
        file, k = "", 0
        if shape.kind == "convex":
            while not file or (work.folder / file).exists():
                file, k = f"collision/{stem}_{k:02d}.obj", k + 1
            (work.folder / "collision").mkdir(exist_ok=True)
            (work.folder / file).write_text(hull_text(shape, np.zeros(3)), encoding="ascii")
        element = collision_element(link, shape, file, np.zeros(3))
        if origin is not None and shape.kind == "convex":
            element.remove(child(element, "origin"))
            element.insert(0, origin)


def no_collision(work: Work, reason: str = "no_collision") -> None:
    """Pieces for bodies that move and show a surface but collide with nothing."""
    model = work.model()
    if model is None:
        return
    bare = {link.name for link, hulls in zip(model.articulation.links, model.hulls)
            if not hulls and len(link.faces)}  # fmt: skip
    if bare:
        rebuild(work, reason, bare)


def fewer_points(work: Work, reason: str = "hull_points") -> None:
    """Convex hulls of few points in place of those that a GPU refuses."""
    profile = PROFILES["physx-gpu"]
    if reason == "hull_points":  # of several simulators; the least that one of them takes
        few = min(p.max_hull_points for p in PROFILES.values() if p.max_hull_points)
        profile = replace(profile, max_hull_points=few)
    for link, element, (points, _faces) in list(_collision_points(work)):
        name = str(link.get("name"))
        hull = hull_of(points)
        faults = {} if hull is None else too_fine(trimesh.Trimesh(*hull), profile)
        if hull is None or reason not in faults:
            continue
        chunk = Chunk(hull[0], hull[1], 0.0, hull_volume(hull[0]))
        shape = _as_hull(shape_around(chunk, 0.0), chunk)
        link.remove(element)
        _write_pieces(work, link, name, [shape], element.find("origin"))
        away = max(_beyond(points, shape.vertices), _beyond(shape.vertices, points))
        count, most = faults[reason]
        what = {"hull_points": "points", "hull_faces": "faces"}.get(reason, "corners of a face")
        why = f"a GPU takes {most} {what}; the hull's surface moves by {1e3 * away:.2g} mm at most"
        after = f"a hull of {len(shape.vertices)} points"
        work.change(reason, name, f"{count} {what}", after, why)


def _beyond(points: FloatArray, corners: FloatArray) -> float:
    """How far any of points (n, 3) lies outside the hull of corners (m, 3), metres, at most."""
    planes = ConvexHull(corners).equations
    return max(float((points @ planes[:, :3].T + planes[:, 3]).max()), 0.0)


def _as_hull(shape: CollisionShape, chunk: Chunk) -> CollisionShape:
    """The piece as a hull: the element's own origin stays."""
    if shape.kind == "convex":
        return shape
    found = hull_of(few_points(chunk.vertices))
    assert found is not None
    return CollisionShape("convex", vertices=found[0], faces=found[1])


def concave(work: Work, reason: str = "concave_collision") -> None:
    """Convex pieces in place of a concave mesh, which would collide as its hull."""
    for link, element, (vertices, faces) in list(_collision_points(work)):
        name = str(link.get("name"))
        full = hull_volume(vertices)
        solid = trimesh.Trimesh(vertices, faces)
        if not solid.is_watertight or abs(solid.volume) >= HULLS.filled * full:
            continue
        whole = Articulation(
            Mesh(vertices, faces), (Link(name, "body", np.arange(len(faces))),), ()
        )
        shapes = collision_shapes(lightened(whole))[name]
        if len(shapes) < 2:
            continue
        pose = pose_of(element)
        link.remove(element)
        _write_pieces(work, link, name, [_moved_shape(s, pose) for s in shapes])
        why = "a mesh collides as its convex hull, which filled its hollow"
        work.change(reason, name, "1 concave mesh", f"{len(shapes)} pieces", why)


def _collision_points(
    work: Work,
) -> Iterator[tuple[ET.Element, ET.Element, tuple[FloatArray, np.ndarray]]]:
    """(link, element, triangles in the element's frame, scale applied) of collision meshes."""
    for link, kind, element, mesh in work.meshes():
        if kind == "collision":
            scale = [float(w) for w in (mesh.get("scale") or "1 1 1").split()]
            shape = yourdfpy.Mesh(filename=mesh.get("filename") or "", scale=scale)
            found = shape_triangles(yourdfpy.Geometry(mesh=shape), work.folder)
            if found is not None:
                yield link, element, found
