"""The layers that a USD stage is composed of, looked through before anything is composed.

OpenUSD opens what a file composes (sublayers, references, payloads, value clips) by itself, pipes
and files of others included. So the names are read layer by layer, and each asks the door first.
Thirty prims that each reference the one before twice compose to a billion; so they are counted
first, too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door, Outside, is_file
from mam_pipeline.formats.soup import LIMITS, Budget


def check_layers(path: Path, door: Door) -> tuple[str, ...]:
    """Look at every layer of a stage, without composing it.

    Returns:
        Names of those whose format the library has no reader for: looks in MaterialX.

    Raises:
        Outside: one lies outside the folder. InputError: one is no ordinary file, or there are too
            many.
    """
    from pxr import Ar, Sdf

    left, seen, unread = [str(path)], set[str](), set[str]()
    while left:
        name = left.pop()
        if name in seen:
            continue
        seen.add(name)
        if len(seen) > LIMITS.nodes:
            raise InputError(f"{path} is composed of more than {LIMITS.nodes} layers; flatten it")
        layer = _layer(name)
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
            if Sdf.FileFormat.FindByExtension(file.suffix) is None:
                unread.add(file.name)
                continue
            left.append(found)
    return tuple(sorted(unread))


def _layer(name: str) -> Any:
    """A layer by its name; None where there is none, or no reader of its format."""
    from pxr import Sdf

    known = Sdf.FileFormat.FindByExtension(Path(name.partition("[")[0]).suffix)
    return None if known is None else Sdf.Layer.FindOrOpen(name)


def check_size(path: Path) -> None:
    """Refuse a stage that composes to more prims, instances included, than may be read.

    Raises:
        InputError: it does, or is nested too deep.
    """
    from pxr import Sdf

    layer = _layer(str(path))
    if layer is not None:
        _Count(path).prims(_Stack(layer), Sdf.Path.absoluteRootPath, ())


@dataclass
class _Stack:
    """A layer and its sublayers, which compose as one."""

    root: Any

    @cached_property
    def layers(self) -> list[Any]:
        """All of them, each once."""
        from pxr import Sdf

        found: dict[str, Any] = {}
        left = [self.root]
        while left:
            layer = left.pop()
            if layer is None or layer.identifier in found:
                continue
            found[layer.identifier] = layer
            names = [Sdf.ComputeAssetPathRelativeToLayer(layer, n) for n in layer.subLayerPaths]
            left += [_layer(name) for name in names if name]
        return list(found.values())

    def specs(self, at: Any) -> list[Any]:
        """What the layers say of a prim."""
        from pxr import Sdf

        found = [layer.GetObjectAtPath(at) for layer in self.layers]
        return [s for s in found if isinstance(s, Sdf.PrimSpec)]


@dataclass
class _Count:
    """How many prims are composed for a prim; at least as many as there will be, for one that is
    overridden counts as often as something is said of it.

    Attributes:
        known: by layer stack and path. stacks: by the identifier of their first layer.
    """

    path: Path
    known: dict[tuple[str, Any], int] = field(default_factory=dict)
    stacks: dict[str, _Stack] = field(default_factory=dict)

    def prims(self, stack: _Stack, at: Any, above: tuple[tuple[str, Any], ...]) -> int:
        """For a path in a layer stack.

        Args:
            above: what is being counted; what leads back there is not composed.
        """
        specs = stack.specs(at)
        while not specs:  # it comes from what is composed above it
            at = at.GetParentPath()
            specs = stack.specs(at)
        key = stack.root.identifier, at
        if key not in self.known:
            if key in above:
                return 0
            if len(above) > LIMITS.deep:
                raise InputError(f"{self.path}: prims are nested more than {LIMITS.deep} deep")
            above = (*above, key)
            count = sum(self._within(spec, stack, above) for spec in specs)
            if not at.IsAbsoluteRootPath():
                count += self._instances(specs, stack, above)
            self.known[key] = self._few(count)
        return self.known[key]

    def _few(self, count: int) -> int:
        if count > 2 * LIMITS.nodes:
            Budget(self.path).nodes(count)
        return count

    def _within(self, spec: Any, stack: _Stack, above: tuple[tuple[str, Any], ...]) -> int:
        """For what one layer says: the prim, its children, what it composes and its variants."""
        count = 1
        for child in spec.nameChildren:
            count = self._few(count + self.prims(stack, child.path, above))
        for kind in ("references", "payload"):
            for arc in spec.GetInfo(kind).GetAddedOrExplicitItems() if spec.HasInfo(kind) else ():
                other = self._other(arc.assetPath, spec.layer, stack)
                target = arc.primPath
                if other is not None and target.isEmpty and other.root.defaultPrim:
                    target = other.root.GetDefaultPrimAsPath()
                if other is not None and not target.isEmpty:
                    count = self._few(count + self.prims(other, target, above))
        for kind in ("inheritPaths", "specializes"):
            for at in spec.GetInfo(kind).GetAddedOrExplicitItems() if spec.HasInfo(kind) else ():
                count = self._few(count + self.prims(stack, at, above))
        for one in spec.variantSets.values() if spec.HasInfo("variantSetNames") else ():
            inner = [self._within(v.primSpec, stack, above) for v in one.variants.values()]
            count += max(inner, default=0)
        return count

    def _other(self, name: str, layer: Any, stack: _Stack) -> _Stack | None:
        """The layer stack of a file that a layer names."""
        from pxr import Sdf

        if not name:
            return stack
        found = _layer(Sdf.ComputeAssetPathRelativeToLayer(layer, name))
        if found is None:
            return None
        return self.stacks.setdefault(found.identifier, _Stack(found))

    def _instances(
        self, specs: list[Any], stack: _Stack, above: tuple[tuple[str, Any], ...]
    ) -> int:
        """For the instances of a point instancer, as many as it has at its first time."""
        many, targets = 0, []
        for spec in specs:
            rows = spec.layer.GetAttributeAtPath(spec.path.AppendProperty("protoIndices"))
            named = spec.layer.GetRelationshipAtPath(spec.path.AppendProperty("prototypes"))
            if named is not None:
                targets += named.targetPathList.GetAddedOrExplicitItems()
            if rows is None:
                continue
            times = spec.layer.ListTimeSamplesForPath(rows.path)
            values = [rows.default]
            values += [spec.layer.QueryTimeSample(rows.path, times[0])] if times else []
            many = max(many, *(0 if v is None else len(v) for v in values))
        each = max((self.prims(stack, t, above) for t in targets), default=0)
        return many * max(each, 1)


def _names(layer: Any) -> Iterator[str]:
    """What a layer composes, and the files of its value clips."""
    from pxr import Sdf

    yield from (name for name in layer.GetCompositionAssetDependencies() if name)
    clips: list[Any] = []
    prims = 0

    def note(at: Any) -> None:
        nonlocal prims
        if not at.IsPrimPath():
            return
        prims += 1
        if prims > LIMITS.nodes:
            return
        spec = layer.GetObjectAtPath(at)
        if isinstance(spec, Sdf.PrimSpec) and spec.HasInfo("clips"):
            clips.append(spec.GetInfo("clips"))

    layer.Traverse(Sdf.Path.absoluteRootPath, note)
    Budget(Path(layer.realPath)).nodes(prims)  # an error of the visit itself would be lost in it
    while clips:
        value = clips.pop()
        if isinstance(value, dict):
            clips += value.values()
        elif isinstance(value, Sdf.AssetPath):
            yield value.path
        elif isinstance(value, Sdf.AssetPathArray | list | tuple):
            clips += list(value)
