"""The small network of our own algorithms, its file (safetensors, no code), and how it acts."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file

from mam_pipeline import folders
from mam_pipeline.edited import STRICT, Index, Range, parse_json, validated
from mam_pipeline.errors import InputError
from mam_pipeline.folder_data import weights

Width = Annotated[int, Range(1, 100_000)]
Row = Annotated[tuple[Index, ...], Field(max_length=100_000)]


@dataclass(frozen=True)
class _Sizes:
    """The header of the file of weights; see `MlpPolicy`."""

    __pydantic_config__ = STRICT
    obs_dim: Width
    action_dim: Width
    arm_joints: Width
    chunk: Width = 1
    hidden: Annotated[tuple[Width, ...], Field(max_length=32)] = (256, 256)
    horizon: Annotated[int, Range(1, 1e9)] = 200
    timed: bool = True
    relative: bool = True
    squash: Literal["none", "clip", "tanh"] = "none"
    activation: Literal["relu", "tanh"] = "relu"
    inputs: Row | None = None
    marks: Row = ()
    fine: Row = ()


FINE_METRES, FINE_RADIANS = 0.02, 0.1
"""Differences within which a magnified entry tells most."""


class MlpPolicy(torch.nn.Module):
    """Observation (and time) to a chunk of actions: an MLP with the statistics inside.

    The arm's part of an action is predicted as its difference to the present joint values when
    `relative` (absolute joint targets); the gripper command as it is. `squash` says how actions
    are kept in -1..1: none, clip or tanh. With `marks` (postures as differences to the present one)
    that difference is a weighted sum of theirs: what moves an arm from mark to mark on one object
    then does so on others.
    """

    mean: torch.Tensor
    std: torch.Tensor
    scale: torch.Tensor
    offset: torch.Tensor

    def __init__(
        self,
        obs_dim: int,
        action_dim: int,
        arm_joints: int,
        chunk: int = 1,
        hidden: tuple[int, ...] = (256, 256),
        horizon: int = 200,
        timed: bool = True,
        relative: bool = True,
        squash: str = "none",
        activation: str = "relu",
        inputs: tuple[int, ...] | None = None,
        marks: tuple[int, ...] = (),
        fine: tuple[int, ...] = (),
    ) -> None:
        """`inputs`: entries of the observation that the network sees; None is all of them. `marks`:
        where in the observation the arm's way to each mark begins. `fine`: entries that it also
        sees magnified, metres."""
        super().__init__()
        self.sizes = {
            "obs_dim": obs_dim,
            "action_dim": action_dim,
            "arm_joints": arm_joints,
            "chunk": chunk,
            "hidden": list(hidden),
            "horizon": horizon,
            "timed": timed,
            "relative": relative,
            "squash": squash,
            "activation": activation,
            "inputs": None if inputs is None else list(inputs),
            "marks": list(marks),
            "fine": list(fine),
        }
        self.marks, self.fine = list(marks), list(fine)
        self.inputs = None if inputs is None else list(inputs)
        self.obs_dim, self.action_dim, self.arm_joints = obs_dim, action_dim, arm_joints
        self.chunk, self.horizon, self.timed = chunk, horizon, timed
        self.relative, self.squash = relative, squash
        layers: list[torch.nn.Module] = []
        width = (
            (obs_dim if inputs is None else len(inputs)) + int(timed) + 2 * len(marks) + len(fine)
        )
        kind = torch.nn.Tanh if activation == "tanh" else torch.nn.ReLU
        for size in hidden:
            layers += [torch.nn.Linear(width, size), kind()]
            width = size
        outputs = action_dim - arm_joints + len(marks) if marks else action_dim
        layers.append(torch.nn.Linear(width, chunk * outputs))
        self.net = torch.nn.Sequential(*layers)
        self.register_buffer("mean", torch.zeros(obs_dim))
        self.register_buffer("std", torch.ones(obs_dim))
        self.register_buffer("scale", torch.ones(action_dim))
        self.register_buffer("offset", torch.zeros(action_dim))

    def forward(self, obs: torch.Tensor, step: torch.Tensor) -> torch.Tensor:
        """(b, obs_dim) and (b,) step counts to normalised actions (b, chunk, action_dim)."""
        x = ((obs - self.mean) / self.std).clamp(-10, 10)
        if self.inputs is not None:
            x = x[:, self.inputs]
        if self.timed:
            x = torch.cat([x, (step[:, None].float() / self.horizon)], dim=1)
        x = torch.cat([x, torch.tanh(obs[:, self.fine] / FINE_METRES)], dim=1)
        if not self.marks:
            return self.net(x).reshape(len(obs), self.chunk, self.action_dim)
        ways = torch.stack([obs[:, k : k + self.arm_joints] for k in self.marks], dim=1)
        far = ways.abs().amax(dim=2)
        x = torch.cat([x, far, torch.tanh(far / FINE_RADIANS)], dim=1)
        out = self.net(x).reshape(len(obs), self.chunk, -1)
        n = self.arm_joints
        others, weights = out.split([self.action_dim - n, len(self.marks)], dim=2)
        return torch.cat([(weights @ ways - self.offset[:n]) / self.scale[:n], others], dim=2)

    def actions(self, obs: torch.Tensor, step: torch.Tensor) -> torch.Tensor:
        """(b, chunk, action_dim) in the environment's units."""
        out = self(obs, step) * self.scale + self.offset
        if self.relative:
            arm = obs[:, None, : self.arm_joints]
            out = torch.cat([out[..., : self.arm_joints] + arm, out[..., self.arm_joints :]], -1)
        if self.squash == "tanh":
            return torch.tanh(out)
        return out.clamp(-1, 1) if self.squash == "clip" else out

    def save(self, folder: Path) -> None:
        """Write policy.safetensors with the sizes in its header."""
        state = {k: v.contiguous() for k, v in self.state_dict().items()}
        with folders.new_file(folder / "policy.safetensors") as part:
            save_file(state, part, {"sizes": json.dumps(self.sizes)})

    @staticmethod
    def load(folder: Path) -> MlpPolicy:
        """Read what `save` wrote.

        Raises:
            InputError: missing, or not such a file.
        """
        name = "policy.safetensors"
        file = weights(folder, name, f"{folder} holds no {name}; has its training ended?")
        try:
            with safe_open(file, "pt") as opened:
                said = (opened.metadata() or {})["sizes"]
            sizes = validated(_Sizes, parse_json(said, f"{file}: sizes"))
            if max((*(sizes.inputs or ()), *sizes.marks, *sizes.fine), default=0) >= sizes.obs_dim:
                raise ValueError("it looks at entries beyond the observation")
            with torch.device("meta"):  # the weights take the memory, not what they are told to be
                policy = MlpPolicy(**vars(sizes))
            policy.load_state_dict(load_file(file), assign=True)
        except (SafetensorError, KeyError, TypeError, ValueError, RuntimeError, OSError) as error:
            why = " ".join(str(error).split())[:300]
            raise InputError(f"{file} is not a policy of mam-sim: {why}") from error
        return policy.eval()


class MlpActor:
    """Runs an MlpPolicy step by step; chunks overlap and are averaged, recent ones weigh more."""

    def __init__(self, policy: MlpPolicy, decay: float = 0.5) -> None:
        self.policy, self.decay = policy, decay
        self.reset()

    def reset(self) -> None:
        """Forget the episode so far."""
        self.step = 0
        self.pending: list[tuple[int, NDArray[np.float32]]] = []

    def act(self, obs: Any) -> NDArray[np.float32]:
        """One action for one flat observation (n,) or (1, n)."""
        flat = torch.as_tensor(np.asarray(obs, dtype=np.float32)).reshape(1, -1)
        with torch.no_grad():
            chunk = self.policy.actions(flat, torch.tensor([self.step]))[0].numpy()
        self.pending.append((self.step, chunk))
        self.pending = [(s, c) for s, c in self.pending if self.step - s < len(c)]
        weights = np.array([self.decay ** (self.step - s) for s, _ in self.pending])
        rows = np.stack([c[self.step - s] for s, c in self.pending])
        self.step += 1
        return np.asarray(weights @ rows / weights.sum(), dtype=np.float32)
