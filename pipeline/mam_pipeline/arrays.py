"""Arrays from an .npz file of anybody: numbers and text alone, and never more than it holds.

A file that is packed may say that its arrays are a million times as large as itself, and one of
Python's objects would run a program as it is read.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from mam_pipeline.errors import InputError

DAMAGED = (ValueError, TypeError, KeyError, OSError, EOFError, MemoryError, OverflowError,
           RuntimeError, NotImplementedError, zipfile.BadZipFile, zlib.error)  # fmt: skip
"""What NumPy and zipfile raise at a file that is not what it says."""


@dataclass(frozen=True)
class ArrayLimits:
    """What one .npz file may hold.

    Attributes:
        bytes: of all its arrays, unpacked. entries: arrays.
    """

    bytes: int = 4 << 30
    entries: int = 4096


LIMITS = ArrayLimits()


class Arrays(Mapping[str, NDArray[Any]]):
    """The arrays of a file by name, read as they are asked for."""

    def __init__(self, file: Path) -> None:
        """Look through the file.

        Raises:
            InputError: it is no .npz file, or claims too much.
        """
        self.file = file
        try:
            with zipfile.ZipFile(file) as archive:
                entries = archive.infolist()
        except DAMAGED as error:
            raise self._damaged(error) from error
        self._sizes = {e.filename.removesuffix(".npy"): e.file_size for e in entries}
        if len(entries) > LIMITS.entries or sum(self._sizes.values()) > LIMITS.bytes:
            raise InputError(
                f"{file} unpacks to more than {LIMITS.entries} arrays or {LIMITS.bytes >> 30} GiB"
            )

    def __getitem__(self, name: str) -> NDArray[Any]:
        """An array; for the errors see the class."""
        if name not in self._sizes:
            raise InputError(f"{self.file} holds no array {name!r}")
        try:
            with zipfile.ZipFile(self.file) as archive, archive.open(f"{name}.npy") as stream:
                _fits(stream, self._sizes[name])
                stream.seek(0)
                return np.asarray(npy.read_array(stream, allow_pickle=False))
        except DAMAGED as error:
            raise self._damaged(error) from error

    def __contains__(self, name: object) -> bool:
        return name in self._sizes

    def __iter__(self) -> Iterator[str]:
        return iter(self._sizes)

    def __len__(self) -> int:
        return len(self._sizes)

    def numbers(self, name: str, *shape: int | None) -> NDArray[Any]:
        """Finite numbers of a shape, in which None is any length.

        Raises:
            InputError: there are none.
        """
        found = self[name]
        fits = len(shape) == found.ndim and all(w in (None, n) for w, n in zip(shape, found.shape))
        if not fits or found.dtype.kind not in "biuf" or not np.isfinite(found).all():
            wanted = " x ".join("n" if n is None else str(n) for n in shape)
            raise InputError(f"{self.file}: {name} must be {wanted} finite numbers")
        return found

    def _damaged(self, error: BaseException) -> InputError:
        why = " ".join(str(error).split())[:200] or type(error).__name__
        return InputError(f"{self.file} is no file of arrays that can be read: {why}")


def _fits(stream: IO[bytes], size: int) -> None:
    """Raise ValueError where an array's header says more than its bytes."""
    version = npy.read_magic(stream)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read(stream)
    if dtype.hasobject:
        raise ValueError("it holds objects of Python")
    count = 1
    for length in shape:
        count *= length
    if count * dtype.itemsize > size or min(shape, default=0) < 0:
        raise ValueError(f"it claims {count} entries in {size} bytes")
