"""Every folder of weights says what made it, and its files are those that it describes."""

from __future__ import annotations

import json
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

import mam_pipeline
from mam_pipeline import config_file
from mam_pipeline.errors import ConfigError
from mam_policies.shipped import SHIPPED
from mam_training import manifest, publish
from mam_training.command import configured
from mam_training.joints.train import JointTraining
from mam_training.parts.fit_abstention import AbstentionTraining
from mam_training.parts.train import PartsTraining
from mam_training.photo.fit_confidence import ConfidenceTraining
from mam_training.photo.fit_opened import OpenedTraining
from mam_training.photo.train_box import BoxTraining
from mam_training.photo.train_front import FrontTraining
from mam_training.policies.train_generalist import GeneralistTraining

ROOT = Path(__file__).resolve().parents[2]
PIPELINE = Path(mam_pipeline.__file__).parent
PATTERNS = ("*.gz", "*.npz", "*.xz", "*.safetensors", "weights/**/*.txt", "weights/**/*.json")
FOLDERS = sorted({
    file.parent for package in (PIPELINE, SHIPPED.parent) for pattern in PATTERNS
    for file in package.rglob(pattern) if "weights" in file.parts
})  # fmt: skip
TRAINERS = {
    "parts": PartsTraining, "joints": JointTraining, "photo_front": FrontTraining,
    "photo_box": BoxTraining,
    "photo_confidence": ConfidenceTraining, "photo_opened": OpenedTraining,
    "abstention": AbstentionTraining, "generalist_drawer": GeneralistTraining,
    "generalist_door": GeneralistTraining,
}  # fmt: skip


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda f: "-".join(f.parts[-3:]))
def test_weights_have_a_manifest_that_is_true(folder: Path) -> None:
    assert manifest.faults(folder) == []


def test_all_weights_lie_in_such_folders() -> None:
    assert len(FOLDERS) == 10
    loose = [f for p in PATTERNS[:4] for package in (PIPELINE, SHIPPED.parent)
             for f in package.rglob(p) if f.parent not in FOLDERS]  # fmt: skip
    assert loose == []


def named_commits() -> dict[str, str]:
    """Commits that recipes and manifests name, by where they do."""
    trainers = {name: make() for name, make in TRAINERS.items()}
    out = {name: start for name, t in trainers.items() if (start := getattr(t, "start", ""))}
    for folder in FOLDERS:
        kept = json.loads((folder / manifest.NAME).read_text(encoding="utf-8"))
        if kept["reproducible"]:
            out["/".join(folder.parts[-3:])] = kept["code"]
    return out


def test_the_commits_that_recipes_and_manifests_name_are_in_the_history() -> None:
    """Weights whose code, or whose start, nobody can check out are not made again by a command."""
    if _git("rev-parse", "--is-shallow-repository").stdout.strip() != b"false":
        pytest.skip("no clone, or one without its whole history")
    lost = {
        where: commit for where, commit in named_commits().items()
        if _git("merge-base", "--is-ancestor", commit, "HEAD").returncode
    }  # fmt: skip
    assert lost == {}


def _git(*words: str) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, check=False)


@dataclass(frozen=True)
class Recipe:
    """A trainer's config."""

    rounds: int = 3
    cache: Path = Path("cache")


def test_a_manifest_tells_what_was_changed_since(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("trees")
    data = {"rows": 2, "sha256": manifest.data_digest([b"1", b"2"])}
    manifest.write(tmp_path, "python -m t recipe.yaml", Recipe(), {"seed": 0}, data, ["generated"])
    assert manifest.faults(tmp_path) == []
    (tmp_path / "a.txt").write_text("other trees")
    (tmp_path / "b.txt").write_text("more")
    wrong, extra = sorted(manifest.faults(tmp_path), key=lambda s: "b.txt" in s)
    assert "a.txt is not the file" in wrong and "does not name b.txt" in extra
    (tmp_path / manifest.NAME).unlink()
    assert "has no manifest.json" in manifest.faults(tmp_path)[0]


def test_the_order_and_the_borders_of_data_count() -> None:
    digests = {manifest.data_digest(d) for d in ([b"a", b"b"], [b"b", b"a"], [b"ab"], [b"", b"ab"])}
    assert len(digests) == 4


@pytest.mark.parametrize("name", TRAINERS)
def test_recipes_hold_the_defaults_of_their_trainers(name: str) -> None:
    base = TRAINERS[name]()
    file = ROOT / "configs" / "train" / f"{name}.yaml"
    filled = config_file.fill(base, config_file.read(file), file)
    if name == "generalist_door":  # a trainer has the defaults of one recipe
        assert filled.kind == "door" and filled != base
    else:
        assert filled == base


def test_flags_go_over_a_recipe_and_unknown_keys_are_errors(tmp_path: Path) -> None:
    file = tmp_path / "recipe.yaml"
    file.write_text("rounds: 5\n")
    assert configured(Recipe(), [str(file)]) == Recipe(rounds=5)
    assert configured(Recipe(), [str(file), "--rounds", "7"]) == Recipe(rounds=7)
    file.write_text("round: 5\n")
    with pytest.raises(ConfigError, match="did you mean 'rounds'"):
        configured(Recipe(), [str(file)])


def made_weights(folder: Path, code: str) -> Path:
    """A folder of weights with a manifest that says which code made it."""
    folder.mkdir(parents=True)
    (folder / "model.txt").write_text("trees")
    data = {"rows": 1, "sha256": manifest.data_digest([b"1"])}
    file = manifest.write(folder, "python -m t", Recipe(), {"seed": 0}, data, ["generated"])
    kept = json.loads(file.read_text())
    file.write_text(json.dumps({**kept, "code": code}))
    return folder


def test_what_is_published_takes_the_place_of_the_old_weights_whole(tmp_path: Path) -> None:
    made_weights(tmp_path / "build" / "parts" / "abstention", "abc1234")
    old = publish.published_place("parts/abstention", tmp_path / "package")
    old.mkdir(parents=True)
    (old / "old.txt").write_text("gone afterwards")
    assert publish.rooms_of(tmp_path / "build") == ["parts/abstention"]
    publish.publish(tmp_path / "build", ["parts/abstention"], tmp_path / "package")
    assert sorted(p.name for p in old.iterdir()) == [manifest.NAME, "model.txt"]
    assert manifest.faults(old) == []


@pytest.mark.parametrize("code", ["abc1234-dirty", "unknown"])
def test_weights_of_code_that_is_no_commit_are_refused(tmp_path: Path, code: str) -> None:
    made_weights(tmp_path / "build" / "joints", code)
    with pytest.raises(ConfigError, match="is no commit; commit, then train again: python -m t"):
        publish.publish(tmp_path / "build", ["joints"], tmp_path / "package")
    assert not (tmp_path / "package").exists()


def test_a_working_tree_with_changes_publishes_nothing(tmp_path: Path) -> None:
    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    publish.check_tree(tmp_path)
    (tmp_path / "changed.py").write_text("")
    with pytest.raises(ConfigError, match=r"clean working tree only, here is: .*changed\.py"):
        publish.check_tree(tmp_path)


@pytest.mark.parametrize("name", TRAINERS)
def test_no_trainer_writes_into_the_package_by_itself(name: str) -> None:
    out = TRAINERS[name]().out
    assert out.parts[:2] == ("build", "weights")
    assert publish.published_place("/".join(out.parts[2:])).is_dir()
