"""A loose cube in the scene: built, put where physics leaves it still, and looked at."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import sapien
import torch
from mani_skill.utils.geometry.rotation_conversions import quaternion_apply, quaternion_invert
from mani_skill.utils.structs import Actor, Pose
from scipy.spatial.transform import Rotation

from mam_envs.grasping.candidates import PlacementError
from mam_envs.placement.reach_in import REACH_IN
from mam_envs.scene.layout import Layout
from mam_pipeline.types import FloatArray

if TYPE_CHECKING:
    from mani_skill.envs.scene import ManiSkillScene

COLOUR = (0.80, 0.22, 0.16, 1.0)
SETTLE = 40
"""Steps of the simulation for which the cube is watched before an episode begins."""
DEEPEST = 0.002
"""Metres that it may lie in anything then."""
MOVED = 0.01
"""Metres that it may have gone since it was put there."""
TRIES = 10
"""Places that are tried before the drawer is refused."""


class Loose:
    """The cube of one sub-scene's task (a task with one runs with num_envs=1).

    Attributes:
        actor: ManiSkill's body.
    """

    def __init__(self, scene: ManiSkillScene, layout: Layout) -> None:
        thing = layout.goals[0].thing
        assert thing is not None
        self.scene, self.layout, self.thing = scene, layout, thing
        builder = scene.create_actor_builder()
        half = [0.5 * thing.size] * 3
        builder.add_box_collision(half_size=half, density=thing.mass / thing.size**3)
        if scene.can_render():
            material = sapien.render.RenderMaterial(base_color=COLOUR, roughness=0.7)
            builder.add_box_visual(half_size=half, material=material)
        builder.initial_pose = sapien.Pose(p=[0.0, 0.0, 5.0])
        self.actor: Actor = builder.build(name="thing")
        model, goal = layout.model, layout.goals[0]
        rest = model.kinematics.link_poses({})[model.kinematics.joint(goal.joint).child][0]
        self._rest = torch.tensor(rest, device=scene.device, dtype=torch.float32)

    def put(self, rng: np.random.RandomState, world_asset: FloatArray, q: float) -> None:
        """Draw a place and a yaw at which the cube lies still and goes into nothing.

        Args:
            world_asset: (4, 4) of the object. q: value of the drawer's joint.

        Raises:
            PlacementError: there was none.
        """
        goal, places = self.layout.goals[0], np.array(self.layout.places)
        motion = world_asset @ self.layout.model.motion(goal.joint, np.array([q]), {})[0]
        where = f"in what {goal.joint!r} moves"
        if self.layout.starts:
            ground = [(x, y, 0.5 * self.thing.size) for x, y in self.layout.starts]
            places, motion, where = np.array(ground), np.eye(4), "on the ground"
        order = rng.permutation(len(places))
        yaws = np.deg2rad(rng.uniform(-1, 1, len(order)) * REACH_IN.turn)
        for k, yaw in list(zip(order, yaws))[:TRIES]:
            at = motion[:3, :3] @ places[k] + motion[:3, 3]
            turn = Rotation.from_matrix(motion[:3, :3]) * Rotation.from_euler("z", yaw)
            above = at + np.array([0.0, 0.0, 0.5 * DEEPEST])
            start = sapien.Pose(above, turn.as_quat(scalar_first=True))
            self._set(Pose.create(start))
            for _ in range(SETTLE):
                self.scene.step()
            gone = float(np.linalg.norm(self.actor.pose.p[0].cpu().numpy() - at))
            if gone < MOVED and self.speed()[0] < 0.02 and self._depth() < DEEPEST:
                return
        raise PlacementError(
            f"{self.layout.model.asset.card.name}: a cube of {100 * self.thing.size:.1f} cm does "
            f"not lie still {where}; make success.size smaller",
            "room",
        )

    def _set(self, pose: Pose) -> None:
        self.actor.set_pose(pose)
        zero = torch.zeros(1, 3, device=self.scene.device)
        self.actor.set_linear_velocity(zero)
        self.actor.set_angular_velocity(zero)

    def _depth(self) -> float:
        """Metres that the cube goes into anything."""
        own = self.actor._bodies[0]
        touching = [c for c in self.scene.px.get_contacts() if own in c.bodies]
        return max((-p.separation for c in touching for p in c.points), default=0.0)

    def speed(self) -> torch.Tensor:
        """(1,) metres per second."""
        return self.actor.linear_velocity.norm(dim=-1)

    def inside(self, part: Pose) -> torch.Tensor:
        """(1, 3) the cube's middle in the asset's frame, as the part at `part` carries it with its
        joint at 0."""
        local = quaternion_apply(quaternion_invert(part.q), self.actor.pose.p - part.p)
        return local @ self._rest[:3, :3].T + self._rest[:3, 3]

    def matrix(self) -> FloatArray:
        """(4, 4) world_T_thing."""
        found = self.actor.pose.to_transformation_matrix()[0].cpu().numpy()
        return np.asarray(found, dtype=float)

    def seen(self, part: Pose, force: torch.Tensor) -> dict[str, Any]:
        """What a task sees of it (see `TaskState`)."""
        return {
            "thing": self.actor.pose.raw_pose,
            "inside": self.inside(part),
            "thing_speed": self.speed(),
            "thing_force": force,
        }


def loose_thing(scene: ManiSkillScene, layouts: Sequence[Layout]) -> Loose | None:
    """The cube of a scene whose task has one."""
    return None if layouts[0].goals[0].thing is None else Loose(scene, layouts[0])
