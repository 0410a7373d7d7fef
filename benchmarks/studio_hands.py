"""Eyes and hands of a scripted person before the studio's page in a headless Chromium.

Clicks, drags and keys are real and are counted. Parts are chosen, removed and woken by the page's
keys, as by somebody who has pressed `?` once. What is seen is found by rays from the browser's
camera. Views are turned by setting that camera, which counts as one drag.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mam_pipeline.geometry.sampling import face_geometry
from mam_pipeline.types import FloatArray, IntArray
from mam_sim.studio.lines import Lines, lines_near
from mam_sim.studio.page import Page
from mam_sim.studio.picking import Camera
from mam_sim.studio.session import Session

SIDES = [(a, e) for e in (20.0, 55.0, -25.0) for a in (-35.0, 35.0, 90.0, 145.0, -145.0, -90.0)]
THINK, POINT, PRESS, TYPE = 1.35, 1.1, 0.2, 0.28
"""Seconds of the keystroke-level model (Card, Moran and Newell 1980): to think before an act, to
point, to press and let go, to type one key as an average typist."""


@dataclass
class Acts:
    """What a person did, and the time that the keystroke-level model gives for it."""

    edits: int = 0
    clicks: int = 0
    drags: int = 0
    keys: int = 0
    shortcuts: int = 0
    steps: list[str] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Of the person alone: every act is thought of; clicks and drags are pointed at, too."""
        click, drag = THINK + POINT + PRESS, THINK + 2 * POINT + PRESS
        typed = self.keys * TYPE + self.shortcuts * (THINK + TYPE)
        return self.clicks * click + self.drags * drag + typed


