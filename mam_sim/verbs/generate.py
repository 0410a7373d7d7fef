"""`mam-sim generate`: procedural articulated objects with exact truth, as asset folders."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from mam_pipeline.edited import Range, Seed
from mam_sim.options import Verb


@dataclass(frozen=True, kw_only=True)
class Generate(Verb):
    """Write procedural objects: static.glb (what a user would have) with its exact asset folder."""

    category: str = "all"
    """One category, or "all": then --count objects of each that has joints."""
    count: Annotated[int, Range(1, 100_000)] = 1
    """How many objects of each category."""
    seed: Seed = 0
    """Seed of the first object; the others follow. The same seed gives the same bytes."""
    out: Path | None = None
    """Folder to write; one asset folder per object and a MANIFEST.csv."""
    list_: Annotated[bool, tyro.conf.arg(name="list")] = False
    """Print the categories and stop."""
    textures: bool = True
    """Draw procedural pictures on the materials."""
    plain: bool = False
    """No styles: the static file is the exact object."""
    jobs: Annotated[int, Range(1, 1024)] = 1
    """Processes; the files do not depend on how many."""

    def run(self) -> int:
        """Write the data set, or list the categories."""
        from mam_pipeline.errors import ConfigError

        if self.list_:
            from mam_world.registry import categories, motionless

            for name, entry in {**categories(), **motionless()}.items():
                print(f"{name:<26} {entry.family}")
            return 0
        if self.out is None:
            raise ConfigError("say where to write: mam-sim generate --category NAME --out DIR")
        from mam_pipeline.claims import OBJECTS, claim_folder
        from mam_world.dataset import write_dataset

        claim_folder(self.out, OBJECTS)

        rows = write_dataset(
            self.category, self.count, self.seed, self.out, self.textures, self.plain, self.jobs,
            on_object=self._say,
        )  # fmt: skip
        print(f"wrote: {self.out}")
        if not self.quiet:
            print(f"next: mam-sim check {self.out / str(rows[0][0])}", file=sys.stderr)
        return 0

    def _say(self, row: list[object]) -> None:
        if not self.quiet:
            print(f"{row[0]}: {row[5]} joint{'' if row[5] == 1 else 's'}", file=sys.stderr)
