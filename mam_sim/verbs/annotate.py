"""`mam-sim annotate`: mark corners, panels and handles on a photo, in a local web page."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from mam_pipeline.edited import Range
from mam_sim.options import Verb


@dataclass(frozen=True, kw_only=True)
class Annotate(Verb):
    """Mark front corners, panels and handles on a photo; saves a hints file.

    The page is served on this machine only (127.0.0.1) and needs nothing from the network.
    """

    photo: Positional[Path]
    """The photo."""
    out: Path | None = None
    """The hints file to write; default: <name>-hints.yaml beside the photo."""
    port: Annotated[int, Range(0, 65535)] = 0
    """Port of the local server; 0 takes any free one."""
    browser: bool = True
    """Open the page in the default browser."""

    def run(self) -> int:
        """Serve the page until it is interrupted."""
        from mam_pipeline.claims import HINTS, claim_file
        from mam_pipeline.errors import InputError
        from mam_pipeline.photo.annotate import Annotation, make_server

        target = self.out or self.photo.with_name(f"{self.photo.stem}-hints.yaml")
        claim_file(target, HINTS)
        annotation = Annotation(self.photo, target)
        try:
            server = make_server(annotation, self.port)
        except (OSError, OverflowError) as error:
            message = f"cannot listen on port {self.port} of 127.0.0.1: {error}"
            raise InputError(message) from error
        url = f"http://127.0.0.1:{server.server_address[1]}/"
        print(f"page:  {url}   (ctrl-c ends)", file=sys.stderr, flush=True)
        if self.browser:
            import webbrowser

            webbrowser.open(url)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            print("", file=sys.stderr)
        finally:
            server.server_close()
        if not annotation.saved:
            print("nothing was saved", file=sys.stderr)
            return 0
        print(target)
        print(f"next:  mam-sim make-env {self.photo} --hints {target}", file=sys.stderr)
        return 0
