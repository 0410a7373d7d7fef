"""Roles and their backends: where models plug in (design: one Protocol per role).

`BUILTIN` names the built-in backends as "module:Class" strings; third parties register theirs
in the entry-point groups `mam_sim.reconstructor`, `.segmenter`, `.prior`, `.reasoner`,
`.solver`, `.retexturer`. Listing names imports nothing heavy.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import metadata
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.doubt import Doubt
from mam_pipeline.errors import BackendError, ConfigError, unknown_name
from mam_pipeline.hints import Hints
from mam_pipeline.registry import Registry, installed, resolve
from mam_pipeline.types import Articulation, IntArray, KinematicTree, Mesh, Primitives


@dataclass(frozen=True)
class Availability:
    """Whether a backend can run here; `why` says what is missing and how to get it.

    `version` is its own, or where the model behind it answers: a URL or a command.
    """

    ok: bool
    why: str = ""
    version: str = ""
    licence: str = ""


@dataclass(frozen=True)
class Reconstruction:
    """A mesh made from a photo, in metres, with what was measured on the way.

    Attributes:
        confidence: cuboid, panels, handles, scale -> "high" | "medium" | "low" | "given".
        doubt: why nobody should rely on it before a person has confirmed it; None where one can.
        pictures: name -> (H, W, 3) uint8 RGB pictures for the report (overlay, front ...).
    """

    mesh: Mesh
    hints: Hints
    confidence: Mapping[str, str] = field(default_factory=dict)
    summary: str = ""
    assumed: tuple[str, ...] = ()
    pictures: Mapping[str, NDArray[np.uint8]] = field(default_factory=dict)
    details: Mapping[str, Any] = field(default_factory=dict)
    doubt: Doubt | None = None


@dataclass(frozen=True)
class KinematicPrior:
    """Where motion is likely: the counterpart of SP4D's multi-view kinematic masks (3.2).

    Attributes:
        mobility: (P,) 0..1 per primitive, how likely it belongs to a moving part.
        affinity: (P, P) 0..1, how likely two primitives move together.
        masks: (N, H, W) int per-view kinematic part maps, -1 background; may be empty.
        views: (N, 4, 4) `camera_T_asset` (OpenCV axes) of the masks.
        evidence: named measurements, for the report alone.
        probe: what the embedded prior measured (`prior.probe.Probe`), for whole groups; else None.
        labels: (P,) kinematic label of every primitive, that of the masks; 0 is held fast. Empty
            where the prior made no masks.
        fov: of the masks' cameras, radians.
    """

    mobility: NDArray[np.float64]
    affinity: NDArray[np.float64]
    masks: IntArray = field(default_factory=lambda: np.zeros((0, 0, 0), dtype=np.int64))
    views: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 4, 4)))
    source: str = "embedded"
    evidence: Mapping[str, Any] = field(default_factory=dict)
    probe: Any = None
    labels: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    fov: float = float(np.radians(35.0))


@runtime_checkable
class Backend(Protocol):
    """What every backend has: it can say whether it may run here.

    It may say more of itself, for the keys of stages and the asset card: see `maker`.
    """

    @classmethod
    def available(cls) -> Availability: ...


class Reconstructor(Backend, Protocol):
    """Photo to mesh. `options` holds the user's help (bbox, mask, front, layout, height ...)."""

    def reconstruct(self, photo: Path, options: Mapping[str, Any]) -> Reconstruction: ...


class Segmenter(Backend, Protocol):
    """Mesh to primitives (paper 3.2)."""

    def segment(self, mesh: Mesh, seed: int = 0) -> Primitives: ...


class Prior(Backend, Protocol):
    """Mesh and primitives to kinematic priors (paper 3.2)."""

    def observe(self, mesh: Mesh, primitives: Primitives, seed: int = 0) -> KinematicPrior: ...


class Reasoner(Backend, Protocol):
    """Primitives and priors to parts, tree and joint subtypes (paper 3.2 and 3.3)."""

    def reason(
        self, mesh: Mesh, primitives: Primitives, prior: KinematicPrior | None, seed: int = 0
    ) -> KinematicTree: ...


class Retexturer(Backend, Protocol):
    """New appearance for a part; its triangles stay as they are (paper 3.4)."""

    def retexture(self, mesh: Mesh, picture: Path) -> Mesh: ...


class Solver(Backend, Protocol):
    """Tree to joints with axes, origins and limits (paper 3.3 and 3.4)."""

    def solve(
        self, mesh: Mesh, primitives: Primitives, tree: KinematicTree, seed: int = 0
    ) -> Articulation: ...


