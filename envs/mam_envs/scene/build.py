"""The world round the object: floor or table, stands, walls, lights, cameras, the object."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import sapien
from mani_skill.sensors.camera import CameraConfig
from mani_skill.utils import sapien_utils
from mani_skill.utils.building.ground import build_ground
from mani_skill.utils.building.urdf_loader import URDFLoader
from mani_skill.utils.structs import Articulation
from sapien.wrapper.articulation_builder import MimicJointRecord

from mam_envs.config import CameraSpec, SceneConfig
from mam_envs.object_model import ObjectModel
from mam_envs.scene.layout import Layout
from mam_pipeline.asset.card import AssetCard
from mam_pipeline.errors import InputError
from mam_pipeline.formats.urdf.admit import through_door
from mam_pipeline.types import FloatArray

if TYPE_CHECKING:
    from mani_skill.envs.scene import ManiSkillScene

OBJECT_BIT = 28
"""Bodies that share this bit do not collide: the object's own links (whose fit is checked offline
by `mam-sim check`; convex pieces that graze each other would jam it) and what it stands on (a door
that ends at the floor would rub there)."""
GROUND_BIT = 27
"""Links of a robot that drives share this bit with the ground: planar joints carry it, and wheels
that dip into the ground would press on it with a force without bounds."""
WOOD, GREY, WHITE = (0.58, 0.44, 0.31, 1.0), (0.35, 0.36, 0.38, 1.0), (0.86, 0.86, 0.84, 1.0)


class ObjectLoader(URDFLoader):
    """ManiSkill's URDF loader that gives bodies the contact materials of their asset, and leaves
    visuals out where nothing is rendered."""

    visual_free = False

    def __init__(self, card: AssetCard) -> None:
        super().__init__()
        self._contacts = {part.link: (part.friction, part.restitution) for part in card.parts}
        self._made: dict[tuple[float, float], sapien.physx.PhysxMaterial] = {}

    def _get_material(self, link_name: str, index: int) -> sapien.physx.PhysxMaterial | None:
        """One material for all that feels alike, since PhysX has room for 65536; None is
        ManiSkill's own."""
        contact = self._contacts.get(link_name)
        if contact is not None and contact not in self._made:
            friction, restitution = contact
            made = sapien.physx.PhysxMaterial(friction, friction, restitution)
            self._made[contact] = made
        return None if contact is None else self._made[contact]

    def _build_link(self, link: Any, builder: Any) -> Any:
        if self.visual_free:
            link.visuals = []
        through_door(link, Path(self.urdf_dir))
        return super()._build_link(link, builder)


def build_object(scene: ManiSkillScene, layout: Layout, index: int, name: str) -> Articulation:
    """Load one asset into sub-scene `index`, its base fixed to the world."""
    loader = ObjectLoader(layout.model.asset.card)
    loader.set_scene(scene)
    loader.name = name
    loader.fix_root_link = True
    loader.scale = layout.model.scale
    loader.visual_free = not scene.can_render()
    builder = loader.parse(str(layout.model.asset.urdf_path))["articulation_builders"][0]
    builder.set_scene_idxs([index])
    builder.initial_pose = sapien.Pose(layout.world_asset)
    builder.mimic_joint_records = _couplings(layout.model)
    built = builder.build(name=name)
    for link in built.links:
        link.set_collision_group_bit(group=2, bit_idx=OBJECT_BIT, bit=1)
    return built


def _couplings(model: ObjectModel) -> list[MimicJointRecord]:
    """Coupled joints as SAPIEN's builder takes them, at the object's scale.

    The builder ties two joints with a tendon: `joint` = multiplier * `mimic` + offset if `joint`
    hangs on the link that `mimic` moves; if both hang on one link, the names change places.

    Raises:
        InputError: the two joints are farther apart in the tree, where it ties nothing.
    """
    joints = {j.name: j for j in model.kinematics.joints}
    out = []
    for name, coupling in model.couplings.items():
        own, leader = joints[name], joints[coupling.joint]
        if own.parent == leader.child:
            follows = (name, leader.name, coupling.multiplier, coupling.offset)
        elif own.parent == leader.parent:
            follows = (leader.name, name, coupling.multiplier, coupling.offset)
        elif leader.parent == own.child and coupling.multiplier:
            factor = 1.0 / coupling.multiplier
            follows = (leader.name, name, factor, -factor * coupling.offset)
        else:
            raise InputError(
                f"{model.asset.card.name}: joint {name!r} follows {leader.name!r}, and SAPIEN can "
                "couple only joints of one link or of neighbours; take <mimic> out of the URDF and "
                "coupling out of asset.json to let it move on its own"
            )
        out.append(MimicJointRecord(*follows))
    return out


