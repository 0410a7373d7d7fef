"""USD reading (usd, usda, usdc, usdz) through OpenUSD: a stage's triangles at its first time.

What is shown is read: invisible prims, guides and proxies are not, instances stand where they are
drawn, skeletons in the pose of the first time. Materials are UsdPreviewSurface.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from mam_pipeline.errors import InputError
from mam_pipeline.formats.pictures import Picture, Pictures, model_door
from mam_pipeline.formats.soup import Budget, FileContent, Piece, fans, paired
from mam_pipeline.optional import require
from mam_pipeline.types import FloatArray, IntArray, Material
from mam_sim_formats.usd_layers import check_layers, check_size

_NOISE = re.compile(r"^\s*Error in '.*?' at line \d+ in file \S+ : ", re.M)
"""Where in its own source the library found an error."""


def read_usd(path: Path, root: Path | None = None) -> FileContent:
    """Read every triangle of a stage in its own frame and unit.

    Args:
        path: the file. root: folder whose files it may name; default: its own.

    Raises:
        InputError: it cannot be read, or it composes layers from outside its folder.
    """
    with failures_said(path):
        return StageReader(path, root).content()


@contextmanager
def failures_said(path: Path) -> Iterator[None]:
    """Whatever the library raises is a sentence about the file."""
    require(f"{path.name}: reading USD", "pxr")
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # it fails in many ways
        words = _NOISE.sub("", str(error)).strip().splitlines()
        what = words[0] if words else type(error).__name__
        raise InputError(f"{path} cannot be read as USD ({what})") from error


class StageReader:
    """A stage that was looked through before it was composed, and the triangles drawn so far.

    Attributes:
        closed: paths of prims below which nothing is drawn.
    """

    def __init__(self, path: Path, root: Path | None = None) -> None:
        from pxr import Usd, UsdGeom

        self.path = path
        self.budget = Budget(path)
        self.pictures = Pictures(path, self.budget, model_door(path, root))
        unread = check_layers(path, self.pictures.door)
        check_size(path)
        self.stage = Usd.Stage.Open(str(path))
        self.time = Usd.TimeCode.EarliestTime()
        self.frames = UsdGeom.XformCache(self.time)
        self.materials: list[Material] = [Material()]
        self.known: dict[str, tuple[int, str]] = {}
        self.pieces: list[Piece] = []
        self.dropped = Counter(f"{name}, whose format USD cannot read here" for name in unread)
        self.drawn = 0
        self.closed: frozenset[str] = frozenset()
        self._stay_inside()

    def content(self) -> FileContent:
        """Every triangle of the stage."""
        from pxr import UsdGeom

        self._pose_skeletons()
        self._walk(self.stage.GetPseudoRoot(), np.eye(4), 0)
        notes = self.pictures.notes()
        if self.dropped:
            notes += (f"not taken over: {', '.join(sorted(self.dropped))}",)
        up = str(UsdGeom.GetStageUpAxis(self.stage)).lower()
        told = float(UsdGeom.GetStageMetersPerUnit(self.stage))
        unit = told if np.isfinite(told) and told > 0.0 else None
        if unit is None:
            notes += (f"metersPerUnit = {told:g} is no unit; the size is taken from the object",)
        return FileContent(tuple(self.pieces), tuple(self.materials), up, unit, notes)

    def _stay_inside(self) -> None:
        for layer in self.stage.GetUsedLayers():
            real = layer.realPath.partition("[")[0]
            if real and not self.pictures.door.holds(Path(real)):
                raise InputError(f"{self.path} composes {real}, which lies outside its folder")

    def _pose_skeletons(self) -> None:
        """Bake skins into points, in a layer of our own."""
        from pxr import Gf, Usd, UsdSkel

        roots = [p for p in self.stage.Traverse() if p.IsA(UsdSkel.Root)]
        if not roots:
            return
        self.stage.SetEditTarget(self.stage.GetSessionLayer())
        start = self.stage.GetStartTimeCode()
        for root in roots:
            if not UsdSkel.BakeSkinning(UsdSkel.Root(root), Gf.Interval(start, start)):
                self.dropped["a skeleton's pose"] += 1
        self.time = Usd.TimeCode(start)

    def _walk(self, root: Any, place: FloatArray, depth: int) -> None:
        """Draw what is below a prim; `place` is put before its frame in the world."""
        from pxr import Usd, UsdGeom

        if depth > 20:
            raise InputError(f"{self.path}: instancers are nested more than {depth} deep")
        walk = iter(Usd.PrimRange(root, Usd.TraverseInstanceProxies()))
        for prim in walk:
            self.drawn += 1
            self.budget.nodes(self.drawn)
            if prim != root and str(prim.GetPath()) in self.closed:
                walk.PruneChildren()
                continue
            if not prim.IsA(UsdGeom.Imageable):
                if prim.GetTypeName().startswith("Physics"):
                    self.dropped["physics joints"] += 1
                continue
            shown = UsdGeom.Imageable(prim)
            hidden = shown.GetVisibilityAttr().Get(self.time) == UsdGeom.Tokens.invisible
            if hidden or shown.GetPurposeAttr().Get() in ("guide", "proxy"):
                walk.PruneChildren()
            elif prim.IsA(UsdGeom.PointInstancer):
                walk.PruneChildren()
                self._instances(prim, place, depth)
            else:
                self._surface(prim, place)

    def _surface(self, prim: Any, place: FloatArray) -> None:
        """Draw one prim, where it is a mesh or a solid."""
        from pxr import UsdGeom

        if prim.IsA(UsdGeom.Mesh):
            self._mesh(UsdGeom.Mesh(prim), place)
        elif prim.IsA(UsdGeom.Gprim):
            self._solid(prim, place)

    def _instances(self, prim: Any, place: FloatArray, depth: int) -> None:
        from pxr import UsdGeom

        told = UsdGeom.PointInstancer(prim)
        targets = told.GetPrototypesRel().GetForwardedTargets()
        which = told.GetProtoIndicesAttr().Get(self.time) or ()
        frames = told.ComputeInstanceTransformsAtTime(
            self.time, self.time, UsdGeom.PointInstancer.IncludeProtoXform
        )
        world = place @ self._world(prim)
        if len(which) and not 0 <= min(which) <= max(which) < len(targets):
            raise InputError(f"{self.path} is broken: {prim.GetPath()} names a missing prototype")
        for index, frame in zip(which, frames):
            root = self.stage.GetPrimAtPath(targets[index])
            # the prototype's own frame in the world is taken back: it stands where it is drawn
            own = np.linalg.inv(self._world(root))
            self._walk(root, world @ np.array(frame).T @ own, depth + 1)

    def _world(self, prim: Any) -> FloatArray:
        return np.array(self.frames.GetLocalToWorldTransform(prim), dtype=np.float64).T

    def _mesh(self, mesh: Any, place: FloatArray) -> None:
        from pxr import UsdGeom, UsdShade

        prim = mesh.GetPrim()
        points = np.array(mesh.GetPointsAttr().Get(self.time) or (), dtype=np.float64)
        counts = np.array(mesh.GetFaceVertexCountsAttr().Get(self.time) or (), dtype=np.int64)
        corners = np.array(mesh.GetFaceVertexIndicesAttr().Get(self.time) or (), dtype=np.int64)
        if not len(points) or not len(counts):
            return
        if counts.sum() != len(corners) or not 0 <= corners.min() <= corners.max() < len(points):
            raise InputError(f"{self.path} is broken: {prim.GetPath()} names a missing vertex")
        wheel, polygon = fans(counts)
        self.budget.triangles(len(points), len(wheel))
        frame = place @ self._world(prim)
        left_handed = mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded
        if left_handed != (np.linalg.det(frame[:3, :3]) < 0):
            wheel = wheel[:, ::-1]
        if mesh.GetSubdivisionSchemeAttr().Get() not in (None, "none"):
            refined = len(mesh.GetCreaseIndicesAttr().Get() or ()) or counts.max() == 4
            self.dropped.update(["subdivision (the cage is kept)"] if refined else [])
        own = self._material(UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0])
        bound = np.full(len(counts), own[0], dtype=np.int64)
        maps = {own[0]: own[1]}
        for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets():
            told = UsdShade.MaterialBindingAPI(subset.GetPrim()).ComputeBoundMaterial()[0]
            index, name = self._material(told)
            rows = np.array(subset.GetIndicesAttr().Get(self.time) or (), dtype=np.int64)
            bound[rows[(rows >= 0) & (rows < len(bound))]] = index
            maps[index] = name
        for index in np.unique(bound):
            chosen = wheel[bound[polygon] == index]
            self._piece(
                mesh, points, corners, counts, chosen, frame, int(index), maps.get(int(index), "")
            )

    def _piece(
        self, mesh: Any, points: FloatArray, corners: IntArray, counts: IntArray, wheel: IntArray,
        frame: FloatArray, material: int, uv_name: str,
    ) -> None:  # fmt: skip
        """Add the triangles of one material; `wheel` (F, 3) indexes the corners of polygons."""
        from pxr import UsdGeom

        spots = wheel.reshape(-1)
        primvars = UsdGeom.PrimvarsAPI(mesh.GetPrim())
        sizes = (len(points), len(corners), counts)
        uv = self._primvar(primvars, (uv_name, "st", "UVMap", "map1", "st0", "st1"), corners, sizes)
        color = self._primvar(primvars, ("displayColor",), corners, sizes)
        keys = [corners[spots]]
        keys += [found[1][spots] for found in (uv, color) if found is not None]
        rows, faces = paired(np.stack(keys, axis=1))
        texture = painted = None
        if uv is not None and uv[0].shape[1] == 2:
            at = uv[0][rows[:, 1]]
            texture = np.stack([at[:, 0], 1.0 - at[:, 1]], axis=1).astype(np.float32)
        if color is not None:
            painted = np.full((len(rows), 4), 255, np.uint8)
            painted[:, :3] = np.clip(np.round(color[0][rows[:, -1], :3] * 255.0), 0, 255)
        if material and painted is not None:  # a material goes over display colours
            painted = None
        vertices = points[rows[:, 0]] @ frame[:3, :3].T + frame[:3, 3]
        name = _name(mesh.GetPrim())
        self.pieces.append(Piece(vertices, faces, name, material, texture, painted))

    def _primvar(
        self, primvars: Any, names: Sequence[str], corners: IntArray,
        sizes: tuple[int, int, IntArray],
    ) -> tuple[FloatArray, IntArray] | None:  # fmt: skip
        """Values (N, K), and the row of each corner of a polygon; None where there are none."""
        found = next(
            (p for n in names if n and (p := primvars.FindPrimvarWithInheritance(n)).HasValue()),
            None,
        )
        if found is None:
            return None
        values = np.array(found.ComputeFlattened(self.time) or (), dtype=np.float64)
        if values.ndim != 2 or not len(values):
            return None
        kind, (points, spots, counts) = found.GetInterpolation(), sizes
        if kind in ("vertex", "varying") and len(values) == points:
            return values, corners
        if kind == "faceVarying" and len(values) == spots:
            return values, np.arange(spots)
        if kind == "uniform" and len(values) == len(counts):
            return values, np.repeat(np.arange(len(counts)), counts)
        return values, np.zeros(spots, dtype=np.int64)

    def _solid(self, prim: Any, place: FloatArray) -> None:
        """A cube, sphere, cylinder, cone or capsule as triangles."""
        from pxr import UsdGeom, UsdShade

        kind = prim.GetTypeName()

        def number(name: str) -> float:
            return float(prim.GetAttribute(name).Get(self.time))

        if kind == "Cube":
            mesh = trimesh.creation.box([number("size")] * 3)
        elif kind == "Sphere":
            mesh = trimesh.creation.icosphere(3, number("radius"))
        elif kind == "Cylinder":
            mesh = trimesh.creation.cylinder(number("radius"), number("height"), sections=32)
        elif kind == "Cone":
            mesh = trimesh.creation.cone(number("radius"), number("height"), sections=32)
            mesh.apply_translation([0, 0, -0.5 * number("height")])
        elif kind == "Capsule":
            mesh = trimesh.creation.capsule(number("height"), number("radius"), count=[16, 16])
            mesh.apply_translation(-mesh.bounds.mean(axis=0))
        else:
            self.dropped[f"{kind} prims"] += 1
            return
        points = np.asarray(mesh.vertices)
        axis = prim.GetAttribute("axis")
        if axis and axis.Get() in ("X", "Y"):
            points = points[:, [2, 0, 1]] if axis.Get() == "X" else points[:, [1, 2, 0]]
        self.budget.triangles(len(points), len(mesh.faces))
        frame = place @ self._world(prim)
        faces = np.asarray(mesh.faces)
        if np.linalg.det(frame[:3, :3]) < 0:
            faces = faces[:, ::-1]
        material, _ = self._material(UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0])
        vertices = points @ frame[:3, :3].T + frame[:3, 3]
        told = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayColor")
        color = None if material or not told else told.ComputeFlattened(self.time)
        if color:  # one for all of it
            r, g, b = (float(c) for c in color[0])
            material = self.known.setdefault(f"{r} {g} {b}", (len(self.materials), ""))[0]
            if material == len(self.materials):
                self.materials.append(Material("color", (r, g, b, 1.0)))
        self.pieces.append(Piece(vertices, faces, _name(prim), material))

    def _material(self, material: Any) -> tuple[int, str]:
        """Index of a material, and the name of the coordinates that its texture uses."""
        if not material:
            return 0, ""
        key = str(material.GetPath())
        if key not in self.known:
            made, uv = self._preview(material)
            self.known[key] = len(self.materials), uv
            self.materials.append(made)
        return self.known[key]

    def _preview(self, material: Any) -> tuple[Material, str]:
        shader = material.ComputeSurfaceSource()[0]
        name = material.GetPrim().GetName()
        if not shader:
            return Material(name), ""

        def number(key: str, default: float) -> float:
            port = shader.GetInput(key)
            found = port.Get(self.time) if port else None
            return float(found) if isinstance(found, int | float) else default

        color, picture, uv = (0.7, 0.7, 0.7), None, ""
        port = shader.GetInput("diffuseColor")
        if port and port.HasConnectedSource():
            source = port.GetConnectedSource()[0].GetPrim()
            picture, uv = self._texture(source)
            color = (1.0, 1.0, 1.0) if picture is not None else color
        elif port and port.Get(self.time) is not None:
            r, g, b = port.Get(self.time)
            color = (float(r), float(g), float(b))
        made = Material(
            name,
            (*color, number("opacity", 1.0) or 1.0),
            None if picture is None else picture.data,
            None if picture is None else picture.kind,
            number("metallic", 0.0),
            number("roughness", 0.5),
        )
        return made, uv

    def _texture(self, prim: Any) -> tuple[Picture | None, str]:
        """The picture of a UsdUVTexture, and the name of the coordinates that it reads."""
        from pxr import Ar, UsdShade

        shader = UsdShade.Shader(prim)
        port = shader.GetInput("file")
        asset = port.Get(self.time) if port else None
        if asset is None:
            return None, ""
        uv, at = "", shader
        for _ in range(4):  # a transform may stand between the texture and its coordinates
            feed = at.GetInput("st") or at.GetInput("in")
            if not feed or not feed.HasConnectedSource():
                break
            at = UsdShade.Shader(feed.GetConnectedSource()[0].GetPrim())
            told = at.GetInput("varname")
            if told:
                uv = str(told.Get(self.time) or "")
                break
        resolved = asset.resolvedPath
        if "[" in resolved:  # inside a usdz
            opened = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(resolved))
            if opened:
                data = bytes(opened.GetBuffer())
                return self.pictures.decoded(data, asset.path), uv
        return self.pictures.named(asset.path), uv


def _name(prim: Any) -> str:
    """Of the object whose only surface a prim is, as exporters write it, or its own."""
    from pxr import UsdGeom

    above = prim.GetParent()
    surfaces = sum(1 for child in above.GetChildren() if child.IsA(UsdGeom.Gprim))
    return str(prim.GetName() if above.IsPseudoRoot() or surfaces > 1 else above.GetName())
