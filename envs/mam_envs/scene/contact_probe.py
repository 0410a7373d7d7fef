"""Forces between robot and world: what opens by itself, or by brute force, is no success."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.utils.structs import Actor, Articulation, Link

from mam_envs.scene.frames import raw_poses, rotate


class ContactProbe:
    """Forces between a robot, the moving links of each stage, and everything else.

    They are read after every step of the simulation: fingers that drag a part along with some play
    touch it in only some of a control step's five. On the CPU one pass over PhysX's contact list
    tells what the whole robot and all links that the joint carries touch; on the GPU one query per
    hand link tells it of the joint's own link.

    Contacts have normal forces, without friction. What the fingers pull or push with while they
    touch the part is therefore the force in the joints that carry them, as force sensors there
    would measure it; ManiSkill leaves gravity out for robots. It is not read at the wrist: where
    one finger's joint mimics the other's, PhysX keeps part of it from the joints before them.
    """

    def __init__(
        self,
        scene: ManiSkillScene,
        robot: Articulation,
        fingers: Mapping[str, Sequence[str]],
        hand: Sequence[Link],
        targets: Sequence[Link],
        parts: Sequence[Sequence[Link]],
        thing: Actor | None = None,
    ) -> None:
        """Bind to a built scene.

        Args:
            fingers: names of the robot's links whose joints are read, and of those that move with
                each; contacts of other links count as they are.
            hand: the robot's links that are asked for on the GPU.
            targets: per stage the joint's moving link, merged over sub-scenes.
            parts: per stage all links of sub-scene 0's object that the joint carries.
            thing: a loose body whose contact with the robot is counted, too (CPU).
        """
        self.scene, self.hand, self.targets = scene, hand, targets
        self.robot, by_name = robot, robot.links_map
        self.fingers = [by_name[name] for name in fingers]
        self._at = [int(link.index[0]) for link in self.fingers]
        frames = [link._objs[0].joint.pose_in_child.q for link in self.fingers]
        self._frames = torch.tensor(np.array(frames)[None], device=scene.device)
        carried = {name for names in fingers.values() for name in names}
        self._by_joint = [link.name in carried for link in hand]
        self.finger_ids = {_scene_id(link) for link in robot.links if link.name in carried}
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
        self._in_joints = torch.zeros((n, len(self.fingers), 3), device=device)
        self._push: torch.Tensor | None = self._on_part
        self._on_links: dict[int, Any] = {}  # (b, 3) newtons, summed; (3,) on the CPU
        self._steps = 0

    @property
    def peak(self) -> torch.Tensor:
        """(b,) newtons between robot and part, squeeze included, the most since `clear`."""
        return self._peak

    @property
    def part_force(self) -> torch.Tensor:
        """(b,) newtons of the robot on the part, friction of the fingers included, as one vector
        (what fingers squeeze between them cancels out), mean since `clear`."""
        return self.part_push.norm(dim=-1)

    @property
    def part_push(self) -> torch.Tensor:
        """(b, 3) that vector as the robot feels it, world frame."""
        if self._push is None:
            self._push = (self._on_part + self._felt()) / self._steps
        return self._push

    @property
    def link_force(self) -> torch.Tensor:
        """(b,) newtons on the robot's link that presses hardest, mean since `clear`."""
        if not self._on_links:
            return torch.zeros_like(self._peak)
        forces = [torch.as_tensor(row).to(self._peak) for row in self._on_links.values()]
        hardest = torch.stack(forces).view(len(forces), -1, 3).norm(dim=-1).amax(dim=0)
        return hardest / max(self._steps, 1)

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
        self._push = None
        hard, by_joint = pairs_now.norm(dim=-1), torch.tensor(self._by_joint)
        self._peak = torch.maximum(self._peak, hard.sum(dim=0))
        self._on_part = self._on_part + pairs_now[~by_joint].sum(dim=0)
        self._feel((hard[by_joint] > 0).any(dim=0))
        for k, link in enumerate(self.hand):
            self._on_links[k] = self._on_links.get(k, 0.0) + link.get_net_contact_forces()

    def _feel(self, touching: torch.Tensor) -> None:
        """Add the forces in the fingers' joints now, each in its joint's frame on the finger, where
        a finger is `touching` (b,)."""
        forces = self.robot.get_link_incoming_joint_forces()[:, self._at, :3]
        self._in_joints = self._in_joints + forces * touching[:, None, None]

    def _felt(self) -> torch.Tensor:
        """(b, 3) those forces since `clear` as they bear on the fingers, world frame, summed."""
        turns = raw_poses(self.fingers)[..., 3:]
        return -rotate(turns, rotate(self._frames, self._in_joints)).sum(dim=1)

    def _listed(self, contacts: list, wanted: set[int]) -> None:
        """Of the only sub-scene, from PhysX's list; `wanted`: the part's bodies."""
        total, on_thing, on_part, by_finger = 0.0, 0.0, np.zeros(3), False
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
                self._push = None
                hard = float(np.linalg.norm(impulses, axis=1).sum())
                total += hard
                if link in self.finger_ids:
                    by_finger = by_finger or hard > 0
                else:
                    on_part += turned
            elif other == self.thing_id:
                on_thing += float(np.linalg.norm(impulses, axis=1).sum())
        rate = 1.0 / float(self.scene.px.timestep)
        for link, impulse in links.items():
            self._on_links[link] = self._on_links.get(link, 0.0) + rate * impulse
        if on_thing:
            self.on_thing = self.on_thing.clamp(min=rate * on_thing)
        if total:
            self._peak = self._peak.clamp(min=rate * total)
            self._on_part = self._on_part + self._on_part.new_tensor(rate * on_part)
        if by_finger:
            self._feel(torch.ones_like(self._peak))


def _scene_id(link: Link | Actor) -> int:
    """Of the first sub-scene's body."""
    return int(link._bodies[0].entity.per_scene_id)
