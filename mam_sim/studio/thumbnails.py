"""Small pictures of the objects of a folder, made one by one while the page is in use."""

from __future__ import annotations

import base64
import io
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.read import read_asset
from mam_pipeline.errors import MamSimError
from mam_pipeline.formats.mesh_files import load_mesh
from mam_pipeline.formats.suffixes import PHOTOS
from mam_pipeline.formats.urdf.read import read_urdf
from mam_pipeline.geometry.stand_in import stand_in
from mam_pipeline.render.mesh_pictures import render_mesh
from mam_pipeline.types import Mesh

SIZE = 96  # pixels
EMPTY = "data:image/gif;base64,R0lGODlhAQABAAAAACH5BAEKAAEALAAAAAABAAEAAAICTAEAOw=="


class Thumbnails:
    """Pictures by path; what is not there yet is made in the background."""

    def __init__(self, folder: Path, tell: Callable[[], None]) -> None:
        """Make none yet.

        Args:
            folder: that the paths are in. tell: called when a picture is ready.
        """
        self._folder, self._tell = folder, tell
        self._made: dict[str, str] = {}
        self._wanted: list[str] = []
        self._busy = threading.Lock()

    def url(self, path: str) -> str:
        """The picture as a data URL; an empty one while there is none."""
        return self._made.get(path, EMPTY)

    def want(self, paths: Sequence[str]) -> None:
        """Say which ones are shown, the first most urgent."""
        self._wanted = [p for p in paths if p not in self._made]
        if self._wanted and not self._busy.locked():
            threading.Thread(target=self._make, daemon=True).start()

    def _make(self) -> None:
        if not self._busy.acquire(blocking=False):
            return
        try:
            while self._wanted:
                path = self._wanted.pop(0)
                try:
                    self._made[path] = _url(picture(self._folder / path))
                except (MamSimError, OSError, ValueError):
                    self._made[path] = EMPTY  # the page says what is wrong when it is opened
                self._tell()
        finally:
            self._busy.release()


def picture(path: Path) -> NDArray[np.uint8]:
    """(SIZE, SIZE, 3) or smaller: a photo, or the object of a file or an asset folder.

    Raises:
        MamSimError: it cannot be read.
    """
    if path.suffix.lower() in PHOTOS:
        return thumbnail(path, SIZE)
    mesh = _mesh(path)
    light = stand_in(mesh)
    return render_mesh(mesh if light is None else light.mesh, size=(SIZE, SIZE))


def thumbnail(photo: Path, size: int) -> NDArray[np.uint8]:
    """(H, W, 3) a photo, its longer side at most some pixels."""
    with Image.open(photo) as opened:
        upright = ImageOps.exif_transpose(opened).convert("RGB")
    upright.thumbnail((size, size))
    return np.asarray(upright)


def _mesh(path: Path) -> Mesh:
    if path.is_dir():
        return read_asset(Asset.load(path)).mesh
    if path.suffix.lower() in (".urdf", ".xml"):
        return read_urdf(path).mesh
    return load_mesh(path).mesh


def _url(picture: NDArray[np.uint8]) -> str:
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "PNG")
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()