class Hands:
    """Uses the page, and counts every act.

    Attributes:
        acts: what was done. fresh: the next click on a piece selects anew.
        looked: seconds that the rays of these eyes took; the page waited meanwhile.
    """

    def __init__(self, page: Page, window: Any, session: Session) -> None:
        """Sit down before a page.

        Args:
            window: of Playwright, in which the page is open.
        """
        self.page, self.window, self.session = page, window, session
        self.face_area = face_geometry(session.mesh.vertices, session.mesh.faces)[1]
        self.acts, self.fresh, self.looked = Acts(), True, 0.0
        self._looking = False

    @contextmanager
    def looking(self) -> Iterator[None]:
        """Count the seconds of what is done inside as `looked`."""
        if self._looking:
            yield
            return
        self._looking, begun = True, time.monotonic()
        try:
            yield
        finally:
            self._looking = False
            self.looked += time.monotonic() - begun

    def clear(self) -> None:
        """Select nothing: a click beside the object."""
        if self.shown():
            self.acts.clicks += 1
            self.window.mouse.click(*self.pixel(np.array([0.02, 0.03])))
            until(lambda: not self.shown(), 20.0)

    def all_to(self, share: int) -> bool:
        """Open (100) or close (0) everything by its slider; whether something moves."""
        parts: Any = self.page.parts
        if parts.all is None:
            return False
        self.acts.drags += 1
        self.acts.steps.append("open all" if share else "close all")
        slider = self.window.get_by_role("slider").first
        slider.focus()
        for key in ("Home", "End") if share else ("End", "Home"):
            slider.press(key)
            wanted = 0 if key == "Home" else 100
            until(lambda wanted=wanted: parts.all.value == wanted, 20.0)
        self.window.wait_for_timeout(300)
        return True

    def point_at(self, place: FloatArray) -> bool:
        """Click a place (3,) of the object at rest from where it is seen; whether it was hit."""
        work, size = self.page.work, self.session.mesh.diagonal
        if any(abs(v) > 1e-6 for v in work.scene.values.values()):
            self.all_to(0)
        for side in [None, *SIDES]:
            camera = self.camera() if side is None else self.seen_from(side)
            at = camera.screen(place[None])[0]
            if not (at.min() > 0.02 and at.max() < 0.98):
                continue
            hit = work.tracer()[1].cast(camera.position, camera.rays(at[None]))
            if not len(hit.at) or np.linalg.norm(hit.at[0] - place) > 0.005 * size:
                continue
            if side is not None:
                self.turn(side)
                at = self.camera().screen(place[None])[0]
            work.face = None
            self.acts.clicks += 1
            self.acts.steps.append("click a place")
            self.window.mouse.click(*self.pixel(at))
            return until(lambda: work.face is not None, 20.0, fail=False)
        return False

    def where(
        self, lines: Lines, wanted: Sequence[int], places: FloatArray
    ) -> tuple[FloatArray, int] | None:
        """Where on the screen one of some lines is pointed at, from a view in which it is found
        with the fewest clicks, and how many; the view is turned there. None where it is nowhere.

        Args:
            wanted: rows of `lines`, at rest. places: (n, 3) on these lines.
        """
        work, size = self.page.work, self.session.mesh.diagonal
        if any(abs(v) > 1e-6 for v in work.scene.values.values()):
            self.all_to(0)
        tracer, best = work.tracer()[1], None
        with self.looking():
            for side in [None, *SIDES]:
                camera = self.camera() if side is None else self.seen_from(side)
                for at in camera.screen(places):
                    if not (at.min() > 0.02 and at.max() < 0.98):
                        continue
                    ray = camera.rays(at[None])[0]
                    hits = lines_near(lines, tracer, camera.position, ray, size)
                    clicks = next((k for k, hit in enumerate(hits, 1) if hit.line in wanted), 0)
                    turned = side is not None
                    if clicks and (best is None or clicks + turned < best[0]):
                        best = clicks + turned, side, at, clicks
        if best is None:
            return None
        if best[1] is not None:
            self.turn(best[1])
        return best[2], best[3]

    def take_at(self, at: FloatArray) -> None:
        """Click a place on the screen, whose line is taken."""
        self.settled()
        before = self.session.state
        self.acts.clicks += 1
        self.acts.edits += 1
        self.acts.steps.append("click a line")
        self.window.mouse.click(*self.pixel(at))
        until(lambda: self.session.state is not before, 60.0, fail=False)

    def shown(self) -> set[int]:
        """Pieces that are selected on the page."""
        return set(self.page.work.selected)

    def places(
        self, camera: Camera, pieces: Iterable[int], labels: IntArray | None = None
    ) -> dict[int, FloatArray]:
        """Where on the screen (0..1) pieces are best clicked, the largest first.

        Args:
            labels: (F,) piece of every face; default: those of the page.
        """
        with self.looking():
            return self._places(camera, pieces, labels)

    def _places(
        self, camera: Camera, pieces: Iterable[int], labels: IntArray | None
    ) -> dict[int, FloatArray]:
        labels = self.session.primitives.labels if labels is None else labels
        steps = (np.arange(120) + 0.5) / 120
        grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        seen = self.page.work.tracer()[1].cast(camera.position, camera.rays(grid))
        label = labels[seen.face]
        out = {}
        for piece in sorted(pieces, key=lambda p: -float(self.face_area[labels == p].sum())):
            own = seen.at[label == piece]
            if len(own) >= 2:
                at = camera.screen(own)
                apart = np.linalg.norm(at - np.median(at, axis=0), axis=1)
                out[piece] = at[int(np.argmin(apart))]
        return out

    def seen_from(self, side: tuple[float, float]) -> Camera:
        """The camera that `turn` sets."""

        class Holder:
            position: Any = None
            look_at: Any = None

        holder, now = Holder(), self.camera()
        self.page.work.scene.view(holder, *side)
        ahead = np.asarray(holder.look_at) - np.asarray(holder.position)
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, (0, 0, 1.0))
        right /= np.linalg.norm(right)
        turn = np.stack([right, np.cross(ahead, right), ahead], axis=1)
        return Camera(np.asarray(holder.position), turn, now.fov, now.aspect)

    def camera(self) -> Camera:
        """That of the window."""
        camera = next(iter(self.page.server.get_clients().values())).camera
        turn = Rotation.from_quat(np.roll(camera.wxyz, -1)).as_matrix()
        return Camera(np.asarray(camera.position), turn, camera.fov, camera.aspect)

    def turn(self, side: tuple[float, float]) -> None:
        """Turn the view."""
        self.acts.drags += 1
        self.acts.steps.append(f"view from {side[0]:.0f}, {side[1]:.0f}")
        wanted = self.seen_from(side)
        for client in self.page.server.get_clients().values():
            self.page.work.scene.view(client.camera, *side)
        until(lambda: np.allclose(self.camera().position, wanted.position, atol=1e-3), 10, False)
        self.window.wait_for_timeout(300)  # the browser's own camera follows by a message

    def pixel(self, at: FloatArray) -> tuple[float, float]:
        """Where a place on the screen (0..1) is in the window."""
        box = self.window.locator("canvas:visible").first.bounding_box()
        return box["x"] + at[0] * box["width"], box["y"] + at[1] * box["height"]

    def click(self, at: FloatArray, piece: int, more: bool) -> bool:
        """Click a place on the screen; whether the piece is selected then."""
        was = self.shown()
        self.acts.clicks += 1
        self.acts.steps.append(f"piece {piece}")
        if more:
            self.window.keyboard.down("Shift")
        self.window.mouse.click(*self.pixel(at))
        if more:
            self.window.keyboard.up("Shift")
        until(lambda: self.shown() != was, 20.0 if piece not in was else 0.5, fail=False)
        self.fresh = False
        return piece in self.shown()

    def click_area(self, at: FloatArray) -> bool:
        """Click a place on the screen for the faces around it; whether more are selected then."""
        work, before = self.page.work, set(self.page.work.brushed)
        self.acts.clicks += 1
        self.acts.steps.append("area")
        self.window.keyboard.down("Shift")
        self.window.mouse.click(*self.pixel(at))
        self.window.keyboard.up("Shift")
        return until(lambda: work.brushed > before, 5.0, fail=False)

    def settled(self) -> None:
        """Wait until the panel shows what was done: a person reads it before the next act."""
        with self.page.work.lock:
            pass
        self.window.wait_for_timeout(150)

    def pick(self, label: str, option: str, edit: bool = True) -> None:
        """Take an option of a list: two clicks."""
        self.settled()
        panel: Any = self.page.mend
        target = label == "Other part"
        if target and panel.target.value == option:
            return
        work = self.page.work

        def now() -> tuple[Any, ...]:
            return self.session.state, work.part, panel.target.value, work.picks

        before = now()
        self.acts.clicks += 2
        self.acts.edits += edit and label not in ("Other part", "Select")
        self.acts.steps.append(f"{label}: {option}")
        self.window.get_by_label(label, exact=True).first.click()
        self.window.get_by_role("option", name=option, exact=True).click()
        until(lambda: before != now(), 20.0, False)

    def press(self, button: str, edit: bool = True) -> None:
        """Press a button that edits, or with which an edit begins or ends."""
        self.settled()
        before = self.session.state
        self.acts.clicks += 1
        self.acts.edits += edit
        self.acts.steps.append(button)
        self.window.get_by_role("button", name=button).click()
        if edit:
            until(lambda: self.session.state is not before, 60.0, fail=False)
        else:
            pointing = button != "Done"
            until(lambda: (self.page.work.pointing is not None) == pointing, 60.0, fail=False)

    def shortcut(self, key: str, edit: bool = True) -> None:
        """Press a key of the page."""
        self.settled()
        before = self.session.state
        self.acts.shortcuts += 1
        self.acts.edits += edit
        self.acts.steps.append(f"key {key}")
        self.window.keyboard.press(key)
        if edit:
            until(lambda: self.session.state is not before, 60.0, fail=False)

    def take_line(self, number: int) -> None:
        """Take a line of the list, from 1: a click."""
        self.settled()
        before = self.session.state
        self.acts.clicks += 1
        self.acts.edits += 1
        self.acts.steps.append(f"line {number}")
        self.window.locator(f'.way[data-key="way {number}"]').click()
        until(lambda: self.session.state is not before, 60.0, fail=False)

    def type_in(self, label: str, text: str) -> None:
        """Type a number into a field: a click, keys, Tab."""
        before = self.session.state
        self.acts.clicks += 1
        self.acts.keys += len(text) + 2  # what is there is selected first
        self.acts.edits += 1
        self.acts.steps.append(f"{label}: {text}")
        there = self.window.get_by_label(label, exact=True).first
        there.fill(text)
        there.press("Tab")
        until(lambda: self.session.state is not before, 20.0, fail=False)

    def tab(self, name: str) -> None:
        """Go to a tab."""
        self.acts.clicks += 1
        self.window.get_by_role("tab", name=name).click()


def until(true: Callable[[], Any], seconds: float, fail: bool = True) -> bool:
    """Wait until something is true; False, or an error, where it does not become so."""
    end = time.monotonic() + seconds
    while not true():
        if time.monotonic() > end:
            if fail:
                raise TimeoutError("the page did not do it")
            return False
        time.sleep(0.02)
    return True