BUILTIN: dict[str, dict[str, str]] = {
    "reconstructor": {"embedded": "mam_pipeline.photo.reconstruct:EmbeddedReconstructor"},
    "segmenter": {"geometric": "mam_pipeline.segment.geometric:GeometricSegmenter"},
    "prior": {
        "none": "mam_pipeline.prior.none:NoPrior",
        "embedded": "mam_pipeline.prior.embedded:EmbeddedPrior",
        "file": "mam_pipeline.models.file_prior:FilePrior",
    },
    "reasoner": {
        "embedded": "mam_pipeline.parts.embedded:EmbeddedReasoner",
        "vlm": "mam_pipeline.models.vlm:VlmReasoner",
        "file": "mam_pipeline.models.vlm:FileReasoner",
    },
    "solver": {"embedded": "mam_pipeline.joints.solver:EmbeddedSolver"},
    "retexturer": {},
}
PACKAGES: dict[str, dict[str, tuple[str, ...]]] = {
    "plugins/mam_sim_models": {
        "reconstructor": ("hunyuan3d", "triposr", "triposg", "fal", "tripo", "meshy", "space"),
        "segmenter": ("p3sam",),
        "prior": ("sp4d",),
        "retexturer": ("hunyuan3d",),
    },
    "benchmarks/paper": {"solver": ("init", "lm", "nelder-mead")},
}
"""Our own packages beside the core, by folder: what they bring, for the error without them."""
# What "auto" tries, best first. A model is tried only where the user has set it up; nothing that
# costs money or sends pictures to a stranger is ever taken without being named.
PREFERENCE: dict[str, tuple[str, ...]] = {
    "reconstructor": ("embedded",),
    "segmenter": ("p3sam", "geometric"),
    "prior": ("sp4d", "embedded"),
    "reasoner": ("embedded",),
    "solver": ("embedded",),
    "retexturer": ("hunyuan3d",),
}


def names(role: str) -> dict[str, str]:
    """All backend names of a role with their "module:Class" target, third parties included."""
    return Registry(role, BUILTIN[role]).targets()


@dataclass(frozen=True)
class Maker:
    """Who made a stage: part of the stage's key, and what the asset card says.

    Attributes:
        name: of the backend, resolved ("auto" never is one); "hints" or "urdf" where none was used.
        version: of its code: the package's version, and for ours a digest of the sources.
        weights: digest of what it has learned; "" where it has learned nothing.
        options: what else decides its answers: the model behind it, the files that it reads.
        edited: whether a person changed what it made.
    """

    name: str
    version: str = ""
    weights: str = ""
    options: str = ""
    edited: bool = False


def package_of(role: str, name: str) -> str:
    """The folder of our package that brings a backend; "" where none of them does."""
    return next((p for p, roles in PACKAGES.items() if name in roles.get(role, ())), "")


def check_name(role: str, name: str) -> None:
    """Refuse a name that no backend of a role has; nothing is imported.

    Raises:
        ConfigError: no such name; the nearest and all others are named.
    """
    known = ["auto", *names(role)]
    if name not in known:
        package = package_of(role, name)
        if package:
            raise ConfigError(
                f"the {role} {name!r} comes with a package that is not installed; in a clone of "
                f"mam-sim: pip install ./{package}"
            )
        raise unknown_name(role, name, known)


def resolved(role: str, name: str = "auto") -> str:
    """The name of the backend that plays a role; "auto" is the best one available.

    A backend that is named need not be available: what it made before can still be used.

    Raises:
        ConfigError: no such name. BackendError: "auto", and none is available.
    """
    check_name(role, name)
    if name != "auto":
        return name
    table = names(role)
    for candidate in PREFERENCE[role]:
        if (
            candidate in table
            and resolve(table[candidate], f"the {role} {candidate!r}").available().ok
        ):
            return candidate
    missing = [package_of(role, c) for c in PREFERENCE[role] if c not in table]
    hint = f"pip install ./{missing[0]}, and then mam-sim doctor" if missing else "mam-sim doctor"
    raise BackendError(f"no {role} is available here; run: {hint}")


def load(role: str, name: str = "auto") -> tuple[str, Any]:
    """Return (name, instance) of a backend; "auto" takes the best one available.

    Raises:
        ConfigError: no such name.
        BackendError: named explicitly but not available here; nothing is substituted.
    """
    name = resolved(role, name)
    cls = Registry(role, BUILTIN[role]).load(name)
    state: Availability = cls.available()
    if not state.ok:
        raise BackendError(f"the {role} {name!r} cannot run here: {state.why}")
    return name, cls()


def maker(role: str, name: str) -> Maker:
    """Who a (resolved) backend is, by its class methods `version`, `weights` and `options`.

    All three are optional. `version` gives text; the default is that of the package that it comes
    from. `weights` gives the files or folders that hold what it has learned. `options` gives text.
    """
    cls = Registry(role, BUILTIN[role]).load(name)
    version = getattr(cls, "version", None)
    behind = cls.available().version
    said = [f"at {_digest(behind)}"] if behind.startswith(("http", "/")) or " " in behind else []
    if hasattr(cls, "options"):
        said.append(cls.options())
    return Maker(
        name,
        _package_version(role, name, cls) if version is None else version(),
        _content_digest(tuple(cls.weights())) if hasattr(cls, "weights") else "",
        "; ".join(said),
    )


def _package_version(role: str, name: str, cls: type) -> str:
    if name in BUILTIN[role]:
        try:
            release = metadata.version("mam-sim")
        except metadata.PackageNotFoundError:  # run from its sources
            release = "0"
        return f"{release}+{_code_digest()}"
    entries = installed(f"mam_sim.{role}").select(name=name)
    return next((entry.dist.version for entry in entries if entry.dist is not None), "")


@cache
def _code_digest() -> str:
    """Of all our sources: a stage that other code made is made anew."""
    root = Path(__file__).parent
    digest = hashlib.sha256()
    for file in sorted(root.rglob("*.py")):
        digest.update(file.relative_to(root).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:12]


@cache
def _content_digest(places: tuple[Traversable, ...]) -> str:
    if not places:
        return ""
    digest = hashlib.sha256()
    for place in places:
        for file in _files(place):
            digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:12]


def _files(place: Traversable) -> list[Traversable]:
    if place.is_file():
        return [place]
    return [f for entry in sorted(place.iterdir(), key=lambda p: p.name) for f in _files(entry)]


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:12]
