"""The same four assets as MuJoCo, SAPIEN, PyBullet and we draw them, side by side in one picture.

    python benchmarks/same_pictures.py --out docs/results/same_pictures.png

Each program draws with its own renderer, from the same place and by nearly the same light; the
heaviest part is open by six tenths. SAPIEN needs a Vulkan driver, MuJoCo OpenGL (EGL in software is
enough), and PyBullet may be in the interpreter that scripts/setup.sh makes for it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from ctypes.util import find_library
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from mam_sim_formats.mjcf_export import export_mjcf
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.read import read_asset
from mam_pipeline.asset.writer import write_asset
from mam_pipeline.evidence.read import named_size
from mam_pipeline.geometry.motion import Motion, motion_points
from mam_pipeline.render.mesh_pictures import render_mesh
from mam_pipeline.types import Mesh
from mam_world import make_object

if find_library("EGL"):  # MuJoCo asks at import; without it, it draws on a screen only
    os.environ.setdefault("MUJOCO_GL", "egl")
OBJECTS = (("nightstand", 3), ("fridge", 2), ("oven", 1), ("washer_front", 0))
"""Categories of the procedural world, and seeds."""
OPEN = 0.6
"""Of the way from closed to open."""
SURROUNDINGS = 140
"""How light the surroundings are that metals reflect, 0 to 255."""
SIDE = Path(sys.prefix) / "pybullet" / "bin" / "python"
BULLET = """
import json, sys, numpy as np, pybullet as p
a = json.load(sys.stdin)
p.connect(p.DIRECT)
body = p.loadURDF(a["urdf"], useFixedBase=True, flags=p.URDF_USE_MATERIAL_COLORS_FROM_MTL)
for i in range(p.getNumJoints(body)):
    name = p.getJointInfo(body, i)[1].decode()
    p.resetJointState(body, i, a["values"].get(name, 0.0))
n = a["size"]
w, h, picture, _, seen = p.getCameraImage(
    n, n, p.computeViewMatrix(a["eye"], a["target"], [0, 0, 1]),
    p.computeProjectionMatrixFOV(a["field"], 1.0, 0.01 * a["far"], 10 * a["far"]),
    renderer=p.ER_TINY_RENDERER, shadow=0, lightDirection=a["light"], lightAmbientCoeff=0.35,
    lightDiffuseCoeff=a["strength"], lightSpecularCoeff=0.0)
