"""From what a real arm reports to our policy's observation, and from its action to motor targets.

Everything the conversion needs is plain numbers (`Deployment`), so that a policy folder carries
them in its config.json and runs without a simulator.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mam_envs.kinematics import Chain, TreeJoint
from mam_policies.mlp import MlpPolicy

HANDLE = ("handle_x.pos", "handle_y.pos", "handle_z.pos")
VALUE, TOUCH = "object_joint.pos", "touch.pos"
PERCEIVED = (*HANDLE, VALUE, TOUCH)
"""Named floats behind the motors in the state vector: the point to hold in the robot's base frame
(metres), the joint's value (radians or metres), whether the fingers touch the part (0 or 1).
They end in .pos because lerobot-rollout passes no other numbers of a robot on to the policy."""

Array = NDArray[np.float64]


@dataclass
class Deployment:
    """What turns a state vector into our observation; plain values only.

    Attributes:
        observation: (name, start, stop) rows of the flat observation.
        joints: simulated joints in the order of the state; scale, offset: sim = scale * real +
            offset for each of them.
        arm: indices in `joints` of the arm's joints.
        gripper: index of the joint that the gripper command is for.
        gain, bias, moving: per action entry; its target is gain * a + bias, added to the target
            before where `moving`; limited: whether a is cut to -1..1 first.
        base: world_T_base, row by row. chain: joints on the way to the tool; tool: tip_T_tool.
        turn: a quaternion of the tool in the world, w first, as the simulator signed it.
        closed, opened, goal: values of the joint to be operated.
        dt: seconds per control step. decay: weight of older chunks.
    """

    observation: list[list[Any]] = field(default_factory=list)
    joints: list[str] = field(default_factory=list)
    scale: list[float] = field(default_factory=list)
    offset: list[float] = field(default_factory=list)
    arm: list[int] = field(default_factory=list)
    gripper: int = 0
    gain: list[float] = field(default_factory=list)
    bias: list[float] = field(default_factory=list)
    moving: list[bool] = field(default_factory=list)
    limited: list[bool] = field(default_factory=list)
    base: list[float] = field(default_factory=list)
    chain: list[dict[str, Any]] = field(default_factory=list)
    locked: dict[str, float] = field(default_factory=dict)
    tool: list[float] = field(default_factory=list)
    turn: list[float] = field(default_factory=lambda: [1.0, 0.0, 0.0, 0.0])
    closed: float = 0.0
    opened: float = 1.0
    goal: float = 1.0
    dt: float = 0.05
    decay: float = 0.5


class Converter:
    """Runs an MlpPolicy on state vectors (b, n) of a real arm; keeps the episode's memory."""

    def __init__(self, plan: Deployment, policy: MlpPolicy) -> None:
        self.plan, self.policy = plan, policy
        self.scale, self.offset = np.array(plan.scale), np.array(plan.offset)
        self.base = np.array(plan.base, dtype=float).reshape(4, 4)
        joints = tuple(
            TreeJoint(
                str(j["name"]), str(j["type"]), "", "",
                np.array(j["origin"], dtype=float).reshape(4, 4), np.array(j["axis"], dtype=float),
                -np.inf, np.inf,
            )
            for j in plan.chain
        )  # fmt: skip
        arm = tuple(plan.joints[i] for i in plan.arm)
        self.chain = Chain(joints, arm, plan.locked, np.array(plan.tool).reshape(4, 4))
        self.reset()

    def reset(self) -> None:
        """Forget the episode."""
        self.step = 0
        self.pending: list[tuple[int, Array]] = []
        self.last: tuple[Array, Array] | None = None
        self.begin: Array | None = None
        self.target: Array | None = None

    def act(self, state: Array) -> Array:
        """Targets (b, m) in motor units for states (b, joints + PERCEIVED) in motor units."""
        q, obs = self.observe(state)
        with torch.no_grad():
            flat = torch.as_tensor(obs, dtype=torch.float32)
            chunk = self.policy.actions(flat, torch.full((len(flat),), self.step)).numpy()
        self.pending.append((self.step, chunk))
        self.pending = [(s, c) for s, c in self.pending if self.step - s < c.shape[1]]
        weights = np.array([self.plan.decay ** (self.step - s) for s, _ in self.pending])
        rows = np.stack([c[:, self.step - s] for s, c in self.pending])
        action = np.tensordot(weights, rows, axes=1) / weights.sum()
        self.step += 1
        return self._targets(action, q)

    def observe(self, state: Array) -> tuple[Array, Array]:
        """Simulated joint values (b, n) and our flat observation (b, k); moves the memory on."""
        plan, count = self.plan, len(self.plan.joints)
        state = np.asarray(state, dtype=float)
        q = state[:, :count] * self.scale + self.offset
        seen = {name: state[:, count + i] for i, name in enumerate(PERCEIVED)}
        value = seen[VALUE]
        before = self.last or (q, value)
        self.last = (q, value)
        if self.begin is None:
            self.begin = value.copy()
        rotation, position, _ = self.chain.forward(q[:, plan.arm])
        turn, shift = self.base[:3, :3], self.base[:3, 3]
        tool = position @ turn.T + shift
        facing = quaternion(turn @ rotation)
        facing = np.where(facing @ np.array(plan.turn)[:, None] < 0, -facing, facing)
        handle = np.stack([seen[name] for name in HANDLE], axis=1) @ turn.T + shift
        parts = {
            "agent/qpos": q,
            "agent/qvel": (q - before[0]) / plan.dt,
            "extra/tcp_pose": np.concatenate([tool, facing], axis=1),
            "extra/privileged/handle_position": handle,
            "extra/privileged/tcp_to_handle": handle - tool,
            "extra/privileged/joint_value": value,
            "extra/privileged/joint_speed": (value - before[1]) / plan.dt,
            "extra/privileged/joint_goal": np.full_like(value, plan.goal),
            "extra/privileged/open_fraction": (value - plan.closed) / (plan.opened - plan.closed),
            "extra/privileged/progress": (value - self.begin) / (plan.goal - self.begin),
            "extra/privileged/touching": seen[TOUCH],
        }
        aim = q[:, [*plan.arm, plan.gripper]] if self.target is None else self.target
        parts["agent/controller/arm/target_qpos"] = aim[:, : len(plan.arm)]
        columns = [parts[name].reshape(len(q), -1) for name, *_ in plan.observation]
        return q, np.concatenate(columns, axis=1)

    def _targets(self, action: Array, q: Array) -> Array:
        plan = self.plan
        order = [*plan.arm, plan.gripper]
        action = action[:, : len(order)]
        action = np.where(np.array(plan.limited), np.clip(action, -1, 1), action)
        if self.target is None:
            self.target = q[:, order]
        step = action * np.array(plan.gain) + np.array(plan.bias)
        self.target = step + np.where(np.array(plan.moving), self.target, 0.0)
        return (self.target - self.offset[order]) / self.scale[order]


