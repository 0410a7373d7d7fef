"""The panel in which a robot tries a joint: the expert's attempt, played beside the object."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mam_pipeline.asset.card import Asset
from mam_pipeline.errors import BackendError, ConfigError
from mam_pipeline.optional import require
from mam_pipeline.types import FloatArray
from mam_sim.studio.parts import Parts
from mam_sim.studio.workspace import Workspace

COLOR = (225, 227, 230)
UNMADE = "*Make the asset first: the robot tries what was made.*"
SIDE = 70.0  # degrees from the front, from where one sees object and robot beside each other


class Robot:
    """Runs the scripted expert on the asset in the simulator, and plays what it did."""

    def __init__(self, work: Workspace, parts: Parts) -> None:
        """Build the panel; nothing of the simulator is imported here."""
        from mam_envs.robots import ROBOTS

        self.work, self.parts = work, parts
        gui: Any = work.server.gui
        with gui.add_folder("Robot", expand_by_default=False):
            self.joint = gui.add_dropdown("Part", ("(none)",))
            arms = {target: name for name, target in reversed(ROBOTS.targets().items())}
            self.robot = gui.add_dropdown("Arm", tuple(arms.values()), initial_value="panda")
            self.go = gui.add_button("Let the robot try", icon="robot")
            self.told = gui.add_markdown("")
            self.at = gui.add_slider("Moment (s)", 0.0, 1.0, 0.05, 0.0, visible=False)
            self.again = gui.add_button("Play", icon="player-play", visible=False)
        self.go.on_click(work.guarded(self._try, alone=False))
        self.again.on_click(work.guarded(self._play, alone=False))
        self.at.on_update(work.guarded(self._show))
        self._links: list[Any] = []
        self._attempt: Any = None
        self._playing = threading.Lock()
        self._trying = False

    def refresh(self) -> None:
        """The parts that can be tried; an attempt on what has been edited since goes away."""
        articulation = self.work.state.articulation
        names = [
            articulation.links[j.child].name for j in articulation.joints if j.type != "fixed"
        ] or ["(none)"]
        if list(self.joint.options) != names:
            self.joint.options = tuple(names)
        if self.work.part in names:
            self.joint.value = self.work.part
        if self._attempt is not None and self._of is not self.work.state:
            self._clear()
        session = self.work.open
        made = (session.place.asset / "asset.json").is_file() and not session.unsaved
        if not self._trying:
            self.go.disabled = not made or names == ["(none)"]
            if not made or self.told.content == UNMADE:
                self.told.content = "" if made else UNMADE

    def _clear(self) -> None:
        self._attempt = None
        for node in self._links:
            node.remove()
        self._links = []
        self.told.content, self.at.visible, self.again.visible = "", False, False

    def _try(self) -> None:
        require("the robot", "mani_skill")
        from mam_policies.attempt import FPS, attempt

        work = self.work
        folder = work.open.place.asset
        if not (folder / "asset.json").is_file() or work.open.unsaved:
            raise ConfigError("make the asset first: the robot tries what was made")
        card, state = Asset.load(folder).card, work.state
        joint = next((j.name for j in card.joints if j.child == self.joint.value), None)
        if joint is None:
            raise ConfigError(f"{self.joint.value} does not move in the asset: make it again")
        self._clear()
        self._trying = True
        self.go.disabled, self.told.content = True, "*The robot plans and tries; a minute or so.*"
        try:
            done = attempt(folder, joint, self.robot.value)
        except BackendError as error:
            self.told.content = f"**It cannot try**: {error}"
            return
        finally:
            self.go.disabled = self._trying = False
        with work.lock:
            self._attempt, self._of = done, state
            self._draw(engine_of(folder))
            self.told.content = (
                f"**It succeeds**: {joint} is {100 * done.open_fraction:.0f} % open."
                if done.success
                else f"**It fails**: {done.reason}."
            )
            self.at.visible = self.again.visible = len(done.poses) > 1
            self.at.max = max((len(done.poses) - 1) / FPS, 0.05)
        self._play()

    def _draw(self, back: FloatArray) -> None:
        """The robot's links; `back` is engine_T_asset."""
        self._back = back
        for k, (vertices, faces) in enumerate(self._attempt.surfaces):
            self._links.append(self.work.server.scene.add_mesh_simple(
                f"/robot/{k}", vertices, faces, color=COLOR, side="double",
            ))  # fmt: skip
        poses = back @ self._attempt.poses[0]
        low, high = self.work.state.articulation.mesh.bounds
        corners = [low, high]
        for pose, (vertices, _) in zip(poses, self._attempt.surfaces):
            placed = vertices @ pose[:3, :3].T + pose[:3, 3]
            corners += [placed.min(axis=0), placed.max(axis=0)]
        bounds = np.stack([np.min(corners, axis=0), np.max(corners, axis=0)])
        for client in self.work.server.get_clients().values():
            self.work.scene.view(client.camera, SIDE, bounds=bounds)
        self._pose(0)

    def _play(self) -> None:
        """Show the attempt as fast as it was."""
        from mam_policies.attempt import FPS

        done = self._attempt
        if done is None or not self._playing.acquire(blocking=False):
            return
        try:
            begun = time.monotonic()
            while self._attempt is done:
                k = int((time.monotonic() - begun) * FPS)
                with self.work.lock:
                    self.at.value = min(k, len(done.poses) - 1) / FPS
                    self._pose(min(k, len(done.poses) - 1))
                if k >= len(done.poses) - 1:
                    break
                time.sleep(1 / FPS)
        finally:
            self._playing.release()

    def _show(self, event: Any) -> None:
        from mam_policies.attempt import FPS

        if event.client is not None and self._attempt is not None:
            self._pose(min(round(self.at.value * FPS), len(self._attempt.poses) - 1))

    def _pose(self, k: int) -> None:
        done = self._attempt
        with self.work.server.atomic():
            poses = self._back @ done.poses[k]
            turns = np.roll(Rotation.from_matrix(poses[:, :3, :3]).as_quat(), 1, axis=1)
            for node, pose, turn in zip(self._links, poses, turns):
                node.position, node.wxyz = pose[:3, 3], turn
            known = self.work.scene.values
            self.parts.pose(
                {n: float(v) for n, v in zip(done.joints, done.values[k]) if n in known}
            )


def engine_of(folder: Any) -> FloatArray:
    """(4, 4) engine_T_asset: from the frame of an asset to that in which it was made."""
    import json

    frame = folder / "stages" / "frame.json"
    if not frame.is_file():
        return np.eye(4)
    return np.linalg.inv(
        np.asarray(json.loads(frame.read_text(encoding="utf-8"))["asset_T_engine"])
    )
