"""What decides how an asset is made: settings of the engine, and of the whole way to an asset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from mam_pipeline import backends
from mam_pipeline.edited import Length, Positive, Seed, check_ranges
from mam_pipeline.errors import ConfigError
from mam_pipeline.models.settings import ModelConfig
from mam_pipeline.photo.options import PhotoConfig
from mam_pipeline.rules import ALL_RULES, Rules
from mam_pipeline.types import Axis


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
    seed: Seed = 0
    """Seed of everything random."""
    rules: Rules = ALL_RULES
    """Hand rules that are followed."""

    def check(self) -> None:
        """Raise ConfigError where a role has no backend of the name."""
        for role in ("segmenter", "prior", "reasoner", "solver"):
            backends.check_name(role, getattr(self, role))


DEFAULT = EngineConfig()


@dataclass(frozen=True)
class MakeConfig:
    """Everything that decides what an asset becomes; saved with it as stages/config.yaml."""

    up: Literal["auto", Axis] = "auto"
    """Up axis of the source."""
    facing: Literal["auto", Axis] = "auto"
    """Direction of the source's axes in which its front looks."""
    height: Length | None = None
    """Height of the object: 55cm, 22in; a bare number is metres."""
    scale: Positive | None = None
    """Metres per unit of the source; give this or the height."""
    yes: bool = False
    """Take the size as it is given, however unusual."""
    hints: Path | None = None
    """YAML file with what you know about the parts."""
    accept: tuple[str, ...] = ()
    """A dormant part that moves after all, by its name (lid_0), or "all"; may be repeated."""
    allow_outside: bool = False
    """Let a mesh or URDF of your own name files outside its folder (textures, meshes)."""
    what: str | None = None
    """What the object is, in your words: "toaster oven", "cabinet with 2 doors and 3 drawers"."""
    names: bool = True
    """Weigh the names, copies and animations in the file, and the file's own name."""
    visuals: Literal["obj", "glb"] = "obj"
    """Format of the visual meshes: OBJ is read by every simulator, GLB is one file per link."""
    interiors: bool = True
    """Give drawers boxes and cut meshes caps where the source has none."""
    reconstructor: str = "auto"
    """Makes a mesh of a photo: embedded; hunyuan3d, triposr, triposg; fal, tripo, meshy, space."""
    retexture: Mapping[str, str] = field(default_factory=dict)
    """New appearance of parts by Hunyuan3D-Paint, their triangles unchanged: PART PICTURE, or PART
    and words, of which an image endpoint first makes a picture."""
    engine: EngineConfig = field(default_factory=EngineConfig)
    photo: PhotoConfig = field(default_factory=PhotoConfig)
    models: ModelConfig = field(default_factory=ModelConfig)

    def check(self) -> None:
        """Raise ConfigError for a length that is no positive number or an unknown backend."""
        check_ranges(self, flag=True)
        backends.check_name("reconstructor", self.reconstructor)
        self.engine.check()
        if self.height is not None and self.scale is not None:
            raise ConfigError("give --height or --scale, not both")
