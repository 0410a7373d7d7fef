"""The README of an exported policy: command lines, what must be perceived, how to place things."""

from __future__ import annotations

import json
import shlex
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from mam_pipeline.folder_data import dataset_folder
from mam_policies.collection import Collection
from mam_policies.lerobot.dataset import FPS, IMAGES, REPO_ID
from mam_policies.lerobot.joint_mapping import JointMapping
from mam_policies.lerobot.policy import PERCEIVED
from mam_policies.mlp import MlpPolicy
from mam_policies.run import EnvChoice, RunInfo
from mam_policies.task_words import task_words

HANDLE_ROWS = ("handle_position", "tcp_to_handle")
VALUE_ROWS = ("joint_value", "joint_speed", "open_fraction", "progress")
PERCEPTION: dict[str, tuple[str, tuple[str, ...], float]] = dict(
    zip(
        PERCEIVED,
        (
            ("grasp point, x in the robot's base frame, metres", HANDLE_ROWS, 0.6),
            ("the same, y (left)", HANDLE_ROWS, 0.0),
            ("the same, z (up)", HANDLE_ROWS, 0.3),
            ("the object's joint, radians or metres, 0 in the asset's own pose", VALUE_ROWS, 0.0),
            ("1 while the hand touches the moving part, else 0", ("touching",), 0),
        ),
        strict=True,
    )
)
"""Of each perceived value: its meaning, the observation entries that follow from it, an example."""


def write_readme(
    folder: Path,
    out: Path,
    env: Any,
    info: RunInfo,
    choice: EnvChoice,
    joints: JointMapping,
    policy: MlpPolicy,
    states: list[str],
) -> None:
    """Write README.md of one of our policies, and camera.png where a picture can be drawn."""
    place = np.asarray(env.unwrapped.layout(0).placement.base, dtype=float)
    seen = set(range(policy.obs_dim)) if policy.inputs is None else set(policy.inputs)
    _write(
        "policy.md.j2",
        folder,
        {
            **_page(folder, out, env, info, choice, joints),
            "states": states,
            "perceived": [
                (name, meaning, _uses(rows, seen, info))
                for name, (meaning, rows, _) in PERCEPTION.items()
            ],
            "example": json.dumps({name: value for name, (*_, value) in PERCEPTION.items()}),
            "best_trajectory": (folder / "best_trajectory").is_dir(),
            "base": place[:3, 3],
            "yaw": np.degrees(np.arctan2(place[1, 0], place[0, 0])),
        },
    )


def write_lerobot_readme(
    folder: Path, out: Path, env: Any, info: RunInfo, joints: JointMapping
) -> None:
    """Write README.md of one of LeRobot's own policies, and camera.png where it can be drawn."""
    cameras = env.unwrapped.config.scene.cameras if info.config.get("cameras", True) else {}
    listed = [{"name": k, "width": c.width, "height": c.height} for k, c in cameras.items()]
    page = _page(folder, out, env, info, info.env, joints)
    _write("lerobot_policy.md.j2", folder, {**page, "cameras": listed})


def write_dataset_readme(folder: Path, out: Path, found: Collection, joints: JointMapping) -> None:
    """Write README.md of a dataset in `folder`/dataset, which will lie in `out`/dataset."""
    from mam_policies.lerobot.training import LeRobotTraining, training_arguments

    info = dataset_folder(folder / "dataset")
    own = ("observation.", "action", "next.")
    rows = {k: v for k, v in info.features.items() if k.startswith(own)}
    cameras = any(name.startswith(IMAGES) for name in rows)
    act = LeRobotTraining(
        "--policy.type=act", 100_000, 8, 1000, cameras, False,
        ("--policy.pretrained_backbone_weights=null",),
    )  # fmt: skip
    words = training_arguments(out / "dataset", rows, act, Path("act"))
    table = [
        (name, " x ".join(map(str, row.shape)) if name.startswith(IMAGES) else
         ", ".join(f"`{n}`" for n in row.names or [row.dtype]))
        for name, row in rows.items()
    ]  # fmt: skip
    shown = found.outcomes[found.kept[0]]
    page = {
        "asset": found.asset, "joint": shown.joint, "asked": found.config.task,
        "robot": found.config.robot, **_mapped(out, joints),
    }  # fmt: skip
    _write(
        "dataset.md.j2",
        folder,
        {
            **page, "page": page, "task": shown.task, "episodes": info.total_episodes,
            "fps": info.fps, "lerobot": metadata.version("lerobot"), "repo_id": REPO_ID,
            "root": out / "dataset", "features": table, "cameras": cameras,
            "units": _units(joints),
            "train": " \\\n  ".join(["lerobot-train", *map(shlex.quote, words)]),
        },
    )  # fmt: skip


