"""Forces between robot and world: what opens by itself, or by brute force, is no success."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.utils.structs import Actor, Articulation, Link


class ContactProbe:
    """Contact forces between a robot, the moving links of each stage, and everything else.

    They are read after every step of the simulation: fingers that drag a part along with some play
    touch it in only some of a control step's five. On the CPU one pass over PhysX's contact list
    counts the whole robot and all links that the joint carries; on the GPU one query per hand link
    counts the joint's own link.
    """

    def __init__(
        self,
        scene: ManiSkillScene,
        robot: Articulation,
        hand: Sequence[Link],
        targets: Sequence[Link],
        parts: Sequence[Sequence[Link]],
        thing: Actor | None = None,
    ) -> None:
        """Bind to a built scene.

        Args:
            hand: the robot's links that are asked for on the GPU.
            targets: per stage the joint's moving link, merged over sub-scenes.
            parts: per stage all links of sub-scene 0's object that the joint carries.
            thing: a loose body whose contact with the robot is counted, too (CPU).
        """
        self.scene, self.hand, self.targets = scene, hand, targets
        self.robot_ids = {_scene_id(link) for link in robot.links}
        self.part_ids = [{_scene_id(link) for link in links} for links in parts]
        self.thing_id = None if thing is None else _scene_id(thing)
        self.clear()

    def clear(self) -> None:
        """Begin a control step."""
        n, device = self.scene.num_envs, self.scene.device
        self._peak = torch.zeros(n, device=device)
        self.on_thing = torch.zeros(n, device=device)
        self._on_part = torch.zeros((n, 3), device=device)
        self._on_links: dict[int, torch.Tensor] = {}
        self._steps = 0

    @property
    def peak(self) -> torch.Tensor:
        """(b,) newtons between robot and part, squeeze included, the most since `clear`."""
        return self._peak

    @property
    def part_force(self) -> torch.Tensor:
        """(b,) newtons on the part as one vector, mean since `clear`."""
        return self.part_push.norm(dim=-1)

    @property
    def part_push(self) -> torch.Tensor:
        """(b, 3) that vector as the robot feels it, world frame."""
        return self._on_part / max(self._steps, 1)

    @property
    def link_force(self) -> torch.Tensor:
        """(b,) newtons on the robot's link that presses hardest, mean since `clear`."""
        if not self._on_links:
            return torch.zeros_like(self._peak)
        rows = torch.stack([force.norm(dim=-1) for force in self._on_links.values()])
        return rows.amax(dim=0) / max(self._steps, 1)

    def watch(self, stage: torch.Tensor) -> None:
        """Take note of the forces of one step of the simulation; `stage` (b,) of each sub-scene."""
        self._steps += 1
        if self.scene.gpu_sim_enabled:
            self._query(stage)
            return
        contacts = self.scene.px.get_contacts()
        if contacts:
            self._listed(contacts, self.part_ids[int(stage[0])])

    def _query(self, stage: torch.Tensor) -> None:
        """Of all sub-scenes, hand links only; `stage` (b,)."""
        rows = []
        for target in self.targets:
            pairs = [self.scene.get_pairwise_contact_forces(link, target) for link in self.hand]
            rows.append(torch.stack(pairs))
        at = stage[None, None, :, None].expand(1, len(self.hand), -1, 3)
        pairs_now = torch.stack(rows).gather(0, at)[0]  # (hand, b, 3)
        self._peak = torch.maximum(self._peak, pairs_now.norm(dim=-1).sum(dim=0))
        self._on_part = self._on_part + pairs_now.sum(dim=0)
        for k, link in enumerate(self.hand):
            self._on_links[k] = self._on_links.get(k, 0.0) + link.get_net_contact_forces()

    def _listed(self, contacts: list, wanted: set[int]) -> None:
        """Of the only sub-scene, from PhysX's list; `wanted`: the part's bodies."""
        total, on_thing, on_part = 0.0, 0.0, np.zeros(3)
        links: dict[int, np.ndarray] = {}
        for contact in contacts:
            a, b = (body.entity.per_scene_id for body in contact.bodies)
            if (a in self.robot_ids) == (b in self.robot_ids):
                continue
            link, other = (a, b) if a in self.robot_ids else (b, a)
            impulses = np.array([p.impulse for p in contact.points]).reshape(-1, 3)
            turned = impulses.sum(axis=0) * (1.0 if link == a else -1.0)
            links[link] = links.get(link, 0.0) + turned
            if other in wanted:
                total += float(np.linalg.norm(impulses, axis=1).sum())
                on_part += turned
            elif other == self.thing_id:
                on_thing += float(np.linalg.norm(impulses, axis=1).sum())
        rate, like = 1.0 / float(self.scene.px.timestep), self._on_part
        self._peak = self._peak.clamp(min=rate * total)
        self.on_thing = self.on_thing.clamp(min=rate * on_thing)
        self._on_part = like + like.new_tensor(rate * on_part)
        for link, impulse in links.items():
            before = self._on_links.get(link, torch.zeros_like(like))
            self._on_links[link] = before + like.new_tensor(rate * impulse)


def _scene_id(link: Link | Actor) -> int:
    """Of the first sub-scene's body."""
    return int(link._bodies[0].entity.per_scene_id)
