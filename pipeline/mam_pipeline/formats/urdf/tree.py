"""A parsed URDF at rest: frames of its links, the bodies that move as one, and their joints."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yourdfpy

from mam_pipeline.errors import InputError
from mam_pipeline.formats.urdf.admit import admitted
from mam_pipeline.types import Articulation, Coupling, FloatArray, Joint

MOVING = {"revolute", "continuous", "prismatic"}
MOST_TURN = 200.0 * np.pi
"""Radians; a hinge with a wider range turns without end."""


@dataclass(frozen=True)
class UrdfTree:
    """Links and joints of one URDF; planar and floating joints count as fixed.

    Attributes:
        path: the file; mesh names in it are resolved against its folder.
        robot: the parsed `yourdfpy.Robot`.
        frames: (4, 4) `root_T_link` of every link at q = 0, parents before children.
        inbound: link name -> the joint that holds it; the root has none.
    """

    path: Path
    robot: Any
    frames: Mapping[str, FloatArray]
    inbound: Mapping[str, Any]

    @staticmethod
    def read(path: str | Path) -> UrdfTree:
        """Parse a file without its meshes.

        Raises:
            InputError: no such file, not a URDF, or joints that form a loop.
        """
        file = Path(path)
        robot = parse_urdf(file)
        return UrdfTree(file, robot, _rest_frames(robot, file), {j.child: j for j in robot.joints})

    @property
    def root(self) -> str:
        """Name of the root link."""
        return next(iter(self.frames))

    def carrier(self, link: str) -> str:
        """The link whose joint moves this one: itself, or the nearest over fixed joints."""
        return carrier(link, self.inbound)

    def bodies(self, solid: Iterable[str]) -> dict[str, int]:
        """Links that are bodies of their own, with their index; the root comes first.

        Links joined by fixed joints are one body, named after the link that carries them.

        Args:
            solid: names of the links that have a surface; a link without one is no body.
        """
        shown = {self.carrier(link) for link in solid}
        names = [n for n in self.frames if n in shown and n != self.root and self.carrier(n) == n]
        return {name: i for i, name in enumerate([self.root, *names])}

    def body_of(self, link: str, bodies: Mapping[str, int]) -> str | None:
        """The body that a link moves with: that of the nearest ancestor that is one."""
        name = self.carrier(link)
        while name not in bodies:
            if name not in self.inbound:
                return None
            name = self.carrier(self.inbound[name].parent)
        return name

    def joint(self, body: str, bodies: Mapping[str, int]) -> Joint:
        """The joint of a body other than the root, in the root's frame at rest.

        A link without a surface hands its motion to the body behind it (of a chain of joints the
        last that is not a mimic counts). A revolute joint without limits is continuous.
        """
        source, parent = self._source(body, bodies)
        frame = self.frames[source.child]
        lower, upper, kind = _limits(source)
        return Joint(
            name=self.inbound[body].name,
            type=kind,
            subtype={"prismatic": "slide", "continuous": "spin"}.get(kind, "hinge"),  # type: ignore[arg-type]
            parent=bodies[parent],
            child=bodies[body],
            axis=frame[:3, :3] @ _unit_axis(source),
            origin=frame[:3, 3],
            lower=min(lower, upper),
            upper=max(lower, upper),
            coupling=self._coupling(source, bodies),
        )

    def _source(self, body: str, bodies: Mapping[str, int]) -> tuple[Any, str]:
        """The URDF's joint that gives a body its motion, and the body that it hangs on."""
        chain = [self.inbound[body]]
        parent = self.carrier(self.inbound[body].parent)
        while parent not in bodies:  # a moving link without a surface
            chain.append(self.inbound[parent])
            parent = self.carrier(self.inbound[parent].parent)
        return next((j for j in chain if j.mimic is None), chain[0]), parent

    def _coupling(self, source: Any, bodies: Mapping[str, int]) -> Coupling | None:
        """What a mimic joint follows at last; None where that moves no body."""
        named = {j.name: j for j in self.robot.joints}
        multiplier, offset, seen = 1.0, 0.0, set[str]()
        while source.mimic is not None:
            if source.name in seen or source.mimic.joint not in named:
                return None
            seen.add(source.name)
            own = source.mimic
            factor = 1.0 if own.multiplier is None else float(own.multiplier)
            offset += multiplier * float(own.offset or 0.0)
            multiplier *= factor
            source = named[own.joint]
        for body in bodies:
            if seen and body != self.root and self._source(body, bodies)[0] is source:
                return Coupling(self.inbound[body].name, multiplier, offset)
        return None


