"""Videos and pictures of an episode: SAPIEN's camera, or Open3D's ray casting without a driver."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yourdfpy
from mani_skill.utils import common
from numpy.typing import NDArray
from PIL import Image

from mam_envs.scene.layout import Layout
from mam_envs.scene.loose import COLOUR
from mam_pipeline import folders
from mam_pipeline.claims import FILM_MARK, png_mark
from mam_pipeline.formats.door import outside_allowed
from mam_pipeline.formats.door_resolver import DoorResolver
from mam_pipeline.formats.urdf.geometry import resolve, shape_triangles
from mam_pipeline.render.scene_pictures import render_scene
from mam_pipeline.types import FloatArray

Frame = NDArray[np.uint8]
ROBOT = (0.93, 0.93, 0.94)


def write_video(frames: Sequence[Frame], path: Path, fps: int = 20) -> Path:
    """Write (H, W, 3) uint8 frames as an H.264 mp4 that browsers play; sides are made even."""
    import imageio.v2 as imageio

    path.parent.mkdir(parents=True, exist_ok=True)
    with folders.new_file(path) as part:
        writer: Any = imageio.get_writer(
            part, fps=fps, codec="libx264", quality=8, macro_block_size=1,
            output_params=[*FILM_MARK],
        )  # fmt: skip
        with writer as out:
            for frame in frames:
                h, w = frame.shape[0] // 2 * 2, frame.shape[1] // 2 * 2
                out.append_data(np.ascontiguousarray(frame[:h, :w]))
    return path


def write_strip(frames: Sequence[Frame], path: Path, count: int = 4) -> Path:
    """Write evenly chosen frames side by side as one PNG."""
    chosen = [frames[i] for i in np.linspace(0, len(frames) - 1, count).round().astype(int)]
    path.parent.mkdir(parents=True, exist_ok=True)
    with folders.new_file(path) as part:
        picture = Image.fromarray(np.concatenate(chosen, axis=1))
        picture.save(part, format="PNG", pnginfo=png_mark())
    return path


class Camera:
    """Takes pictures of one environment, with its own renderer if it has one."""

    def __init__(self, env: Any, size: tuple[int, int] = (480, 360)) -> None:
        """`size`: width, height of ray-cast pictures; rendered ones follow the scene's config."""
        self.env = env.unwrapped
        self.size = size
        self.rendered = self.env.render_mode == "rgb_array"

    def shoot(self) -> Frame:
        """(H, W, 3) uint8 picture of sub-scene 0 now."""
        if self.rendered:
            return np.asarray(common.to_numpy(self.env.render()))[0].astype(np.uint8)
        return self._ray_cast()

    @cached_property
    def meshes(self) -> list[tuple[str, str, FloatArray, FloatArray, FloatArray]]:
        """(owner, link, vertices, faces, face colours) of robot, object and loose thing."""
        layout = self.env.layout(0)
        with outside_allowed():  # installed with the robot's code
            robot = layout.robot.path.parent
            rows = _visuals("robot", layout.robot.model.robot, robot, 1.0, ROBOT)
        folder = layout.model.asset.urdf_path.parent
        rows += _visuals("object", layout.model.kinematics.robot, folder, layout.model.scale, None)
        if self.env.loose is not None:
            cube = trimesh.creation.box([self.env.loose.thing.size] * 3)
            tints = np.tile(COLOUR[:3], (len(cube.faces), 1))
            rows.append(("thing", "thing", np.asarray(cube.vertices), cube.faces, tints))
        return rows

    def _ray_cast(self) -> Frame:
        poses = {("robot", link.name): link for link in self.env.agent.robot.links}
        poses.update({("object", link.name): link for link in self.env.objects[0].links})
        if self.env.loose is not None:
            poses["thing", "thing"] = self.env.loose.actor
        points, faces, colours, count = [], [], [], 0
        for owner, name, vertices, triangles, tints in self.meshes:
            if (owner, name) not in poses:
                continue
            m = common.to_numpy(poses[owner, name].pose.to_transformation_matrix())[0]
            points.append(vertices @ m[:3, :3].T + m[:3, 3])
            faces.append(triangles + count)
            colours.append(tints)
            count += len(vertices)
        ground, ground_faces = _floor()
        points.append(ground)
        faces.append(ground_faces + count)
        colours.append(np.tile([0.72, 0.66, 0.58], (len(ground_faces), 1)))
        return render_scene(
            np.concatenate(points), np.concatenate(faces), np.concatenate(colours),
            *default_view(self.env.layout(0)), self.size,
        )  # fmt: skip


def default_view(layout: Layout) -> tuple[FloatArray, FloatArray]:
    """Eye and target (3,) of the default camera."""
    middle, size, side = layout.view()
    return middle + size * np.array([-0.95, 1.0 * side, 0.7]), middle


def _floor(half: float = 1.6) -> tuple[FloatArray, FloatArray]:
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=float) * half
    return corners - [0, 0, 0.002], np.array([[0, 1, 2], [0, 2, 3]])


def _visuals(
    owner: str,
    robot: yourdfpy.Robot,
    folder: Path,
    scale: float,
    colour: tuple[float, float, float] | None,
) -> list[tuple[str, str, FloatArray, FloatArray, FloatArray]]:
    """The visual meshes of one URDF in link frames, with one colour per face."""
    out = []
    for link in robot.links:
        for visual in link.visuals:
            mesh = _load(visual.geometry, folder)
            if mesh is None or not len(mesh.faces):
                continue
            origin = np.eye(4) if visual.origin is None else np.asarray(visual.origin)
            vertices = (np.asarray(mesh.vertices) @ origin[:3, :3].T + origin[:3, 3]) * scale
            tints = _tints(mesh) if colour is None else np.tile(colour, (len(mesh.faces), 1))
            out.append((owner, link.name, vertices, np.asarray(mesh.faces), tints))
    return out


def _load(geometry: yourdfpy.Geometry, folder: Path) -> Any:
    if geometry.mesh is not None:
        file = resolve(geometry.mesh.filename, folder)
        if file is None:
            return None
        mesh = trimesh.load(file, force="mesh", resolver=DoorResolver(file, folder))
        if geometry.mesh.scale is not None:
            mesh.apply_scale(geometry.mesh.scale)
        return mesh
    surface = shape_triangles(geometry, folder)
    return None if surface is None else trimesh.Trimesh(*surface, process=False)


def _tints(mesh: trimesh.Trimesh) -> FloatArray:
    """(F, 3) colours 0..1 from a mesh's materials; grey where it has none."""
    if mesh.visual is None or not mesh.visual.defined:
        return np.full((len(mesh.faces), 3), 0.75)
    try:
        visual = mesh.visual.to_color() if hasattr(mesh.visual, "to_color") else mesh.visual
        colours = np.asarray(visual.face_colors)[:, :3] / 255.0
    except (AttributeError, ValueError, IndexError, TypeError):
        colours = np.full((len(mesh.faces), 3), 0.7)
    return colours if len(colours) == len(mesh.faces) else np.full((len(mesh.faces), 3), 0.7)
