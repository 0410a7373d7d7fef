"""Every folder of weights says what made it, and its files are those that it describes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

import mam_pipeline
from mam_pipeline import config_file
from mam_pipeline.errors import ConfigError
from mam_training import manifest
from mam_training.articulation.train import NetworkTraining
from mam_training.command import configured
from mam_training.joints.train import JointTraining
from mam_training.parts.fit_abstention import AbstentionTraining
from mam_training.parts.train import PartsTraining
from mam_training.photo.fit_confidence import ConfidenceTraining
from mam_training.photo.train_front import FrontTraining

ROOT = Path(__file__).resolve().parents[2]
PIPELINE = Path(mam_pipeline.__file__).parent
FOLDERS = sorted({
    file.parent for pattern in ("*.gz", "*.npz", "*.xz", "weights/**/*.txt", "weights/**/*.json")
    for file in PIPELINE.rglob(pattern) if "weights" in file.parts
})  # fmt: skip
TRAINERS = {
    "parts": PartsTraining, "joints": JointTraining, "photo_front": FrontTraining,
    "photo_confidence": ConfidenceTraining, "abstention": AbstentionTraining,
    "network": NetworkTraining,
}  # fmt: skip


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda f: "-".join(f.relative_to(PIPELINE).parts))
def test_weights_have_a_manifest_that_is_true(folder: Path) -> None:
    assert manifest.faults(folder) == []


def test_all_weights_lie_in_such_folders() -> None:
    assert len(FOLDERS) == 8
    loose = [f for p in ("*.gz", "*.npz", "*.xz") for f in PIPELINE.rglob(p)
             if f.parent not in FOLDERS]  # fmt: skip
    assert loose == []


@dataclass(frozen=True)
class Recipe:
    """A trainer's config."""

    rounds: int = 3
    cache: Path = Path("cache")


def test_a_manifest_tells_what_was_changed_since(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("trees")
    data = {"rows": 2, "sha256": manifest.data_digest([b"1", b"2"])}
    manifest.write(tmp_path, "python -m trainer recipe.yaml", Recipe(), {"seed": 0}, data)
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
    assert config_file.fill(base, config_file.read(file), file) == base


def test_flags_go_over_a_recipe_and_unknown_keys_are_errors(tmp_path: Path) -> None:
    file = tmp_path / "recipe.yaml"
    file.write_text("rounds: 5\n")
    assert configured(Recipe(), [str(file)]) == Recipe(rounds=5)
    assert configured(Recipe(), [str(file), "--rounds", "7"]) == Recipe(rounds=7)
    file.write_text("round: 5\n")
    with pytest.raises(ConfigError, match="did you mean 'rounds'"):
        configured(Recipe(), [str(file)])
