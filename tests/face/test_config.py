"""One way to configure: a file fills the options of a verb, flags go over it, and all is saved."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from pathlib import Path

import pytest
import yaml
from mam_sim_bench.config import BenchConfig

from mam_envs.config import EnvConfig, RewardConfig, SuccessConfig
from mam_pipeline import config_file
from mam_pipeline.errors import ConfigError
from mam_pipeline.make_config import MakeConfig
from mam_policies.algorithms import ALGORITHMS
from mam_policies.algorithms.ppo import Ppo
from mam_policies.run import EnvChoice, RunInfo
from mam_sim.cli import VERBS, main, verb_class
from mam_sim.options import Verb, carried, defaults, fill, parse, settings
from mam_sim.preset_files import presets

ROOT = Path(__file__).resolve().parents[2]
PRESETS = {"pipeline": "articulate", "env": "make-env"}


def options(verb: str, *args: str | Path) -> Verb:
    return parse(verb_class(verb), f"mam-sim {verb}", [str(a) for a in args])


@pytest.mark.parametrize(
    "file", [f for folder in PRESETS for f in sorted((ROOT / "configs" / folder).glob("*.yaml"))],
    ids=lambda f: f.stem,
)  # fmt: skip
def test_presets_say_what_differs_from_the_defaults(file: Path) -> None:
    plain = defaults(verb_class(PRESETS[file.parent.name]))
    values = config_file.read(file)
    assert settings(fill(plain, values, file)) != settings(plain)
    assert list(values) == [file.parent.name]


@pytest.mark.parametrize(
    "file", sorted((ROOT / "configs" / "policies").glob("*.yaml")), ids=lambda f: f.stem
)
def test_presets_of_training_name_an_algorithm_and_its_settings(file: Path) -> None:
    got = options("train", "cabinet", "--out", "run", "--config", file)
    plain = options("train", "cabinet", "--out", "run", "--algo", config_file.read(file)["algo"])
    assert settings(got) != settings(plain) and set(settings(got)) == set(settings(plain))


def test_presets_come_with_the_package_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = [f for f in (ROOT / "configs").glob("*/*.yaml") if f.parent.name != "train"]
    assert {n: f.resolve() for n, f in presets().items()} == {f.stem: f for f in files}
    monkeypatch.chdir(tmp_path)
    by_name = options("train", "cabinet", "--out", "run", "--config", "bc_drawer")
    by_file = options("train", "cabinet", "--out", "run", "--config", presets()["bc_drawer"])
    assert settings(by_name) == settings(by_file)
    with pytest.raises(ConfigError, match="did you mean bc_drawer"):
        options("train", "cabinet", "--out", "run", "--config", "bc_drawr")
    Path("bc_drawer").write_text("algo: ppo\n")  # a file of that name here comes first
    assert options("train", "cabinet", "--out", "run", "--config", "bc_drawer").algo == "ppo"  # type: ignore[attr-defined]


def test_randomisation_is_switched_on_by_name_or_file(tmp_path: Path) -> None:
    chance = config_file.read(presets()["randomised"])["env"]["randomisation"]
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump({"colour": 0.3}))
    for verb, args in (("collect", ["x", "--out", "y"]), ("train", ["x", "--out", "y"]),
                       ("eval", ["--expert", "--asset", "x"])):  # fmt: skip
        got = options(verb, *args, "--randomise", "randomised", "--env.randomisation.yaw", "3").env  # type: ignore[attr-defined]
        assert got.randomisation.colour == chance["colour"] and got.randomisation.yaw == 3.0
        got = options(verb, *args, "--randomise", file).env  # type: ignore[attr-defined]
        assert got == EnvConfig(randomisation=replace(got.randomisation, colour=0.3))
    RunInfo("bc", EnvChoice(("x",), config=EnvConfig.make({"success": {"fraction": 0.5}})), [],
            8, 7).save(tmp_path)  # fmt: skip
    got = options("eval", tmp_path, "--randomise", file).env  # type: ignore[attr-defined]
    assert got.success.fraction == 0.5 and got.randomisation.colour == 0.3
    file.write_text("hue: 1\n")
    with pytest.raises(ConfigError, match="hue"):
        options("collect", "x", "--out", "y", "--randomise", file)


def test_a_run_is_configured_by_its_algorithm(tmp_path: Path) -> None:
    given = options(
        "train", "cabinet", "--out", "run", "--algo", "ppo", "--steps", "7", "--clip-range", "0.3",
        "--env.success.fraction", "0.5", "--joint", "drawer",
    )  # fmt: skip
    file = tmp_path / "saved.yaml"
    file.write_text(yaml.safe_dump(settings(given)))
    again = options("train", "cabinet", "--out", "run", "--config", file)
    assert settings(again) == settings(given)
    assert again.train == Ppo.Config(steps=7, clip_range=0.3)  # type: ignore[attr-defined]
    file.write_text("algo: ppo\ntrain: {epochs: 3}\n")
    with pytest.raises(ConfigError, match="no setting 'epochs' in train; did you mean"):
        options("train", "cabinet", "--out", "run", "--config", file)


def test_an_evaluation_keeps_the_environment_of_the_training(tmp_path: Path) -> None:
    env = EnvConfig(reward=RewardConfig(reach=5.0))
    info = RunInfo("bc", EnvChoice(("a",), config=env), [], 1, 1)
    info.save(tmp_path)
    assert RunInfo.load(tmp_path) == info
    got = options("eval", tmp_path, "--env.reward.contact", "3").env  # type: ignore[attr-defined]
    assert got == EnvConfig(reward=RewardConfig(reach=5.0, contact=3.0))


def test_what_was_collected_says_how(tmp_path: Path) -> None:
    given = options("collect", "a", "--out", "b", "--episodes", "3", "--env.reward.reach", "2")
    file = tmp_path / "collect.json"
    config_file.save(settings(given), file)
    assert settings(options("collect", "a", "--out", "b", "--config", file)) == settings(given)


def test_flags_go_over_the_file_and_the_file_over_the_defaults(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text("pipeline: {height: 0.9, engine: {solver: lm, seed: 3}}\nquiet: true\n")
    got = options("articulate", "x.glb", "--out", "a", "--config", file, "--solver", "init")
    pipeline = got.pipeline  # type: ignore[attr-defined]
    assert isinstance(pipeline, MakeConfig) and got.quiet
    assert (pipeline.height, pipeline.engine.solver, pipeline.engine.seed) == (0.9, "init", 3)
    assert pipeline.engine.segmenter == "auto"


def test_what_is_saved_is_read_again(tmp_path: Path) -> None:
    given = options(
        "make-env", "x.glb", "--height", "0.9", "--segmenter", "geometric", "--layout", "3 drawers",
        "--max-cost", "0.5", "--env.reward.reach", "2", "--env.randomisation.start", "0.1", "0.2",
        "--env.scene.cameras.front.width", "64", "--retexture", "door", "red wood",
        "--hints", "h.yaml",
    )  # fmt: skip
    file = tmp_path / "saved.yaml"
    file.write_text(yaml.safe_dump(settings(given)))
    again = options("make-env", "x.glb", "--config", file)
    assert settings(again) == settings(given)
    env = again.env  # type: ignore[attr-defined]
    assert isinstance(env, EnvConfig) and env.randomisation.start == (0.1, 0.2)
    assert EnvConfig.make(file) == env


def test_the_next_command_carries_what_was_chosen(tmp_path: Path) -> None:
    file = tmp_path / "my settings.yaml"
    file.write_text("pipeline: {height: 0.9}\nenv: {reward: {reach: 2}}\n")
    flags: list[str | Path] = [
        "--config", file, "--segmenter", "geometric", "--seed", "3", "--no-interiors",
        "--layout", "3 drawers", "--retexture", "door", "red wood", "--no-plain-travel",
    ]  # fmt: skip
    given = options("articulate", "x.glb", "--out", "a", *flags)
    words = carried(given, sections=("pipeline",))
    assert words[:2] == ["--config", str(file)] and "--height" not in words
    again = options("make-env", "x.glb", *words)
    assert again.pipeline == given.pipeline  # type: ignore[attr-defined]
    given = options(
        "collect", "a", "--out", "d", "--config", file, "--robot", "so100", "--task", "close",
        "--joint", "door", "--env.randomisation.start", "0.1", "0.2",
        "--env.scene.cameras.front.width", "64", "--env.scene.no-wall",
    )  # fmt: skip
    again = options(*given._training())  # type: ignore[attr-defined]
    assert again.env == given.env  # type: ignore[attr-defined]
    told = (again.robot, again.task, again.joint)  # type: ignore[attr-defined]
    assert told == ("so100", "close", "door")
    assert carried(options("collect", "a", "--out", "d")) == []


def test_every_scale_of_the_reward_has_a_flag() -> None:
    args = [word for f in fields(RewardConfig) for word in (f"--env.reward.{f.name}", "7")]
    reward = options("make-env", "x.glb", *args).env.reward  # type: ignore[attr-defined]
    assert set(vars(reward).values()) == {7.0}


def test_help_says_each_sentence_in_one_piece(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["make-env", "--help-all"]) == 0
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "PART PICTURE, or PART and words, of which an image endpoint" in said
    assert (
        "--height LENGTH Height of the object: 55cm, 22in; a bare number is metres." in said
        and "{None}" not in said
    )
    assert "--env.randomisation.damping FLOAT FLOAT factors on the joint's values." in said


def test_help_shows_what_people_use_and_says_where_the_rest_is(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["make-env", "--env.reward.reach", "2", "--help"]) == 0
    said = capsys.readouterr().out
    assert "--height LENGTH" in said and "--robot TEXT" in said
    assert "--env.reward" not in said and "--closed-fronts" not in said
    assert said.rstrip().endswith("mam-sim make-env --help-all shows all options")
    # what it does not show is taken all the same
    assert options("make-env", "x.glb", "--no-abstain").pipeline.engine.rules.abstain is False  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "words", [*([verb] for verb in VERBS), *(["train", "--algo", a] for a in ALGORITHMS.builtin)]
)
def test_help_is_short(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*words, "--help"]) == 0
    shown = re.findall(r"^[ │]*(--[a-z][\w.-]*)", capsys.readouterr().out, re.MULTILINE)
    assert "--quiet" in shown and len(set(shown)) <= 20, shown


def test_the_bench_is_configured_in_the_same_way(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text("bench: {fuse: true, engine: {prior: none}, models: {questions: asked}}\n")
    bench = options("bench", "x", "--config", file, "--no-exec").bench  # type: ignore[attr-defined]
    assert isinstance(bench, BenchConfig) and not bench.execute
    assert (bench.fuse, bench.engine.prior, bench.models.questions) == (True, "none", Path("asked"))


def test_sections_of_other_verbs_are_passed_over(tmp_path: Path) -> None:
    file = tmp_path / "project.yaml"
    file.write_text("pipeline: {height: 0.9}\nenv: {reward: {reach: 2}}\nbench: {fuse: true}\n")
    got = options("articulate", "x.glb", "--out", "a", "--config", file)
    assert got.pipeline.height == 0.9  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("pipelin: {height: 1}", "there is no setting 'pipelin'; did you mean 'pipeline'?"),
        (
            "pipeline: {heigth: 1}",
            "no setting 'heigth' in pipeline; did you mean 'pipeline.height'",
        ),
        ("segmenter: geometric", "did you mean 'pipeline.engine.segmenter'?"),
        ("pipeline: {height: tall}", "pipeline.height must be a length such as 0.55 (metres)"),
        ("pipeline: {up: w}", "pipeline.up must be one of auto, x, -x, y, -y, z, -z, not 'w'"),
        ("pipeline: [", "is not YAML"),
    ],
)
def test_a_wrong_file_is_refused_in_one_sentence(
    text: str, sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "wrong.yaml"
    file.write_text(text)
    assert main(["articulate", "x.glb", "--out", str(tmp_path / "a"), "--config", str(file)]) == 2
    said = capsys.readouterr().err
    assert sentence in said and str(file) in said and len(said.splitlines()) == 1


def test_a_missing_file_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "a", "--config", "none.yaml"]) == 2
    assert capsys.readouterr().err == "mam-sim: there is no configuration file none.yaml\n"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["view", "X", "--size", "9999999"], "--size must be a number from 16 to 4096, not"),
        (["view", "X", "--frames", "0"], "--frames must be a number from 2 to 1000, not 0"),
        (["view", "X", "--azimuth", "nan"], "--azimuth must be a number from -360 to 360, not nan"),
        (["collect", "X", "--out", "Y", "--noise", "-1"], "--noise must be a number from 0 to 1"),
        (["collect", "X", "--out", "Y", "--seed", "-1"], "--seed must be at least 0, not -1"),
        (["generate", "--out", "Y", "--count", "0"], "--count must be a number from 1 to 100000"),
        (["eval", "X.zip", "--episodes", "0"], "--episodes must be a number from 1 to"),
        (["train", "X", "--out", "Y", "--noise", "inf"], "--noise must be a number from 0 to 1"),
        (["make-env", "X", "--seed", str(10**20)], "--seed must be a number from 0 to"),
        (
            ["collect", "X", "--out", "Y", "--env.randomisation.yaw", "nan"],
            "--env.randomisation.yaw must be a number from 0 to 180, not nan",
        ),
        (
            ["collect", "X", "--out", "Y", "--env.success.still-speed", "0.1", "-1"],
            "--env.success.still-speed[1] must be a number above 0, not -1.0",
        ),
    ],
)
def test_numbers_have_ranges(
    words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    assert sentence in " ".join(capsys.readouterr().err.split())


def test_a_python_caller_meets_the_same_ranges(tmp_path: Path) -> None:
    bad = {"randomisation": {"friction": [float("nan"), 1.0]}}
    with pytest.raises(ConfigError, match=r"friction\[0\] must be"):
        EnvConfig.make(bad)
    made = EnvConfig(success=SuccessConfig(fraction=float("nan")))
    with pytest.raises(ConfigError, match=r"success\.fraction must be a number above 0"):
        EnvConfig.make(made)
    with pytest.raises(ConfigError, match="--scale must be a number above 0"):
        MakeConfig(scale=float("inf")).check()
