"""LeRobot's own learners (act, diffusion, smolvla) as students of the scripted expert.

A student sees cameras and motor values only, as on a real arm; its teacher, the scripted expert,
knows everything. Demonstrations are collected with cameras, written in motor units, and given to
stock `lerobot-train`. In further rounds the student acts, the expert's plan says what it would have
done (DAgger, Ross 2011), and training goes on with those episodes added. Without cameras
the privileged state stands in for them: quick on a CPU, but no policy for a real arm.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray

from mam_pipeline.errors import BackendError, ConfigError, InputError
from mam_pipeline.optional import require
from mam_policies.algorithms.bc import LOST
from mam_policies.collect import CollectConfig, Collected, collect
from mam_policies.lerobot.dataset import Names, Track, offline, write_dataset
from mam_policies.lerobot.export import MAPPING, export_dataset
from mam_policies.lerobot.joint_mapping import JointMapping
from mam_policies.lerobot.robot_interface import mapping_of
from mam_policies.run import EnvChoice, RunInfo, TrainingError, describe_env, few_objects, flat

Kind = Literal["act", "diffusion", "smolvla"]
OnProgress = Callable[[str, float, str], None]
IMAGE = "observation.images."
WITHOUT_DOWNLOADS: dict[str, tuple[str, ...]] = {
    "act": ("--policy.pretrained_backbone_weights=null",),
    "diffusion": (),  # LeRobot's default starts from nothing
}
"""Arguments that keep a learner from asking for weights on the Hub."""


@dataclass(frozen=True)
class StudentConfig:
    """Settings of LeRobot's training.

    Attributes:
        kind: LeRobot's policy type. steps, batch: of its training, in every round.
        episodes, noise: demonstrations, and the expert's execution noise in them, radians.
        cameras: see pictures and motors; else motors and the privileged state.
        rounds, round_episodes: further rounds in which the student acts.
        download: start from weights on the Hub (ImageNet for act, the base model for smolvla).
        more: further arguments for lerobot-train, as they are.
    """

    kind: Kind = "act"
    steps: int = 20_000
    batch: int = 8
    episodes: int = 50
    noise: float = 0.008
    cameras: bool = True
    rounds: int = 0
    round_episodes: int = 20
    download: bool = False
    seed: int = 0
    more: tuple[str, ...] = ()


def train_student(
    choice: EnvChoice,
    config: StudentConfig,
    out: Path,
    mapping: Path | None = None,
    progress: OnProgress = lambda *_: None,
) -> RunInfo:
    """Collect, train with LeRobot, and leave its policy folder in out/policy.

    Args:
        mapping: joint mapping file; needed for arms that LeRobot drives (see export).

    Raises:
        ConfigError, HintNeeded: several assets; a learner that needs downloads; no mapping.
        BackendError: no Vulkan driver for the cameras. TrainingError: lerobot-train failed.
    """
    offline_wish(config)
    if len(choice.assets) != 1:
        raise ConfigError(f"{config.kind} is trained on one asset at a time")
    out.mkdir(parents=True, exist_ok=True)
    wish = CollectConfig(
        choice.assets[0], config.episodes, choice.joint, choice.task, choice.robot,
        seed=config.seed * 1_000_003, noise=config.noise, video=config.cameras,
        max_steps=choice.max_steps,
    )  # fmt: skip
    found: Collected = collect(
        wish, out / "demos", lambda n, of, words: progress("demonstrations", n / of, words)
    )
    export_dataset(out / "demos", out / "data", mapping)
    policy = train_policy(out / "data" / "dataset", config, out / "lerobot", progress)
    env = choice.make(**view(config.cameras))
    try:
        sizes = describe_env(env)
        for k in range(1, config.rounds + 1):
            with few_objects():
                _student_round(env, policy, config, out, k, progress)
            data = _joined(out, k)
            policy = train_policy(data, config, out / f"lerobot_{k}", progress)
    finally:
        env.close()
    _put(policy, out / "policy")
    shutil.copy(out / "data" / MAPPING, out / MAPPING)
    info = RunInfo(
        config.kind, choice, sizes["observation"], sizes["action_dim"], sizes["arm_joints"],
        asdict(config), {"demonstrations": found.episodes, "steps": config.steps},
    )  # fmt: skip
    info.save(out)
    return info


def offline_wish(config: StudentConfig) -> None:
    """Keep LeRobot off the network unless downloads were asked for.

    Raises:
        ConfigError: this learner has no beginning without them.
    """
    if config.download:
        return
    if config.kind not in WITHOUT_DOWNLOADS:
        raise ConfigError(f"{config.kind} starts from weights on the Hub; add --download")
    offline()


def view(cameras: bool) -> dict[str, Any]:
    """Arguments of the environment for a student."""
    return {"obs_mode": "rgb+state"} if cameras else {}


def train_policy(
    dataset: Path, config: StudentConfig, folder: Path, progress: OnProgress = lambda *_: None
) -> Path:
    """Run `lerobot-train`, or let it go on from its last checkpoint; returns its policy folder.

    Raises:
        TrainingError: it ended with an error; the last words are in the message.
    """
    last = folder / "checkpoints" / "last"
    policy = last / "pretrained_model"
    step = last / "training_state" / "training_step.json"
    if step.is_file() and int(json.loads(step.read_text())["step"]) >= config.steps:
        return policy
    command = [sys.executable, "-m", "lerobot.scripts.lerobot_train"]
    if step.is_file():
        command += [f"--config_path={policy / 'train_config.json'}", "--resume=true"]
        command += [f"--steps={config.steps}"]
    else:
        shutil.rmtree(folder, ignore_errors=True)
        command += _arguments(dataset, config, folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    said: list[str] = []
    around = {k: v for k, v in os.environ.items() if k != "HF_HUB_OFFLINE" or not config.download}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
        env=around,
    ) as process:  # fmt: skip
        for line in process.stdout or ():
            said = [*said[-30:], line.rstrip()]
            found = re.search(r"step:([\d.]+)([KM]?) .*loss:([\d.]+)", line)
            if found:
                size = {"": 1, "K": 1e3, "M": 1e6}[found[2]]
                done = float(found[1]) * size / config.steps
                progress(config.kind, min(done, 1.0), f"loss {found[3]}")
                _keep_last(folder / "checkpoints")
    _keep_last(folder / "checkpoints")
    if process.returncode != 0 or not policy.is_dir():
        words = next((s for s in reversed(said) if s.strip()), "it said nothing")
        raise TrainingError(f"lerobot-train ended with status {process.returncode}: {words}")
    return policy


def _keep_last(checkpoints: Path) -> None:
    """Delete what is older than the checkpoint to go on from: one may take gigabytes."""
    last = checkpoints / "last"
    newest = int(last.resolve().name) if last.exists() else 0
    for folder in checkpoints.glob("[0-9]*"):
        if int(folder.name) < newest:
            shutil.rmtree(folder, ignore_errors=True)


def _arguments(dataset: Path, config: StudentConfig, folder: Path) -> list[str]:
    features = json.loads((dataset / "meta" / "info.json").read_text())["features"]
    seen: dict[str, dict[str, Any]] = {}
    for name, feature in features.items():
        shape = list(feature["shape"])
        if name == "observation.state":
            seen[name] = {"type": "STATE", "shape": shape}
        elif name.startswith(IMAGE) and config.cameras:
            seen[name] = {"type": "VISUAL", "shape": [shape[2], shape[0], shape[1]]}
        elif name == "observation.environment_state" and not config.cameras:
            seen[name] = {"type": "ENV", "shape": shape}
    policy = f"--policy.type={config.kind}"
    if config.kind == "smolvla":
        policy = "--policy.path=lerobot/smolvla_base"
    out = [
        policy, f"--policy.input_features={json.dumps(seen)}", "--policy.push_to_hub=false",
        "--dataset.repo_id=local/mam_sim", f"--dataset.root={dataset}", f"--output_dir={folder}",
        f"--steps={config.steps}", f"--batch_size={config.batch}", f"--seed={config.seed}",
        f"--save_freq={max(config.steps // 10, 1)}", f"--log_freq={max(config.steps // 200, 1)}",
        "--wandb.enable=false",
    ]  # fmt: skip
    if not torch.cuda.is_available():
        out += ["--policy.device=cpu", "--num_workers=0"]
    if not config.download:
        out += WITHOUT_DOWNLOADS[config.kind]
    return [*out, *config.more]


class Student:
    """A LeRobot policy folder acting in our environment, through LeRobot's own pipelines."""

    def __init__(self, folder: Path, base: Any, mapping: JointMapping) -> None:
        """Load the policy; `base` is the unwrapped environment.

        Raises:
            InputError: no such policy there, or one that needs inputs which nobody gives.
        """
        require("a LeRobot policy", "lerobot")
        from lerobot.configs.policies import PreTrainedConfig
        from lerobot.policies.factory import get_policy_class, make_pre_post_processors

        if not (folder / "model.safetensors").is_file():
            raise InputError(f"{folder} holds no policy of LeRobot (no model.safetensors)")
        config = PreTrainedConfig.from_pretrained(folder)
        if not torch.cuda.is_available():
            config.device = "cpu"
        self.policy = get_policy_class(config.type).from_pretrained(folder, config=config)
        self.before, self.after = make_pre_post_processors(config, str(folder))
        self.device = torch.device(str(config.device))
        self.inputs = set(config.input_features)
        self.spec, self.mapping = base.robot_spec, mapping
        self.joints = [j.name for j in base.agent.robot.active_joints]
        self.moved = [*self.spec.arm, self.spec.gripper[0]]
        self.hidden = sum(b - a for _, a, b, secret in base.observation_layout() if secret)
        goal = base.layout(0).goals[0]
        self.task = f"{goal.task.replace('turn_to', 'turn')} {goal.joint.replace('_', ' ')}"

    def reset(self) -> None:
        """Start an episode."""
        self.policy.reset()

    def look(self, obs: Any) -> dict[str, NDArray[Any]]:
        """Our batched observation under LeRobot's names, in motor units."""
        state = flat(obs["state"] if isinstance(obs, dict) else obs)
        motors = self.mapping.to_real(self.joints, state[: len(self.joints)].astype(float))
        out: dict[str, NDArray[Any]] = {
            "observation.state": motors.astype(np.float32),
            "observation.environment_state": state[len(state) - self.hidden :],
        }
        for name, data in (obs["sensor_data"] if isinstance(obs, dict) else {}).items():
            if "rgb" in data:
                out[IMAGE + name] = np.asarray(data["rgb"].cpu())[0].astype(np.uint8)
        return out

    def act(self, obs: Any) -> NDArray[np.float32]:
        """The environment's action for its observation."""
        from lerobot.utils.control_utils import predict_action

        seen = {k: v for k, v in self.look(obs).items() if k in self.inputs}
        target = predict_action(
            seen, self.policy, self.device, self.before, self.after, False, self.task
        )
        sim = self.mapping.to_sim(self.moved, target.reshape(-1).cpu().numpy().astype(float))
        return np.asarray(self.spec.action(sim[:-1], float(sim[-1])), dtype=np.float32)


