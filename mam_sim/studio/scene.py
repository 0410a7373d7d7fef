"""The object in the page's three-dimensional view: links, colours, axes, sizes, selection."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mam_pipeline.formats.gltf_write import glb_bytes
from mam_pipeline.geometry.sampling import face_geometry
from mam_pipeline.render.mesh_pictures import DORMANT, palette
from mam_pipeline.render.motion import value_at
from mam_pipeline.types import (
    Articulation,
    FloatArray,
    IntArray,
    Joint,
    JointCandidate,
    JointType,
    Material,
    Mesh,
    joint_motion,
)
from mam_sim.facts import span
from mam_sim.studio.picking import seen_spots

if TYPE_CHECKING:
    import viser

Show = Literal["as it is", "parts", "pieces", "edges", "collision"]
SHOWS: tuple[Show, ...] = ("as it is", "parts", "pieces", "edges", "collision")
EDGES = (70, 80, 95)
SELECTED, AXIS, CHOSEN, BAD = (255, 140, 0), (60, 110, 200), (230, 70, 50), (214, 52, 44)
CONTACT, OVER = (20, 150, 90), (90, 160, 250)
NUMBERS = 150  # pieces that can be told apart by a number
NAMED = 12  # joints that can all have their names in the view
CELLS = tuple(float(m * 10.0**e) for e in range(-4, 3) for m in (1, 2, 5))  # metres
SIDES, SIDES_TURNED = ("deep", "wide", "high"), ("wide", "deep", "high")
GROUND, SUN = (150, 145, 140), np.array([-2.2, -1.0, 3.0])  # SUN: towards it, front at -X
LABEL = (0.16, 0.16, 0.05)  # room of a label in the view as it opens, diagonals
STEPS = 24  # of the arc that shows a range
FOV = 0.75  # radians from the lower to the upper edge of the view
FIT = 1.6  # height of the view at the object, diagonals


class Scene:
    """Draws one articulation; nodes hang below /object.

    Attributes:
        values: joint name -> value, as shown.
        turn: (3, 3) rotation about Z that brings the object's front to -X.
        on_stroke: told of drags on the object while it can be painted.
    """

    def __init__(self, api: viser.SceneApi) -> None:
        self.api = api
        self.values: dict[str, float] = {}
        self.turn: FloatArray = np.eye(3)
        self.on_stroke: Any = None
        self._links: list[Any] = []
        self._surfaces: list[list[Any]] = []  # nodes of each link's surface
        self._painted = False
        self._previewed: JointCandidate | None = None
        self._drawn: list[Any] = []  # what each link's surface was drawn from
        self._extras: dict[str, list[Any]] = {}
        self._named: set[str] = set()  # parts that an axis names in the view

    def show(
        self,
        articulation: Articulation,
        labels: IntArray,
        show: Show,
        hulls: Mapping[str, Sequence[Mesh]],
    ) -> None:
        """Draw the articulation anew, its joints where they were.

        Args:
            labels: (F,) piece of every face. show: what the surface tells.
            hulls: collision pieces by link name, in the frame of the articulation.
        """
        for group in list(self._extras):
            self._drop(group)
        self.articulation, self.labels = articulation, labels
        self.values = {j.name: self.values.get(j.name, 0.0) for j in articulation.joints}
        for i, link in enumerate(articulation.links):
            pieces = hulls.get(link.name, ())
            drawn = (show, i, id(articulation.mesh), link.faces.tobytes(), tuple(map(id, pieces)))
            if i < len(self._links):
                if self._drawn[i] == drawn:
                    continue  # its surface is on the screen already
                self._links[i].remove()
            node = self.api.add_frame(f"/object/{i}", show_axes=False)
            self._links[i : i + 1], self._drawn[i : i + 1] = [node], [drawn]
            self._surfaces[i : i + 1] = [[]]
            if show == "edges" and len(link.faces):
                part = articulation.mesh.submesh(link.faces)
                self.api.add_mesh_simple(
                    f"/object/{i}/edges", part.vertices, part.faces, color=EDGES, wireframe=True,
                )  # fmt: skip
                continue
            for k, mesh in enumerate(self._meshes(i, show, pieces)):
                surface = self.api.add_glb(f"/object/{i}/surface{k}", glb_bytes(mesh, up="z"))
                self._surfaces[i].append(surface)
                if self._painted:
                    surface.on_drag("left")(self.on_stroke)
        self._cut_off(len(articulation.links))
        if show == "pieces":
            self._numbers()
        self.pose(self.values)

    def paint(self, on: bool) -> None:
        """Whether a drag that begins on the object is a stroke; else it turns the view."""
        if on == self._painted:
            return
        self._painted = on
        for surface in (s for link in self._surfaces for s in link):
            if on:
                surface.on_drag("left")(self.on_stroke)
            else:
                surface.remove_drag_callback()

    def clear(self) -> None:
        """Take everything away."""
        self._cut_off(0)
        self._extras = {}

    def _cut_off(self, first: int) -> None:
        """Take links away from one on."""
        for node in self._links[first:]:
            node.remove()
        del self._links[first:], self._drawn[first:], self._surfaces[first:]

    def _meshes(self, link: int, show: Show, hulls: Sequence[Mesh]) -> list[Mesh]:
        faces = self.articulation.links[link].faces
        mesh = self.articulation.mesh
        if show == "collision":
            tint = palette(np.arange(len(hulls) + 1) + 7 * link + 1)
            return [painted(hull, tint[k]) for k, hull in enumerate(hulls)]
        if not len(faces):
            return []
        if show == "as it is":
            return [mesh.submesh(faces)]
        owner = self.articulation.face_link if show == "parts" else self.labels + 1
        colors = palette(owner)
        for part in self.articulation.dormant if show == "parts" else ():
            colors[part.link.faces] = DORMANT
        return [painted(mesh.submesh(faces), colors[faces])]

    def pose(self, values: Mapping[str, float]) -> None:
        """Move the joints: name -> value."""
        self.values.update(values)
        for node, pose in zip(self._links, self.articulation.link_poses(self.values)):
            node.wxyz = _wxyz(pose[:3, :3])
            node.position = pose[:3, 3]

    def preview(self, links: Iterable[int], way: JointCandidate | None, value: float) -> None:
        """Move links from rest along a way that is not their joint's, and draw its line.

        Args:
            links: what moves. way: None puts all where the joints are. value: radians or metres.
        """
        if way is None:
            self._drop("preview")
            self.pose({})
            return
        if self._previewed is not way or "preview" not in self._extras:
            self._drop("preview")
            self._previewed, size = way, self.articulation.mesh.diagonal
            ends = way.origin + np.outer([-0.3, 0.3], way.axis) * size
            self._keep("preview", self.api.add_arrows(
                "/preview", ends[None], CHOSEN, shaft_radius=0.004 * size,
                head_radius=0.011 * size, head_length=0.03 * size,
            ))  # fmt: skip
        kind: JointType = "prismatic" if way.subtype == "slide" else "revolute"
        motion = joint_motion(kind, way.axis, way.origin, value)
        for link in links:
            self._links[link].wxyz = _wxyz(motion[:3, :3])
            self._links[link].position = motion[:3, 3]

    def contacts(self, points: FloatArray) -> None:
        """Dots where a part touches what stands still: (n, 3), at rest."""
        self._drop("contacts")
        if len(points):
            self._keep("contacts", self.api.add_point_cloud(
                "/contacts", points.astype(np.float32), CONTACT, point_shape="circle",
                point_size=0.006 * self.articulation.mesh.diagonal,
            ))  # fmt: skip

    def axes(self, on: bool, chosen: str, called: Callable[[str], str]) -> None:
        """An arrow along every joint's axis, with its range and the part's name.

        Args:
            chosen: name of the part whose axis is red; its range is written down. called: what
                people call a part; where there are many, only the chosen one is named.
        """
        self._drop("axes")
        self._named = set()
        if not on:
            return
        size = self.articulation.mesh.diagonal
        named: list[FloatArray] = []
        for joint in self.articulation.joints:
            if joint.type == "fixed":
                continue
            name = self.articulation.links[joint.child].name
            color = CHOSEN if name == chosen else AXIS
            where = f"/object/{joint.parent}/axis_{joint.child}"
            start, end = _axis_ends(self.articulation, joint)
            self._keep("axes", self.api.add_arrows(
                where, np.array([[start, end]]), color, shaft_radius=0.004 * size,
                head_radius=0.011 * size, head_length=0.03 * size,
            ))  # fmt: skip
            arc = range_line(self.articulation, joint)
            self._keep("axes", self.api.add_line_segments(
                f"{where}_range", np.stack([arc[:-1], arc[1:]], axis=1), color,
                thickness=0.006 * size,
            ))  # fmt: skip
            if name == chosen or len(self.articulation.joints) <= NAMED:
                self._named.add(called(name))
                told = f"{called(name)}: {span(joint)}" if name == chosen else called(name)
                named.append(_free_spot(arc[len(arc) // 2], named, size))
                self._keep("axes", self.api.add_label(
                    f"{where}_name", told, position=named[-1], anchor="bottom-center",
                ))  # fmt: skip

    def select(self, chosen: NDArray[np.bool_]) -> None:
        """Lay colour over some faces (F,)."""
        self._lay("selected", chosen, SELECTED, 0.7)

    def point_out(self, faces: IntArray, called: str) -> None:
        """Lay a pale colour over a part's faces, and name it where the view does not already."""
        mesh, owner = self.articulation.mesh, self.articulation.face_link
        self._lay("over", np.isin(np.arange(len(mesh.faces)), faces), OVER, 0.35)
        if len(faces) and called not in self._named:
            points = mesh.vertices[np.unique(mesh.faces[faces])]
            low, high = points.min(axis=0), points.max(axis=0)
            self._keep("over", self.api.add_label(
                f"/object/{owner[faces[0]]}/over_name", called, anchor="bottom-center",
                position=(*(low[:2] + high[:2]) / 2, high[2]),
            ))  # fmt: skip

    def _lay(
        self, group: str, chosen: NDArray[np.bool_], color: tuple[int, int, int], opacity: float
    ) -> None:  # fmt: skip
        self._drop(group)
        mesh = self.articulation.mesh
        normal = face_geometry(mesh.vertices, mesh.faces)[0]
        for i, link in enumerate(self.articulation.links):
            faces = link.faces[chosen[link.faces]]
            if not len(faces):
                continue
            lift = 0.0012 * mesh.diagonal * normal[faces]
            corners = mesh.vertices[mesh.faces[faces]]
            both = np.concatenate([corners + lift[:, None], corners - lift[:, None]])
            self._keep(group, self.api.add_mesh_simple(
                f"/object/{i}/{group}", both.reshape(-1, 3),
                np.arange(3 * len(both)).reshape(-1, 3), color=color, opacity=opacity,
                side="double", cast_shadow=False, flat_shading=True,
            ))  # fmt: skip

    def redden(self, links: Iterable[int]) -> None:
        """Lay red over what runs into something."""
        self.select(np.isin(self.articulation.face_link, list(links)))
        for node in self._extras.get("selected", []):
            node.color = BAD

    def sizes(self, on: bool) -> None:
        """Width, depth and height along the box of the object at rest."""
        self._drop("sizes")
        if not on:
            return
        low, high = self.articulation.mesh.bounds
        gap = 0.04 * self.articulation.mesh.diagonal
        corner = np.array([low[0] - gap, low[1] - gap, low[2]])
        words = SIDES if abs(self.turn[0, 0]) > abs(self.turn[0, 1]) else SIDES_TURNED
        for k, word in enumerate(words):
            end = corner.copy()
            end[k] = high[k]
            start = corner.copy()
            start[k] = low[k]
            self._keep("sizes", self.api.add_line_segments(
                f"/sizes/{k}", np.array([[start, end]]), (70, 70, 70),
                thickness=0.003 * self.articulation.mesh.diagonal,
            ))  # fmt: skip
            self._keep("sizes", self.api.add_label(
                f"/sizes/{k}_text", f"{high[k] - low[k]:.2f} m {word}", position=(start + end) / 2,
                anchor="center-center",
            ))  # fmt: skip

    def floor(self) -> float:
        """A grid under the object, in squares of a decimal length, which is returned (metres)."""
        low, high = self.articulation.mesh.bounds
        size = float(np.ptp(np.stack([low, high]), axis=0).max())
        cell = max((c for c in CELLS if c <= size / 4), default=CELLS[0])
        wide = np.ceil(4 * size / cell) * cell
        self.api.add_grid(
            "/floor", float(wide), float(wide), cell_size=cell, section_size=5 * cell,
            cell_color=(222, 222, 222), section_color=(196, 196, 196), shadow_opacity=0.25,
            position=(float((low[0] + high[0]) / 2), float((low[1] + high[1]) / 2), float(low[2])),
        )  # fmt: skip
        return cell

    def light(self) -> None:
        """A sky, and a sun that shines on the front from the upper left."""
        self.api.add_light_hemisphere(
            "/light/sky", ground_color=GROUND, intensity=1.8, wxyz=(0.5**0.5, 0.5**0.5, 0.0, 0.0)
        )  # fmt: skip
        self.api.add_light_directional(
            "/light/sun", intensity=1.7, position=tuple(self.turn.T @ SUN)
        )  # fmt: skip

    def view(
        self, camera: Any, azimuth: float = -35.0, elevation: float = 20.0,
        bounds: FloatArray | None = None,
    ) -> None:  # fmt: skip
        """Put a camera before the front.

        Args:
            azimuth, elevation: degrees. bounds: (2, 3) of what is to be seen; default: the object.
        """
        low, high = self.articulation.mesh.bounds if bounds is None else bounds
        a, e = np.radians(azimuth), np.radians(elevation)
        eye = np.array([-np.cos(a) * np.cos(e), -np.sin(a) * np.cos(e), np.sin(e)])
        eye = self.turn.T @ eye
        middle = (low + high) / 2
        away = FIT / (2 * np.tan(FOV / 2)) * float(np.linalg.norm(high - low))
        camera.fov = FOV
        camera.position = middle + away * eye
        camera.look_at = middle

    def _numbers(self) -> None:
        mesh = self.articulation.mesh
        spots = seen_spots(mesh, self.labels)
        size = np.bincount(self.labels, face_geometry(mesh.vertices, mesh.faces)[1])
        owner = self.articulation.face_link
        for p in [int(p) for p in np.argsort(-size) if int(p) in spots][:NUMBERS]:
            link = int(owner[np.argmax(self.labels == p)])
            self._keep("numbers", self.api.add_label(
                f"/object/{link}/number_{p}", str(p), position=spots[p], anchor="center-center",
                font_screen_scale=0.8, depth_test=True,
            ))  # fmt: skip

    def _keep(self, group: str, node: Any) -> None:
        self._extras.setdefault(group, []).append(node)

    def _drop(self, group: str) -> None:
        for node in self._extras.pop(group, []):
            node.remove()


