"""`mam-sim annotate`: mark corners, panels and handles on a photo, in a local web page."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import tyro


def annotate(
    photo: Annotated[Path, tyro.conf.Positional],
    /,
    out: Path | None = None,
    port: int = 0,
    browser: bool = True,
) -> int:
    """Mark front corners, panels and handles on a photo; saves a hints file.

    The page is served on this machine only (127.0.0.1) and needs nothing from the network.

    Args:
        photo: the photo.
        out: the hints file to write; default: hints.yaml beside the photo.
        port: of the local server; 0 takes any free one.
        browser: open the page in the default browser.
    """
    from mam_pipeline.errors import InputError
    from mam_pipeline.photo.annotate import Annotation, make_server

    target = out if out is not None else photo.with_name(f"{photo.stem}-hints.yaml")
    annotation = Annotation(photo, target)
    try:
        server = make_server(annotation, port)
    except (OSError, OverflowError) as error:
        raise InputError(f"cannot listen on port {port} of 127.0.0.1: {error}") from error
    url = f"http://127.0.0.1:{server.server_address[1]}/"
    print(f"page:  {url}   (ctrl-c ends)", file=sys.stderr, flush=True)
    if browser:
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
    print(f"next:  mam-sim make-env {photo} --hints {target}", file=sys.stderr)
    return 0
