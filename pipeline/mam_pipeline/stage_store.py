"""Results of stages on disk: reused where nothing has changed, and open to a person's edits.

Each stage has a folder with its artefact and a stage.json: who made it, digests of what went in,
and the digest of the artefact. A stage is reused when all of these are the same. An artefact whose
digest is another than that in stage.json was edited: it is kept as long as what went in is the
same, what differs from the generated one is the person's (provenance `user`), and what follows is
made anew.
"""

from __future__ import annotations

import json
import os
import shutil
import stat
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

from mam_pipeline.backends import Maker
from mam_pipeline.digests import file_digest, text_digest
from mam_pipeline.edited import (
    read_json,
)
from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.stage_artefacts import Codec

T = TypeVar("T")


@dataclass(frozen=True)
class Kept(Generic[T]):
    """The result of a stage, the digest of its artefact, and who made it."""

    value: T
    digest: str
    maker: Maker


class StageStore:
    """The folder `stages/` of an asset.

    Attributes:
        notes: sentences on edits that could not be used any more, for the card.
    """

    def __init__(self, folder: Path, shown: Path | None = None) -> None:
        """`shown`: the folder as the user knows it, where this one is a copy."""
        self.folder = folder
        self.shown = shown or folder
        self.notes: list[str] = []

    def stage(
        self,
        name: str,
        maker: Maker,
        settings: Mapping[str, Any],
        inputs: Mapping[str, str],
        codec: Codec[T],
        compute: Callable[[], T],
    ) -> Kept[T]:
        """The result of a stage, from disk where it can be reused, else computed and kept.

        Args:
            name: of the stage and its folder.
            maker, settings: who makes it and how. inputs: digests of what goes in.
            codec: how it is kept. compute: makes it.

        Raises:
            ConfigError: the artefact was edited into something that cannot be used.
        """
        folder = self.folder / name
        artefact, note = folder / codec.filename, folder / "stage.json"
        made_by = asdict(maker)
        key = text_digest(json.dumps([name, made_by, settings, inputs], default=str))
        before = self._note(name, codec.filename)
        if before:
            digest = file_digest(artefact)
            edited = digest != before["digest"]
            if edited and before["inputs"] == inputs:
                value = codec.marked(self._loaded(name, codec), before["prints"])
                return Kept(value, digest, replace(Maker(**before["made_by"]), edited=True))
            if not edited and before["key"] == key:
                return Kept(self._loaded(name, codec), digest, maker)
            if edited:
                self._set_aside(name, artefact)
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        value = compute()
        codec.save(value, artefact)
        digest = file_digest(artefact)
        record = {"key": key, "digest": digest, "made_by": made_by, "settings": settings}
        record |= {"inputs": inputs, "prints": codec.prints(value)}
        note.write_text(json.dumps(record, default=str))
        return Kept(value, digest, maker)

    def _note(self, name: str, filename: str) -> dict[str, Any]:
        """What stage.json says of a result that is there; nothing where it cannot be used."""
        note = self.folder / name / "stage.json"
        if not (note.is_file() and (self.folder / name / filename).is_file()):
            return {}
        try:
            said = read_json(note).values
            Maker(**said["made_by"])
            if {"key", "digest", "inputs", "prints"} <= said.keys():
                return dict(said)
        except (InputError, TypeError, KeyError, AttributeError):
            pass
        self.notes.append(f"stages/{name}/stage.json could not be read: the stage was made anew")
        return {}

    def _loaded(self, name: str, codec: Codec[T]) -> T:
        """The artefact that is there.

        Raises:
            ConfigError: it was edited or damaged into something unusable.
        """
        shown = self.shown / name / codec.filename
        try:
            return codec.load(self.folder / name / codec.filename, shown)
        except ConfigError:
            raise
        except Exception as error:  # each library fails in its own way at a damaged file
            what = f"{type(error).__name__}: {str(error) or 'damaged'}".splitlines()[0]
            raise ConfigError(
                f"{shown} or a file beside it cannot be used ({what}); "
                f"delete {shown.parent} to have it made anew"
            ) from error

    def _set_aside(self, name: str, artefact: Path) -> None:
        kept = self.folder / f"{name}.edited{artefact.suffix}"
        shutil.copyfile(artefact, kept)
        self.notes.append(
            f"stages/{name}/{artefact.name} was edited for another input: it is not used, "
            f"and kept as stages/{kept.name}"
        )


def copy_stages(old: Path, new: Path) -> None:
    """Copy the stages of an asset, where there are any; nothing but files and folders is followed.

    Raises:
        InputError: a link, a pipe or the like lies among them.
    """
    if not old.is_dir():
        return
    for at, folders, files in os.walk(old):
        here = Path(at)
        for item in (here, *(here / name for name in (*folders, *files))):
            mode = item.lstat().st_mode
            if not (stat.S_ISDIR(mode) or stat.S_ISREG(mode)):
                raise InputError(
                    f"{item} is no ordinary file, and is not followed; delete it, and what it "
                    "stood for is made anew"
                )
        there = new / here.relative_to(old)
        there.mkdir(parents=True, exist_ok=True)
        for name in files:
            shutil.copyfile(here / name, there / name)
