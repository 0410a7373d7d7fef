"""How fast the studio is: opening, frames a second, a slider, an edit, against the number of faces.

    python benchmarks/studio_speed.py [--sizes 50000 200000 1000000] [--out FILE.json]

One procedural cabinet, its triangles cut ever finer, is opened in a headless Chromium that draws
on the processor. For each size:

    read      seconds from the file to an object that can be edited, the engine's run included
    page      seconds from the page's address to the object on the screen, once it was read
    frames    a second while the view is turned
    cpu_ms    of processor time that all of Chromium spends on such a frame: it hardly depends on
              what else the machine does
    slider    milliseconds from a key on a slider to the first frame with the part moved
    edit      the same from a click on "Other direction"
    shared    seconds to open the self-contained page of `mam-sim view --html`, and its frames

Needs the extra `studio`, playwright and chromium.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import tyro
from common import save
from engine_scaling import refined
from playwright.sync_api import sync_playwright

from mam_pipeline.formats.mesh_files import save_glb
from mam_pipeline.make_config import MakeConfig
from mam_sim import viewer
from mam_sim.studio.page import Page
from mam_sim.studio.place import place_of
from mam_sim.studio.session import Session
from mam_world import make_object
from mam_world.style import Style

DRAWN_BY_CPU = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SIZE = {"width": 1280, "height": 720}
KEEP = """
const plain = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, options) {
  return plain.call(this, kind, {...options, preserveDrawingBuffer: true});
};
"""
SEEN = """
() => {
  const from = [...document.querySelectorAll("canvas")].find((c) => c.width > 300);
  if (!from) return -1;
  const to = document.createElement("canvas");
  [to.width, to.height] = [96, 54];
  const draw = to.getContext("2d", {willReadFrequently: true});
  draw.drawImage(from, 0, 0, 96, 54);
  return draw.getImageData(0, 0, 96, 54).data.reduce((s, v, i) => (s * 31 + v) % 1000000007, 7);
}
"""
WATCH = f"""
(patience) => new Promise((done, failed) => {{
  const seen = {SEEN};
  const before = seen(), begun = performance.now();
  const look = () => {{
    const took = performance.now() - begun;
    if (seen() !== before) done(took);
    else if (took > patience) failed(new Error("nothing changed"));
    else setTimeout(look, 4);
  }};
  look();
}})
"""
COUNT = """
(ms) => new Promise((done) => {
  let frames = 0;
  const begun = performance.now();
  const next = (now) => {
    frames += 1;
    if (now - begun < ms) requestAnimationFrame(next);
    else done((frames - 1) * 1000 / (now - begun));
  };
  requestAnimationFrame(next);
})
"""


@contextmanager
def window(browser: Any, script: str = "") -> Iterator[Any]:
    """A fresh window, without what others have cached."""
    context = browser.new_context(viewport=SIZE)
    context.set_default_timeout(300_000)
    page = context.new_page()
    if script:
        page.add_init_script(script)
    yield page
    context.close()


def drawn(page: Any) -> None:
    """Wait until the picture has more than its background, and stays as it is."""
    last, same = None, 0
    while same < 3:
        now = page.evaluate(SEEN)
        same = same + 1 if now == last and now > 0 else 0
        last = now
        time.sleep(0.1)


def spent() -> float:
    """Processor seconds of all processes below this one, browsers among them."""
    ticks, parents = {}, {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue  # it has ended
        parents[int(stat.parent.name)] = int(fields[1])
        ticks[int(stat.parent.name)] = int(fields[11]) + int(fields[12])

    def ours(pid: int) -> bool:
        while pid > 1 and pid != os.getpid():
            pid = parents.get(pid, 0)
        return pid == os.getpid()

    mine = (t for pid, t in ticks.items() if pid != os.getpid() and ours(pid))
    return sum(mine) / os.sysconf("SC_CLK_TCK")


def frames(page: Any, seconds: float = 4.0) -> tuple[float, float]:
    """Frames a second while the pointer turns the view, and processor milliseconds of a frame."""
    box = page.locator("canvas:visible").first.bounding_box()
    x, y = box["x"] + 0.45 * box["width"], box["y"] + 0.5 * box["height"]
    page.mouse.move(x, y)
    page.mouse.down()
    page.evaluate(f"void (window.counted = ({COUNT})({1000 * seconds}))")
    begun, before = time.monotonic(), spent()
    while time.monotonic() - begun < seconds:
        x += 6 if (time.monotonic() - begun) % 2 < 1 else -6
        page.mouse.move(x, y)
        time.sleep(0.015)
    found = float(page.evaluate("window.counted"))
    took, used = time.monotonic() - begun, spent() - before
    page.mouse.up()
    return found, 1000 * used / max(found * took, 1.0)


def latency(page: Any, act: Any, times: int = 5) -> float:
    """Median milliseconds until the picture changes after `act(k)`."""
    took = []
    for k in range(times):
        drawn(page)
        page.evaluate(f"void (window.change = ({WATCH})(60000))")
        act(k)
        took.append(float(page.evaluate("window.change")))
    return median(took)


def one(size: int, browser: Any, folder: Path) -> dict[str, Any]:
    """All figures of one size."""
    truth = make_object("cabinet_two_door", 5, replace(Style(), gap=0.002)).truth()
    mesh = refined(truth.mesh, size)
    file = folder / f"cabinet_{size}.glb"
    save_glb(mesh, file)
    begun = time.perf_counter()
    session = Session(place_of(file, MakeConfig(), folder / f"made_{size}"))
    session.prepare()
    row: dict[str, Any] = {"faces": len(mesh.faces), "shown": len(session.mesh.faces)}
    row["read_s"] = time.perf_counter() - begun
    page = Page()
    try:
        page.put(session)
        with window(browser, KEEP) as shown:
            begun = time.perf_counter()
            shown.goto(page.url)
            empty = None
            while (now := shown.evaluate(SEEN)) < 0 or now == empty or empty is None:
                empty = now if now >= 0 and empty is None else empty
                time.sleep(0.02)
            shown.get_by_role("slider").nth(1).wait_for()
            row["page_s"] = time.perf_counter() - begun
            drawn(shown)
            slider = shown.get_by_role("slider").nth(1)
            slider.focus()
            row["slider_ms"] = latency(
                shown, lambda k: slider.press("Home" if k % 2 else "End")
            )  # fmt: skip
            slider.press("Home")
            shown.get_by_role("tab", name="Put right").click()
            page.work.choose(session.state.tree.nodes[1].name)
            button = shown.get_by_role("button", name="Other direction")
            row["edit_ms"] = latency(shown, lambda _k: button.click())
        with window(browser) as shown:
            shown.goto(page.url)
            shown.get_by_role("slider").nth(1).wait_for()
            time.sleep(2)
            row["frames"], row["cpu_ms"] = frames(shown)
    finally:
        page.stop()
    html = folder / "view.html"
    html.write_text(viewer.page(session.state.articulation, "cabinet"), encoding="utf-8")
    with window(browser) as shown:
        begun = time.perf_counter()
        shown.goto(html.as_uri())
        shown.wait_for_function("document.body.dataset.ready === 'yes'")
        row["shared_s"] = time.perf_counter() - begun
        row["shared_frames"], row["shared_cpu_ms"] = frames(shown)
    row["shared_mb"] = html.stat().st_size / 1e6
    return {k: round(v, 3) if isinstance(v, float) else v for k, v in row.items()}


def main(sizes: tuple[int, ...] = (50_000, 200_000, 1_000_000), out: Path | None = None) -> None:
    """Measure every size, and print a row for each."""
    rows = []
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=[*DRAWN_BY_CPU, "--no-sandbox"]
        )
        for size in sizes:
            rows.append(one(size, browser, Path(folder)))
            print(rows[-1], flush=True)
        browser.close()
    save(out, rows)


if __name__ == "__main__":
    tyro.cli(main)