def surface_of(config: SceneConfig, layout: Layout) -> str:
    """Resolve "auto": small objects stand on a table, large ones on the floor."""
    if layout.robot.floor_only:
        return "floor"
    if config.surface != "auto":
        return config.surface
    low, high = layout.model.bounds()
    return "table" if high[2] - low[2] < 0.6 and layout.placement.base_height < 0.3 else "floor"


def build_world(scene: ManiSkillScene, config: SceneConfig, layouts: list[Layout]) -> None:
    """Ground (z = 0 carries robot and object), stands, wall. `layouts`: one per sub-scene."""
    table = surface_of(config, layouts[0]) == "table"
    if table:
        build_ground(scene, altitude=-config.table_height, floor_width=40)
        _box(scene, "table", (-0.3, 0.0, -0.02), (2.4, 2.4, 0.04), WOOD, None)
    else:
        ground = build_ground(scene, floor_width=40)
        for bit in (OBJECT_BIT, GROUND_BIT):
            ground.set_collision_group_bit(group=2, bit_idx=bit, bit=1)
    for i, layout in enumerate(layouts):
        _stands(scene, layout, i)
        if config.wall and scene.can_render():
            _walls(scene, layout, -config.table_height if table else 0.0, i)


def _walls(scene: ManiSkillScene, layout: Layout, floor: float, i: int) -> None:
    """Two walls of a room: behind the object, and on the side that the camera looks at."""
    low, high = layout.model.bounds()
    depth = float(0.5 * (high[0] - low[0])) + 0.9
    _, _, side = layout.view()
    wide = float(high[1] - low[1]) + 2.2
    tall, middle = 4.0, floor + 2.0
    _box(scene, f"wall_{i}", (depth, 0, middle), (0.05, 14.0, tall), WHITE, i, solid=False)
    across = (depth - 7.0, -side * wide, middle)
    _box(scene, f"side_wall_{i}", across, (14.0, 0.05, tall), WHITE, i, solid=False)


def _stands(scene: ManiSkillScene, layout: Layout, i: int) -> None:
    """What robot and object stand on; the robot's own stand takes no part in contacts."""
    height = layout.placement.base_height
    if height > 0:
        at = layout.placement.base[:3, 3]
        w = 2.0 * layout.robot.base_radius
        middle = (float(at[0]), float(at[1]), 0.5 * height)
        _box(scene, f"robot_stand_{i}", middle, (w, w, height), GREY, i, solid=False)
    block = layout.block()
    if block is not None:
        _box(scene, f"object_stand_{i}", 0.5 * (block[0] + block[1]), block[1] - block[0], GREY, i)


def _box(
    scene: ManiSkillScene,
    name: str,
    middle: Sequence[float] | FloatArray,
    size: Sequence[float] | FloatArray,
    colour: tuple[float, float, float, float],
    index: int | None,
    solid: bool = True,
) -> None:
    builder = scene.create_actor_builder()
    half = [0.5 * float(s) for s in size]
    if solid:
        builder.add_box_collision(half_size=half)
    elif not scene.can_render():
        return
    if scene.can_render():
        material = sapien.render.RenderMaterial(base_color=colour, roughness=0.7, specular=0.2)
        builder.add_box_visual(half_size=half, material=material)
    builder.initial_pose = sapien.Pose(p=[float(v) for v in middle])
    if index is not None:
        builder.set_scene_idxs([index])
    built = builder.build_static(name=name)
    if solid:
        built.set_collision_group_bit(group=2, bit_idx=OBJECT_BIT, bit=1)


def camera(uid: str, spec: CameraSpec, layout: Layout) -> CameraConfig:
    """ManiSkill's configuration of one camera."""
    eye, target = np.array(spec.eye, dtype=float), np.array(spec.target, dtype=float)
    if spec.relative:
        middle, size, side = layout.view()
        mirror = np.array([1.0, side, 1.0])
        eye, target = middle + size * mirror * eye, middle + size * mirror * target
    return CameraConfig(
        uid,
        pose=sapien_utils.look_at(eye=eye.tolist(), target=target.tolist()),
        width=spec.width,
        height=spec.height,
        fov=float(np.deg2rad(spec.fov)),
        near=0.01,
        far=60,
    )


def build_lights(scene: ManiSkillScene, shadow: bool) -> None:
    """A lamp from the front, a fill light, ambient light."""
    scene.set_ambient_light([0.35] * 3)
    scene.add_directional_light(
        [1.0, 0.6, -1.2], [1.1] * 3, shadow=shadow, shadow_scale=5, shadow_map_size=2048
    )
    scene.add_directional_light([0.2, -1.0, -0.6], [0.5] * 3)