found = np.reshape(picture, (n, n, 4)).astype(np.uint8)
found[..., 3] = 255 * (np.reshape(seen, (n, n)) >= 0)
np.save(a["out"], found)
"""


@dataclass(frozen=True)
class Shot:
    """What is drawn, and from where.

    Attributes:
        values: joint values by name. target: point looked at. far: of the eye from it, metres.
        size: pixels along a side. azimuth, elevation, field: degrees, as `render_mesh` has them.
    """

    asset: Asset
    values: dict[str, float]
    target: NDArray[np.float64]
    far: float
    size: int
    azimuth: float = -35.0
    elevation: float = 25.0
    field: float = 30.0

    @property
    def away(self) -> NDArray[np.float64]:
        """(3,) unit vector from the object to the eye."""
        a, e = np.radians(self.azimuth), np.radians(self.elevation)
        return np.array([-np.cos(a) * np.cos(e), -np.sin(a) * np.cos(e), np.sin(e)])

    @property
    def key(self) -> NDArray[np.float64]:
        """(3,) unit vector from the object to the light: from the eye, and above it."""
        key = self.away + np.array([0.2, 0.5, 1.1])
        return np.asarray(key / np.linalg.norm(key))


def shot_of(category: str, seed: int, folder: Path, size: int) -> tuple[Shot, Mesh]:
    """An object, its heaviest part half open, and its mesh as it then stands."""
    made = make_object(category, seed)
    asset = write_asset(
        made.articulation, folder / category, name=category, collision=made.collision,
        thing=named_size(category.replace("_", " "))[0],
    )  # fmt: skip
    mass = {p.link: p.mass for p in asset.card.parts}
    limited = [j for j in asset.card.movable if j.lower is not None]
    joint = max(limited, key=lambda j: mass[j.child])
    values = {j.name: j.closed for j in asset.card.movable}
    values[joint.name] = joint.closed + OPEN * (joint.open - joint.closed)
    articulation = read_asset(asset)
    own = next(j for j in articulation.joints if j.name == joint.name)
    carried = articulation.carried_links(own)
    faces = np.concatenate([articulation.links[i].faces for i in carried])
    corners = np.unique(articulation.mesh.faces[faces])
    points = np.array(articulation.mesh.vertices)
    way: Motion = "prismatic" if own.type == "prismatic" else "revolute"
    points[corners] = motion_points(
        way, own.axis, own.origin, np.array([values[joint.name]]), points[corners]
    )[0]
    mesh = replace(articulation.mesh, vertices=points)
    far = 0.54 * mesh.diagonal / np.sin(np.radians(30.0) / 2)
    return Shot(asset, values, mesh.bounds.mean(axis=0), float(far), size), mesh


def ours(shot: Shot, mesh: Mesh) -> Image.Image:
    """Our own renderer's picture."""
    size = (shot.size, shot.size)
    picture = render_mesh(
        mesh, size, shot.azimuth, shot.elevation, distance=shot.far, supersample=2
    )
    return Image.fromarray(np.asarray(picture)[..., :3])


def mujoco(shot: Shot) -> Image.Image:
    """MuJoCo's picture of the MJCF."""
    import mujoco as library

    file = export_mjcf(shot.asset, shot.asset.folder.parent / f"{shot.asset.card.name}_x" / "o.xml")
    model: Any = library.MjModel.from_xml_path(str(file))
    model.vis.global_.fovy = shot.field
    model.light_active[1:], model.light_castshadow[:] = 0, 0
    model.light_type[0], model.light_dir[0] = library.mjtLightType.mjLIGHT_DIRECTIONAL, -shot.key
    model.light_ambient[0], model.light_diffuse[0], model.light_specular[0] = 0.0, 0.45, 0.0
    model.vis.headlight.ambient[:], model.vis.headlight.diffuse[:] = 0.35, 0.2
    model.vis.headlight.specular[:] = 0.0
    data: Any = library.MjData(model)
    camera: Any = library.MjvCamera()
    for name, value in shot.values.items():
        data.joint(name).qpos[0] = value
    library.mj_forward(model, data)
    camera.lookat[:], camera.distance = shot.target, shot.far
    camera.azimuth, camera.elevation = shot.azimuth, -shot.elevation
    with library.Renderer(model, shot.size, shot.size) as renderer:
        renderer.update_scene(data, camera)
        picture = renderer.render().copy()
        renderer.enable_segmentation_rendering()
        renderer.update_scene(data, camera)
        return _on_white(picture, renderer.render()[..., 0] >= 0)


def sapien(shot: Shot) -> Image.Image:
    """SAPIEN's picture of the URDF, by its rasteriser."""
    import sapien as library

    scene = library.Scene()
    loader = scene.create_urdf_loader()
    loader.fix_root_link = True
    robot = loader.load(str(shot.asset.urdf_path))
    names = [j.name for j in robot.active_joints]
    robot.set_qpos(np.array([shot.values[n] for n in names], np.float32))
    # it adds light before the colours are encoded for a screen, so the same light is less here
    scene.set_ambient_light([0.02] * 3)
    scene.set_environment_map_from_files(*[_grey(shot)] * 6)  # without one, metals are dark
    scene.add_directional_light((-shot.key).tolist(), [0.8] * 3, shadow=False)
    scene.add_directional_light((-shot.away).tolist(), [0.2] * 3, shadow=False)
    size, field = shot.size, np.radians(shot.field)
    camera = scene.add_camera("eye", size, size, float(field), 0.01 * shot.far, 10 * shot.far)
    forward = -shot.away
    left = np.cross([0.0, 0.0, 1.0], forward)
    left /= np.linalg.norm(left)
    place = np.eye(4)
    place[:3, 0], place[:3, 1], place[:3, 2] = forward, left, np.cross(forward, left)
    place[:3, 3] = shot.target + shot.far * shot.away
    camera.entity.set_pose(library.Pose(place))
    scene.update_render()
    camera.take_picture()
    picture = np.clip(255 * camera.get_picture("Color")[..., :3], 0, 255).astype(np.uint8)
    return _on_white(picture, camera.get_picture("Segmentation")[..., 1] > 0)


