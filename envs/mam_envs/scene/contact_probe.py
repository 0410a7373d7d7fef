"""Whether the robot touches the part that it is to move: what opens by itself is no success."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from mani_skill.utils.structs import Link

if TYPE_CHECKING:
    from mani_skill.envs.sapien_env import BaseEnv


class ContactProbe:
    """Contact force between some robot links and the moving links of each stage.

    It is read after every step of the simulation: fingers that drag a part along with some play
    touch it in only some of a control step's five. On the CPU one pass over PhysX's contact list;
    on the GPU one pair query per robot link.
    """

    def __init__(
        self, env: BaseEnv, robot_links: list[Link], stages: list[Link], parts: list[set[str]]
    ) -> None:
        """`stages`: the moving link per stage (merged over sub-scenes); `parts`: per stage the
        names of all links of sub-scene 0's object that the joint carries."""
        self.env, self.robot_links, self.stages = env, robot_links, stages
        self.robot_ids = {
            b.entity.per_scene_id for link in env.agent.robot.links for b in link._bodies[:1]
        }
        links = env._objects[0].links if not env.gpu_sim_enabled else []  # type: ignore[attr-defined]
        self.part_ids = [
            {link._bodies[0].entity.per_scene_id for link in links if link.name in names}
            for names in parts
        ]
        self.clear()

    def clear(self) -> None:
        """Begin a control step."""
        self._peak = torch.zeros(self.env.num_envs, device=self.env.device)

    @property
    def peak(self) -> torch.Tensor:
        """(b,) newtons, the most since `clear`."""
        return self._peak

    def watch(self, stage: torch.Tensor) -> None:
        """Take note of the forces of one step of the simulation."""
        if self.env.scene.gpu_sim_enabled:
            self._peak = torch.maximum(self._peak, self._pairs(stage))
            return
        contacts = self.env.scene.px.get_contacts()
        if contacts:
            now = self._listed(contacts, self.part_ids[int(stage[0])])
            self._peak = self._peak.clamp(min=now)

    def _pairs(self, stage: torch.Tensor) -> torch.Tensor:
        """(b,) newtons between robot and the moving part of each sub-scene's stage (b,)."""
        scene = self.env.scene
        rows = []
        for target in self.stages:
            pairs = [scene.get_pairwise_contact_forces(r, target) for r in self.robot_links]
            rows.append(torch.stack([p.norm(dim=-1) for p in pairs]).sum(dim=0))
        return torch.stack(rows, dim=1).gather(1, stage[:, None])[:, 0]

    def _listed(self, contacts: list, wanted: set[int]) -> float:
        """Newtons between the robot and the `wanted` bodies of the only sub-scene."""
        total = 0.0
        for contact in contacts:
            a, b = (body.entity.per_scene_id for body in contact.bodies)
            if (a in wanted and b in self.robot_ids) or (b in wanted and a in self.robot_ids):
                total += sum(float((p.impulse @ p.impulse) ** 0.5) for p in contact.points)
        return total / float(self.env.scene.px.timestep)
