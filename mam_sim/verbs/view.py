"""`mam-sim view`: pictures and a film of an asset moving its joints; needs no display driver."""

from __future__ import annotations

import csv
import os
import re
import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Annotated
from urllib.parse import quote

from tyro.conf import Positional

from mam_pipeline.claims import PAGE, claim_entries, claim_file
from mam_pipeline.edited import Range
from mam_pipeline.types import Articulation
from mam_sim.options import Verb

if TYPE_CHECKING:
    from mam_pipeline.asset.card import AssetCard
    from mam_sim.viewer import Shown


VIEWED = ("closed.png", "open.png", "moving.gif")
"""Everything in a folder of pictures."""


@dataclass(frozen=True, kw_only=True)
class View(Verb):
    """Draw an asset closed and open, and every joint moving, into one folder.

    With --html: one page instead that opens offline, turns, and has a slider for every joint.
    Of a folder of assets, --html writes such a page for each, and a gallery that leads to them.
    """

    asset: Positional[Path]
    """Asset folder or URDF; with --html also a folder of assets."""
    out: Path | None = None
    """Where closed.png, open.png and moving.gif go; default: ASSET/view. With --html: the file,
    to whose name .html is added where it is missing; default: ASSET/view.html, or
    FOLDER/gallery.html."""
    html: bool = False
    """Write one self-contained web page instead of pictures."""
    credits: Path | None = None
    """With --html: CSV file with the columns file and credit. Who made the file that an asset was
    made from, and under which licence, stands on its page and in the gallery."""
    size: Annotated[int, Range(16, 4096)] = 360
    """Pixels along each side."""
    frames: Annotated[int, Range(2, 1000)] = 24
    """Frames of the film, over one opening and closing."""
    azimuth: Annotated[float, Range(-360, 360)] = -35.0
    """Degrees from the front towards the viewer's right."""
    elevation: Annotated[float, Range(-90, 90)] = 25.0
    """Degrees above the horizon."""
    allow_outside: bool = False
    """Let a URDF of your own name files outside its folder."""

    def run(self) -> int:
        """Draw the pictures; prints the folder."""
        from PIL import Image

        from mam_pipeline import folders
        from mam_pipeline.formats.door import Door, outside_allowed
        from mam_pipeline.render.motion import motion_pictures, there_and_back

        if self.html and self.asset.is_dir() and not (self.asset / "asset.json").is_file():
            return self._write_gallery()
        with outside_allowed(self.allow_outside):
            articulation, folder, card = _read(self.asset)
        if self.html:
            return self._write_page(articulation, folder, card)
        target = self.out or Door(folder).may_write(folder / "view")
        claim_entries(target, "pictures of an asset", VIEWED.__contains__)
        shares = [0.0, 1.0, *there_and_back(self.frames)]
        size = (self.size, self.size)
        drawn = motion_pictures(articulation, shares, size, self.azimuth, self.elevation)
        closed, opened, *film = [Image.fromarray(picture) for picture in drawn]
        with folders.new_entries(target, "moving.gif") as work:
            closed.save(work / "closed.png")
            opened.save(work / "open.png")
            film[0].save(
                work / "moving.gif", save_all=True, append_images=film[1:], duration=60, loop=0
            )
        print(target)
        if not self.quiet:
            names = ", ".join(j.name for j in articulation.joints)
            print(f"closed.png, open.png, moving.gif; joints: {names}", file=sys.stderr)
            print(f"next: mam-sim check {self.asset}", file=sys.stderr)
        return 0

    def _named(self) -> Path | None:
        """The page that --out names; a browser opens what ends in .html."""
        if self.out is None or self.out.suffix.lower() in (".html", ".htm"):
            return self.out
        return self.out.with_name(f"{self.out.name}.html")

    def _write_page(self, articulation: Articulation, folder: Path, card: AssetCard | None) -> int:
        from mam_pipeline.folders import write_text
        from mam_pipeline.formats.door import Door
        from mam_sim.viewer import page

        name = self.asset.stem if self.asset.is_file() else folder.name
        target = self._named() or Door(folder).may_write(folder / "view.html")
        claim_file(target, PAGE)
        target.parent.mkdir(parents=True, exist_ok=True)
        write_text(target, page(articulation, name, card, **self._beside(folder, card)))
        print(target)
        if not self.quiet:
            print("next: open it in any browser; it needs no network", file=sys.stderr)
        return 0

    def _write_gallery(self) -> int:
        """A page of every asset in the folder, and the gallery; returns the exit status."""
        from mam_pipeline.asset.listing import asset_folders
        from mam_pipeline.folders import write_text
        from mam_pipeline.formats.door import Door
        from mam_pipeline.geometry.stand_in import lightened
        from mam_sim.viewer import gallery, page

        target = self._named() or Door(self.asset).may_write(self.asset / "gallery.html")
        claim_file(target, PAGE)
        target.parent.mkdir(parents=True, exist_ok=True)
        shown, passed = [], 0
        for folder in asset_folders([self.asset]):
            if not self.quiet:
                print(folder.name, file=sys.stderr, flush=True)
            articulation, _, card = _read(folder)
            file = Door(folder).may_write(folder / "view.html")
            claim_file(file, PAGE)
            passed += card is not None and card.executable is True
            beside = self._beside(folder, card)
            write_text(file, page(lightened(articulation), _title(folder), card, **beside))
            link = _relative(file, target.parent)
            shown.append(self._shown(folder, articulation, link, beside.get("credit", "")))
        title = f"{len(shown)} objects" + (f", {passed} pass the check" if passed else "")
        write_text(target, gallery(shown, title))
        print(target)
        if not self.quiet:
            print("next: open it in any browser; keep the folder with it", file=sys.stderr)
        return 0

    def _beside(self, folder: Path, card: AssetCard | None) -> dict[str, str]:
        """Photo, credit and film of an asset, for its page."""
        from mam_sim.report import film_url, photo_url

        if card is None:
            return {}
        return {
            "photo": photo_url(folder), "credit": self._credit(card), "film": film_url(folder),
        }  # fmt: skip

    @cached_property
    def _credits(self) -> dict[str, str]:
        """Who made a file, by its name.

        Raises:
            InputError: there is no such table.
        """
        from mam_pipeline.errors import InputError, disk_error

        if self.credits is None:
            return {}
        try:
            with self.credits.open(newline="", encoding="utf-8-sig") as stream:
                rows = list(csv.DictReader(stream))
        except OSError as error:
            raise disk_error(error) from error
        except (UnicodeDecodeError, csv.Error) as error:
            raise InputError(f"{self.credits} is no table in UTF-8: {error}") from error
        if any(not row.get("file") or not row.get("credit") for row in rows):
            raise InputError(f"{self.credits} needs the columns file and credit, in every row")
        return {row["file"]: row["credit"] for row in rows}

    def _credit(self, card: AssetCard | None) -> str:
        source = "" if card is None else str(card.source.get("path", ""))
        return self._credits.get(PurePosixPath(source).name, "")

    def _shown(self, folder: Path, articulation: Articulation, link: str, credit: str) -> Shown:
        from mam_pipeline.asset.card import Asset
        from mam_pipeline.check.report import REASONS
        from mam_pipeline.render.motion import motion_pictures
        from mam_sim import facts
        from mam_sim.report import picture_url
        from mam_sim.viewer import Shown

        size = (self.size, self.size)
        closed, opened = motion_pictures(
            articulation, [0.0, 1.0], size, self.azimuth, self.elevation
        )  # fmt: skip
        card = Asset.load(folder).card
        reasons = card.check_reasons if card.executable is False else ()
        count = sum(j.type != "fixed" for j in articulation.joints)
        return Shown(
            _title(folder), link, picture_url(closed), picture_url(opened),
            f"{count} joint{'' if count == 1 else 's'}" if count else "nothing moves",
            "check fails: " + "; ".join(REASONS.get(r, r) for r in reasons) if reasons else "",
            credit, facts.attempt_sentence(card), facts.attempt_ok(card),
        )  # fmt: skip


def _title(folder: Path) -> str:
    """The name of an asset's folder without the digest that a batch puts behind it."""
    return re.sub(r"(?<=.)-[0-9a-f]{8}$", "", folder.name)


def _relative(file: Path, folder: Path) -> str:
    """The way from a folder to a file, as a link."""
    return quote(Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix())


def _read(path: Path) -> tuple[Articulation, Path, AssetCard | None]:
    """The object, its folder, and its card where it is an asset of ours."""
    from mam_pipeline.asset.card import Asset
    from mam_pipeline.asset.read import read_asset
    from mam_pipeline.formats.urdf.read import read_urdf

    if path.suffix.lower() in (".urdf", ".xml"):
        return read_urdf(path), path.parent, None
    asset = Asset.load(path)
    return read_asset(asset), asset.folder, asset.card
