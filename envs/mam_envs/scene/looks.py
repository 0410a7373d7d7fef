"""What cameras see differently in every episode: lights, colours, backgrounds, cameras and their
pictures.

Nothing is rebuilt for it, so it costs about as much as putting the object elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import sapien
import torch
from scipy.spatial.transform import Rotation

from mam_envs.config import RandomisationConfig
from mam_envs.scene.background import Picture, random_pattern
from mam_pipeline.types import FloatArray

SCENERY = ("table", "wall", "side_wall", "ground", "robot_stand", "object_stand")
"""What the names of the bodies round the object begin with."""


class Looks:
    """The visible properties of one built scene, each as a change of what was built."""

    def __init__(self, scene: Any, objects: Iterable[Any], config: RandomisationConfig) -> None:
        """`scene`: ManiSkill's, with its cameras; `objects`: the articulations to be tinted."""
        self._scene, self._config = scene, config
        self._object = [m for o in objects for link in o.links for m in _link_materials(link)]
        self._world: list[tuple[Any, FloatArray]] = []
        self._lamps: list[tuple[Any, FloatArray, FloatArray]] = []
        self._ambient = np.array(scene.sub_scenes[0].ambient_light, dtype=float)
        for sub in scene.sub_scenes:
            for entity in sub.entities:
                if entity.name.partition("_")[2].startswith(SCENERY) or entity.name in SCENERY:
                    self._world += _materials(entity)
                lamp = entity.find_component_by_type(sapien.render.RenderDirectionalLightComponent)
                if lamp is not None:
                    along = lamp.pose.to_transformation_matrix()[:3, 0].astype(float)
                    self._lamps.append((lamp, np.array(lamp.color, dtype=float), along))
        self._cameras = [
            (sensor.camera, raw, raw.local_pose, float(raw.fovy))
            for sensor in scene.sensors.values()
            for raw in sensor.camera._render_cameras
        ]
        self._blur = self._noise = 0.0
        self.background: Picture | None = None
        self._rng = np.random.default_rng(0)

    def draw(self, rng: np.random.RandomState) -> None:
        """Change everything anew; always the same numbers in the same order."""
        c = self._config
        factor = float(rng.uniform(*c.light))
        hue, turn = rng.uniform(-1, 1, 3), rng.normal(0, 1, (len(self._lamps), 3))
        self._light(factor * (1 + c.light_colour * hue), np.deg2rad(c.light_turn) * turn)
        _tint(self._object, rng.uniform(0, 1, 3), c.colour * float(rng.uniform()))
        for material in self._world:
            _tint([material], rng.uniform(0, 1, 3), c.scenery * float(rng.uniform()))
        for camera, raw, pose, fovy in self._cameras:
            shift, wider = rng.normal(0, 1, 6), np.deg2rad(c.fov) * float(rng.uniform(-1, 1))
            _place(camera, raw, pose * _shift(shift, c.camera, c.camera_turn), fovy + wider)
        self._noise, self._blur = c.noise * float(rng.uniform()), c.blur * float(rng.uniform())
        self._rng = np.random.default_rng(rng.randint(2**31))
        varied = c.backgrounds > 0 and self._rng.uniform() < c.backgrounds
        self.background = random_pattern(self._rng) if varied else None

    def _light(self, factor: FloatArray, turns: FloatArray) -> None:
        for sub in self._scene.sub_scenes:
            sub.ambient_light = (self._ambient * factor).tolist()
        for (lamp, colour, along), turn in zip(self._lamps, turns):
            lamp.color = (colour * factor).tolist()
            away = along + np.cross(turn, along)
            away = (away / np.linalg.norm(away)).tolist()
            lamp.pose = sapien.Pose(lamp.pose.p, sapien.math.shortest_rotation([1, 0, 0], away))

    def spoil(self, data: Mapping[str, Any]) -> None:
        """Blur the pictures `rgb` (b, H, W, 3) uint8 of cameras, and add noise, in place."""
        if not self._noise and not self._blur:
            return
        import cv2

        for seen in data.values():
            if "rgb" not in seen:
                continue
            pictures = seen["rgb"].cpu().numpy().astype(np.float32)
            if self._blur:
                sigma = self._blur
                pictures = np.stack([cv2.GaussianBlur(p, (0, 0), sigma) for p in pictures])
            pictures += self._rng.normal(0, self._noise, pictures.shape).astype(np.float32)
            spoilt = torch.from_numpy(np.clip(np.round(pictures), 0, 255).astype(np.uint8))
            seen["rgb"] = spoilt.to(seen["rgb"].device)


def _link_materials(link: Any) -> Iterator[tuple[Any, FloatArray]]:
    for raw in link._objs:
        yield from _materials(raw.entity)


def _materials(entity: Any) -> list[tuple[Any, FloatArray]]:
    """Materials of a body with their colours (4,)."""
    body = entity.find_component_by_type(sapien.render.RenderBodyComponent)
    parts = [] if body is None else [p for s in body.render_shapes for p in s.parts]
    return [(p.material, np.array(p.material.base_color, dtype=float)) for p in parts]


def _tint(materials: Iterable[tuple[Any, FloatArray]], colour: FloatArray, share: float) -> None:
    """Mix materials with `colour` (3,)."""
    for material, base in materials:
        mixed = (1 - share) * base[:3] + share * colour
        material.set_base_color([*mixed.tolist(), float(base[3])])


def _place(camera: Any, raw: Any, pose: sapien.Pose, fovy: float) -> None:
    """Put one of a camera's renderers elsewhere; ManiSkill remembers the matrices otherwise."""
    raw.set_local_pose(pose)
    raw.set_fovy(fovy, compute_x=True)
    camera._cached_local_pose = camera._cached_model_matrix = None
    camera._cached_extrinsic_matrix = camera._cached_intrinsic_matrix = None


def _shift(by: FloatArray, metres: float, degrees: float) -> sapien.Pose:
    """A small motion, from normal numbers `by` (6,)."""
    turn = Rotation.from_rotvec(np.deg2rad(degrees) * by[3:]).as_quat(scalar_first=True)
    return sapien.Pose((metres * by[:3]).tolist(), turn.tolist())
