"""The stages in order, in memory: mesh -> primitives -> prior -> tree -> joints -> front.

`articulate_mesh` is what the benchmark, the command line and a user's own code call. Caching on
disk and the asset folder are the business of `mam_pipeline.run`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mam_pipeline import backends
from mam_pipeline.backends import KinematicPrior
from mam_pipeline.errors import NotPhysicalError
from mam_pipeline.hints import Hints
from mam_pipeline.rules import ALL_RULES, Ruled, Rules
from mam_pipeline.types import Articulation, FloatArray, KinematicTree, Mesh, Primitives

OnStage = Callable[[str], None]


@dataclass(frozen=True)
class EngineConfig:
    """Which backend plays each role ("auto" takes the best one available and says which)."""

    segmenter: str = "auto"
    """Cuts the mesh into primitives: geometric, p3sam."""
    prior: str = "auto"
    """Probes which primitives may move: embedded, sp4d, file, none."""
    reasoner: str = "auto"
    """Finds parts, tree and joint types: embedded, vlm, file."""
    solver: str = "auto"
    """Estimates joints: embedded, or the paper's init, lm, nelder-mead."""
    seed: int = 0
    """Seed of everything random."""
    rules: Rules = ALL_RULES
    """Hand rules that are followed."""


@dataclass(frozen=True)
class EngineRun:
    """All that one run of the engine produced, stage by stage, with what it used."""

    primitives: Primitives
    prior: KinematicPrior | None
    tree: KinematicTree
    articulation: Articulation
    used: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)


def articulate_mesh(
    mesh: Mesh,
    hints: Hints | None = None,
    config: EngineConfig = EngineConfig(),
    on_stage: OnStage | None = None,
) -> EngineRun:
    """Run the engine on a mesh in the asset frame (metres, Z up).

    Raises:
        NotPhysicalError: nothing movable was found.
        BackendError: a backend named in the config cannot run.
    """
    from mam_pipeline.parts.hints import along_nodes

    engine = Engine(config, on_stage)
    primitives = along_nodes(engine.segment(mesh), mesh, hints)
    prior = engine.observe(mesh, primitives, hints)
    tree = engine.reason(mesh, primitives, prior, hints)
    articulation = engine.solve(mesh, primitives, tree)
    return EngineRun(primitives, prior, tree, articulation, engine.used, engine.seconds)


class Engine:
    """The stages one by one; remembers which backend was used and the seconds it took."""

    def __init__(self, config: EngineConfig, on_stage: OnStage | None = None) -> None:
        self.config = config
        self.used: dict[str, str] = {}
        self.seconds: dict[str, float] = {}
        self._on_stage = on_stage

    def segment(self, mesh: Mesh) -> Primitives:
        """Faces to primitives (paper 3.2)."""
        with _Stage(self, "segment"):
            segmenter = self._load("segmenter", self.config.segmenter)
            primitives: Primitives = segmenter.segment(mesh, seed=self.config.seed)
            return primitives

    def observe(
        self, mesh: Mesh, primitives: Primitives, hints: Hints | None = None
    ) -> KinematicPrior | None:
        """Primitives to kinematic priors; None when hints settle every part anyway."""
        if hints is not None and _settled(hints):
            self.used["prior"] = "hints"
            return None
        with _Stage(self, "prior"):
            prior = self._load("prior", self.config.prior)
            if self.used["prior"] == "none":
                return None
            observed: KinematicPrior = prior.observe(mesh, primitives, seed=self.config.seed)
            return observed

    def reason(
        self,
        mesh: Mesh,
        primitives: Primitives,
        prior: KinematicPrior | None,
        hints: Hints | None = None,
    ) -> KinematicTree:
        """Primitives and priors to parts, tree and joint subtypes; hints have the last word."""
        from mam_pipeline.parts.hints import apply_hints

        with _Stage(self, "reason"):
            if hints is not None and _settled(hints):
                self.used["reasoner"] = "hints"
                base = KinematicTree((_everything(primitives),))
                return apply_hints(base, primitives, mesh, hints)
            reasoner = self._load("reasoner", self.config.reasoner)
            tree: KinematicTree = reasoner.reason(mesh, primitives, prior, seed=self.config.seed)
            return tree if hints is None else apply_hints(tree, primitives, mesh, hints)

    def solve(self, mesh: Mesh, primitives: Primitives, tree: KinematicTree) -> Articulation:
        """Tree to joints with axes, origins and limits (paper 3.3, 3.4)."""
        if all(node.subtype == "fixed" for node in tree.nodes):
            why = str(tree.nodes[0].evidence.get("nothing_movable", "every part is fixed"))
            raise NotPhysicalError(
                f"nothing movable was found in this mesh ({why}); "
                "a hints file can name a part: --hints FILE"
            )
        with _Stage(self, "joints"):
            solver = self._load("solver", self.config.solver)
            solved: Articulation = solver.solve(mesh, primitives, tree, seed=self.config.seed)
            return solved

    def _load(self, role: str, name: str) -> Any:
        """The backend of a role, following the hand rules of the config."""
        self.used[role], backend = backends.load(role, name)
        return backend.with_rules(self.config.rules) if isinstance(backend, Ruled) else backend


