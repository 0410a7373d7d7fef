"""The command line: one clear sentence, the right exit status, nothing half written."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mam_pipeline.asset.card import AssetCard
from mam_pipeline.errors import ConfigError
from mam_policies.run import EnvChoice, RunInfo
from mam_sim.api import make_env
from mam_sim.cli import PACKAGES, VERBS, main


def test_every_verb_exists() -> None:
    for target, _ in VERBS.values():
        module, _, name = target.partition(":")
        assert callable(getattr(importlib.import_module(module), name))


def test_a_verb_of_a_package_that_is_not_installed_names_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for module in [m for m in sys.modules if m.partition(".")[0] in PACKAGES]:
        monkeypatch.delitem(sys.modules, module)
    for package, folder in PACKAGES.items():
        monkeypatch.setitem(sys.modules, package, None)
        verbs = [v for v, (target, _) in VERBS.items() if target.startswith(package)]
        assert verbs
        for verb in verbs:
            assert main([verb, "--help"]) == 2
            assert f"pip install ./plugins/{folder}" in capsys.readouterr().err


def test_unknown_verb_names_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["make-emv"]) == 2
    assert "did you mean 'make-env'?" in capsys.readouterr().err


def test_a_reader_that_leaves_is_no_error() -> None:
    command = f"{sys.executable} -m mam_sim.cli bench --help | head -1; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True)
    assert "usage" in done.stdout and done.stdout.endswith("0\n") and not done.stderr


def _glb_text(folder: Path) -> Path:
    path = folder / "text.glb"
    path.write_text("this is no mesh")
    return path


def _empty(folder: Path) -> Path:
    path = folder / "empty.obj"
    path.write_text("")
    return path


def _nan(folder: Path) -> Path:
    path = folder / "nan.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv nan 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n")
    return path


def _flat(folder: Path) -> Path:
    path = folder / "flat.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n")
    return path


def _urdf(folder: Path) -> Path:
    path = folder / "lost.urdf"
    path.write_text(
        '<robot name="r"><link name="a"><visual><geometry><mesh filename="gone.obj"/></geometry>'
        "</visual></link></robot>"
    )
    return path


def _unknown_suffix(folder: Path) -> Path:
    path = folder / "note.docx"
    path.write_text("hello")
    return path


@pytest.mark.parametrize(
    "make", [_glb_text, _empty, _nan, _flat, _urdf, _unknown_suffix, lambda f: f / "none.glb"]
)
def test_bad_input_is_refused_in_one_sentence(
    make: object, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = make(tmp_path)  # type: ignore[operator]
    before = sorted(tmp_path.iterdir())
    status = main(["articulate", str(source), "--out", str(tmp_path / "out")])
    error = capsys.readouterr().err
    assert status == 2
    assert "Traceback" not in error
    assert error.count("mam-sim:") == 1 and source.name in error
    assert sorted(tmp_path.iterdir()) == before


def test_flags_are_checked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = tmp_path / "cube.obj"
    corners = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T
    source.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "f 1 2 3\nf 2 3 8\n")
    out = str(tmp_path / "out")
    assert main(["articulate", str(source), "--out", out, "--height", "-1"]) == 2
    assert "--height must be a number above 0" in capsys.readouterr().err
    assert main(["articulate", str(source), "--out", out, "--segmenter", "geometrik"]) == 2
    assert "did you mean 'geometric'?" in capsys.readouterr().err
    assert not Path(out).exists()


def test_a_folder_that_is_no_asset_is_never_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("words")
    source = _flat(tmp_path)
    assert main(["articulate", str(source), "--out", str(tmp_path / "mine")]) == 2
    assert "is not empty and holds no asset" in capsys.readouterr().err
    assert (tmp_path / "mine" / "thesis.tex").read_text() == "words"


def _asset_folder(folder: Path) -> Path:
    """A card and an empty URDF: enough to be taken for an asset."""
    AssetCard(name="box", urdf="object.urdf").save(folder)
    (folder / "object.urdf").write_text("<robot name='box'/>")
    return folder


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        (["make-env", "SOURCE", "--robot", "pandaa"], "no robot named 'pandaa'; did you mean"),
        (["collect", "SOURCE", "--robot", "pandaa"], "no robot named 'pandaa'; did you mean"),
        (["collect", "SOURCE", "--task", "opem"], "no task named 'opem'; did you mean 'open'?"),
        (["train", "SOURCE", "--robot", "pandaa"], "no robot named 'pandaa'; did you mean"),
        (["make-env", "SOURCE", "--prior", "sp4"], "no prior named 'sp4'; did you mean 'sp4d'?"),
        (["articulate", "SOURCE", "--solver", "imit"], "did you mean 'init'?"),
    ],
)
def test_a_wrong_name_is_refused_before_any_file_is_read(
    command: list[str], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = _glb_text(tmp_path)  # reading it would be refused in other words
    args = [str(source) if word == "SOURCE" else word for word in command]
    assert main([*args, "--out", str(tmp_path / "out")]) == 2
    assert sentence in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("verb", ["check", "export", "collect"])
@pytest.mark.parametrize(("name", "kind"), [("x.glb", "mesh"), ("x.JPG", "photo")])
def test_what_an_asset_is_made_of_is_no_asset(
    verb: str, name: str, kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / name
    file.write_text("anything")
    out = [] if verb == "check" else ["--out", str(tmp_path / "out")]
    assert main([verb, str(file), *out]) == 2
    said = f"{file} is a {kind}, not an asset; run: mam-sim make-env {file}"
    assert said in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_an_export_of_an_asset_asks_for_the_format(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(_asset_folder(tmp_path)), "--out", str(tmp_path / "out")]) == 2
    assert "is an asset; add --to mjcf, usd, usdz or sdf" in capsys.readouterr().err


def test_a_run_without_weights_has_no_export(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    RunInfo("sac", EnvChoice(("a",)), [], 1, 1).save(tmp_path)
    assert main(["export", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "holds no policy.safetensors; has its training ended?" in capsys.readouterr().err


def test_make_env_names_its_argument_for_the_arm() -> None:
    with pytest.raises(ConfigError, match="takes the arm as `robot`"):
        make_env("cabinet", robot_uids="panda")
