"""A folder is reviewed in a real browser: pictures, keys that decide, and rows to go to."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import Any

import pytest

from mam_pipeline.make_config import MakeConfig
from tests.face.studio_window import until


def decided(folder: Path) -> dict[str, tuple[str, float]]:
    """Decision and seconds by the object's name, as the review's CSV has them."""
    file = folder / "review.csv"
    if not file.is_file():
        return {}
    with file.open(newline="", encoding="utf-8") as opened:
        return {
            re.split(r"[.-]", row["path"])[0]: (row["decision"], float(row["seconds"]))
            for row in csv.DictReader(opened) if row["decision"]
        }  # fmt: skip


def test_in_a_browser_a_folder_is_decided_on_by_keys_and_the_list_leads_to_an_object(
    cabinet: Path, window: Any, tmp_path: Path
) -> None:
    pytest.importorskip("viser", reason="the studio's page needs the extra studio")
    from mam_sim.studio.page import Page
    from mam_sim.studio.review import Review

    for name in ("left", "right"):
        (tmp_path / f"{name}.glb").write_bytes(cabinet.read_bytes())
    (tmp_path / "broken.glb").write_bytes(b"no mesh")
    page = Page(queue=True)

    def shown() -> str:
        """Name of the open object, when a decision would be on it."""
        queue: Any = page._queue
        return "" if queue._leaving else re.split(r"[.-]", queue.path)[0]

    try:
        page.review(Review(tmp_path), MakeConfig())
        window.goto(page.url)
        window.get_by_text("0 of 3 decided").wait_for()  # its tab is the open one
        window.locator(".object", has_text="cannot be opened").wait_for()
        pictures = "[...document.querySelectorAll('.object img')].filter((i) => i.naturalWidth > 1)"
        window.wait_for_function(f"{pictures}.length === 2")
        window.keyboard.press("Delete")
        until(lambda: decided(tmp_path).get("broken", ("",))[0] == "reject")
        first = until(lambda: shown() if shown() in ("left", "right") else None)
        other = {"left": "right", "right": "left"}[first]
        window.locator(".object", has_text=other).click()
        until(lambda: shown() == other)
        window.get_by_text("1 of 3 decided").wait_for()
        window.keyboard.press("Enter")
        until(lambda: shown() == first)
        until(lambda: (tmp_path / f"{other}-asset" / "asset.json").is_file())
        window.get_by_text("2 of 3 decided").wait_for()
        window.keyboard.press("m")
        window.get_by_text("3 of 3 decided").wait_for()
        said = decided(tmp_path)
        assert {name: said[name][0] for name in said} == {
            "broken": "reject", other: "accept", first: "mend",
        }  # fmt: skip
        assert all(seconds > 0 for _, seconds in said.values())
    finally:
        page.stop()
