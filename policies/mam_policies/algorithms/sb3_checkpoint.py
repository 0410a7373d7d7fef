"""Checkpoints of reinforcement learning: tensors and numbers only, and a fresh start after each.

SB3's own zip files hold pickled objects; a checkpoint from a stranger must execute nothing.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch

from mam_pipeline import folders
from mam_pipeline.errors import InputError

ROWS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
"""What SB3's replay buffer keeps."""


def save_checkpoint(model: Any, folder: Path, more: dict[str, Any]) -> None:
    """Write weights, optimisers, step count, replay memory (sac) and `more`, all or nothing."""
    folder.mkdir(parents=True, exist_ok=True)
    state: dict[str, Any] = {
        "parameters": model.get_parameters(),
        "steps": int(model.num_timesteps),
        "updates": int(model._n_updates),
        **more,
    }
    if getattr(model, "log_ent_coef", None) is not None:
        state["log_ent_coef"] = model.log_ent_coef.detach()
    memory = getattr(model, "replay_buffer", None)
    if memory is not None:
        count = memory.buffer_size if memory.full else memory.pos
        rows = {k: torch.from_numpy(getattr(memory, k)[:count].copy()) for k in ROWS}
        state |= {"memory": rows, "pos": int(memory.pos), "full": bool(memory.full)}
    with folders.new_file(folder / "last.pt") as part:
        torch.save(state, part)


def load_checkpoint(folder: Path) -> dict[str, Any] | None:
    """What `save_checkpoint` wrote, or None.

    Raises:
        InputError: the file holds something else; nothing in it is executed.
    """
    file = folder / "last.pt"
    if not file.is_file():
        return None
    try:
        state = torch.load(file, weights_only=True)
        return {**state, "steps": int(state["steps"])}
    except Exception as error:  # torch raises many kinds; the file is the user's
        raise InputError(f"{file} is not a checkpoint of mam-sim: {error}") from error


def restore(model: Any, state: dict[str, Any]) -> None:
    """Put a checkpoint into a fresh model."""
    model.set_parameters(state["parameters"])
    model.num_timesteps, model._n_updates = state["steps"], int(state["updates"])
    if "log_ent_coef" in state:
        model.log_ent_coef.data.copy_(state["log_ent_coef"])
    if "memory" in state:
        memory = model.replay_buffer
        for key, rows in state["memory"].items():
            getattr(memory, key)[: len(rows)] = rows.numpy()
        memory.pos, memory.full = state["pos"], state["full"]


def renew(model: Any, seed: int, steps: int) -> None:
    """Start the environments and all random streams anew, as a resumed run has to."""
    model.set_random_seed((seed * 1_000_003 + 7919 * steps) % 2**31)
    model._last_obs = model.env.reset()
    model._last_episode_starts = np.ones(model.n_envs, dtype=bool)
