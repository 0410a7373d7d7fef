"""The README of an exported policy: command lines, what must be perceived, how to place things."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mam_policies.lerobot.dataset import FPS
from mam_policies.lerobot.joint_mapping import JointMapping
from mam_policies.lerobot.policy import PERCEIVED
from mam_policies.mlp import MlpPolicy
from mam_policies.run import EnvChoice, RunInfo

MEANING = {
    "handle.x": "point to hold, x in the robot's base frame, metres",
    "handle.y": "the same, y (left)",
    "handle.z": "the same, z (up)",
    "joint.value": "value of the object's joint, radians or metres, 0 in the asset's own pose",
    "touch": "1 while the hand touches the moving part, else 0",
}
USES = {
    "handle": ("handle_position", "tcp_to_handle"),
    "joint": ("joint_value", "joint_speed", "open_fraction", "progress"),
    "touch": ("touching",),
}


def write_readme(
    folder: Path,
    out: Path,
    env: Any,
    info: RunInfo,
    choice: EnvChoice,
    policy: MlpPolicy,
    joints: JointMapping,
    states: list[str],
) -> None:
    """Write README.md, and camera.png where a picture can be drawn."""
    spec = env.unwrapped.robot_spec
    goal = env.unwrapped.layout(0).goals[0]
    task = f"{goal.task.replace('turn_to', 'turn')} {goal.joint.replace('_', ' ')}"
    real = joints.robot.endswith("_follower")
    picture = _picture(env, folder / "camera.png")
    rows = [f"- `{n}`: {MEANING[n]}{_seen(n, policy, info)}" for n in PERCEIVED]
    place = np.asarray(env.unwrapped.layout(0).placement.base, dtype=float)
    yaw = np.degrees(np.arctan2(place[1, 0], place[0, 0]))
    eye = _camera_words(env) if picture else ""
    body = _sim(choice) + _map(out, real, "robot")
    trial = _record("mam_sim", body, out, task, "--dataset.video=false ", _clip(spec, joints))
    fixed = ", ".join(f'"{n}": {v}' for n, v in zip(PERCEIVED, (0.6, 0.0, 0.3, 0.0, 0)))
    text = f"""# Policy: {task} of {env.unwrapped.layout(0).model.asset.card.name}

Trained by mam-sim ({info.algo}) for the simulated robot `{spec.uid}`. LeRobot 0.4.4 loads this
folder as policy type `mam_sim`; the package `lerobot_policy_mam_sim` must be installed.

Control rate: **{FPS} Hz**. Actions are absolute joint targets; units are in `joint_mapping.yaml`
({_units(joints)}).

## Try it without hardware

```sh
{trial}
```

Success of each episode stands in `episodes.jsonl`. Add `--robot.latency_steps=2`,
`--robot.joint_noise=0.01`, `--robot.handle_noise=0.01` or `--robot.calibration_error=0.02`
to see what it bears, and `--robot.eye_in_hand=true` for a camera on the hand. LeRobot's own
evaluation:

```sh
lerobot-eval --policy.path={out} --env.type=mam_sim --env.asset={choice.assets[0]} \\
  --env.joint={goal.joint} --env.robot={choice.robot}{_map(out, real, "env")} \\
  --env.discover_packages_path=lerobot_policy_mam_sim --eval.n_episodes=10 --eval.batch_size=1
```

Open loop, the best demonstration, where this folder has `best_trajectory`:

```sh
lerobot-replay --robot.type=mam_sim {body} \\
  --dataset.repo_id=local/best --dataset.root={out}/best_trajectory --dataset.episode=0 \\
  --dataset.fps={FPS} --play_sounds=false
```

## On the real arm

{_real_words(real, joints, spec, out, task)}

## What must be perceived

`observation.state` is, in this order: {", ".join(f"`{s}`" for s in states)}.
The motors come from the arm. The rest must come from perception (a marker on the front, a depth
camera), in this order behind the motors:

{chr(10).join(rows)}

A robot that reports motors only can be run with constants measured once:
`--policy.fixed='{{{fixed}}}'` (put your own in).
Then the policy is not told how far the joint has moved; its success under these conditions has not
been measured.

## How to place arm and object

