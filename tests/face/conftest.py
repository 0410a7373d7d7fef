"""A cabinet in the studio, and a window of a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mam_pipeline.formats.mesh_files import save_glb
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.types import Mesh
from mam_sim.studio.place import place_of
from mam_sim.studio.session import Session
from tests.face.studio_window import (
    CHROMIUM,
    DRAWN_BY_CPU,
    PATIENCE,
    SIZE,
)


@pytest.fixture(scope="module")
def cabinet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cabinet of plain boxes as a file: a carcass, a door before it, a knob on the door."""
    import trimesh

    carcass = [
        ((0.4, 0.02, 0.6), (0, 0.24, 0.3)), ((0.4, 0.02, 0.6), (0, -0.24, 0.3)),
        ((0.4, 0.5, 0.02), (0, 0, 0.01)), ((0.4, 0.5, 0.02), (0, 0, 0.59)),
        ((0.02, 0.5, 0.6), (0.19, 0, 0.3)),
    ]  # fmt: skip
    door = [((0.02, 0.46, 0.55), (-0.212, 0, 0.3)), ((0.04, 0.03, 0.1), (-0.242, -0.18, 0.3))]
    boxes = [
        trimesh.creation.box(size, trimesh.transformations.translation_matrix(at))
        for size, at in (*carcass, *door)
    ]
    joined: Any = trimesh.util.concatenate(boxes)
    path = tmp_path_factory.mktemp("studio") / "cabinet.glb"
    save_glb(Mesh(joined.vertices, joined.faces), path)
    return path


@pytest.fixture(scope="module")
def opened(cabinet: Path) -> Session:
    return Session(place_of(cabinet, MakeConfig(), cabinet.parent / "made"))


@pytest.fixture
def session(opened: Session) -> Session:
    while opened.can_undo:
        opened.undo()
    return opened


@pytest.fixture(scope="module")
def window() -> Iterator[Any]:
    """A window of a browser without a screen; skips where there is none."""
    sync = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine: apt-get install chromium")
    with sync.sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=[*DRAWN_BY_CPU, "--no-sandbox"]
        )
        page = browser.new_page(viewport=SIZE)
        page.set_default_timeout(PATIENCE)
        yield page
        browser.close()


@pytest.fixture(scope="module")
def page(opened: Session) -> Iterator[Any]:
    """The studio's page, served, with the cabinet open."""
    pytest.importorskip("viser", reason="the studio's page needs the extra studio")
    from mam_sim.studio.page import Page

    page = Page()
    page.put(opened)
    yield page
    page.stop()