def coupling_note(path: Path, kept: Articulation) -> str:
    """A sentence about mimic joints of a file that `kept` does not couple; "" for none."""
    follow = {j.name for j in kept.joints if j.coupling is not None}
    names = [j.name for j in parse_urdf(path).joints if j.mimic and j.name not in follow]
    if not names:
        return ""
    said = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
    return f"the coupling of {said} is not kept: what follows, or what leads, shows no surface"


def parse_urdf(path: Path) -> Any:
    """The `yourdfpy.Robot` of a file; its meshes are not read.

    Raises:
        InputError: no such file, not a URDF, or one that names files outside its folder.
    """
    admitted(path)
    try:
        return yourdfpy.URDF.load(
            str(path), load_meshes=False, build_scene_graph=False, load_collision_meshes=False
        ).robot
    except Exception as error:  # the parser raises whatever its XML step met
        raise InputError(f"{path} is not a readable URDF: {error}") from error


def carrier(link: str, inbound: Mapping[str, Any]) -> str:
    """The link whose joint moves this one: itself, or the nearest ancestor over fixed joints.

    Args:
        inbound: link name -> the joint that holds it, with `type` and `parent`.
    """
    while link in inbound and inbound[link].type not in MOVING:
        link = inbound[link].parent
    return link


def _rest_frames(robot: Any, path: Path) -> dict[str, FloatArray]:
    children: dict[str, list[Any]] = {}
    for joint in robot.joints:
        children.setdefault(joint.parent, []).append(joint)
    has_parent = {j.child for j in robot.joints}
    roots = [link.name for link in robot.links if link.name not in has_parent]
    if not roots:
        raise InputError(f"{path} has no root link: its joints form a loop")
    if len(roots) > 1:
        roots.sort(key=lambda n: -len(children.get(n, [])))
        warnings.warn(f"{path}: several roots, keeping {roots[0]!r}", stacklevel=3)
    frames: dict[str, FloatArray] = {roots[0]: np.eye(4)}
    queue = [roots[0]]
    while queue:
        parent = queue.pop(0)
        for joint in children.get(parent, []):
            offset = np.eye(4) if joint.origin is None else np.asarray(joint.origin)
            frames[joint.child] = frames[parent] @ offset
            queue.append(joint.child)
    return frames


def _unit_axis(joint: Any) -> FloatArray:
    """(3,) axis in the joint's frame; x, as the format has it, where none is given."""
    axis = np.array([1.0, 0.0, 0.0]) if joint.axis is None else np.asarray(joint.axis, float)
    length = float(np.linalg.norm(axis))
    return np.array([1.0, 0.0, 0.0]) if length < 1e-9 else axis / length


def _limits(joint: Any) -> tuple[float, float, Any]:
    """Limits as written and the type that they make of the joint."""
    lower, upper, kind = -np.inf, np.inf, joint.type
    if kind != "continuous" and joint.limit is not None:
        lower, upper = joint.limit.lower or 0.0, joint.limit.upper or 0.0
        if joint.limit.lower is None and joint.limit.upper is None and kind == "revolute":
            lower, upper = -np.inf, np.inf
    if kind == "revolute" and not abs(upper - lower) < MOST_TURN:
        lower, upper, kind = -np.inf, np.inf, "continuous"
    return lower, upper, kind
