"""`mam-sim studio`: look at objects in the browser, and put right what the engine got wrong."""

from __future__ import annotations

import sys
import webbrowser
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes, Positional

from mam_pipeline.errors import ConfigError
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.optional import require
from mam_sim.options import Verb


@dataclass(frozen=True, kw_only=True)
class Studio(Verb):
    """Look at an object in the browser, move its joints, and put right what is wrong.

    What you put right is saved as a hints file: `articulate --hints` makes the same asset from it.
    The page is served on this machine only (127.0.0.1) and needs nothing from the network.
    """

    source: Positional[Path]
    """An asset folder, a mesh, a photo or a URDF; or a folder of these, to review one by one."""
    out: Path | None = None
    """The asset folder to write; default: <name>-asset here, or the asset that was opened."""
    port: int = 0
    """Port of the local page; 0 takes any free one."""
    open: bool = True
    """Open the page in the default browser."""
    pipeline: Annotated[MakeConfig, OmitArgPrefixes] = field(default_factory=MakeConfig)

    def run(self) -> int:
        """Serve the page until it is interrupted."""
        require("the studio", "viser")
        from mam_sim.studio.page import Page
        from mam_sim.studio.place import place_of
        from mam_sim.studio.review import FILE, Review

        many = self.source.is_dir() and not (self.source / "asset.json").is_file()
        if many and (self.out is not None or self.pipeline.hints is not None):
            raise ConfigError("--out and --hints are of one object; a folder has many")
        review = Review(self.source) if many else None
        place = None if many else place_of(self.source, self.pipeline, self.out)
        page = Page(self.port, queue=many)
        print(f"page:  {page.url}   (ctrl-c ends)", file=sys.stderr, flush=True)
        if self.open:
            webbrowser.open(page.url)
        try:
            if place is not None:
                page.open(place)
                if page.photo is not None:
                    print(f"photo: {page.photo.url}", file=sys.stderr, flush=True)
                    if self.open and (page.work.session is None or page.work.open.why_asked):
                        webbrowser.open(page.photo.url)
            else:
                assert review is not None
                page.review(review, self.pipeline)
            page.server.sleep_forever()
        except KeyboardInterrupt:
            print("", file=sys.stderr)
        finally:
            page.stop()
        written = self.source / FILE if place is None else place.hints
        if written.is_file():
            print(written)
        return 0
