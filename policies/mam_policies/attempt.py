"""One attempt of the expert on a joint, recorded as poses, to be shown anywhere.

    python -m mam_policies.attempt ASSET JOINT ROBOT OUT.npz

runs it in a process of its own: a simulator that crashes takes nothing with it.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mam_pipeline.errors import BackendError, MamSimError
from mam_pipeline.folders import Scratch
from mam_pipeline.guarded import Limits, guarded
from mam_pipeline.types import FloatArray, IntArray

LONGEST = 300.0  # seconds that an attempt may take
MOST_FACES = 1500  # of a link, as it is shown
FPS = 20  # control steps a second


@dataclass(frozen=True)
class Attempt:
    """What happened.

    Attributes:
        success: of the environment. reason: why not, or "". open_fraction: of the joint at the end.
        joints: names of the object's joints. values: (T, J) theirs, radians or metres.
        links: names of the robot's links with a surface. poses: (T, L, 4, 4) asset_T_link.
        surfaces: vertices (V, 3) in the link's frame and faces (F, 3) of each link.
    """

    success: bool
    reason: str
    open_fraction: float
    joints: list[str]
    values: FloatArray
    links: list[str]
    poses: FloatArray
    surfaces: list[tuple[FloatArray, IntArray]]

    def save(self, path: Path) -> None:
        """Write an .npz file."""
        names = ("success", "reason", "open_fraction", "joints", "links")
        head = {name: getattr(self, name) for name in names}
        arrays: dict[str, Any] = {}
        for k, (vertices, faces) in enumerate(self.surfaces):
            arrays |= {f"v{k}": vertices, f"f{k}": faces}
        np.savez(path, head=json.dumps(head), values=self.values, poses=self.poses, **arrays)

    @staticmethod
    def load(path: Path) -> Attempt:
        """Read what `save` wrote."""
        with np.load(path, allow_pickle=False) as data:
            head = json.loads(str(data["head"]))
            surfaces = [(data[f"v{k}"], data[f"f{k}"]) for k in range(len(head["links"]))]
            return Attempt(values=data["values"], poses=data["poses"], surfaces=surfaces, **head)


def attempt(asset: Path, joint: str, robot: str = "panda") -> Attempt:
    """Let the expert try a joint, in another process.

    Args:
        asset: folder. joint: of it. robot: name in `mam_envs.robots.ROBOTS`.

    Raises:
        BackendError: it cannot be tried; the message says why.
    """
    with Scratch() as folder:
        out = Path(folder) / "attempt.npz"
        command = [sys.executable, "-m", "mam_policies.attempt", str(asset), joint, robot, str(out)]
        watched = guarded(command, Limits(LONGEST))
        try:
            done = subprocess.run(watched, capture_output=True, text=True, timeout=LONGEST)
        except subprocess.TimeoutExpired as error:
            raise BackendError(f"the robot was not done after {LONGEST:.0f} s") from error
        if out.is_file():
            return Attempt.load(out)
        said = done.stderr.strip().splitlines()
        raise BackendError(said[-1] if said else f"the simulator ended with {done.returncode}")


def record(asset: Path, joint: str, robot: str, seed: int = 0) -> Attempt:
    """Run one episode in this process.

    Raises:
        MamSimError: no grasp, no place for the arm, an unknown joint or robot.
    """
    import torch
    from mani_skill.utils import common

    import mam_envs
    from mam_envs.scene.video import Camera
    from mam_policies.expert import Expert, PlanningError

    torch.set_num_threads(1)
    env = mam_envs.make(
        asset, joint=joint, robot_uids=robot, control_mode="pd_joint_pos", obs_mode="state",
        render_mode=None, reward_mode="none", max_episode_steps=260,
    )  # fmt: skip
    try:
        base: Any = env.unwrapped
        _, info = env.reset(seed=seed)
        model = base.layout(0).model
        meshes = [m for m in Camera(env).meshes if m[0] == "robot"]
        robot_links = {k.name: k for k in base.agent.robot.links}
        meshes = [m for m in meshes if m[1] in robot_links]
        thing = base.objects[0]
        slides = np.array([j.type[0] == "prismatic" for j in thing.active_joints])
        poses, values = [], []

        def note() -> None:
            def matrix(pose: Any) -> FloatArray:
                return np.asarray(common.to_numpy(pose.to_transformation_matrix())[0])

            back = np.linalg.inv(matrix(thing.pose))
            now = np.stack([back @ matrix(robot_links[m[1]].pose) for m in meshes])
            now[:, :3, 3] /= model.scale
            poses.append(now)
            q = np.asarray(common.to_numpy(thing.qpos)[0], dtype=np.float64)
            values.append(np.where(slides, q / model.scale, q))

        note()
        expert, reason, success, left = Expert(env), "", False, FPS // 2
        try:
            expert.reset()
        except PlanningError as error:
            reason, left = str(error), 0
        while left > 0:
            action = expert.act()
            if expert.phase == "done" and not success:
                break
            _, _, _, truncated, info = env.step(action)
            note()
            success = success or bool(info["success"][0])
            left -= success
            if bool(truncated[0]):
                break
        surfaces = [_light(m[2] / model.scale, m[3].astype(np.int64)) for m in meshes]
        return Attempt(
            success, "" if success else reason or expert.reason or "out of time",
            float(info["open_fraction"][0]), [j.name for j in thing.active_joints],
            np.stack(values), [m[1] for m in meshes], np.stack(poses), surfaces,
        )  # fmt: skip
    finally:
        env.close()


def _light(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """A surface with few triangles, which is enough to see a robot."""
    import fast_simplification
    import trimesh

    mesh = trimesh.Trimesh(vertices, faces)
    if len(mesh.faces) <= MOST_FACES:
        return np.asarray(mesh.vertices), np.asarray(mesh.faces)
    small, cut = fast_simplification.simplify(
        np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.int32),
        target_count=MOST_FACES,
    )  # fmt: skip
    return np.asarray(small, dtype=np.float64), np.asarray(cut, dtype=np.int64)


def main(asset: str, joint: str, robot: str, out: str) -> int:
    """Record and write; a reason why it cannot be tried is the last line of stderr."""
    try:
        record(Path(asset), joint, robot).save(Path(out))
    except MamSimError as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))
