"""Nothing outside a stranger's folder is read, copied or written, whoever is asked to open it."""

from __future__ import annotations

import io
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from mam_pipeline.asset.card import Asset
from mam_pipeline.check.check import check_asset
from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door, Outside, Survey, outside_allowed
from mam_pipeline.formats.mesh_files import load_mesh
from mam_pipeline.formats.urdf.tree import parse_urdf
from mam_pipeline.stage_store import copy_stages
from mam_sim.cli import main as mam_sim


def _png() -> bytes:
    buffer = io.BytesIO()
    Image.new("RGB", (2, 2)).save(buffer, format="PNG")
    return buffer.getvalue()


PNG = _png()


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    assert mam_sim(["generate", "--category", "box_cabinet", "--out", str(folder), "--quiet"]) == 0
    return next(p.parent for p in folder.glob("*/asset.json"))


@pytest.fixture
def asset(made: Path, tmp_path: Path) -> Path:
    secret = tmp_path / "secret.obj"
    shutil.copy(next(made.glob("visual/*.obj")), secret)
    return Path(shutil.copytree(made, tmp_path / "asset"))


def _mesh(name: str) -> Callable[[Path], None]:
    def spoil(asset: Path) -> None:
        urdf = asset / "object.urdf"
        text = urdf.read_text()
        old = text.partition('filename="')[2].partition('"')[0]
        urdf.write_text(text.replace(old, name.replace("HERE", str(asset.parent)), 1))

    return spoil


def _linked(pattern: str, target: str = "secret.obj") -> Callable[[Path], None]:
    def spoil(asset: Path) -> None:
        file = sorted(asset.glob(pattern))[0]
        file.unlink()
        file.symlink_to(asset.parent / target)

    return spoil


def _texture(name: str) -> Callable[[Path], None]:
    def spoil(asset: Path) -> None:
        mtl = sorted(asset.glob("visual/*.mtl"))[0]
        mtl.write_text(f"{mtl.read_text()}map_Kd {name}\n")

    return spoil


def _pipe(asset: Path) -> None:
    file = sorted(asset.glob("visual/*.obj"))[0]
    file.unlink()
    os.mkfifo(file)


def _card(asset: Path) -> None:
    file = asset / "asset.json"
    data = json.loads(file.read_text())
    (asset.parent / "object.urdf").write_text((asset / "object.urdf").read_text())
    file.write_text(json.dumps({**data, "urdf": "../object.urdf"}))


HOSTILE = {
    "relative": _mesh("../secret.obj"),
    "absolute": _mesh("HERE/secret.obj"),
    "file": _mesh("file://HERE/secret.obj"),
    "package": _mesh("package://x/../../secret.obj"),
    "link": _linked("visual/*.obj"),
    "linked urdf": _linked("object.urdf"),
    "linked card": _linked("asset.json"),
    "loop of links": _linked("visual/*.obj", "asset/visual"),
    "pipe": _pipe,
    "texture": _texture("../../secret.obj"),
    "texture after options": _texture("-s 1 1 1 ../../secret.obj"),
    "card": _card,
}


@pytest.mark.parametrize("spoil", HOSTILE.values(), ids=HOSTILE)
def test_no_verb_opens_what_lies_outside(
    asset: Path, spoil: Callable[[Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    spoil(asset)
    with pytest.raises(InputError):
        Asset.load(asset)
    out = asset.parent / "out"
    verbs = [["view"], ["export", "--to", "mjcf"], ["export", "--to", "usd"], ["collect"]]
    for verb, *more in verbs:
        assert mam_sim([verb, str(asset), *more, "--out", str(out)]) == 2
        assert "Traceback" not in capsys.readouterr().err and not out.exists()
    assert mam_sim(["check", str(asset)]) in (1, 2)


def test_the_users_own_urdf_may_reach_outside(asset: Path) -> None:
    _mesh("../secret.obj")(asset)
    (asset / "asset.json").unlink()
    with pytest.raises(InputError, match="--allow-outside"):
        parse_urdf(asset / "object.urdf")
    assert check_asset(asset, drive=False).reasons == ("mesh_outside",)
    assert mam_sim(["view", str(asset / "object.urdf"), "--allow-outside", "--quiet"]) == 0
    assert "mesh_outside" not in check_asset(asset, drive=False, allow_outside=True).reasons


def test_a_card_and_its_urdf_agree(asset: Path) -> None:
    file = asset / "asset.json"
    data = json.loads(file.read_text())
    data["joints"][0]["name"] = "another"
    file.write_text(json.dumps(data))
    with pytest.raises(InputError, match=r"'another' of asset\.json is not in the URDF"):
        Asset.load(asset)
    assert "card_differs" in check_asset(asset).reasons


def test_pictures_outside_are_left_out_and_said(tmp_path: Path) -> None:
    inner = tmp_path / "a"
    inner.mkdir()
    (tmp_path / "wood.png").write_bytes(PNG)
    (inner / "a.obj").write_text(
        "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\n"
    )
    (inner / "a.mtl").write_text("newmtl m\nmap_Kd ../wood.png\n")
    loaded = load_mesh(inner / "a.obj")
    assert loaded.mesh.materials[0].image is None and "../wood.png" in loaded.notes[0]
    with outside_allowed():
        assert load_mesh(inner / "a.obj").mesh.materials[0].image == PNG
    (inner / "a.mtl").write_text("newmtl m\nmap_Kd C:\\artist\\wood.png\n")
    assert not any("outside" in note for note in load_mesh(inner / "a.obj").notes)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.dae", "<COLLADA><image><init_from>../x.png</init_from></image></COLLADA>"),
        ("b.dae", "<COLLADA><image><init_from>file://&#46;./x.png</init_from></image></COLLADA>"),
        ("a.ply", "ply\ncomment TextureFile ../x.png\nend_header\n"),
        ("a.gltf", '{"images": [{"uri": "%2e%2e/x.png"}]}'),
    ],
)
def test_every_format_that_names_files_is_looked_through(
    tmp_path: Path, name: str, text: str
) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "x.png").write_bytes(PNG)
    (tmp_path / "a" / name).write_text(text)
    with pytest.raises(Outside, match=r"x\.png"):
        Survey(Door(tmp_path / "a")).mesh(tmp_path / "a" / name)


@pytest.mark.parametrize("what", ["link", "loop", "pipe"])
def test_links_among_stages_are_never_followed(tmp_path: Path, what: str) -> None:
    stages = tmp_path / "stages" / "1_primitives"
    stages.mkdir(parents=True)
    (tmp_path / "secret").write_text("secret")
    if what == "pipe":
        os.mkfifo(stages / "x")
    else:
        (stages / "x").symlink_to(tmp_path / "secret" if what == "link" else stages.parent)
    with pytest.raises(InputError, match="x is no ordinary file"):
        copy_stages(tmp_path / "stages", tmp_path / "copy")


def test_nothing_is_written_through_a_link(asset: Path) -> None:
    (asset.parent / "mine").mkdir()
    (asset / "view").symlink_to(asset.parent / "mine")
    assert mam_sim(["view", str(asset), "--quiet"]) == 2
    (asset / "view").unlink()
    (asset / "view").mkdir()
    (asset / "view" / "closed.png").symlink_to(asset.parent / "secret.obj")
    before = (asset.parent / "secret.obj").read_bytes()
    assert mam_sim(["view", str(asset), "--quiet"]) == 0
    assert (asset.parent / "secret.obj").read_bytes() == before
    assert not list((asset.parent / "mine").iterdir())