def _student_round(
    env: Any, policy: Path, config: StudentConfig, out: Path, number: int, progress: OnProgress
) -> None:
    """Let the student act; keep its episodes, labelled by the expert, one file each."""
    from mam_policies.lerobot.joint_mapping import load_mapping

    folder = out / f"round_{number}"
    folder.mkdir(exist_ok=True)
    base = env.unwrapped
    joints = load_mapping(out / "data" / MAPPING, [j.name for j in base.agent.robot.active_joints])
    student: Student | None = None
    for i in range(config.round_episodes):
        file = folder / f"{i:05d}.npz"
        if not file.is_file():
            student = student or Student(policy, base, mapping_of(base, joints))
            seed = config.seed * 1_000_003 + 100_000 * number + i
            rows: dict[str, Any] = _shadow(env, student, seed)
            np.savez_compressed(file.with_suffix(".part.npz"), **rows)
            file.with_suffix(".part.npz").replace(file)
        progress(f"round {number}", (i + 1) / config.round_episodes, f"{i + 1} episodes")


def _shadow(env: Any, student: Student, seed: int) -> dict[str, NDArray[Any]]:
    """One episode of the student with the expert's targets in motor units; {} without a plan."""
    from mam_policies.expert import Expert, PlanningError

    obs, _ = env.reset(seed=seed)
    expert = Expert(env, attempts=1)
    try:
        expert.reset()
    except PlanningError:
        return {}
    student.reset()
    rows: dict[str, list[Any]] = {"action": [], "success": []}
    for arm, gripper in zip(expert.plan.arm, expert.plan.gripper):
        for key, value in student.look(obs).items():
            rows.setdefault(key, []).append(value)
        target = student.mapping.to_real(student.moved, np.append(arm, gripper))
        rows["action"].append(target.astype(np.float32))
        obs, _, _, truncated, info = env.step(student.act(obs))
        rows["success"].append(bool(np.asarray(info["success"]).reshape(-1)[0]))
        away = np.abs(env.unwrapped.planner_state().arm - arm).max()
        if rows["success"][-1] or away > LOST or bool(np.asarray(truncated).reshape(-1)[0]):
            break
    return {k: np.stack(v) for k, v in rows.items()}


