"""A run or a dataset as LeRobot wants it: policy folder, joint mapping, README, or a dataset.

A folder is built beside its place and renamed when it is whole; a killed export leaves nothing
that looks finished, and the same command makes it anew.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mam_envs.robots import RobotSpec, robot_spec
from mam_pipeline import folders
from mam_pipeline.claims import EXPORT, claim_folder, mark_export
from mam_pipeline.errors import ConfigError, HintNeeded, InputError
from mam_pipeline.folder_data import file_of, policy_folder
from mam_pipeline.optional import require
from mam_policies.collection import Collection, Names, Track
from mam_policies.lerobot.dataset import FPS, offline, write_dataset
from mam_policies.lerobot.joint_mapping import (
    SO_ARMS,
    JointMapping,
    identity,
    load_mapping,
    template,
)
from mam_policies.lerobot.policy import OBSERVED, PERCEIVED, Deployment
from mam_policies.lerobot.robot_interface import RobotInterface, mapping_of
from mam_policies.mlp import MlpPolicy
from mam_policies.run import RunInfo
from mam_policies.settings import ALGORITHMS

MAPPING = "joint_mapping.yaml"
BEST = "best_trajectory"


@dataclass(frozen=True)
class Exported:
    """What was written.

    Attributes:
        folder: of the export. kind: "policy" or "dataset".
        mapping: the joint mapping in it. notes: what the user should know.
        dataset: the folder that LeRobotDataset takes as its root; None for a policy.
    """

    folder: Path
    kind: str
    mapping: Path
    notes: tuple[str, ...] = ()
    dataset: Path | None = None


def export_run(
    run: Path, out: Path, mapping: Path | None = None, asset: str | None = None
) -> Exported:
    """Write the policy folder that stock LeRobot loads by `--policy.path`.

    Args:
        run: run folder. mapping: joint mapping file; needed for robots with real drivers.
        asset: which one, where the run was trained on several (the exported numbers, such as the
            arm's place, belong to one).

    Raises:
        InputError, ConfigError: no run, an algorithm whose policy is neither one small network nor
            LeRobot's, unusable mapping, an input that no robot could give.
        HintNeeded: the robot is real and the mapping is missing; a template is written.
    """
    offline()
    info = RunInfo.load(run)
    learned = ALGORITHMS.load(info.algo)()
    if learned.leaves_lerobot:
        return _export_lerobot_policy(run, info, out, mapping)
    policy = learned.network(run)
    choice = _one_asset(info, asset)
    spec = robot_spec(choice.robot)
    unknown = [name for name, *_ in info.observation if name not in OBSERVED]
    if unknown:
        raise ConfigError(f"the policy sees {', '.join(unknown)}, which no robot could report")
    given = _mapping_for(spec, out, mapping)
    claim_folder(out, EXPORT)
    interface = RobotInterface(choice, given) if choice.control_mode == "pd_joint_pos" else None
    env = choice.make() if interface is None else interface.env
    notes = list(_notes(policy, info))
    try:
        base = env.unwrapped
        joints = mapping_of(base, given)
        plan = deployment(base, info, joints)
        moved = [*spec.arm, spec.gripper[0]]
        states = [*joints.names(plan.joints), *PERCEIVED]
        actions = joints.names(moved)

        def build(folder: Path) -> None:
            from mam_policies.lerobot.export_readme import write_readme

            _write_policy(folder, policy, plan, states, actions)
            joints.save(folder / MAPPING)
            if interface is not None and (run / "demos").is_dir():
                notes.extend(_write_best(run, interface, folder / BEST))
            env.reset(seed=0)
            write_readme(folder, out, env, info, choice, joints, policy, states)
            mark_export(folder, "policy", run)

        _build(out, build)
    finally:
        env.close()
    return Exported(out, "policy", out / MAPPING, tuple(notes))


def _export_lerobot_policy(run: Path, info: RunInfo, out: Path, mapping: Path | None) -> Exported:
    """LeRobot's own policy as it is, in the units it was trained in; only files that were checked
    go along."""
    if mapping is not None and mapping.read_bytes() != file_of(run, MAPPING).read_bytes():
        raise ConfigError(f"{run} was trained in other units; train it with --mapping {mapping}")
    found = policy_folder(run / "policy")
    given = file_of(run, MAPPING)
    claim_folder(out, EXPORT)
    env = info.env.make()
    try:
        joints = mapping_of(env.unwrapped, str(given))

        def build(folder: Path) -> None:
            from mam_policies.lerobot.export_readme import write_lerobot_readme

            for name in found.files:
                shutil.copyfile(found.folder / name, folder / name)
            joints.save(folder / MAPPING)
            env.reset(seed=0)
            write_lerobot_readme(folder, out, env, info, joints)
            mark_export(folder, "policy", run)

        _build(out, build)
    finally:
        env.close()
    return Exported(out, "policy", out / MAPPING)


def export_dataset(collected: Path, out: Path, mapping: Path | None = None) -> Exported:
    """Write a collection's demonstrations as a dataset in the real arm's names and units.

    Raises:
        InputError: no collection there. HintNeeded, ConfigError: see export_run.
    """
    found = Collection.load(collected)
    spec = robot_spec(found.config.robot)
    given = _mapping_for(spec, out, mapping)
    claim_folder(out, EXPORT)
    names = found.names
    state, action = (tuple(n.rsplit(".", 1)[0] for n in row) for row in (names.state, names.action))
    units = {n.rsplit(".", 1)[0]: "metres" if n.endswith(".m") else "radians" for n in names.state}
    joints = given or identity(spec.uid, units)
    real = Names(tuple(joints.names(state)), tuple(joints.names(action)), names.environment)

    def tracks() -> Iterator[tuple[Track, np.ndarray]]:
        for track, reward in found.tracks():
            yield (
                replace(
                    track,
                    state=joints.to_real(state, track.state).astype(np.float32),
                    action=joints.to_real(action, track.action).astype(np.float32),
                ),
                reward,
            )

    def build(folder: Path) -> None:
        from mam_policies.lerobot.export_readme import write_dataset_readme

        # LeRobot makes the dataset's folder itself
        write_dataset(tracks(), real, joints.robot, folder / "dataset")
        joints.save(folder / MAPPING)
        write_dataset_readme(folder, out, found, joints)
        mark_export(folder, "dataset", collected)

    _build(out, build)
    return Exported(out, "dataset", out / MAPPING, dataset=out / "dataset")


def deployment(base: Any, info: RunInfo, joints: JointMapping) -> Deployment:
    """The numbers of an environment that turn motor values into the policy's inputs.

    Raises:
        ConfigError: a control mode that has no absolute targets.
    """
    spec, layout = base.robot_spec, base.layout(0)
    names = [j.name for j in base.agent.robot.active_joints]
    moved = [*spec.arm, spec.gripper[0]]
    scale, offset = joints.arrays(names)
    goal = layout.goals[0]
    gain, bias, moving, limited = _action_terms(base, len(moved))
    return Deployment(
        observation=[list(row[:3]) for row in info.observation],
        joints=names,
        scale=scale.tolist(),
        offset=offset.tolist(),
        arm=[names.index(n) for n in spec.arm],
        gripper=names.index(spec.gripper[0]),
        gain=gain,
        bias=bias,
        moving=moving,
        limited=limited,
        base=np.asarray(layout.placement.base, dtype=float).reshape(-1).tolist(),
        chain=[
            {
                "name": j.name,
                "type": j.type,
                "origin": np.asarray(j.origin).reshape(-1).tolist(),
                "axis": np.asarray(j.axis).tolist(),
            }
            for j in spec.chain.joints
        ],
        locked={k: float(v) for k, v in spec.locked.items()},
        tool=np.asarray(spec.chain.tool).reshape(-1).tolist(),
        # the simulator's sign goes on without a jump, and no arm turns its hand by 180 degrees
        turn=base.tool_pose().raw_pose[0, 3:].tolist(),
        closed=goal.closed,
        opened=goal.open,
        goal=goal.q_goal,
        dt=1.0 / FPS,
    )


def _action_terms(base: Any, count: int) -> tuple[list[float], list[float], list[bool], list[bool]]:
    """(gain, bias, moving, limited) of the first `count` action entries, from the controllers."""
    controller = base.agent.controller
    parts = getattr(controller, "controllers", {"all": controller})
    gain, bias, moving, limited = [], [], [], []
    for part in parts.values():
        settings = part.config
        delta = bool(getattr(settings, "use_delta", False))
        if delta and not getattr(settings, "use_target", False):
            raise ConfigError(
                "the run moves relative to measured joints; train with absolute joint targets"
            )
        normal = bool(getattr(settings, "normalize_action", False))
        size = int(np.prod(part.single_action_space.shape))
        for k in range(size):
            span = (-1.0, 1.0)
            if normal:
                span = (float(part.action_space_low[k]), float(part.action_space_high[k]))
            gain.append((span[1] - span[0]) / 2)
            bias.append((span[1] + span[0]) / 2)
            moving.append(delta)
            limited.append(normal)
    return gain[:count], bias[:count], moving[:count], limited[:count]


def _build(out: Path, build: Callable[[Path], None]) -> None:
    """Call `build` with a fresh folder that takes out's place when it is whole."""
    with folders.new_folder(out) as folder:
        build(folder)


def _write_policy(
    folder: Path, policy: MlpPolicy, plan: Deployment, states: list[str], actions: list[str]
) -> None:
    require("export to LeRobot", "lerobot")
    try:
        import lerobot_policy_mam_sim as plugin
    except ImportError as error:
        raise ConfigError(
            "LeRobot's plug-in is not installed; run: "
            "pip install --no-deps -e plugins/lerobot_policy_mam_sim"
        ) from error
    from lerobot.configs.types import FeatureType, PolicyFeature
    from lerobot.utils.constants import ACTION, OBS_STATE

    config = plugin.MamSimConfig(
        input_features={OBS_STATE: PolicyFeature(FeatureType.STATE, (len(states),))},
        output_features={ACTION: PolicyFeature(FeatureType.ACTION, (len(actions),))},
        device="cpu",
        push_to_hub=False,
        sizes=dict(policy.sizes),
        plan=plan,
        state_names=states,
        action_names=actions,
    )
    wrapped = plugin.MamSimPolicy(config)
    wrapped.net.load_state_dict(policy.state_dict())
    wrapped.save_pretrained(folder)
    before, after = plugin.make_mam_sim_pre_post_processors(config)
    before.save_pretrained(folder)
    after.save_pretrained(folder)


def _write_best(run: Path, interface: RobotInterface, folder: Path) -> Iterator[str]:
    """The best demonstration for lerobot-replay; a note where it no longer succeeds."""
    from mam_policies.lerobot.replay import best_trajectory, write_trajectory

    try:
        trajectory = best_trajectory(run, interface)
    except InputError as error:
        yield f"no trajectory to replay: {error}"
        return
    write_trajectory(trajectory, interface, "replay of the best demonstration", folder)


def _mapping_for(spec: RobotSpec, out: Path, mapping: Path | None) -> JointMapping | None:
    """The user's mapping; None where the robot has no driver in LeRobot (identity will do).

    Raises:
        ConfigError: a robot that drives. HintNeeded: the user has to fill in a mapping first.
    """
    if spec.drive is not None:
        raise ConfigError(
            f"a mapping to a real arm knows no base that drives, as {spec.uid} has; take the "
            "dataset that mam-sim collect writes beside its demonstrations"
        )
    if mapping is not None:
        return load_mapping(mapping, [*spec.arm, spec.gripper[0]])
    if spec.uid not in SO_ARMS:
        return None
    file = out / MAPPING
    if not file.is_file():
        claim_folder(out, EXPORT)
        out.mkdir(parents=True, exist_ok=True)
        folders.write_text(file, template(spec.uid, spec.arm, spec.gripper[0]))
    missing = "sign and offset of every joint, closed and open of the gripper"
    raise HintNeeded(
        f"how {SO_ARMS[spec.uid]} counts its joints is not known here; fill in {missing} in "
        f"{file}, then run again with --mapping {file}"
    )


def _one_asset(info: RunInfo, asset: str | None) -> Any:
    assets = info.env.assets
    if asset is None and len(assets) > 1:
        raise ConfigError(f"the run knows several assets; choose by --asset: {', '.join(assets)}")
    return replace(info.env, assets=(asset or assets[0],))


def _notes(policy: MlpPolicy, info: RunInfo) -> Iterator[str]:
    seen = set(range(policy.obs_dim)) if policy.inputs is None else set(policy.inputs)
    speeds = [n for n, a, b, _ in info.observation if n.endswith(("qvel", "joint_speed"))]
    if any(set(range(a, b)) & seen for n, a, b, _ in info.observation if n in speeds):
        yield (
            "the policy sees velocities; on a robot they are differences of positions. "
            "`mam-sim train --deployable` makes one that needs none"
        )
