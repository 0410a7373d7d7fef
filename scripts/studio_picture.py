"""The tutorial's picture of the studio: a generated cabinet with one door chosen, half open.

    python scripts/studio_picture.py docs/tutorials/studio.png

It needs the extra `studio`, playwright and chromium.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

import mam_world as world
from mam_pipeline.formats.mesh_files import save_glb
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.types import Link
from mam_sim.studio.page import Page
from mam_sim.studio.place import place_of
from mam_sim.studio.scene import all_at
from mam_sim.studio.session import Session

SIZE = (1280, 720)
DRAWN_BY_CPU = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def main(out: Path, width: int, height: int) -> None:
    """Open the studio in a browser without a screen, and write what it shows."""
    with tempfile.TemporaryDirectory() as folder:
        made = world.make_object("cabinet_two_door", 5, world.Style())
        save_glb(made.static, Path(folder) / "cabinet.glb")
        place = place_of(Path(folder) / "cabinet.glb", MakeConfig(), Path(folder) / "made")
        session = Session(place)
        session.prepare()
        page = Page()
        page.put(session)
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(
                executable_path=shutil.which("chromium"), args=[*DRAWN_BY_CPU, "--no-sandbox"]
            )
            window = browser.new_page(viewport={"width": width, "height": height})
            window.set_default_timeout(300_000)
            window.goto(page.url)
            window.get_by_role("tab", name="Put right").click()
            link = min(session.state.articulation.links[1:], key=lambda k: _leftness(session, k))
            node = next(n for n in session.state.tree.nodes if n.name == link.name)
            page.work.selected = set(node.primitives)
            page.parts.pose(all_at(session.state.articulation, 0.35))
            page.work.choose(link.name)
            time.sleep(3)
            for notice in window.get_by_label("Close notification").all():
                notice.click()
            for close in window.locator(".mantine-Notification-closeButton").all():
                close.click()
            window.wait_for_timeout(1500)
            window.screenshot(path=str(out))
            browser.close()
        page.stop()
    Image.open(out).convert("RGB").save(out, optimize=True)


def _leftness(session: Session, link: Link) -> float:
    """How far a link lies to the left: +Y, as seen from the front."""
    corners = session.mesh.faces[link.faces]
    return -float(session.mesh.vertices[corners][..., 1].mean())


if __name__ == "__main__":
    size = tuple(int(n) for n in sys.argv[2].split("x")) if len(sys.argv) > 2 else SIZE
    main(Path(sys.argv[1]), *size)
