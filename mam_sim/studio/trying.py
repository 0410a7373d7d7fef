"""The panel for trying: make and check the asset, see where it fails, take it along."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.exporters import export_asset
from mam_pipeline.check.model import CheckModel
from mam_pipeline.check.report import REASONS
from mam_pipeline.errors import ConfigError, MamSimError
from mam_pipeline.formats.door import Door, is_file
from mam_pipeline.geometry.surface import hull_of
from mam_pipeline.types import Mesh
from mam_sim.console import STAGES
from mam_sim.facts import shown_value, unit
from mam_sim.studio.parts import Parts
from mam_sim.studio.robot import Robot, engine_of
from mam_sim.studio.words import verdict_text
from mam_sim.studio.workspace import Workspace

ORDER = ("read", "segment", "prior", "reason", "joints", "asset", "check")


class Trying:
    """Makes the asset as the command line does, and shows the check's verdict at its place."""

    def __init__(self, work: Workspace, parts: Parts) -> None:
        self.work, self.parts = work, parts
        gui: Any = work.server.gui
        gui.add_markdown("*Making saves first. It is what `mam-sim articulate --hints` does.*")
        self.make = gui.add_button("Make and check the asset", icon="player-play")
        self.progress = gui.add_progress_bar(0, visible=False)
        self.doing = gui.add_markdown("")
        self.verdict = gui.add_markdown("")
        self.places = gui.add_dropdown("Show where", ("",), visible=False)
        self.export = gui.add_button_group("Take along", ("ZIP", "MuJoCo", "USD"))
        self.robot = Robot(work, parts)
        self.make.on_click(work.guarded(self._make, alone=False))
        self.places.on_update(work.guarded(self._show))
        self.export.on_click(work.guarded(self._export))
        self._opened: Any = None
        self._at: dict[str, tuple[str, float]] = {}

    def refresh(self) -> None:
        """The verdict of an asset that was opened; none for what has been edited since."""
        session = self.work.open
        self.robot.refresh()
        self.export.visible = (session.place.asset / "asset.json").is_file()
        if session is not self._opened:
            self._opened = session
            made = session.place.asset
            if (made / "asset.json").is_file() and not session.can_undo:
                self._tell(Asset.load(made))
            else:
                self._forget("Not made yet.")
        elif session.unsaved:
            self._forget("Edited since it was made.")

    def _forget(self, text: str) -> None:
        self.verdict.content, self.places.visible, self._at = text, False, {}

    def _make(self, event: Any) -> None:
        self.make.disabled, self.progress.visible = True, True
        try:
            with self.work.busy("Making and checking the asset"):
                asset = self.work.open.make(self._stage)
        except MamSimError as error:
            self._forget(f"**It was not made:** {error}")
            raise
        finally:
            self.make.disabled, self.progress.visible, self.doing.content = False, False, ""
        with self.work.lock:
            self._tell(asset)
            self.work.refresh()
        self.work.say(event, "Made", f"{asset.folder}", "green")

    def _stage(self, stage: str) -> None:
        self.work.check()
        self.doing.content = f"*{STAGES.get(stage, stage)} …*"
        if stage in ORDER:
            self.progress.value = 100 * ORDER.index(stage) / len(ORDER)

    def _tell(self, asset: Asset) -> None:
        """Verdict, places where it fails, and collision pieces of an asset."""
        found = asset.card.checks.get("executability")
        self.work.hulls = collision_pieces(asset) if asset.card.joints else {}
        if found is None:
            self._forget("It was not checked.")
            return
        self._at, words = {}, []
        joints = {j.name: j for j in self.work.state.articulation.joints}
        for row in found.get("joints", ()):
            joint = joints.get(row["joint"])
            if joint is None:
                continue
            at = row["at"] if row["at"] is not None else joint.upper
            at = at if np.isfinite(at) else 0.0
            text = f"{row['joint']} at {shown_value(joint, at):.3g} {unit(joint)}"
            self._at[text] = (joint.name, float(at))
            words.append(f"{text}: {', '.join(REASONS.get(r, r) for r in row['reasons'])}")
        self.verdict.content = verdict_text(
            found["passed"],
            found["driven"],
            [] if words else found["reasons"],
            words,
            self._still(),
        )
        self.places.visible = bool(self._at)
        if self._at:
            self.places.options = ("", *self._at)

    def _still(self) -> list[str]:
        """A sentence on each part that the check has put to sleep."""
        work, shown = self.work, self.work.state.articulation
        moved = {link.name for link in self.work.state.found.links}
        return [f"{work.called(part.link.name)} is kept still: {part.joint.dormant}"
                for part in shown.dormant if part.link.name in moved]  # fmt: skip

    def _show(self) -> None:
        """Put the joint where the check stopped it, its part in red."""
        work = self.work
        if self.places.value not in self._at:
            work.bad = ()
        else:
            name, value = self._at[self.places.value]
            articulation = work.state.articulation
            joint = next(j for j in articulation.joints if j.name == name)
            self.parts.pose({j.name: 0.0 for j in articulation.joints} | {name: value})
            work.bad = tuple(articulation.carried_links(joint))
        work.mark()

    def _export(self, event: Any) -> None:
        folder = self.work.open.place.asset
        if not (folder / "asset.json").is_file():
            raise ConfigError("make the asset first")
        asset = Asset.load(folder)
        if self.export.value == "ZIP":
            event.client.send_file_download(f"{asset.card.name}.zip", zipped(asset.folder))
            return
        mujoco = self.export.value == "MuJoCo"
        kind, name = ("mjcf", "object.xml") if mujoco else ("usd", "object.usd")
        path = export_asset(asset, kind, asset.folder / name)
        self.work.say(event, "Written", f"{path}", "green")


def collision_pieces(asset: Asset) -> dict[str, Sequence[Mesh]]:
    """Convex pieces by link name, in the frame in which the engine worked."""
    back = engine_of(asset.folder)
    model = CheckModel.read(asset.urdf_path)
    return {
        link.name: [Mesh(*found).transformed(back) for h in hulls if (found := hull_of(h.points))]
        for link, hulls in zip(model.articulation.links, model.hulls)
    }


def zipped(folder: Path) -> bytes:
    """An asset folder as one file, without the stages and what links lead to elsewhere."""
    buffer, door = io.BytesIO(), Door(folder)
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(folder.rglob("*")):
            inside = path.relative_to(folder)
            if is_file(path) and door.holds(path) and inside.parts[0] != "stages":
                archive.write(path, Path(folder.name) / inside)
    return buffer.getvalue()
