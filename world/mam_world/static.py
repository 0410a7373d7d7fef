"""The static file: the style switches applied to the exact pieces (design.md section 8)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mam_pipeline.types import FloatArray, IntArray, Material, Mesh, joint_motion
from mam_world import shapes
from mam_world.style import UNITS, Style


@dataclass(frozen=True)
class Soup:
    """All pieces of an object at the source's pose, asset frame.

    Attributes:
        vertices (V, 3), faces (F, 3), uv (V, 2); face_piece (F,) piece of every face.
        piece_link, piece_material, piece_role, piece_is_box: (P,) columns of the piece table.
        link_poses: (L, 4, 4) motion of every link from its closed pose to the source's.
    """

    vertices: FloatArray
    faces: IntArray
    uv: FloatArray
    face_piece: IntArray
    piece_link: IntArray
    piece_material: IntArray
    piece_role: tuple[str, ...]
    piece_is_box: IntArray
    materials: tuple[Material, ...]
    link_poses: FloatArray

    @property
    def face_link(self) -> IntArray:
        """(F,) link of every face."""
        return self.piece_link[self.face_piece]

    def keep(self, mask: np.ndarray) -> Soup:
        """Only the faces of a boolean mask; unused vertices go."""
        faces = self.faces[mask]
        used = np.zeros(len(self.vertices), dtype=bool)
        used[faces] = True
        index = np.cumsum(used) - 1
        return replace(self, vertices=self.vertices[used], uv=self.uv[used], faces=index[faces],
                       face_piece=self.face_piece[mask])  # fmt: skip


def soup_mesh(soup: Soup, group_names: tuple[str, ...], groups: IntArray | None = None) -> Mesh:
    """The soup as a mesh; groups (F,) default to the links."""
    return Mesh(
        soup.vertices, soup.faces, soup.materials, soup.piece_material[soup.face_piece],
        soup.uv.astype(np.float32), None, soup.face_link if groups is None else groups, group_names,
    )  # fmt: skip


def file_transform(style: Style) -> FloatArray:
    """(4, 4) similarity transform from the asset frame to the file's coordinates."""
    out = joint_motion("revolute", (0, 0, 1), np.zeros(3), style.yaw)
    lean = (np.cos(style.tilt_towards), np.sin(style.tilt_towards), 0.0)
    out = joint_motion("revolute", lean, np.zeros(3), style.tilt) @ out
    if style.y_up:  # file x = asset -y, file y = asset z, file z = asset -x: the front faces +z
        turn = np.eye(4)
        turn[:3, :3] = [[0, -1, 0], [0, 0, 1], [-1, 0, 0]]
        out = turn @ out
    out[:3] *= UNITS[style.unit]
    return out


def restyle(
    soup: Soup, style: Style, rng: np.random.Generator, link_names: tuple[str, ...]
) -> tuple[Mesh, IntArray]:
    """Apply the mesh styles; returns the mesh in the asset frame and (F,) truth links."""
    if not style.drawer_boxes:
        lost = np.array([r == "drawer_box" for r in soup.piece_role])
        soup = soup.keep(~lost[soup.face_piece])
    if style.overlap:
        soup = _overlapped(soup, style.overlap, rng)
    if style.sheets:
        soup = soup.keep(_sheet_faces(soup))
    if style.open_shells:
        soup = soup.keep(_open_shell_faces(soup, rng))
    if style.fasteners:
        soup = _with_fasteners(soup, rng)
    if style.tessellation == "dense":
        soup = _subdivided(soup, limit=24_000)
    if style.components == "split":
        soup = _split_flat(soup)
    elif style.components == "welded":
        soup = _welded(soup)
    if style.unshared:
        soup = replace(soup, vertices=soup.vertices[soup.faces.reshape(-1)],
                       uv=soup.uv[soup.faces.reshape(-1)],
                       faces=np.arange(3 * len(soup.faces)).reshape(-1, 3))  # fmt: skip
    if style.double_sided:
        back = soup.faces[:, ::-1] + len(soup.vertices)
        soup = replace(soup, vertices=np.tile(soup.vertices, (2, 1)), uv=np.tile(soup.uv, (2, 1)),
                       faces=np.concatenate([soup.faces, back]),
                       face_piece=np.tile(soup.face_piece, 2))  # fmt: skip
    return _named(soup, style, link_names), soup.face_link


