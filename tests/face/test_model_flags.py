"""Flags for models outside mam-sim on make-env, articulate and bench."""

from __future__ import annotations

import io
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from mam_sim_bench.config import BenchConfig
from mam_sim_bench.runner import Task, run_bench, task_key
from PIL import Image

from mam_pipeline.errors import ConfigError
from mam_pipeline.make_config import EngineConfig, MakeConfig
from mam_pipeline.models import settings, transports
from mam_pipeline.models.catalogue import ENDPOINT, models
from mam_pipeline.models.settings import ModelConfig
from mam_sim.asking import ask_upload, with_model
from mam_sim.cli import main

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def box(tmp_path: Path) -> Path:
    """A cabinet with a door in front and a knob on it, as a mesh file."""
    at = trimesh.transformations.translation_matrix
    scene = trimesh.Scene(
        [
            trimesh.creation.box((0.4, 0.5, 0.6), at((0, 0, 0.3))),
            trimesh.creation.box((0.02, 0.46, 0.5), at((-0.215, 0, 0.3))),
            trimesh.creation.box((0.04, 0.05, 0.05), at((-0.245, 0.18, 0.3))),
        ]
    )
    path = tmp_path / "box.stl"
    scene.to_geometry().export(path)
    return path


def test_flags_go_before_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MAM_SIM_MAX_COST", "9")
    flags = ModelConfig(max_cost=0.25, vlm_model="m", questions=Path("asked"))
    with settings.given(flags.settings()):
        assert settings.number("MAM_SIM_MAX_COST", 1.0) == 0.25
        assert settings.text("MAM_SIM_VLM_MODEL") == "m"
        assert settings.folder("MAM_SIM_QUESTIONS") == Path("asked")
        with settings.given({"MAM_SIM_VLM_MODEL": None}):
            assert settings.text("MAM_SIM_VLM_MODEL") == "m"
    assert settings.number("MAM_SIM_MAX_COST", 1.0) == 9
    assert ModelConfig().settings() == {}