def front_yaw(articulation: Articulation) -> FloatArray:
    """(4, 4) rotation about Z that turns the object's front towards -X.

    The front is where parts open to: drawers slide out of it, doors swing out of it, lids have
    their free edge there, knobs point out of it. Votes are weighted by the part's extent; with no
    vote, or a symmetric one, the object stays as it is.
    """
    mesh = articulation.mesh
    vote = np.zeros(2)
    for joint in articulation.joints:
        points = mesh.vertices[mesh.faces[articulation.links[joint.child].faces].reshape(-1)]
        if not len(points):
            continue
        low, high = points.min(axis=0), points.max(axis=0)
        arm = (low + high) / 2 - joint.origin
        sign = 1.0 if joint.open >= joint.closed else -1.0
        if joint.type == "prismatic":
            direction = joint.axis * sign
        elif joint.subtype == "spin" or joint.type == "continuous":
            centre = mesh.bounds.mean(axis=0)
            direction = joint.axis * np.sign((low + high) @ joint.axis / 2 - centre @ joint.axis)
        else:
            direction = np.cross(joint.axis * sign, arm)
            if abs(direction[2]) > np.linalg.norm(direction[:2]):  # a lid: free edge is the front
                direction = arm
        flat = direction[:2] / max(float(np.linalg.norm(direction)), 1e-12)
        vote += flat * float(np.linalg.norm(high - low))
    if np.linalg.norm(vote) < 1e-6:
        return np.eye(4)
    angle = np.pi - np.arctan2(vote[1], vote[0])
    angle = _snap_to_faces(mesh, angle)
    out = np.eye(4)
    out[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return out


def _snap_to_faces(mesh: Mesh, angle: float) -> float:
    """Snap the yaw so that the dominant vertical faces end up parallel to the X and Y planes."""
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    upright = np.abs(normals[:, 2]) < 0.1 * np.maximum(area, 1e-20)
    if not upright.any():
        return angle
    theta = np.arctan2(normals[upright, 1], normals[upright, 0])
    phase = np.angle(np.sum(area[upright] * np.exp(4j * theta))) / 4  # modulo 90 degrees
    turned = (angle + phase) % (np.pi / 2)
    shift = -turned if turned < np.pi / 4 else np.pi / 2 - turned
    return angle + shift if abs(shift) < np.radians(30) else angle


def moved(articulation: Articulation, matrix: FloatArray) -> Articulation:
    """The same articulation in another frame: `matrix` is a (4, 4) rigid or similarity transform.

    Prismatic limits and positions scale with it; angles do not.
    """
    from dataclasses import replace

    scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
    turn = matrix[:3, :3] / scale

    def point(p: FloatArray) -> FloatArray:
        return matrix[:3, :3] @ p + matrix[:3, 3]

    joints = []
    for joint in articulation.joints:
        s = scale if joint.type == "prismatic" else 1.0
        joints.append(
            replace(
                joint,
                axis=turn @ joint.axis,
                origin=point(joint.origin),
                lower=joint.lower * s,
                upper=joint.upper * s,
                closed=joint.closed * s,
                open=joint.open * s,
            )
        )
    grasps = tuple(
        replace(
            g,
            position=point(g.position),
            approach=turn @ g.approach,
            closing=turn @ g.closing,
            width=g.width * scale,
            depth=g.depth * scale,
        )
        for g in articulation.grasps
    )
    return replace(
        articulation,
        mesh=articulation.mesh.transformed(matrix),
        joints=tuple(joints),
        grasps=grasps,
    )


def _settled(hints: Hints) -> bool:
    """Hints that place every part themselves (a photo's) need no reasoning about parts."""
    return bool(hints.parts) and all(p.nodes for p in hints.parts)


def _everything(primitives: Primitives):  # type: ignore[no-untyped-def]
    from mam_pipeline.types import PartNode

    return PartNode("body", "body", tuple(range(primitives.count)), -1, "fixed")


class _Stage:
    """Times one stage and tells the listener its name."""

    def __init__(self, engine: Engine, name: str) -> None:
        self.engine, self.name = engine, name

    def __enter__(self) -> None:
        if self.engine._on_stage is not None:
            self.engine._on_stage(self.name)
        self.start = time.perf_counter()

    def __exit__(self, *_: object) -> None:
        self.engine.seconds[self.name] = round(time.perf_counter() - self.start, 3)
