"""3MF reading through lib3mf: what stands on the build plate, with colours and textures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door
from mam_pipeline.formats.pictures import Pictures
from mam_pipeline.formats.soup import LIMITS, Budget, FileContent, Piece
from mam_pipeline.types import FloatArray, IntArray, Material
from mam_sim_formats.threemf_header import check_3mf

_METRES = (1e-6, 1e-3, 1e-2, 0.0254, 0.3048, 1.0)
"""By lib3mf's number of the unit: micrometre, millimetre, centimetre, inch, foot, metre."""


def read_3mf(path: Path, root: Path | None = None) -> FileContent:
    """Read the build items of a 3MF file in its own frame and unit.

    Raises:
        InputError: it cannot be read, or unpacks to more than what is read.
    """
    check_3mf(path)
    try:
        return _Reader(path).content()
    except (InputError, ModuleNotFoundError):
        raise
    except Exception as error:  # the library has one exception, with a number
        raise InputError(f"{path} cannot be read as 3MF ({error}); export it again") from error


class _Reader:
    def __init__(self, path: Path) -> None:
        import lib3mf

        self.path = path
        self.budget = Budget(path)
        self.pictures = Pictures(path, self.budget, Door(path.parent))
        self.model = lib3mf.get_wrapper().CreateModel()
        self.model.QueryReader("3mf").ReadFromFile(str(path))
        self.materials: list[Material] = [Material()]
        self.known: dict[tuple[int, int], int] = {}
        self.pieces: list[Piece] = []
        self.names: dict[str, int] = {}
        self.drawn = 0

    def content(self) -> FileContent:
        items = self.model.GetBuildItems()
        while items.MoveNext():
            item = items.GetCurrent()
            frame = _frame(item.GetObjectTransform()) if item.HasObjectTransform() else np.eye(4)
            self._object(item.GetObjectResource(), frame, 0)
        unit = _METRES[int(self.model.GetUnit())]
        return FileContent(
            tuple(self.pieces), tuple(self.materials), "z", unit, self.pictures.notes()
        )

    def _object(self, told: Any, frame: FloatArray, depth: int) -> None:
        self.drawn += 1
        self.budget.nodes(self.drawn)
        if depth > LIMITS.deep:
            raise InputError(f"{self.path}: components are nested more than {depth} deep")
        identity = told.GetResourceID()
        if told.IsComponentsObject():
            parts = self.model.GetComponentsObjectByID(identity)
            for i in range(parts.GetComponentCount()):
                part = parts.GetComponent(i)
                own = _frame(part.GetTransform()) if part.HasTransform() else np.eye(4)
                self._object(part.GetObjectResource(), frame @ own, depth + 1)
        elif told.IsMeshObject() and told.GetType().name in ("Model", "Other", "Surface"):
            self._mesh(self.model.GetMeshObjectByID(identity), frame)

    def _mesh(self, mesh: Any, frame: FloatArray) -> None:
        self.budget.triangles(mesh.GetVertexCount(), mesh.GetTriangleCount())
        points = np.array([tuple(v.Coordinates) for v in mesh.GetVertices()], dtype=np.float64)
        faces = np.array([tuple(t.Indices) for t in mesh.GetTriangleIndices()], dtype=np.int64)
        if not len(faces):
            return
        if np.linalg.det(frame[:3, :3]) < 0:
            faces = faces[:, ::-1]
        points = points @ frame[:3, :3].T + frame[:3, 3]
        name = self._unique(mesh.GetName() or f"object_{mesh.GetResourceID()}")
        resource, which = self._properties(mesh, len(faces))
        for identity in np.unique(resource):
            chosen = resource == identity
            kind = self.model.GetPropertyTypeByID(int(identity)).name if identity else ""
            if kind == "BaseMaterial":
                for one in np.unique(which[chosen, 0]):
                    mine = chosen & (which[:, 0] == one)
                    material = self._base(int(identity), int(one))
                    self.pieces.append(Piece(points, faces[mine], name, material))
            elif kind in ("Colors", "TexCoord"):
                self.pieces.append(
                    self._by_corner(kind, int(identity), points[faces[chosen]], which[chosen], name)
                )
            else:
                self.pieces.append(Piece(points, faces[chosen], name))

    def _properties(self, mesh: Any, count: int) -> tuple[IntArray, IntArray]:
        """(F,) resource of every triangle, 0 for none, and (F, 3) its property at each corner."""
        resource = np.zeros(count, dtype=np.int64)
        which = np.zeros((count, 3), dtype=np.int64)
        base, index, given = mesh.GetObjectLevelProperty()
        if given:
            resource[:], which[:] = base, index
        for row, told in enumerate(mesh.GetAllTriangleProperties()):
            if told.ResourceID:
                resource[row], which[row] = told.ResourceID, tuple(told.PropertyIDs)
        return resource, which

    def _base(self, identity: int, index: int) -> int:
        if (identity, index) not in self.known:
            group = self.model.GetBaseMaterialGroupByID(identity)
            color = group.GetDisplayColor(index)
            self.known[identity, index] = len(self.materials)
            self.materials.append(Material(str(group.GetName(index) or "material"), _shares(color)))
        return self.known[identity, index]

    def _by_corner(
        self, kind: str, identity: int, corners: FloatArray, which: IntArray, name: str
    ) -> Piece:
        """Triangles with a colour or a texture coordinate at each corner."""
        points, keys = corners.reshape(-1, 3), which.reshape(-1)
        faces: IntArray = np.arange(len(points)).reshape(-1, 3)
        values, row = np.unique(keys, return_inverse=True)
        if kind == "Colors":
            group = self.model.GetColorGroupByID(identity)
            table = np.array([_shares(group.GetColor(int(k))) for k in values])
            colors = np.round(table[row] * 255.0).astype(np.uint8)
            return Piece(points, faces, name, self._plain(identity), None, colors)
        group = self.model.GetTexture2DGroupByID(identity)
        told = [group.GetTex2Coord(int(k)) for k in values]
        flipped = np.array([(t.U, 1.0 - t.V) for t in told], dtype=np.float32)
        if (identity, 0) not in self.known:
            attachment = group.GetTexture2D().GetAttachment()
            data = bytes(attachment.WriteToBuffer())
            picture = self.pictures.decoded(data, attachment.GetPath())
            self.known[identity, 0] = len(self.materials)
            self.materials.append(
                Material(
                    "texture", (1.0, 1.0, 1.0, 1.0),
                    None if picture is None else picture.data,
                    None if picture is None else picture.kind,
                )
            )  # fmt: skip
        return Piece(points, faces, name, self.known[identity, 0], flipped[row])

    def _plain(self, identity: int) -> int:
        if (identity, -1) not in self.known:
            self.known[identity, -1] = len(self.materials)
            self.materials.append(Material("colours", (1.0, 1.0, 1.0, 1.0)))
        return self.known[identity, -1]

    def _unique(self, name: str) -> str:
        self.names[name] = self.names.get(name, 0) + 1
        return name if self.names[name] == 1 else f"{name}.{self.names[name] - 1:03d}"


def _frame(transform: Any) -> FloatArray:
    """(4, 4) of lib3mf's 4 x 3 rows, which stand for points as rows."""
    out = np.eye(4)
    rows = np.array([tuple(row) for row in transform.Fields], dtype=np.float64)
    out[:3, :3], out[:3, 3] = rows[:3].T, rows[3]
    return out


def _shares(color: Any) -> tuple[float, float, float, float]:
    return color.Red / 255.0, color.Green / 255.0, color.Blue / 255.0, color.Alpha / 255.0
