"""Behaviour cloning from the scripted expert: demonstrations, then a small network, in minutes.

Time is an input and actions come in chunks, because phases of the task resemble each other to a
memoryless policy. In DAgger rounds the policy acts and the expert says what it would have
done. Episodes are kept one file each and training checkpoints every few epochs: a killed run goes
on where it was, to the same end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from mam_pipeline import folders
from mam_pipeline.errors import InputError
from mam_pipeline.optional import has
from mam_policies.algorithms import Algorithm, OnProgress
from mam_policies.dagger import dagger_steps
from mam_policies.demonstrations import (
    Demonstration,
    demonstrations,
    load,
    save,
    seed_of,
)
from mam_policies.expert import PlanningError
from mam_policies.mlp import MlpActor, MlpPolicy
from mam_policies.run import EnvChoice, RunInfo, claim, describe_env, few_objects
from mam_policies.settings import BcConfig


class BehaviourCloning(Algorithm[BcConfig]):
    """bc: clones the scripted expert into a small network; minutes on a CPU."""

    name = "bc"
    Config = BcConfig

    def train(
        self,
        choice: EnvChoice,
        config: BcConfig,
        out: Path,
        update: OnProgress = lambda *_: None,
    ) -> RunInfo:
        """Collect demonstrations and clone them into the run folder `out`.

        Raises:
            TrainingError: the expert succeeds too seldom to learn from.
        """
        env = choice.make()
        try:
            sizes = describe_env(env)
            claim(out, choice, f"noise {config.noise} settle {config.settle} seed {config.seed}")
            with few_objects():
                demos = demonstrations(env, config, out / "demos", update)
                policy = _network(choice, config, sizes)
                loss = fit(policy, demos, config, out / "checkpoint", update)
                results: dict[str, Any] = {"demonstrations": len(demos), "rounds": []}
                for k in range(1, config.rounds + 1):
                    new = dagger_round(env, policy, config, k, out / f"round_{k}", update)
                    rate = float(np.mean([d.success for d in new])) if new else 0.0
                    results["rounds"].append(rate)
                    if rate >= config.stop_at:
                        break
                    demos += new
                    loss = fit(policy, demos, config, out / f"checkpoint_{k}", update)
        finally:
            env.close()
        policy.save(out)
        results["loss"] = loss
        info = RunInfo(self.name, choice, **sizes, config=asdict(config), results=results)
        info.save(out)
        return info


def _network(choice: EnvChoice, config: BcConfig, sizes: dict[str, Any]) -> MlpPolicy:
    absolute, rows = choice.control_mode == "pd_joint_pos", sizes["observation"]
    marks = starts(rows, "/posture_") if absolute else ()
    return MlpPolicy(
        sizes["observation"][-1][2],
        sizes["action_dim"],
        sizes["arm_joints"],
        config.chunk,
        config.hidden,
        choice.max_steps,
        timed=not marks,  # the arm's place among the postures tells how far it has come
        relative=absolute,
        squash="none" if absolute else "clip",
        inputs=entries(rows, config.deployable, sizes["arm_joints"] if marks else None),
        marks=marks,
        fine=tuple(k for start in starts(rows, "/grasp_offset") for k in range(start, start + 3)),
    )


UNMEASURED = ("agent/qvel", "extra/privileged/joint_speed", "extra/privileged/touching")
"""Velocities and touch, which real arms do not report."""
ALIKE = (
    "open_fraction", "progress", "touching", "grasp_offset", "grasp_pushes", "grasp_width",
    "grasp_lag",
)  # fmt: skip
"""What is seen of an articulation that does not tell where arm and object stand, nor how the arm
is bent: a policy over many objects would learn single objects by that. Nor does it tell the joint's
type or way, which hardly vary among parts of a kind: another one is an input never seen."""
Rows = list[tuple[str, int, int, bool]]


def entries(rows: Rows, deployable: bool, arm_joints: int | None = None) -> tuple[int, ...] | None:
    """Entries of the flat observation that the network sees; None is all of them.

    Args:
        arm_joints: of a policy that weighs postures: it sees only the gripper, whose joints follow
            these, and what `ALIKE` names.
    """
    unseen = UNMEASURED if deployable else ()
    if arm_joints is not None:
        gripper = tuple(range(arm_joints, rows[0][2]))
        return gripper + tuple(
            i for name, a, b, _ in rows for i in range(a, b)
            if name.split("/")[-1] in ALIKE and name not in unseen
        )  # fmt: skip
    if not unseen:
        return None
    return tuple(i for name, a, b, _ in rows for i in range(a, b) if name not in unseen)


def starts(rows: Rows, word: str) -> tuple[int, ...]:
    """Where in the flat observation each entry with a word in its name begins."""
    return tuple(start for name, start, *_ in rows if word in name)


def dagger_round(
    env: Any,
    policy: MlpPolicy,
    config: BcConfig,
    number: int,
    folder: Path,
    update: OnProgress = lambda *_: None,
) -> list[Demonstration]:
    """Episodes of round `number`; starts from which the expert finds no plan are left out."""
    folder.mkdir(parents=True, exist_ok=True)
    kept: list[Demonstration] = []
    for i in range(config.round_episodes):
        file = folder / f"{i:05d}.npz"
        if not file.is_file():
            seed = seed_of(config.seed, 100_000 * number + i)
            save(file, _dagger_episode(env, policy, seed, config.lost))
        found = load(file)
        if isinstance(found, Demonstration):
            kept.append(found)
        good = sum(d.success for d in kept)
        share, words = (i + 1) / config.round_episodes, f"policy {good} of {len(kept)}"
        update(f"round {number}", share, words)
    return kept


def _dagger_episode(env: Any, policy: MlpPolicy, seed: int, lost: float) -> Demonstration | str:
    spec = env.unwrapped.robot_spec
    try:
        rows = list(dagger_steps(env, MlpActor(policy), seed, lost))
    except PlanningError as error:
        return str(error)
    labels = [spec.action(target[:-1], float(target[-1])) for _, target, _ in rows]
    return Demonstration(np.stack([obs for obs, _, _ in rows]), np.stack(labels), rows[-1][2])


def fit(
    policy: MlpPolicy,
    demos: list[Demonstration],
    config: BcConfig,
    folder: Path,
    update: OnProgress = lambda *_: None,
) -> float:
    """Adam on the smooth L1 error of the chunk; returns the last epoch's mean loss."""
    obs, step, target = training_arrays(policy, demos)
    _statistics(policy, obs, target)
    normal = (target - policy.offset) / policy.scale
    torch.manual_seed(config.seed)
    for layer in policy.net:
        if isinstance(layer, torch.nn.Linear):
            layer.reset_parameters()
    optimiser = torch.optim.Adam(policy.parameters(), lr=config.learning_rate, weight_decay=1e-6)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, config.epochs)
    task = [len(obs), float(target.double().sum()), config.epochs, config.batch]
    start, loss = _resume(folder, policy, optimiser, schedule, task)
    board = _board(folder)
    for epoch in range(start, config.epochs):
        order = torch.randperm(len(obs), generator=torch.Generator().manual_seed(epoch))
        total = 0.0
        for rows in order.split(config.batch):
            error = torch.nn.functional.smooth_l1_loss(
                policy(obs[rows], step[rows]), normal[rows], beta=0.1
            )
            optimiser.zero_grad()
            error.backward()
            optimiser.step()
            total += float(error.detach()) * len(rows)
        schedule.step()
        loss = total / len(obs)
        board("loss", loss, epoch + 1)
        update("training", (epoch + 1) / config.epochs, f"loss {loss:.4f}")
        if (epoch + 1) % config.checkpoint_every == 0 or epoch + 1 == config.epochs:
            _checkpoint(folder, policy, optimiser, schedule, epoch + 1, loss, task)
    policy.eval()
    return loss


