"""Settings of the benchmark."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated

import tyro

from mam_pipeline.edited import Range
from mam_pipeline.make_config import EngineConfig
from mam_pipeline.models.settings import ModelConfig


@dataclass(frozen=True)
class BenchConfig:
    """What decides the numbers."""

    fuse: bool = False
    """First turn each input into one watertight surface, as a generator would."""
    noise: Annotated[float, Range(0, 1)] = 0.0
    """With --fuse: displacement of the surface, as a share of the diagonal."""
    resolution: Annotated[int, Range(16, 1024)] = 192
    """With --fuse: cells of the grid along the longest side."""
    faces: Annotated[int, Range(100, 3_000_000)] = 60_000
    """With --fuse: triangles of the surface."""
    named: bool = False
    """Show the engine names of nodes: a file's links by theirs; of generated objects half without
    sense or false. Without it no name is shown."""
    word: bool = False
    """Tell the engine the object's category in words, where the table of kinds has them."""
    counts: bool = False
    """Tell the engine how many parts of each kind the object has."""
    seeds: Annotated[int, Range(1, 100)] = 1
    """How often the dataset is run, with the engine's seed and those that follow it."""
    execute: Annotated[bool, tyro.conf.arg(name="exec")] = True
    """Write each asset and test it in the simulator."""
    engine: EngineConfig = field(default_factory=EngineConfig)
    models: ModelConfig = field(default_factory=ModelConfig)

    def told(self) -> str:
        """What is special about the input, for the table's title; empty for authored meshes."""
        sorts = {"fused input": self.fuse, "with names": self.named, "with its word": self.word,
                 "with counts": self.counts}  # fmt: skip
        return "".join(f", {sort}" for sort, on in sorts.items() if on)

    def seeded(self) -> list[BenchConfig]:
        """The settings of each run, which differ in the engine's seed alone."""
        first = self.engine.seed
        return [
            replace(self, seeds=1, engine=replace(self.engine, seed=first + k))
            for k in range(self.seeds)
        ]