def _free_spot(spot: FloatArray, taken: Sequence[FloatArray], size: float) -> FloatArray:
    """(3,) a place for a label at or above another, where none of those that are taken is near.

    Args:
        size: diagonal of the object, metres.
    """
    room = np.multiply(LABEL, size)
    up = np.array([0.0, 0.0, room[2]])
    while any(bool(np.all(np.abs(spot - other) < room)) for other in taken):
        spot = spot + up
    return spot


def painted(mesh: Mesh, colors: NDArray[np.uint8]) -> Mesh:
    """A mesh in plain colours: one (3,), or one for each face (F, 3)."""
    rgba = np.full((len(mesh.faces), 4), 255, dtype=np.uint8)
    rgba[:, :3] = colors
    return Mesh(
        mesh.vertices[mesh.faces.reshape(-1)],
        np.arange(3 * len(mesh.faces)).reshape(-1, 3),
        (Material("painted", (1.0, 1.0, 1.0, 1.0)),),
        colors=np.repeat(rgba, 3, axis=0),
    )


def range_line(articulation: Articulation, joint: Joint) -> FloatArray:
    """(n, 3) the way of the part's farthest point (a slide: of its middle) over the range."""
    points = _points(articulation, joint.child)
    if joint.type == "prismatic":
        start = points.mean(axis=0)
        values: Any = [joint.lower, joint.upper]
    else:
        away = np.linalg.norm(np.cross(points - joint.origin, joint.axis), axis=1)
        start = points[np.argmax(away)]
        bounded = np.isfinite([joint.lower, joint.upper]).all()
        low, high = (joint.lower, joint.upper) if bounded else (0.0, 2 * np.pi)
        values = np.linspace(low, high, STEPS)
    moves = [joint_motion(joint.type, joint.axis, joint.origin, v) for v in values]
    return np.stack([m[:3, :3] @ start + m[:3, 3] for m in moves])