@pytest.mark.parametrize("verb", ["make-env", "articulate", "bench"])
def test_help_names_them(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([verb, "--help-all"]) == 0
    said = capsys.readouterr().out
    for flag in (
        "--max-cost",
        "--questions",
        "--vlm-url",
        "--vlm-model",
        "--prior-file",
        "--space",
    ):
        assert flag in said
    assert ("--retexture" in said) == (verb != "bench")


def test_articulate_asks_in_a_folder_and_goes_on_when_answered(
    box: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked, out = tmp_path / "asked", tmp_path / "asset"
    command = ["articulate", str(box), "--up", "z", "--out", str(out), "--quiet"]
    command += ["--reasoner", "file", "--questions", str(asked)]
    assert main(command) == 3
    assert "1_parts" in capsys.readouterr().err and not out.exists()
    text = (asked / "1_parts" / "question.md").read_text()
    rows = [line for line in text.splitlines() if line[:1].isdigit() and ": x " in line]
    assert len(rows) == 3  # the body, the door and the knob
    spans = [[float(v) for v in r.split("x ")[1].split(",")[0].split("..")] for r in rows]
    body = int(np.argmax([b - a for a, b in spans]))
    pieces = [i for i in range(3) if i != body]
    door = {
        "name": "door", "pieces": pieces, "motion": "hinge", "axis": "z", "side": "-y",
        "opens": "-x",
    }  # fmt: skip
    answer = {"base": "body", "parts": [door]}
    (asked / "1_parts" / "answer.json").write_text(json.dumps(answer))
    assert main(command) == 3
    assert "3_motion" in capsys.readouterr().err
    (asked / "3_motion" / "answer.json").write_text('{"joints": [{"name": "door", "ok": true}]}')
    assert main(command) == 0
    card = json.loads((out / "asset.json").read_text())
    assert [j["name"] for j in card["joints"]] == ["door_joint"]
    assert card["joints"][0]["subtype"] == "hinge"
    assert (out / "stages" / "2_prior" / "masks.npz").is_file()
    assert "Kinematic masks" in (out / "report.html").read_text(encoding="utf-8")


def _photo(folder: Path) -> Path:
    picture = np.full((200, 300, 3), 235, dtype=np.uint8)
    picture[60:150, 100:200] = (120, 60, 30)
    Image.fromarray(picture).save(folder / "photo.png")
    return folder / "photo.png"


def test_a_photo_is_sent_away_only_after_a_yes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv("MAM_SIM_MESH_CACHE", str(tmp_path / "meshes"))
    monkeypatch.delenv("MAM_SIM_ALLOW_UPLOAD", raising=False)
    monkeypatch.delenv("FAL_KEY", raising=False)
    photo, out = _photo(tmp_path), tmp_path / "asset"
    command = ["articulate", str(photo), "--out", str(out), "--quiet", "--reconstructor", "fal"]
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    assert main(command) == 2
    assert "set FAL_KEY to your key" in capsys.readouterr().err
    monkeypatch.setenv("FAL_KEY", "x")
    assert main(command) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2 and "takes about $0.375 for a mesh" in said[0]
    assert said[1].startswith("mam-sim: fal.ai gets this photo") and "--allow-upload" in said[1]
    assert main([*command, "--allow-upload", "--max-cost", "0.2"]) == 2
    assert "passes the cap of $0.20 (--max-cost)" in capsys.readouterr().err
    assert not out.exists() and main(["batch", str(photo), *command[2:5], *command[5:]]) == 2
    assert "batch has no --reconstructor fal" in capsys.readouterr().err

    typed = io.StringIO("\ny\n")
    monkeypatch.setattr(typed, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(sys, "stdin", typed)
    with pytest.raises(ConfigError, match=r"nothing was sent to fal.ai"):
        ask_upload(photo, "fal")
    ask_upload(photo, "fal")
    assert "later ones? [y/N]" in capsys.readouterr().err
    ask_upload(photo, "fal")  # it is remembered
    assert capsys.readouterr().err.count("fal.ai") == 1
    assert (tmp_path / "config" / "mam-sim" / "uploads.txt").read_text() == "fal.ai\n"
    ask_upload(photo, "embedded")
    ask_upload(photo, "auto")
    assert capsys.readouterr().err == ""


def test_auto_takes_the_configured_model_only_after_a_yes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("openai", reason="the vlm extra is not installed")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL", "MAM_SIM_VLM_MODEL", "MAM_SIM_ALLOW_MODEL"):
        monkeypatch.delenv(name, raising=False)
    trimesh.creation.box().export(tmp_path / "box.stl")
    mesh, photo, config = tmp_path / "box.stl", _photo(tmp_path), MakeConfig()
    typed = io.StringIO("y\nn\n")
    monkeypatch.setattr(typed, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(sys, "stdin", typed)
    assert with_model(mesh, config) == config  # none is configured
    monkeypatch.setenv("OPENAI_API_KEY", "sk-secret-of-the-user")
    assert with_model(mesh, config).engine.reasoner == "vlm"
    told = capsys.readouterr().err
    assert "gpt-4o at api.openai.com sees pictures" in told and "about $0.14" in told
    assert with_model(photo, config).photo.reader == "vlm"  # it is remembered
    assert "[y/N]" not in capsys.readouterr().err
    named = replace(config, engine=replace(config.engine, reasoner="embedded"))
    assert with_model(mesh, named) == named
    monkeypatch.setenv("OPENAI_BASE_URL", "http://user:pw@localhost:1/v1")  # somebody else
    assert with_model(mesh, config) == config
    assert "gpt-4o at localhost:1 sees" in capsys.readouterr().err
    assert with_model(mesh, config) == config  # the no is remembered, too
    kept = (tmp_path / "config" / "mam-sim" / "uploads.txt").read_text()
    assert kept == "gpt-4o at api.openai.com\nno: gpt-4o at localhost:1\n"
    monkeypatch.setenv("MAM_SIM_ALLOW_MODEL", "1")
    assert with_model(mesh, config).engine.reasoner == "vlm"
    assert "secret" not in kept and "pw" not in capsys.readouterr().err


def test_a_model_that_auto_took_and_that_fails_is_left_out(
    box: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("openai", reason="the vlm extra is not installed")
    monkeypatch.setattr(transports, "LIMITS", replace(transports.LIMITS, pauses=(0.01,)))
    monkeypatch.setenv("OPENAI_BASE_URL", "http://127.0.0.1:9/v1")
    monkeypatch.setenv("MAM_SIM_ALLOW_MODEL", "1")
    command = ["articulate", str(box), "--out", str(tmp_path / "box")]
    main([*command, "--quiet"])
    assert "the language model is left out: the endpoint failed" in capsys.readouterr().err
    assert (tmp_path / "box" / "asset.json").is_file()
    assert main([*command, "--quiet", "--reasoner", "vlm"]) == 2
    assert "without a model: --reasoner embedded" in capsys.readouterr().err


def test_bench_keeps_no_record_of_an_object_that_waits(tmp_path: Path) -> None:
    task = Task("drawer_1", "drawer_unit", "generated:test", 1)
    from mam_world.splits import iterate

    category, seed = next(iter(iterate("validation", 1)))
    task = Task(f"{category}_{seed}", category, "generated:validation", seed)
    engine = EngineConfig("geometric", "none", "file", "init")
    models = ModelConfig(questions=tmp_path / "asked")
    config = BenchConfig(engine=engine, execute=False, models=models)
    log = tmp_path / "log.jsonl"
    before = task_key(task, config)
    record = run_bench([task], config, log)[0]
    assert record.status == "asked" and not log.exists()
    question = tmp_path / "asked" / task.id / "1_grouping"
    assert (question / "question.md").is_file()
    (question / "answer.json").write_text("{}")
    assert task_key(task, config) != before


def test_bench_keeps_the_cap_in_one_process(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "generated:test", "--reasoner", "vlm", "--jobs", "2"]) == 2
    assert "--jobs 1" in capsys.readouterr().err


def test_doctor_tells_how_to_get_each_model(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for model in models():
        monkeypatch.delenv(model.variable, raising=False)
        assert model.licence and model.commands and (ROOT / model.page).is_file()
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    assert not any(model.look().ok for model in models())
    p3sam = next(model for model in models() if model.name == "P3-SAM")
    monkeypatch.setenv("MAM_SIM_P3SAM", "/nowhere/python run.py")
    assert "no such executable" in p3sam.look().text
    monkeypatch.setenv("MAM_SIM_P3SAM", "python3 /nowhere/run.py")
    assert "no such file" in p3sam.look().text
    monkeypatch.setenv("MAM_SIM_P3SAM", "python3")
    monkeypatch.setenv("P3SAM_HOME", str(tmp_path))
    assert p3sam.look().ok and "version unknown" in p3sam.look().text
    monkeypatch.setenv("MAM_SIM_P3SAM", "http://127.0.0.1:9")
    assert "does not answer" in p3sam.look().text
    monkeypatch.setenv("OPENAI_API_KEY", "sk-secret")
    assert "sk-secret" not in ENDPOINT.look().text
