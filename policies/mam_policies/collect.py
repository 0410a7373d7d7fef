"""Demonstrations of the expert: one file per attempt, then a ManiSkill h5 and a LeRobot dataset.

Every attempt is written as soon as it ends and under its own name, so a killed run loses at most
the attempt that was running; the same command goes on from there.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
from mani_skill.utils import common

import mam_envs
from mam_envs.config import EnvConfig
from mam_envs.env import OperateJointEnv
from mam_pipeline import config_file, folders
from mam_pipeline.arrays import Arrays
from mam_pipeline.asset.card import Asset
from mam_pipeline.claims import COLLECTION, claim_folder, is_ours
from mam_pipeline.edited import check_ranges
from mam_pipeline.errors import InputError, NotPhysicalError
from mam_policies.collection import CollectConfig, Collection, Names, Outcome, finished, read_claim
from mam_policies.expert import Expert, PlanningError
from mam_policies.lerobot.dataset import write_dataset
from mam_policies.run import task_settings
from mam_policies.task_words import task_words


@dataclass(frozen=True)
class Collected:
    """The result.

    Attributes:
        episodes: in the data; attempts: run in all; reasons: why attempts failed, with counts.
        h5, dataset: the files. resumed: attempts that were there already.
    """

    folder: Path
    episodes: int
    attempts: int
    reasons: dict[str, int]
    h5: Path
    dataset: Path
    resumed: int


Progress = Callable[[int, int, str], None]


def collect(
    asset: str | Path,
    config: CollectConfig,
    out: Path,
    progress: Progress | None = None,
    env_config: EnvConfig | None = None,
) -> Collected:
    """Run the expert until enough attempts have succeeded, and write the data.

    Args:
        asset: folder of the asset.
        config: what is collected.
        out: folder; attempts/ in it is the memory that a resumed run starts from.
        progress: called with (successes, wanted, message) after every attempt.
        env_config: settings of the environment.

    Raises:
        PlacementError: the arm cannot do this joint; the message says why.
        NotPhysicalError: the expert succeeds in less than a fifth of many attempts.
        InputError: `out` holds the data of another collection.
    """
    torch.set_num_threads(1)
    check_ranges(config)
    attempts = out / "attempts"
    asset = str(Path(asset).resolve())
    settings = task_settings(config.task) if env_config is None else env_config
    claim = _Claim(out, {"asset": asset, "collect": config, "env": settings})
    claim.check()
    folders.check_place(out)
    done = finished(out)
    resumed = len(done)
    said = progress or (lambda _got, _want, _text: None)
    env: Any = None
    try:
        while _kept(done, config) < config.episodes:
            k = len(done)
            _not_hopeless(done, config)
            if env is None:
                env = _make(asset, config, settings)  # asset, joint and robot are right
                claim.write()
            outcome = _attempt(env, config, config.seed + k, attempts / f"{k:06d}.npz")
            done.append(outcome)
            text = "success" if outcome.success else outcome.reason
            said(_kept(done, config), config.episodes, text)
        if env is not None:
            _write_names(env, attempts)
        claim.write()
    except BaseException:
        claim.give_back()
        raise
    finally:
        if env is not None:
            env.close()
    said(config.episodes, config.episodes, "writing h5 and LeRobot dataset")
    found = Collection(out, asset, config, settings, done)
    h5 = _write_h5(found)
    root = write_dataset(found.tracks(), found.names, config.robot, out / "lerobot")
    reasons: dict[str, int] = {}
    for o in done:
        if not o.success:
            reasons[o.reason] = reasons.get(o.reason, 0) + 1
    return Collected(out, len(found.kept), len(done), reasons, h5, root, resumed)


class _Claim:
    """collect.json in a folder: whose it is, and what was asked for."""

    def __init__(self, out: Path, wish: dict[str, Any]) -> None:
        self.out, self.file = out, out / "collect.json"
        self.mine = config_file.plain(wish)
        self.fresh, self.made = not self.file.is_file(), not out.exists()

    def check(self) -> None:
        """Raise InputError where the folder holds other data or other things."""
        out, now = self.out, _flat(self.mine)
        if is_ours(self.file, COLLECTION):
            then = _flat(read_claim(self.file))
            differ = [k for k in now if k != "collect.episodes" and now[k] != then.get(k)]
            if differ:
                key = differ[0]
                raise InputError(
                    f"{out} holds a collection with {key}={then.get(key)!r}, not {now[key]!r}; "
                    "take another --out or delete it"
                )
        else:
            folders.sweep(self.file)  # a run that was killed as it began leaves no claim
            attempts = out / "attempts"
            if attempts.is_dir() and not any(attempts.iterdir()):
                attempts.rmdir()
            claim_folder(out, COLLECTION)

    def write(self) -> None:
        """Make the folder and write down what is asked for now."""
        (self.out / "attempts").mkdir(parents=True, exist_ok=True)
        folders.write_text(self.file, json.dumps(self.mine, indent=1) + "\n")

    def give_back(self) -> None:
        """Take the claim back where nothing has come of it: no attempt has ended."""
        if self.fresh and not finished(self.out):
            shutil.rmtree(self.out / "attempts", ignore_errors=True)
            self.file.unlink(missing_ok=True)
            if self.made:
                folders.remove_if_empty(self.out)


def _flat(values: dict[str, Any], above: str = "") -> dict[str, Any]:
    """Nested values by their dotted names."""
    out: dict[str, Any] = {}
    for key, value in values.items():
        out |= _flat(value, f"{above}{key}.") if isinstance(value, dict) else {above + key: value}
    return out


def _kept(done: list[Outcome], config: CollectConfig) -> int:
    return sum(o.success or config.keep_failures for o in done)


def _not_hopeless(done: list[Outcome], config: CollectConfig) -> None:
    good = sum(o.success for o in done)
    if len(done) >= 15 and 5 * good < len(done):
        reason = next(o.reason for o in reversed(done) if not o.success)
        raise NotPhysicalError(
            f"the expert succeeded in {good} of {len(done)} attempts; the last failed because: "
            f"{reason}"
        )


def _make(asset: str, config: CollectConfig, env_config: EnvConfig) -> Any:
    return mam_envs.make(
        asset,
        joint=config.joint,
        task=config.task,
        robot_uids=config.robot,
        control_mode=config.control_mode,
        obs_mode="rgb+state" if config.cameras else "state",
        reward_mode="normalized_dense",
        max_episode_steps=config.steps,
        config=env_config,
    )


def _attempt(env: Any, config: CollectConfig, seed: int, file: Path) -> Outcome:
    """Run one attempt and write it (npz with the frames, then json with the outcome)."""
    base: OperateJointEnv = env.unwrapped
    expert = Expert(env, noise=config.noise, seed=seed)
    obs, _ = env.reset(seed=seed)
    goal = base.layout().goals[0]
    outcome: dict[str, Any] = {"seed": seed, "success": False, "steps": 0, "joint": goal.joint}
    outcome |= {"task": task_words(base), "reason": ""}
    rows: dict[str, list[Any]] = {}
    try:
        expert.reset()
    except PlanningError as error:
        outcome["reason"] = str(error)
    else:
        _run(env, expert, obs, rows, outcome, config.settle)
    if rows:
        arrays: dict[str, Any] = {k: np.stack(v) for k, v in rows.items()}
        with folders.new_file(file) as part:
            np.savez_compressed(part, **arrays)
    folders.write_text(file.with_suffix(".json"), json.dumps(outcome) + "\n")
    return Outcome(**outcome)


def _run(
    env: Any, expert: Expert, obs: Any, rows: dict[str, list[Any]], outcome: dict, settle: int
) -> None:
    base: OperateJointEnv = env.unwrapped
    _keep(rows, "env_states", base.get_state_dict())
    _see(rows, base, obs)
    success, left = False, settle
    while True:
        action = expert.act()
        if expert.phase == "done" and not success:
            break
        clean = expert.clean_action()
        obs, reward, _, truncated, info = env.step(action)
        failed = bool(info.get("fail", [False])[0]) and not success
        success = success or bool(info["success"][0])
        speeds = expert.speeds if base.robot_spec.drive else ()
        target = np.concatenate([expert.target, [expert.gripper], speeds])
        for key, value in (
            ("actions", clean),
            ("executed", action),
            ("targets", target.astype(np.float32)),
            ("rewards", np.float32(reward[0])),
            ("success", success),
            ("phase", expert.phase),
        ):
            rows.setdefault(key, []).append(value)
        _keep(rows, "env_states", base.get_state_dict())
        _see(rows, base, obs)
        left -= success
        if failed or left < 0 or bool(truncated[0]):
            break
    outcome |= {"success": success, "steps": len(rows.get("actions", ()))}
    outcome |= {"plans": len(expert.plans), "open_fraction": float(info["open_fraction"][0])}
    why = "too much force" if failed else expert.reason or "out of time"
    outcome["reason"] = "" if success else why


def _see(rows: dict[str, list[Any]], base: OperateJointEnv, obs: Any) -> None:
    """Record one observation: the flat state, and what cameras saw."""
    state = obs["state"] if isinstance(obs, dict) else obs
    rows.setdefault("obs/state", []).append(common.to_numpy(state)[0].astype(np.float32))
    if isinstance(obs, dict):
        for name, data in obs["sensor_data"].items():
            if "rgb" in data:
                picture = common.to_numpy(data["rgb"])[0].astype(np.uint8)
                rows.setdefault(f"images/{name}", []).append(picture)


def _keep(rows: dict[str, list[Any]], prefix: str, value: Any) -> None:
    if isinstance(value, dict):
        for k, v in value.items():
            _keep(rows, f"{prefix}/{k}", v)
    else:
        rows.setdefault(prefix, []).append(common.to_numpy(value)[0])


def _write_names(env: Any, attempts: Path) -> None:
    """Write names.json, so that a resumed run needs no environment when all attempts are there."""
    base: OperateJointEnv = env.unwrapped
    spec = base.robot_spec
    joints = {j.name: j.type[0] for j in base.agent.robot.active_joints}

    def unit(name: str) -> str:
        return f"{name}.m" if joints[name] == "prismatic" else f"{name}.rad"

    privileged = []
    for name, start, stop, hidden in base.observation_layout():
        if hidden:
            label = name.rsplit("/", 1)[-1]
            many = stop - start > 1
            privileged += [f"{label}.{i}" if many else label for i in range(stop - start)]
    names = Names(
        state=tuple(unit(n) for n in joints),
        action=(
            *(unit(n) for n in spec.arm),
            unit(spec.gripper[0]),
            *(("base_forwards.m_per_s", "base_turning.rad_per_s") if spec.drive else ()),
        ),
        environment=tuple(privileged),
    )
    folders.write_text(attempts / "names.json", json.dumps(asdict(names)))


def _write_h5(found: Collection) -> Path:
    """ManiSkill's trajectory layout: demos.h5 with traj_i groups, demos.json with the episodes."""
    config, out = found.config, found.folder
    kwargs = {
        "asset": str(Asset.load(found.asset).folder),
        "joint": config.joint,
        "task": config.task,
        "robot_uids": config.robot,
        "obs_mode": "state",
        "control_mode": config.control_mode,
        "config": config_file.plain(found.env_config),
    }
    listing: dict[str, Any] = {
        "env_info": {
            "env_id": mam_envs.ENV_ID,
            "max_episode_steps": config.steps,
            "env_kwargs": kwargs,
        },
        "source_type": "motionplanning",
        "source_desc": "mam-sim's inverse-kinematics expert",
        "episodes": [],
    }

    with folders.new_file(out / "demos.h5") as part, h5py.File(part, "w") as file:
        for i, k in enumerate(found.kept):
            group = file.create_group(f"traj_{i}")
            _fill(group, out / "attempts" / f"{k:06d}.npz")
            listing["episodes"].append(_episode(i, found.outcomes[k], config.control_mode))
    folders.write_text(out / "demos.json", json.dumps(listing, indent=2) + "\n")
    return out / "demos.h5"


def _fill(group: h5py.Group, npz: Path) -> None:
    data = Arrays(npz)
    count = len(data["actions"])
    group["actions"] = data["executed"]
    group["rewards"] = data["rewards"]
    group["success"] = data["success"]
    group["terminated"] = data["success"]
    group["truncated"] = np.arange(count) == count - 1
    group["obs"] = data["obs/state"]
    for name in data:
        if name.startswith("env_states/"):
            group[name] = data[name]


def _episode(i: int, outcome: Outcome, control_mode: str) -> dict[str, Any]:
    return {
        "episode_id": i,
        "episode_seed": outcome.seed,
        "control_mode": control_mode,
        "elapsed_steps": outcome.steps,
        "reset_kwargs": {"options": {}, "seed": outcome.seed},
        "success": outcome.success,
        "fail": not outcome.success,
    }
