"""Helpers of the studio's tests: parts of the cabinet, and what a browser's window shows."""

from __future__ import annotations

import io
import shutil
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from mam_pipeline.types import FloatArray, Joint, PartNode
from mam_sim.studio.picking import Camera
from mam_sim.studio.session import Session

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")


SIZE = {"width": 900, "height": 560}


DRAWN_BY_CPU = [
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-gpu-watchdog",  # which ends the drawing process where a frame takes long
]  # fmt: skip


PATIENCE = 120_000  # ms: on a machine with other work a frame takes seconds


def door(session: Session) -> PartNode:
    """The part that has the panel: the largest piece at the front."""
    middles = session.mesh.vertices[session.mesh.faces].mean(axis=1)
    piece = session.primitives.labels[np.argmin(np.abs(middles - [-0.222, 0, 0.3]).sum(axis=1))]
    return next(n for n in session.state.tree.nodes if piece in n.primitives)


def joint_of(session: Session, name: str) -> Joint:
    articulation = session.state.articulation
    names = [link.name for link in articulation.links]
    found = articulation.joint_of(names.index(name))
    assert found is not None
    return found


def until(
    true: Callable[[], Any], seconds: float = PATIENCE / 1000, told: Callable[[], Any] = str
) -> Any:
    """Wait until something is neither None nor False; returns it.

    Args:
        told: what a failure says besides.
    """
    end = time.monotonic() + seconds
    while (found := true()) is None or found is False:
        assert time.monotonic() < end, f"it did not happen in time {told()}"
        time.sleep(0.05)
    return found


def camera_of(page: Any) -> Camera:
    """The browser's camera."""
    camera = next(iter(page.server.get_clients().values())).camera
    turn = Rotation.from_quat(np.roll(camera.wxyz, -1)).as_matrix()
    return Camera(np.asarray(camera.position), turn, camera.fov, camera.aspect)


def canvas(window: Any) -> dict[str, float]:
    box: dict[str, float] = window.locator("canvas").first.bounding_box()
    return box


def pixel(page: Any, window: Any, points: Any) -> FloatArray:
    """(n, 2) where points are in the window, pixels."""
    box = canvas(window)
    at = camera_of(page).screen(np.asarray(points, dtype=float))
    return at * [box["width"], box["height"]] + [box["x"], box["y"]]


def click_at(page: Any, window: Any, point: Any) -> None:
    """Click a point of the object, and wait until the page shows what that has chosen.

    A button that is drawn anew between the press and the release of the mouse hears neither.
    """
    with page.work.lock:
        page.work.select_nothing()
        page.work.refresh()
    window.get_by_text("1 piece").wait_for(state="hidden")
    window.mouse.click(*pixel(page, window, [point])[0])
    window.get_by_text("1 piece").wait_for()
    with page.work.lock:  # the click is dealt with to its end
        page.server.flush()


def seen(window: Any) -> FloatArray:
    """(H, W, 3) the window as it is drawn."""
    picture = Image.open(io.BytesIO(window.screenshot(timeout=PATIENCE))).convert("RGB")
    return np.asarray(picture, dtype=float)


def window_middle(box: dict[str, float]) -> tuple[int, int]:
    """Column and row of the middle of the view."""
    return int(box["x"] + box["width"] / 2), int(box["y"] + box["height"] / 2)


def drawn(window: Any) -> bool:
    """Whether the middle of the view, as wide as it is now, shows something.

    The view is as wide as the window until the panels have their place.
    """
    column, row = window_middle(canvas(window))
    return bool(seen(window)[row, column].min() < 250)


def in_place(page: Any) -> bool:
    """Whether the browser's camera is where the page puts it at first."""
    at = page.server.initial_camera.position
    return bool(np.allclose(camera_of(page).position, at, atol=1e-3))


def still(window: Any) -> bool:
    """Whether two pictures of the view are the same."""
    box = canvas(window)
    return changed(seen(window), seen(window), box, few=0) is None


def is_lost(window: Any) -> bool:
    """Whether the process that draws the view has ended."""
    view = window.locator("canvas").first
    lost: bool = view.evaluate("canvas => canvas.getContext('webgl2').isContextLost()")
    return lost


def lose(window: Any) -> bool:
    """End what draws the view; returns whether it has ended.

    Asked in the same call: the page loads itself again soon after, and then hears no question.
    """
    view = window.locator("canvas").first
    lost: bool = view.evaluate(
        """canvas => {
          const drawing = canvas.getContext('webgl2');
          drawing.getExtension('WEBGL_lose_context').loseContext();
          return drawing.isContextLost();
        }"""
    )
    return lost


def show(page: Any, window: Any, tab: str = "") -> None:
    """Open the studio's page, wait until the object is drawn, and go to a tab."""
    with page.work.lock:
        page.work.refresh()
        page.parts.pose(dict.fromkeys(page.work.scene.values, 0.0))
    window.goto(page.url)
    window.get_by_text("cabinet").wait_for()
    until(lambda: len(page.server.get_clients()) > 0)
    until(
        lambda: in_place(page) and drawn(window),
        told=lambda: (camera_of(page), canvas(window), is_lost(window)),
    )
    any(still(window) for _ in range(10))  # all of it is there, unless a part plays
    if tab:
        window.get_by_role("tab", name=tab).click()


def choose(window: Any, label: str, option: str) -> None:
    """Take an option of a list."""
    window.get_by_label(label, exact=True).first.click()
    window.get_by_role("option", name=option, exact=True).click()


def door_front(session: Session) -> FloatArray:
    """A point on the door's front, off its knob."""
    return np.array([-0.222, 0.1, 0.35])


def changed(
    before: FloatArray, after: FloatArray, box: dict[str, float], few: int = 500
) -> FloatArray | None:
    """(n, 2) pixels of the view that differ, column and row; None for `few` of them."""
    differs = np.abs(before - after).max(axis=2) > 24
    rows, columns = np.nonzero(differs[:, : int(box["x"] + box["width"])])
    return np.stack([columns, rows], axis=1) if len(rows) > few else None