def all_at(articulation: Articulation, share: float) -> dict[str, float]:
    """Values of all joints a share of the way from closed to open."""
    return {j.name: value_at(j, share) for j in articulation.joints}


def merged_bounds(articulation: Articulation, link: int) -> FloatArray:
    """(2, 3) corners of the box of a link at rest."""
    points = _points(articulation, link)
    return np.stack([points.min(axis=0), points.max(axis=0)])


def _points(articulation: Articulation, link: int) -> FloatArray:
    mesh = articulation.mesh
    return mesh.vertices[np.unique(mesh.faces[articulation.links[link].faces])]


def _axis_ends(articulation: Articulation, joint: Joint) -> tuple[FloatArray, FloatArray]:
    """Ends of an arrow along the axis that reaches a little beyond the part."""
    points = _points(articulation, joint.child)
    along = (points - joint.origin) @ joint.axis
    margin = 0.06 * articulation.mesh.diagonal
    if joint.type == "prismatic":  # from the part outwards
        start = points.mean(axis=0)
        return start, start + joint.axis * (0.5 * np.ptp(along) + 2 * margin)
    return (
        joint.origin + joint.axis * (along.min() - margin),
        joint.origin + joint.axis * (along.max() + margin),
    )


def _wxyz(turn: FloatArray) -> FloatArray:
    return np.asarray(np.roll(Rotation.from_matrix(turn).as_quat(), 1))