def _grey(shot: Shot) -> str:
    """A side of the surroundings that SAPIEN's metals reflect."""
    file = shot.asset.folder.parent / "surroundings.png"
    Image.new("RGB", (64, 64), (SURROUNDINGS,) * 3).save(file)
    return str(file)


def pybullet(shot: Shot) -> Image.Image:
    """PyBullet's picture of the URDF, by its TinyRenderer."""
    light = 0.45 * shot.key + 0.25 * shot.away  # it has one light: the sum of our two
    strength = float(np.linalg.norm(light))
    out = shot.asset.folder.parent / f"{shot.asset.card.name}.npy"
    told = {
        "urdf": str(shot.asset.urdf_path), "values": shot.values, "size": shot.size,
        "eye": (shot.target + shot.far * shot.away).tolist(), "target": shot.target.tolist(),
        "field": shot.field, "far": shot.far, "light": (light / strength).tolist(),
        "strength": strength, "out": str(out),
    }  # fmt: skip
    python = sys.executable if find_spec("pybullet") else str(SIDE)
    clean = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    subprocess.run(
        [python, "-c", BULLET], input=json.dumps(told), text=True, check=True,
        stdout=subprocess.DEVNULL, env=clean,
    )  # fmt: skip
    found = np.load(out)
    return _on_white(found[..., :3], found[..., 3] > 0)


def _on_white(picture: NDArray[np.uint8], seen: NDArray[np.bool_]) -> Image.Image:
    return Image.fromarray(np.where(seen[..., None], picture, 255).astype(np.uint8))


PROGRAMS: dict[str, Callable[[Shot], Image.Image]] = {
    "MuJoCo": mujoco, "SAPIEN": sapien, "PyBullet": pybullet,
}  # fmt: skip


def main(out: Path, size: int = 240) -> None:
    """Draw a row of pictures per program, a column per object.

    Args:
        out: PNG. size: of one picture, pixels.
    """
    head, side = 28, 90
    names = ["mam-sim", *PROGRAMS]
    sheet = Image.new("RGB", (side + size * len(OBJECTS), head + size * len(names)), "white")
    pen = ImageDraw.Draw(sheet)
    with tempfile.TemporaryDirectory() as folder:
        for column, (category, seed) in enumerate(OBJECTS):
            shot, mesh = shot_of(category, seed, Path(folder), 2 * size)
            left = side + column * size
            pen.text((left + size / 2, head / 2), category.partition("_")[0], "black", anchor="mm",
                     font_size=15)  # fmt: skip
            pictures = [ours(shot, mesh), *(draw(shot) for draw in PROGRAMS.values())]
            for row, picture in enumerate(pictures):
                small = picture.resize((size, size), Image.Resampling.LANCZOS)
                sheet.paste(small, (left, head + row * size))
            print(category, flush=True)
    for row, name in enumerate(names):
        pen.text((8, head + (row + 0.5) * size), name, "black", anchor="lm", font_size=15)
    out.parent.mkdir(parents=True, exist_ok=True)
    sheet.save(out, optimize=True)


if __name__ == "__main__":
    tyro.cli(main)
