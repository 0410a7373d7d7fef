"""Site, gallery, shared page and report in a browser, from a phone to a wide screen: none is wider
than its window, no table is cut, no picture broken, no text tiny."""

from __future__ import annotations

import functools
import subprocess
import sys
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler
from pathlib import Path
from typing import Any

import pytest

from tests.local_server import served

ROOT = Path(__file__).resolve().parents[2]
WIDTHS = (390, 800, 1280, 2560)
STILL = "*, *::before, *::after { transition: none !important; animation: none !important }"
LEAST = 12  # pixels of the smallest text that people are asked to read
LOOK = """(least) => {
  const faults = [], wide = document.documentElement.scrollWidth - window.innerWidth;
  if (wide > 0) faults.push(`${wide} pixels too wide`);
  const seen = (e) => e.checkVisibility({opacityProperty: true, visibilityProperty: true})
    && e.getBoundingClientRect().width > 1;
  for (const e of document.querySelectorAll("body *")) {
    const says = [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim());
    const size = parseFloat(getComputedStyle(e).fontSize);
    if (says && size < least - 0.01 && seen(e))
      faults.push(`${size} pixels: ${e.textContent.trim().slice(0, 30)}`);
  }
  for (const e of document.querySelectorAll("table")) {
    let box = e;
    while (box.parentElement && getComputedStyle(box).overflowX === "visible")
      box = box.parentElement;
    if (box.scrollWidth > box.clientWidth + 1 && seen(e))
      faults.push(`cut: ${e.textContent.trim().slice(0, 30)}`);
  }
  for (const e of document.images)
    if (!e.naturalWidth) faults.push(`broken picture: ${e.src.slice(0, 60)}`);
  for (const e of document.querySelectorAll("video[src]"))
    if (!e.videoWidth) faults.push("broken film");
  return [...new Set(faults)];
}"""
LOADED = """() => [...document.images].every((e) => e.complete)
    && [...document.querySelectorAll("video[src]")].every((e) => e.readyState || e.error)"""
OPEN = """() => {
  for (const e of document.querySelectorAll("details")) e.open = true;
  for (const e of document.images) e.loading = "eager";
}"""


def faults(reader: Any, address: str) -> list[str]:
    """What is wrong with a page at any of the widths, everything on it unfolded."""
    reader.goto(address)
    reader.add_style_tag(content=STILL)
    reader.evaluate(OPEN)
    reader.wait_for_function(LOADED)
    found = []
    for width in WIDTHS:
        reader.set_viewport_size({"width": width, "height": 900})
        found += [f"{address} at {width}: {fault}" for fault in reader.evaluate(LOOK, LEAST)]
    return found


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, str]]:
    """The folder of the built site, and the address at which it is served."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, timeout=300)
    with served(functools.partial(Quiet, directory=folder)) as address:
        yield folder, f"{address}/"


@pytest.fixture
def reader(window: Any, site: tuple[Path, str]) -> Iterator[Any]:
    """A window that reaches the site alone."""
    own = site[1]
    window.route("**/*", lambda r: r.continue_() if r.request.url.startswith(own) else r.abort())
    yield window
    window.unroute_all()


@pytest.mark.slow
def test_the_site_is_built_without_a_warning(site: tuple[Path, str]) -> None:
    assert (site[0] / "index.html").is_file()


@pytest.mark.slow
def test_in_a_browser_every_page_of_the_site_is_whole_at_every_width(
    reader: Any, site: tuple[Path, str]
) -> None:
    """Its gallery too, where somebody made one before the site was built."""
    folder, url = site
    pages = [p.relative_to(folder).as_posix() for p in sorted(folder.rglob("*.html"))]
    assert len(pages) > 30
    found = [fault for page in pages for fault in faults(reader, f"{url}{page}")]
    assert not found, found


def test_in_a_browser_the_eyes_of_this_test_see_what_is_wrong(window: Any, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text(
        "<div style='width:600px'>wide</div><p style='font-size:11px'>tiny</p><img src='no.png'>"
        "<video src='no.mp4'></video><div style='width:300px;overflow:auto'><table><tr>"
        "<td style='min-width:500px'>table</table></div>",
        encoding="utf-8",
    )
    found = faults(window, page.as_uri())
    assert sum("at 390: " in fault for fault in found) == 5
    for fault in ("pixels too wide", "11 pixels: tiny", "cut: table", "broken picture", "film"):
        assert any(fault in told for told in found), (fault, found)


@pytest.mark.slow
def test_in_a_browser_gallery_shared_page_and_report_are_whole_at_every_width(
    window: Any, tmp_path: Path
) -> None:
    pytest.importorskip("mani_skill", reason="films are written by the simulator's side")
    from dataclasses import replace

    import numpy as np

    from mam_envs.scene.video import write_video
    from mam_pipeline.asset.card import Asset
    from mam_sim.report import write_report
    from mam_sim.verbs.view import View
    from mam_world.dataset import write_dataset

    for category in ("station_button", "nightstand"):
        write_dataset(category, 1, 0, tmp_path / "made")
    folder = tmp_path / "made" / "nightstand_000000"
    frames = [np.full((90, 120, 3), 40 * k, dtype=np.uint8) for k in range(5)]
    write_video(frames, folder / "demo.mp4")
    told = {"robot": "panda", "task": "open", "joint": "drawer_0", "ok": False, "attempts": 3,
            "why": "out of time"}  # fmt: skip
    card = Asset.load(folder).card
    replace(card, checks={**card.checks, "attempt": told}).save(folder)
    credits = tmp_path / "credits.csv"
    line = f"Ann, CC0, https://example.org/{'long' * 30}"
    credits.write_text(f'file,credit\nstatic.glb,"{line}"\n', encoding="utf-8")
    view = View(asset=tmp_path / "made", html=True, credits=credits, quiet=True, size=64)
    assert view.run() == 0
    pages = [tmp_path / "made" / "gallery.html", folder / "view.html"]
    pages.append(write_report(Asset.load(folder)))
    found = [fault for page in pages for fault in faults(window, page.as_uri())]
    assert not found, found
    said = "Robot panda, task open, drawer_0: fails 3 times; the last time: out of time."
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert said in text and ("data:video/mp4" in text or page.name == "gallery.html")


@pytest.mark.slow
def test_in_a_browser_the_site_is_searched_and_leads_to_the_repository(
    reader: Any, site: tuple[Path, str]
) -> None:
    import tomllib

    _, url = site
    reader.set_viewport_size({"width": 1280, "height": 900})
    reader.goto(f"{url}results/")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    leads = reader.locator(".md-header__source a").get_attribute("href")
    assert leads == project["urls"]["Repository"]
    reader.get_by_placeholder("Search").fill("dormant")
    reader.locator(".md-search-result__item").first.wait_for()