def _joined(out: Path, rounds: int) -> Path:
    """The demonstrations and all rounds so far as one dataset."""
    require("LeRobot's training", "lerobot")
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    from mam_policies.lerobot.dataset import REPO_ID

    root = out / f"data_{rounds}"
    source = LeRobotDataset(REPO_ID, root=out / "data" / "dataset")
    labels = {k: tuple(source.features[k]["names"]) for k in ("observation.state", "action")}
    hidden = tuple(source.features["observation.environment_state"]["names"])
    names = Names(labels["observation.state"], labels["action"], hidden)
    task = str(source.meta.tasks.index[0])
    robot = str(source.meta.robot_type)

    def old() -> Iterator[tuple[Track, NDArray[np.float32]]]:
        for row in source.meta.episodes:
            frames = [source[i] for i in range(row["dataset_from_index"], row["dataset_to_index"])]
            pictures = {
                k[len(IMAGE) :]: np.stack([_bytes(f[k]) for f in frames])
                for k in frames[0]
                if k.startswith(IMAGE)
            }
            state, action, secret = (
                np.stack([np.asarray(f[k]) for f in frames])
                for k in ("observation.state", "action", "observation.environment_state")
            )
            good = bool(frames[-1]["next.success"])
            rewards = np.array([float(f["next.reward"]) for f in frames], dtype=np.float32)
            yield Track(state, action, secret, pictures, good, task), rewards

    def new() -> Iterator[tuple[Track, NDArray[np.float32]]]:
        for file in sorted(out.glob("round_*/[0-9]*[0-9].npz")):
            with np.load(file) as data:
                if int(file.parent.name.split("_")[1]) > rounds or "action" not in data:
                    continue
                pictures = {k[len(IMAGE) :]: data[k] for k in data if k.startswith(IMAGE)}
                yield (
                    Track(
                        data["observation.state"], data["action"],
                        data["observation.environment_state"], pictures,
                        bool(data["success"][-1]), task,
                    ),
                    np.zeros(len(data["action"]), dtype=np.float32),
                )  # fmt: skip

    def everything() -> Iterator[tuple[Track, NDArray[np.float32]]]:
        yield from old()
        yield from new()

    return write_dataset(everything(), names, robot, root)


def _bytes(picture: Any) -> NDArray[np.uint8]:
    """(3, h, w) in 0..1 as (h, w, 3) uint8."""
    values = np.asarray(picture, dtype=np.float32).transpose(1, 2, 0)
    return np.clip(np.round(255 * values), 0, 255).astype(np.uint8)


def _put(policy: Path, place: Path) -> None:
    """Copy the policy folder to its place, all or nothing."""
    partial = place.with_name(".policy.partial")
    shutil.rmtree(partial, ignore_errors=True)
    shutil.copytree(policy, partial)
    shutil.rmtree(place, ignore_errors=True)
    partial.replace(place)
    if not (place / "model.safetensors").is_file():
        raise BackendError("lerobot-train left no model.safetensors")
