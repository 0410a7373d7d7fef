"""The layers that a USD stage is composed of: all are looked up before any but the first is opened.

OpenUSD opens what a file composes (sublayers, references, payloads, value clips) by itself, pipes
and files of others included. So the names are read layer by layer, and each asks the door first.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door, Outside, is_file
from mam_pipeline.formats.soup import LIMITS


def check_layers(path: Path, door: Door) -> None:
    """Look at every layer of a stage, without composing it.

    Raises:
        Outside: one lies outside the folder. InputError: one is no ordinary file, or there are too
            many.
    """
    from pxr import Ar, Sdf

    left, seen = [str(path)], set[str]()
    while left:
        name = left.pop()
        if name in seen:
            continue
        seen.add(name)
        if len(seen) > LIMITS.nodes:
            raise InputError(f"{path} is composed of more than {LIMITS.nodes} layers; flatten it")
        layer = Sdf.Layer.FindOrOpen(name)
        if layer is None:
            continue
        for told in _names(layer):
            anchored = Sdf.ComputeAssetPathRelativeToLayer(layer, told)
            found = Ar.GetResolver().Resolve(anchored).GetPathString()
            if not found:  # there is none
                continue
            file = Path(found.partition("[")[0])
            if not door.holds(file):
                raise Outside(
                    f"{path} composes {told!r}, which lies outside its folder and is not opened; "
                    "copy it into the folder, or, if the file is your own, add --allow-outside"
                )
            if not is_file(file):
                raise InputError(f"{path} composes {told!r}, which is no ordinary file")
            left.append(found)


def _names(layer: Any) -> Iterator[str]:
    """What a layer composes, and the files of its value clips."""
    from pxr import Sdf

    yield from (name for name in layer.GetCompositionAssetDependencies() if name)
    clips: list[Any] = []

    def note(at: Any) -> None:
        spec = layer.GetObjectAtPath(at)
        if isinstance(spec, Sdf.PrimSpec) and spec.HasInfo("clips"):
            clips.append(spec.GetInfo("clips"))

    layer.Traverse(Sdf.Path.absoluteRootPath, note)
    while clips:
        value = clips.pop()
        if isinstance(value, dict):
            clips += value.values()
        elif isinstance(value, Sdf.AssetPath):
            yield value.path
        elif isinstance(value, Sdf.AssetPathArray | list | tuple):
            clips += list(value)