def _page(
    folder: Path, out: Path, env: Any, info: RunInfo, choice: EnvChoice, joints: JointMapping
) -> dict[str, Any]:
    """What both pages know; the shared templates get it as `page`."""
    base = env.unwrapped
    spec, layout = base.robot_spec, base.layout(0)
    mapped = _mapped(out, joints)
    driver, mapping = mapped["driver"], mapped["mapping"]
    simulated = [
        f"--robot.asset={choice.assets[0]}",
        *([f"--robot.joint={choice.joint}"] if choice.joint else []),
        f"--robot.robot={choice.robot}",
        "--robot.log=episodes.jsonl",
        *([f"--robot.mapping={mapping}"] if driver else []),
    ]
    # twice the motion per step that the expert keeps to, in the arm's unit
    clip = 2 * spec.step / abs(float(joints.arrays([spec.arm[0]])[0][0]))
    page = {
        "algo": info.algo,
        "lerobot": metadata.version("lerobot"),
        "rollout": rolls_out(),
        "task": task_words(base),
        "object": layout.model.asset.card.name,
        "robot": spec.uid,
        "asset": choice.assets[0],
        "joint": layout.goals[0].joint,
        "fps": FPS,
        "units": _units(joints),
        "out": out,
        **mapped,
        "asked": choice.task,
        "simulated": " ".join(simulated),
        "clip": f"--robot.max_relative_target={clip:.3g}",
        "view": _picture(env, folder / "camera.png"),
    }
    return {**page, "page": page}


def _mapped(out: Path, joints: JointMapping) -> dict[str, Any]:
    """The mapping file, and the arm's driver in LeRobot ("" where it has none)."""
    driver = joints.robot if joints.robot.endswith("_follower") else ""
    return {"mapping": out / "joint_mapping.yaml", "driver": driver}


def _units(joints: JointMapping) -> str:
    return ", ".join(sorted({m.unit for m in joints.motors}))


def rolls_out() -> bool:
    """Whether the installed LeRobot runs policies by lerobot-rollout; else lerobot-record does."""
    return find_spec("lerobot.scripts.lerobot_rollout") is not None


def _write(template: str, folder: Path, values: dict[str, Any]) -> None:
    pages = Environment(
        loader=PackageLoader("mam_policies.lerobot"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
    text = pages.get_template(template).render(values)
    (folder / "README.md").write_text(text.rstrip() + "\n", encoding="utf-8")


def _uses(wanted: tuple[str, ...], seen: set[int], info: RunInfo) -> bool:
    """Whether the network sees any of these entries of the observation."""
    return any(
        row.rsplit("/", 1)[-1] in wanted and seen & set(range(start, stop))
        for row, start, stop, _ in info.observation
    )


def _picture(env: Any, file: Path) -> dict[str, list[float]] | None:
    """Draw the scene from the default camera; its eye and target, or None if nothing can draw."""
    import imageio.v2 as imageio

    from mam_envs.scene.video import Camera, default_view

    try:
        imageio.imwrite(file, Camera(env).shoot())
    except (RuntimeError, OSError, ImportError):
        return None
    eye, target = (np.round(v, 3).tolist() for v in default_view(env.unwrapped.layout(0)))
    return {"eye": eye, "target": target}