def _board(folder: Path) -> Callable[[str, float, int], None]:
    """Where numbers go: TensorBoard beside the checkpoint, if it is installed."""
    if not has("tensorboard"):
        return lambda *_: None
    from torch.utils.tensorboard import SummaryWriter

    writer = SummaryWriter(str(folder.parent / "tensorboard" / folder.name))
    return lambda name, value, step: writer.add_scalar(name, value, step)


def training_arrays(
    policy: MlpPolicy, demos: list[Demonstration]
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Observations (N, n), steps (N,), and chunks of actions (N, chunk, m), arm relative."""
    obs, steps, chunks = [], [], []
    for demo in demos:
        count = len(demo.obs)
        ahead = np.minimum(np.arange(count)[:, None] + np.arange(policy.chunk), count - 1)
        chunk = demo.actions[ahead].astype(np.float32)
        if policy.relative:
            chunk[..., : policy.arm_joints] -= demo.obs[:, None, : policy.arm_joints]
        obs.append(demo.obs)
        steps.append(np.arange(count))
        chunks.append(chunk)
    return (
        torch.as_tensor(np.concatenate(obs), dtype=torch.float32),
        torch.as_tensor(np.concatenate(steps)),
        torch.as_tensor(np.concatenate(chunks), dtype=torch.float32),
    )


def _statistics(policy: MlpPolicy, obs: torch.Tensor, target: torch.Tensor) -> None:
    policy.mean.copy_(obs.mean(0))
    policy.std.copy_(obs.std(0).clamp(min=1e-3))
    policy.offset.copy_(target.mean((0, 1)))
    policy.scale.copy_(target.std((0, 1)).clamp(min=1e-3))


def _checkpoint(folder: Path, policy, optimiser, schedule, epoch: int, loss: float, task) -> None:  # type: ignore[no-untyped-def]
    folder.mkdir(parents=True, exist_ok=True)
    state = {
        "policy": policy.state_dict(),
        "optimiser": optimiser.state_dict(),
        "schedule": schedule.state_dict(),
        "epoch": epoch,
        "loss": loss,
        "task": task,
    }
    with folders.new_file(folder / "last.pt") as part:
        torch.save(state, part)


def _resume(folder: Path, policy, optimiser, schedule, task) -> tuple[int, float]:  # type: ignore[no-untyped-def]
    file = folder / "last.pt"
    if not file.is_file():
        return 0, float("nan")
    try:
        state = torch.load(file, weights_only=True)  # tensors only: nothing is executed
    except Exception as error:  # torch raises many kinds; the file is the user's
        raise InputError(f"{file} is not a checkpoint of mam-sim: {error}") from error
    shapes = {k: v.shape for k, v in policy.state_dict().items()}
    if {k: v.shape for k, v in state["policy"].items()} != shapes or state.get("task") != task:
        return 0, float("nan")  # another network, more episodes, more epochs: train anew
    policy.load_state_dict(state["policy"])
    optimiser.load_state_dict(state["optimiser"])
    schedule.load_state_dict(state["schedule"])
    return int(state["epoch"]), float(state["loss"])