In simulation the object's front faces -x and its floor point is the origin. The arm's base stands
at x {place[0, 3]:.3f}, y {place[1, 3]:.3f}, z {place[2, 3]:.3f} m, turned by {yaw:.1f} degrees.
The policy was trained with the object shifted by up to 2 cm and turned by up to 10 degrees unless
its run says otherwise.
{eye}"""
    (folder / "README.md").write_text(text, encoding="utf-8")


def write_student_readme(
    folder: Path, out: Path, env: Any, info: RunInfo, joints: JointMapping
) -> None:
    """README.md of one of LeRobot's own policies, and camera.png where it can be drawn."""
    spec, choice = env.unwrapped.robot_spec, info.env
    goal = env.unwrapped.layout(0).goals[0]
    task = f"{goal.task.replace('turn_to', 'turn')} {goal.joint.replace('_', ' ')}"
    real = joints.robot.endswith("_follower")
    cameras = env.unwrapped.config.scene.cameras if info.config.get("cameras", True) else {}
    body = _sim(choice) + _map(out, real, "robot") + " --robot.perceived=false"
    body += " --robot.pictures=true" if cameras else ""
    film = "" if cameras else "--dataset.video=false "  # without it LeRobot drops the pictures
    trial = _record("mam_sim", body, out, task, film, _clip(spec, joints))
    eye = _camera_words(env) if _picture(env, folder / "camera.png") else ""
    sees = ", ".join(f"`{k}` {c.width} x {c.height}" for k, c in cameras.items())
    wanted = (
        f"The motors of `joint_mapping.yaml` and the camera {sees}: give the real camera this "
        f"name in `--robot.cameras`, and\nplace it as `camera.png` shows."
        if cameras
        else "The privileged state of the simulator: **no real arm can run this policy**; train "
        "it with cameras."
    )
    text = f"""# Policy: {task} of {env.unwrapped.layout(0).model.asset.card.name}

LeRobot's `{info.algo}`, trained by `lerobot-train` on the demonstrations of mam-sim's expert for
the simulated robot `{spec.uid}`; nothing of ours is needed to load it.

Control rate: **{FPS} Hz**. Actions are absolute joint targets; units are in `joint_mapping.yaml`
({_units(joints)}).

## Try it without hardware

```sh
{trial}
```

## On the real arm

{_real_words(real, joints, spec, out, task)}

## What it sees

{wanted}
{eye}"""
    (folder / "README.md").write_text(text, encoding="utf-8")


def _record(robot: str, arguments: str, out: Path, task: str, extra: str, clip: str) -> str:
    return (
        f"lerobot-record --robot.type={robot} {arguments} {clip} \\\n"
        f"  --policy.path={out} --dataset.repo_id=local/eval_policy --dataset.root=eval_policy \\\n"
        f'  --dataset.single_task="{task}" --dataset.fps={FPS} --dataset.num_episodes=5 \\\n'
        f"  --dataset.episode_time_s=10 --dataset.reset_time_s=1 {extra}\\\n"
        f"  --dataset.push_to_hub=false --play_sounds=false"
    )


def _sim(choice: EnvChoice) -> str:
    joint = f" --robot.joint={choice.joint}" if choice.joint else ""
    return (
        f"--robot.asset={choice.assets[0]}{joint} --robot.robot={choice.robot} "
        "--robot.log=episodes.jsonl"
    )


def _clip(spec: Any, joints: JointMapping) -> str:
    """max_relative_target: twice the motion per step that the expert keeps to, arm's unit."""
    scale = abs(float(joints.arrays([spec.arm[0]])[0][0]))
    return f"--robot.max_relative_target={2 * spec.step / scale:.3g}"


def _map(out: Path, real: bool, what: str) -> str:
    return f" --{what}.mapping={out}/joint_mapping.yaml" if real else ""


def _real_words(real: bool, joints: JointMapping, spec: Any, out: Path, task: str) -> str:
    if not real:
        return (
            f"LeRobot has no driver for `{spec.uid}`. The mapping is the identity, in radians and "
            "metres: a driver\nof your own whose motors are named and measured as in "
            "`joint_mapping.yaml` can run this policy."
        )
    port = "--robot.port=/dev/ttyACM0 --robot.id=my_arm"
    clip = _clip(spec, joints)
    lines = _record(joints.robot, port, out, task, "", clip)
    return f"""Start slowly, a hand at the power switch; `max_relative_target` limits each step.

LeRobot 0.4 and 0.5:

```sh
{lines}
lerobot-replay --robot.type={joints.robot} {port} {clip} \\
  --dataset.repo_id=local/best --dataset.root={out}/best_trajectory \\
  --dataset.episode=0 --dataset.fps={FPS}
```

LeRobot 0.6 (not tried here) runs policies by lerobot-rollout:

```sh
lerobot-rollout --strategy.type=base --policy.path={out} --robot.type={joints.robot} {port} \\
  {clip} --task="{task}" --duration=10
```"""


def _units(joints: JointMapping) -> str:
    return ", ".join(sorted({m.unit for m in joints.motors}))


def _seen(name: str, policy: MlpPolicy, info: RunInfo) -> str:
    """Whether the network looks at it at all."""
    seen = set(range(policy.obs_dim)) if policy.inputs is None else set(policy.inputs)
    wanted = USES[name.split(".")[0]]
    for row, start, stop, _ in info.observation:
        if row.rsplit("/", 1)[-1] in wanted and seen & set(range(start, stop)):
            return ""
    return " (**not used** by this policy; any number will do)"


def _picture(env: Any, file: Path) -> bool:
    """The scene from the default camera, with whatever can draw it; False if nothing can."""
    import imageio.v2 as imageio

    from mam_envs.scene.video import Camera

    try:
        imageio.imwrite(file, Camera(env).shoot())
    except (RuntimeError, OSError, ImportError):
        return False
    return True


def _camera_words(env: Any) -> str:
    from mam_envs.scene.video import _view

    eye, target = (np.round(v, 3).tolist() for v in _view(env.unwrapped.layout(0)))
    return f"""
`camera.png` shows the first pose from eye {eye} looking at {target} (metres, the object's frame;
vertical field of view 50 degrees at 4:3): lay it over your own camera's picture to align both.
"""