OBSERVED = (
    "agent/qpos", "agent/qvel", "agent/controller/arm/target_qpos", "extra/tcp_pose",
    *(f"extra/privileged/{k}" for k in (
        "handle_position", "tcp_to_handle", "joint_value", "joint_speed", "joint_goal",
        "open_fraction", "progress", "touching",
    )),
)  # fmt: skip
"""Observation entries that Converter.observe can rebuild."""


def perceived_in(plan: Deployment, hidden: Array) -> Array:
    """(b, 5) PERCEIVED from what only the simulator knows, (b, k) as environment_state has it.

    Raises:
        ValueError: it has other entries than those of the environment that was trained in.
    """
    rows = {name: (a, b) for name, a, b in plan.observation if name.startswith(HIDDEN)}
    first, last = min(a for a, _ in rows.values()), max(b for _, b in rows.values())
    if hidden.shape[1] != last - first:
        raise ValueError(
            f"observation.environment_state has {hidden.shape[1]} entries; in training it had "
            f"{last - first}"
        )
    handle, value, touch = (
        hidden[:, rows[HIDDEN + name][0] - first : rows[HIDDEN + name][1] - first]
        for name in ("handle_position", "joint_value", "touching")
    )
    base = np.array(plan.base, dtype=float).reshape(4, 4)
    return np.concatenate([(handle - base[:3, 3]) @ base[:3, :3], value, touch], axis=1)


HIDDEN = "extra/privileged/"
"""What the names of observations begin with that only a simulator knows."""


def quaternion(m: Array) -> Array:
    """(b, 3, 3) rotations as (b, 4) quaternions, w first and never negative."""
    return Rotation.from_matrix(m).as_quat(canonical=True, scalar_first=True)
