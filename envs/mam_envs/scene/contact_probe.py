"""Whether the robot touches the part that it is to move: what opens by itself is no success."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.utils.structs import Articulation, Link


class ContactProbe:
    """Contact force between a robot and the moving links of each stage.

    It is read after every step of the simulation: fingers that drag a part along with some play
    touch it in only some of a control step's five. On the CPU one pass over PhysX's contact list
    counts the whole robot and all links that the joint carries; on the GPU one pair query per hand
    link counts the joint's own link.
    """

    def __init__(
        self,
        scene: ManiSkillScene,
        robot: Articulation,
        hand: Sequence[Link],
        targets: Sequence[Link],
        parts: Sequence[Sequence[Link]],
    ) -> None:
        """Bind to a built scene.

        Args:
            hand: the robot's links that are asked for on the GPU.
            targets: per stage the joint's moving link, merged over sub-scenes.
            parts: per stage all links of sub-scene 0's object that the joint carries.
        """
        self.scene, self.hand, self.targets = scene, hand, targets
        self.robot_ids = {_scene_id(link) for link in robot.links}
        self.part_ids = [{_scene_id(link) for link in links} for links in parts]
        self.clear()

    def clear(self) -> None:
        """Begin a control step."""
        self._peak = torch.zeros(self.scene.num_envs, device=self.scene.device)

    @property
    def peak(self) -> torch.Tensor:
        """(b,) newtons, the most since `clear`."""
        return self._peak

    def watch(self, stage: torch.Tensor) -> None:
        """Take note of the forces of one step of the simulation; `stage` (b,) of each sub-scene."""
        if self.scene.gpu_sim_enabled:
            self._peak = torch.maximum(self._peak, self._pairs(stage))
            return
        contacts = self.scene.px.get_contacts()
        if contacts:
            now = self._listed(contacts, self.part_ids[int(stage[0])])
            self._peak = self._peak.clamp(min=now)

    def _pairs(self, stage: torch.Tensor) -> torch.Tensor:
        """(b,) newtons between hand and the moving link of each sub-scene's stage (b,)."""
        rows = []
        for target in self.targets:
            pairs = [self.scene.get_pairwise_contact_forces(link, target) for link in self.hand]
            rows.append(torch.stack([p.norm(dim=-1) for p in pairs]).sum(dim=0))
        return torch.stack(rows, dim=1).gather(1, stage[:, None])[:, 0]

    def _listed(self, contacts: list, wanted: set[int]) -> float:
        """Newtons between the robot and the `wanted` bodies of the only sub-scene."""
        total = 0.0
        for contact in contacts:
            a, b = (body.entity.per_scene_id for body in contact.bodies)
            if (a in wanted and b in self.robot_ids) or (b in wanted and a in self.robot_ids):
                total += sum(float((p.impulse @ p.impulse) ** 0.5) for p in contact.points)
        return total / float(self.scene.px.timestep)


def _scene_id(link: Link) -> int:
    """Of the first sub-scene's body."""
    return int(link._bodies[0].entity.per_scene_id)
