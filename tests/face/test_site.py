"""The built site in a browser: no page is wider than its window, from a phone to a wide screen."""

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
CUT = """() => [...document.querySelectorAll('.md-typeset__scrollwrap')].slice(0, 2)
    .some((e) => e.scrollWidth > e.clientWidth)"""


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
def reader(window: Any, site: tuple[Path, str]) -> Any:
    """A window that reaches the site alone."""
    own = site[1]
    window.route("**/*", lambda r: r.continue_() if r.request.url.startswith(own) else r.abort())
    return window


@pytest.mark.slow
def test_the_site_is_built_without_a_warning(site: tuple[Path, str]) -> None:
    assert (site[0] / "index.html").is_file()


@pytest.mark.slow
def test_in_a_browser_no_page_of_the_site_is_wider_than_its_window(
    reader: Any, site: tuple[Path, str]
) -> None:
    folder, url = site
    pages = [p.relative_to(folder).parent.as_posix() for p in sorted(folder.rglob("index.html"))]
    assert len(pages) > 30
    wide = []
    for page in pages:
        reader.goto(f"{url}{page}/")
        reader.add_style_tag(content=STILL)
        for width in WIDTHS:
            reader.set_viewport_size({"width": width, "height": 900})
            over = reader.evaluate("document.documentElement.scrollWidth") - width
            if over > 0:
                wide.append(f"{page} at {width}: {over} pixels too wide")
    assert not wide, wide


@pytest.mark.slow
def test_in_a_browser_the_results_are_not_cut_and_the_site_is_searched(
    reader: Any, site: tuple[Path, str]
) -> None:
    import tomllib

    _, url = site
    reader.set_viewport_size({"width": 1280, "height": 900})
    reader.goto(f"{url}results/")
    assert not reader.evaluate(CUT)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    leads = reader.locator(".md-header__source a").get_attribute("href")
    assert leads == project["urls"]["Repository"]
    reader.get_by_placeholder("Search").fill("dormant")
    reader.locator(".md-search-result__item").first.wait_for()