def _named(soup: Soup, style: Style, link_names: tuple[str, ...]) -> Mesh:
    """Nodes of the file, in the order of their faces."""
    if style.nodes == "part":
        return soup_mesh(soup, link_names)
    if style.nodes == "object":
        return soup_mesh(soup, ("object",), np.zeros(len(soup.faces), dtype=np.int64))
    pieces, groups = np.unique(soup.face_piece, return_inverse=True)
    names = tuple(f"mesh_{k:03d}" for k in range(len(pieces)))
    return soup_mesh(soup, names, groups.reshape(-1))


def _overlapped(soup: Soup, share: float, rng: np.random.Generator) -> Soup:
    """Upright boxes grown about their middles by up to `share` of the diagonal, or by half."""
    owner = np.zeros(len(soup.vertices), dtype=np.int64)
    owner[soup.faces] = soup.face_piece[:, None]
    count = len(soup.piece_link)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, owner, soup.vertices)
    np.maximum.at(high, owner, soup.vertices)
    low[np.isinf(low)], high[np.isinf(high)] = 0.0, 0.0  # pieces that another style has removed
    at_corner = np.minimum(soup.vertices - low[owner], high[owner] - soup.vertices) < 1e-9
    upright = np.array(soup.piece_is_box)
    upright[owner[~at_corner.all(axis=1)]] = False
    size = soup.vertices.max(axis=0) - soup.vertices.min(axis=0)
    grow = rng.random((count, 3)) * share * float(np.linalg.norm(size))
    grow = np.minimum(grow, 0.25 * (high - low)) * upright[:, None]
    away = np.sign(soup.vertices - (low + high)[owner] / 2)
    return replace(soup, vertices=soup.vertices + away * grow[owner])


def _box_sides(soup: Soup) -> IntArray:
    """(F,) side 0..5 (-x +x -y +y -z +z at rest) of faces of boxes, -1 elsewhere."""
    first = np.searchsorted(soup.face_piece, soup.face_piece)
    side = (np.arange(len(soup.faces)) - first) // 2
    return np.where(soup.piece_is_box[soup.face_piece], side, -1)


def _outwards(soup: Soup) -> FloatArray:
    """(F,) how far each face looks away from the object's middle."""
    t = soup.vertices[soup.faces]
    normal = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    middle = 0.5 * (soup.vertices.min(axis=0) + soup.vertices.max(axis=0))
    return np.einsum("ij,ij->i", normal, t.mean(axis=1) - middle)


def _sheet_faces(soup: Soup) -> IntArray:
    """(F,) mask that leaves one side of every thin panel: the one that looks outwards."""
    side, out = _box_sides(soup), _outwards(soup)
    mask = np.ones(len(soup.faces), dtype=bool)
    for piece in np.flatnonzero([r in ("panel", "drawer_box") for r in soup.piece_role]):
        if not soup.piece_is_box[piece]:
            continue
        faces = np.flatnonzero(soup.face_piece == piece)
        if len(faces) != 12:
            continue
        t = soup.vertices[soup.faces[faces]]
        area = np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1)
        axis = int(np.argmax(area[::4]))  # areas of sides -x, -y, -z: the thin axis has the largest
        if np.partition(area[::4], 1)[1] > 0.25 * area[4 * axis]:
            continue
        a, b = 2 * axis, 2 * axis + 1
        chosen = a if out[faces[2 * a]] >= out[faces[2 * b]] else b
        mask[faces] = side[faces] == chosen
    return mask


def _open_shell_faces(soup: Soup, rng: np.random.Generator) -> IntArray:
    """(F,) mask without one side of about half of the boxes: the side that looks inwards most."""
    side, out = _box_sides(soup), _outwards(soup)
    mask = np.ones(len(soup.faces), dtype=bool)
    drawn = rng.random(len(soup.piece_link)) < 0.5
    for piece in np.flatnonzero(soup.piece_is_box & drawn):
        faces = np.flatnonzero(soup.face_piece == piece)
        if len(faces) == 12 and soup.piece_role[piece] in ("panel", "solid", "drawer_box"):
            mask[faces] = side[faces] != side[faces[np.argmin(out[faces])]]
    return mask


