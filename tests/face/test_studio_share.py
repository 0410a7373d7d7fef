"""Pages that are given away: one asset, and a gallery."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mam_pipeline.errors import InputError
from mam_sim.studio.session import Session
from tests.face.studio_window import (
    canvas,
    changed,
    door,
    seen,
    until,
)


def test_the_viewers_script_was_built_from_its_source() -> None:
    import hashlib
    from importlib import resources

    folder = resources.files("mam_sim.viewer")
    digest = hashlib.sha256(folder.joinpath("source.js").read_bytes()).hexdigest()
    built = folder.joinpath("viewer.js").read_text(encoding="utf-8")
    assert digest in built[:200], "run scripts/build_viewer.sh"
    assert "three.js authors" in built[:2000] and len(built) < 1_000_000


def test_the_page_that_is_given_away_opens_offline_and_its_slider_moves_the_part(
    window: Any, session: Session, tmp_path: Path
) -> None:
    from mam_sim import viewer

    part = door(session).name
    file = tmp_path / "view.html"
    file.write_text(viewer.page(session.state.articulation, "cab</script>inet"), encoding="utf-8")
    requests: list[str] = []
    window.on("request", lambda request: requests.append(request.url))
    window.goto(file.as_uri())
    window.wait_for_function("document.body.dataset.ready === 'yes'")
    assert window.get_by_role("heading").inner_text() == "cab</script>inet"
    before, box = seen(window), canvas(window)
    slider = window.get_by_role("slider", name=part, exact=True)
    slider.focus()
    slider.press("End")
    assert until(lambda: changed(before, seen(window), box)) is not None
    slider.press("Home")
    until(lambda: True if changed(before, seen(window), box) is None else None)
    assert all(u.startswith(("file:", "blob:")) for u in requests), requests


def test_a_gallery_shows_every_asset_and_leads_to_its_page(tmp_path: Path) -> None:
    from mam_sim.verbs.view import View
    from mam_world.dataset import write_dataset

    write_dataset("station_button", 2, 0, tmp_path / "all")
    credits = tmp_path / "credits.csv"
    credits.write_text('file,credit\nstatic.glb,"<b>Ann, CC0"\n', encoding="utf-8")
    view = View(asset=tmp_path / "all", html=True, credits=credits, quiet=True, size=64)
    assert view.run() == 0
    page = (tmp_path / "all" / "gallery.html").read_text(encoding="utf-8")
    assert page.count("&lt;b&gt;Ann, CC0") == 2 and "<b>Ann" not in page
    assert "<h1>2 objects</h1>" in page and page.count("data:image/png") == 4
    for k in range(2):
        link = f"station_button_00000{k}/view.html"
        own = (tmp_path / "all" / link).read_text(encoding="utf-8")
        assert f'href="{link}"' in page and "&lt;b&gt;Ann, CC0" in own
    credits.write_text("name,by\nstatic.glb,Ann\n", encoding="utf-8")
    with pytest.raises(InputError, match="needs the columns file and credit"):
        replace(view).run()


@pytest.mark.slow
def test_the_sites_gallery_is_made_by_one_command_and_says_who_made_the_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "docs"))
    import hooks
    import make_gallery

    from mam_world.dataset import write_dataset

    write_dataset("station_button", 1, 0, tmp_path / "world")
    folder, made = tmp_path / "others", tmp_path / "gallery"
    folder.mkdir()
    static = tmp_path / "world" / "station_button_000000" / "static.glb"
    static.rename(folder / "button.glb")
    (folder / "credits.csv").write_text('file,credit\nbutton.glb,"Ann, CC0"\n', encoding="utf-8")
    assert make_gallery.main(["--count", "1", "--others", str(folder), "--out", str(made)]) == 0
    monkeypatch.setattr(hooks, "GALLERY", made)
    assert "objects/gallery.html" in hooks._gallery() and "Of 1 inputs: " in hooks._gallery()
    hooks.on_post_build({"site_dir": str(tmp_path / "site")})
    published = tmp_path / "site" / "gallery" / "objects"
    page = (published / "gallery.html").read_text(encoding="utf-8")
    (link,) = re.findall(r'href="([^"]+)"', page)
    assert "Ann, CC0" in page and "Ann, CC0" in (published / link).read_text(encoding="utf-8")
    (folder / "credits.csv").write_text("file,credit\n../x.glb,Ann\n", encoding="utf-8")
    with pytest.raises(InputError):
        make_gallery.of_others(folder)


def test_films_are_of_objects_that_pass_evenly_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "docs"))
    import make_gallery

    rows = [{"name": str(k), "status": "passes" if k % 2 else "fails"} for k in range(12)]
    assert make_gallery.in_turn(rows, 3) == ["1", "5", "9", "3", "7", "11"]
    assert make_gallery.in_turn(rows, 99) == ["1", "3", "5", "7", "9", "11"]
    assert make_gallery.in_turn([], 3) == []


@pytest.mark.sim
@pytest.mark.slow
def test_a_robots_attempt_is_filmed_once_and_told_with_what_came_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mani_skill", reason="films need the simulator")
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "docs"))
    import make_gallery

    from mam_pipeline.asset.card import Asset
    from mam_sim.facts import attempt_ok, attempt_sentence
    from mam_sim.report import film_url
    from mam_world.dataset import write_dataset

    write_dataset("station_button", 1, 0, tmp_path)
    folder = tmp_path / "station_button_000000"
    make_gallery.films([folder], 1)
    card, when = Asset.load(folder).card, (folder / "asset.json").stat().st_mtime_ns
    told = attempt_sentence(card)
    assert told.startswith("Robot panda, task ") and ", button: " in told
    assert attempt_ok(card) == (": succeeds at attempt " in told) != (": fails" in told)
    assert film_url(folder).startswith("data:video/mp4;base64,")
    make_gallery.films([folder], 1)
    assert (folder / "asset.json").stat().st_mtime_ns == when


def test_a_page_gets_the_suffix_by_which_a_browser_opens_it(tmp_path: Path) -> None:
    from mam_sim.verbs.view import View
    from mam_world.dataset import write_dataset

    write_dataset("station_button", 1, 0, tmp_path)
    asset = tmp_path / "station_button_000000"
    for given, written in (("page", "page.html"), ("v1.2", "v1.2.html"), ("a.HTM", "a.HTM")):
        assert View(asset=asset, html=True, quiet=True, out=tmp_path / given).run() == 0
        assert (tmp_path / written).read_text(encoding="utf-8").startswith("<!doctype html>")
