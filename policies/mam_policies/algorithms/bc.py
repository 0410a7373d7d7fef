"""Behaviour cloning from the scripted expert: demonstrations, then a small network, in minutes.

The expert acts with noise on its targets while the noise-free target is the label, so that the
policy learns to come back to the path (as in DART). Time is an input and actions come in chunks,
because phases of the task look alike to a memoryless policy. In further rounds the student acts and
the expert says what it would have done (as in DAgger). Episodes are kept one file each and training
checkpoints every few epochs: a killed run goes on where it was, to the same end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from mam_pipeline.errors import InputError
from mam_pipeline.optional import has
from mam_policies.expert import Expert, PlanningError
from mam_policies.run import (
    Actor,
    EnvChoice,
    MlpPolicy,
    RunInfo,
    TrainingError,
    claim,
    describe_env,
    few_objects,
    flat,
)

OnProgress = Callable[[str, float, str], None]
LOST = 0.5  # radians off the plan from which its rows are no longer the way back


@dataclass(frozen=True)
class BcConfig:
    """Settings of behaviour cloning.

    Attributes:
        episodes: successful demonstrations to learn from.
        noise: standard deviation of the expert's execution noise, radians; every third episode
            has none.
        chunk: actions predicted at once. hidden: layer widths.
        epochs, batch, learning_rate: of Adam with a cosine schedule.
        hold: steps of standing still after success that are recorded too.
        deployable: see no velocities and no touch, which real arms do not report: positions only.
        rounds: times that the student acts in `round_episodes` episodes under the expert's eyes and
            is then trained anew on everything; they end early at a success share of `stop_at`.
    """

    episodes: int = 80
    noise: float = 0.008
    chunk: int = 8
    hidden: tuple[int, ...] = (256, 256)
    epochs: int = 150
    batch: int = 256
    learning_rate: float = 1e-3
    hold: int = 6
    seed: int = 0
    deployable: bool = False
    rounds: int = 0
    round_episodes: int = 20
    stop_at: float = 0.95


@dataclass(frozen=True)
class Demonstration:
    """One episode: observations (T, n) and the expert's clean actions (T, m).

    `success` is that of whoever acted: the expert, or the student in a later round.
    """

    obs: np.ndarray
    actions: np.ndarray
    success: bool = True


def train_bc(
    choice: EnvChoice, config: BcConfig, out: Path, progress: OnProgress = lambda *_: None
) -> RunInfo:
    """Collect demonstrations and clone them into the run folder `out`.

    Raises:
        TrainingError: the expert succeeds too seldom to learn from.
    """
    out.mkdir(parents=True, exist_ok=True)
    env = choice.make()
    try:
        sizes = describe_env(env)
        claim(out, choice, f"noise {config.noise} hold {config.hold} seed {config.seed}")
        with few_objects():
            demos = demonstrations(env, config, out / "demos", progress)
            policy = _network(choice, config, sizes)
            loss = fit(policy, demos, config, out / "checkpoint", progress)
            results: dict[str, Any] = {"demonstrations": len(demos), "rounds": []}
            for k in range(1, config.rounds + 1):
                shown = student_episodes(env, policy, config, k, out / f"round_{k}", progress)
                rate = float(np.mean([d.success for d in shown])) if shown else 0.0
                results["rounds"].append(rate)
                if rate >= config.stop_at:
                    break
                demos += shown
                loss = fit(policy, demos, config, out / f"checkpoint_{k}", progress)
    finally:
        env.close()
    policy.save(out)
    info = RunInfo(
        "bc",
        choice,
        sizes["observation"],
        sizes["action_dim"],
        sizes["arm_joints"],
        asdict(config),
        {**results, "loss": loss},
    )
    info.save(out)
    return info


def _network(choice: EnvChoice, config: BcConfig, sizes: dict[str, Any]) -> MlpPolicy:
    absolute = choice.control_mode == "pd_joint_pos"
    return MlpPolicy(
        sizes["observation"][-1][2],
        sizes["action_dim"],
        sizes["arm_joints"],
        config.chunk,
        config.hidden,
        choice.max_steps,
        relative=absolute,
        squash="none" if absolute else "clip",
        inputs=positions(sizes["observation"]) if config.deployable else None,
    )


def positions(rows: list[tuple[str, int, int, bool]]) -> tuple[int, ...]:
    """Entries of the flat observation that hold no velocity and no touch."""
    unseen = ("agent/qvel", "extra/privileged/joint_speed", "extra/privileged/touching")
    return tuple(i for name, a, b, _ in rows for i in range(a, b) if name not in unseen)


def demonstrations(
    env: Any, config: BcConfig, folder: Path, progress: OnProgress = lambda *_: None
) -> list[Demonstration]:
    """`config.episodes` successes of the expert; those already in `folder` are taken from there.

    Episodes in which the expert would have to try again are left out: they teach a second way of
    doing the same, which a unimodal policy would average with the first.

    Raises:
        TrainingError: after 20 tries fewer than one in five is usable.
    """
    folder.mkdir(parents=True, exist_ok=True)
    kept: list[Demonstration] = []
    tried, reasons = 0, []
    while len(kept) < config.episodes:
        file = folder / f"{tried:05d}.npz"
        if not file.is_file():
            noise = 0.0 if tried % 3 == 0 else config.noise
            found = record(env, config.seed * 1_000_003 + tried, noise, config.hold)
            _write(file, found)
        with np.load(file) as data:
            if data["obs"].size:
                kept.append(Demonstration(data["obs"], data["actions"]))
            else:
                reasons.append(str(data["reason"]))
        tried += 1
        progress("demonstrations", len(kept) / config.episodes, f"{len(kept)} of {tried} tries")
        if tried >= 20 and len(kept) < tried / 5:
            raise TrainingError(
                f"the expert succeeds in {len(kept)} of {tried} tries: {reasons[-1]}"
            )
    return kept


def record(env: Any, seed: int, noise: float, hold: int) -> Demonstration | str:
    """One episode of the expert with a single plan; the reason where that failed."""
    obs, _ = env.reset(seed=seed)
    expert = Expert(env, noise=noise, seed=seed, attempts=1)  # a second plan is not wanted
    try:
        expert.reset()
    except PlanningError as error:
        return str(error)
    spec, left = env.unwrapped.robot_spec, hold
    seen, labels = [], []
    while True:
        action = expert.act()
        if expert.phase == "done" and left == hold:
            return expert.reason
        clean = spec.action(expert.target, expert.gripper) if noise else action
        if expert.mode != "pd_joint_pos":
            clean = expert._delta(env.unwrapped.planner_state(), expert.target)
        seen.append(flat(obs))
        labels.append(clean)
        obs, _, _, truncated, info = env.step(action)
        if bool(np.asarray(info["success"]).reshape(-1)[0]) or left < hold:
            left -= 1
            if left <= 0:
                return Demonstration(np.stack(seen), np.stack(labels))
        if bool(np.asarray(truncated).reshape(-1)[0]):
            return "out of time"


def student_episodes(
    env: Any,
    policy: MlpPolicy,
    config: BcConfig,
    number: int,
    folder: Path,
    progress: OnProgress = lambda *_: None,
) -> list[Demonstration]:
    """Round `number`: the student acts, the expert's plan labels what it sees (DAgger, Ross 2011).

    The student's clock is the plan's, so the label of step t is the plan's row t: the way back to
    the path. Starts for which the expert finds no plan are left out.
    """
    folder.mkdir(parents=True, exist_ok=True)
    kept: list[Demonstration] = []
    for i in range(config.round_episodes):
        file = folder / f"{i:05d}.npz"
        if not file.is_file():
            seed = config.seed * 1_000_003 + 100_000 * number + i
            _write(file, shadow(env, policy, seed))
        with np.load(file) as data:
            if data["obs"].size:
                kept.append(Demonstration(data["obs"], data["actions"], bool(data["success"])))
        good = sum(d.success for d in kept)
        share, words = (i + 1) / config.round_episodes, f"student {good} of {len(kept)}"
        progress(f"round {number}", share, words)
    return kept


def shadow(env: Any, policy: MlpPolicy, seed: int) -> Demonstration | str:
    """One episode of the student with the expert's labels, until success or until it is lost."""
    obs, _ = env.reset(seed=seed)
    expert = Expert(env, attempts=1)
    try:
        expert.reset()
    except PlanningError as error:
        return str(error)
    spec, plan, actor = env.unwrapped.robot_spec, expert.plan, Actor(policy)
    seen, labels = [], []
    for t in range(len(plan)):
        seen.append(flat(obs))
        labels.append(spec.action(plan.arm[t], float(plan.gripper[t])))
        obs, _, _, truncated, info = env.step(actor.act(obs))
        success = bool(np.asarray(info["success"]).reshape(-1)[0])
        away = np.abs(env.unwrapped.planner_state().arm - plan.arm[t]).max()
        if success or away > LOST or bool(np.asarray(truncated).reshape(-1)[0]):
            break
    return Demonstration(np.stack(seen), np.stack(labels), success)


def fit(
    policy: MlpPolicy,
    demos: list[Demonstration],
    config: BcConfig,
    folder: Path,
    progress: OnProgress = lambda *_: None,
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
        progress("training", (epoch + 1) / config.epochs, f"loss {loss:.4f}")
        if (epoch + 1) % 25 == 0 or epoch + 1 == config.epochs:
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


def _write(file: Path, found: Demonstration | str) -> None:
    temporary = file.with_suffix(".part.npz")
    if isinstance(found, str):
        np.savez_compressed(temporary, obs=np.zeros(0), actions=np.zeros(0), reason=found)
    else:
        arrays: dict[str, Any] = asdict(found)
        np.savez_compressed(temporary, **arrays, reason="")
    temporary.replace(file)


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
    torch.save(state, folder / "part.pt")
    (folder / "part.pt").replace(folder / "last.pt")


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