def _with_fasteners(soup: Soup, rng: np.random.Generator) -> Soup:
    """Screw heads on the largest outward sides of some panels."""
    side, out = _box_sides(soup), _outwards(soup)
    low, high = soup.vertices.min(axis=0), soup.vertices.max(axis=0)
    radius = 0.004 * float(np.linalg.norm(high - low))
    parts, faces_, pieces = [soup.vertices], [soup.faces], [soup.face_piece]
    uv, total = [soup.uv], len(soup.vertices)
    t = soup.vertices[soup.faces]
    area = np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1)
    big = np.flatnonzero((side >= 0) & (out > 0.25 * (high - low).min()) & (area > 900 * radius**2))
    big = big[big % 2 == 0]
    for face in rng.permutation(big)[: int(rng.integers(2, 9))]:
        a, b, c = t[face]
        normal = np.cross(b - a, c - a)
        for u, v in ((0.08, 0.92), (0.92, 0.92), (0.92, 0.08), (0.08, 0.08)):
            point = a + u * (b - a) + v * (c - b)
            if u < v:  # the quad's other corner, across the diagonal
                point = a + v * (c - b) + u * (b - a)
            frame = shapes.frame(point, normal, b - a)
            screw = shapes.revolve(
                [
                    [0.0, 0.0],
                    [radius, 0.0],
                    [radius, 0.4 * radius],
                    [0.5 * radius, 0.6 * radius],
                    [0.0, 0.6 * radius],
                ],
                6,
            )
            parts.append(screw.vertices @ frame[:3, :3].T + frame[:3, 3])
            faces_.append(screw.faces + total)
            pieces.append(np.full(len(screw.faces), soup.face_piece[face]))
            uv.append(screw.uv)
            total += len(screw.vertices)
    return replace(soup, vertices=np.concatenate(parts), faces=np.concatenate(faces_),
                   face_piece=np.concatenate(pieces), uv=np.concatenate(uv))  # fmt: skip


def _subdivided(soup: Soup, limit: int) -> Soup:
    """Split every triangle into four, twice at most, as long as the count stays below `limit`."""
    for _ in range(2):
        if 4 * len(soup.faces) > limit:
            return soup
        f, n = soup.faces, len(soup.vertices)
        edges = np.sort(f[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        _, first, inverse = np.unique(edges[:, 0] * n + edges[:, 1], return_index=True,
                                      return_inverse=True)  # fmt: skip
        unique = edges[first]
        m = inverse.reshape(-1, 3) + n
        fine = np.stack([f[:, 0], m[:, 0], m[:, 2], m[:, 0], f[:, 1], m[:, 1], m[:, 2], m[:, 1],
                         f[:, 2], m[:, 0], m[:, 1], m[:, 2]], axis=1).reshape(-1, 3)  # fmt: skip
        soup = replace(soup, faces=fine, face_piece=np.repeat(soup.face_piece, 4),
                       vertices=np.concatenate([soup.vertices, soup.vertices[unique].mean(axis=1)]),
                       uv=np.concatenate([soup.uv, soup.uv[unique].mean(axis=1)]))  # fmt: skip
    return soup


def _split_flat(soup: Soup) -> Soup:
    """Cut pieces along their creases: faces of different flat sides share no vertex."""
    t = soup.vertices[soup.faces]
    normal = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    # caps and box sides have axis-aligned normals in their piece; walls of rounds stay together
    key = np.where(
        np.abs(normal).max(axis=1) > 0.999,
        3 * np.argmax(np.abs(normal), axis=1) + np.sign(normal.sum(axis=1)),
        99,
    )
    corner = np.stack([soup.faces.reshape(-1), np.repeat(key, 3).astype(np.int64)], axis=1)
    unique, inverse = np.unique(corner, axis=0, return_inverse=True)
    return replace(soup, vertices=soup.vertices[unique[:, 0]], uv=soup.uv[unique[:, 0]],
                   faces=inverse.reshape(-1, 3))  # fmt: skip


def _welded(soup: Soup) -> Soup:
    """Share vertices that coincide within 1e-7 m, within a link and across its pieces."""
    link = np.zeros(len(soup.vertices), dtype=np.int64)
    link[soup.faces] = soup.face_link[:, None]
    key = np.c_[np.round(soup.vertices * 1e7).astype(np.int64), link]
    _, first, inverse = np.unique(key, axis=0, return_index=True, return_inverse=True)
    faces = inverse.reshape(-1)[soup.faces]
    flat = (
        (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 0] == faces[:, 2])
    )
    return replace(soup, vertices=soup.vertices[first], uv=soup.uv[first], faces=faces[~flat],
                   face_piece=soup.face_piece[~flat])  # fmt: skip
