"""SP4D's adapter, and the masks in which every kinematic prior shows what it found."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from mam_sim_models.sp4d import REFERENCE, STEP, Sp4dPrior, prior_from_frames

from mam_pipeline import backends, stage_artefacts
from mam_pipeline.errors import BackendError, ConfigError
from mam_pipeline.models.file_prior import FilePrior
from mam_pipeline.prior.masks import groups, load_masks, prior_from_masks, save_masks
from mam_pipeline.render import orbit_views as views
from mam_pipeline.render import pictures
from mam_pipeline.types import Mesh, Primitives

Boxes = tuple[Mesh, Primitives]


def _sp4d_frames(mesh: Mesh, primitives: Primitives, sense: int, size: int = 96) -> np.ndarray:
    """What SP4D would send for this object: colour halves and a smooth part colour code."""
    azimuth, elevation = REFERENCE
    around = [(azimuth + sense * STEP * k, elevation) for k in range(1, 13)]
    cast = views.look(mesh, around, size, distance=1.75, fov=np.radians(34))
    code = np.array([[40, 90, 200], [220, 60, 40], [220, 60, 40]], dtype=np.uint8)
    rng = np.random.default_rng(0)
    rows = []
    for view in cast:
        left = pictures.lit(view, np.full((len(mesh.faces), 3), 150.0))
        ids = view.ids(primitives.labels)
        right = np.where(ids[..., None] >= 0, code[np.maximum(ids, 0)].astype(int), 255)
        noise = rng.integers(-6, 7, right.shape) * (ids[..., None] >= 0)
        rows.append(np.concatenate([left, np.clip(right + noise, 0, 255).astype(np.uint8)], axis=1))
    return np.repeat(np.stack(rows)[None], 2, axis=0)


@pytest.mark.parametrize("sense", [1, -1])
def test_cameras_and_colours_are_found(sense: int, boxes: Boxes) -> None:
    mesh, primitives = boxes
    prior = prior_from_frames(mesh, primitives, _sp4d_frames(mesh, primitives, sense), seed=0)
    assert prior.evidence["silhouette_iou"] > 0.85
    assert prior.affinity[1, 2] > 0.8 > 0.4 > prior.affinity[0, 1]
    assert prior.mobility[0] < 0.3 < 0.7 < prior.mobility[2]
    assert prior.labels.tolist() == [0, 1, 1]


def test_views_of_another_object_are_refused(boxes: Boxes) -> None:
    mesh, primitives = boxes
    rod = trimesh.creation.box((0.02, 0.02, 1.0))
    other = Mesh(rod.vertices, rod.faces)
    frames = _sp4d_frames(other, Primitives(np.zeros(len(rod.faces), dtype=int)), 1)
    with pytest.raises(BackendError, match="do not show this object"):
        prior_from_frames(mesh, primitives, frames, seed=0)
    blank = np.full_like(frames, 255)
    with pytest.raises(BackendError, match="do not show this object"):
        prior_from_frames(mesh, primitives, blank, seed=0)


def test_the_runner_gets_four_equal_frames(
    script: Callable[[str], str], monkeypatch: pytest.MonkeyPatch, boxes: Boxes, tmp_path: Path
) -> None:
    mesh, primitives = boxes
    np.save(tmp_path / "frames.npy", _sp4d_frames(mesh, primitives, 1))
    code = (
        "frames = sorted((inbox / 'frames').glob('*.png'))\n"
        "assert len(frames) == 4 and len({f.read_bytes() for f in frames}) == 1\n"
        f"np.savez(out / 'maps.npz', frames=np.load({str(tmp_path / 'frames.npy')!r}))\n"
    )
    monkeypatch.setenv("MAM_SIM_SP4D", script(code))
    assert backends.load("prior")[0] == "sp4d"  # set up by the user, so auto takes it
    prior = Sp4dPrior().observe(mesh, primitives)
    assert prior.source == "sp4d" and prior.labels.tolist() == [0, 1, 1]


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("sys.stderr.write('OutOfMemoryError: CUDA'); sys.exit(1)", "OutOfMemoryError"),
        ("pass", "wrote no maps.npz"),
        ("(out / 'maps.npz').write_bytes(b'PK half')", "cannot be read"),
        ("np.savez(out / 'maps.npz', frames=np.zeros((4, 12, 8, 8, 3), np.uint8))", "of shape"),
        ("np.savez(out / 'maps.npz', other=np.zeros(3))", "cannot be read"),
    ],
)
def test_runner_faults_are_named(
    script: Callable[[str], str],
    monkeypatch: pytest.MonkeyPatch,
    boxes: Boxes,
    code: str,
    message: str,
) -> None:
    monkeypatch.setenv("MAM_SIM_SP4D", script(code))
    with pytest.raises(BackendError) as caught:
        Sp4dPrior().observe(*boxes)
    assert message in str(caught.value)


def test_masks_from_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, boxes: Boxes) -> None:
    mesh, primitives = boxes
    around = [(-30.0, 10.0), (30.0, 10.0)]
    cast = views.look(mesh, around, 64)
    masks = np.stack([np.minimum(v.ids(primitives.labels), 1) for v in cast])
    monkeypatch.setenv("MAM_SIM_PRIOR_FILE", str(tmp_path))
    with pytest.raises(ConfigError, match="holds no kinematic masks"):
        FilePrior().observe(mesh, primitives)
    angles = np.asarray(around)
    np.savez(tmp_path / "masks.npz", masks=masks, azimuth=angles[:, 0], elevation=angles[:, 1])
    prior = FilePrior().observe(mesh, primitives)
    same = prior_from_masks(cast, masks, primitives, "file")
    np.testing.assert_allclose(prior.affinity, same.affinity)
    assert prior.affinity[1, 2] > 0.9 > 0.3 > prior.affinity[0, 1]
    np.savez(tmp_path / "masks.npz", masks=masks, azimuth=angles[:1, 0], elevation=angles[:, 1])
    with pytest.raises(ConfigError, match="2 masks for 1 views"):
        FilePrior().observe(mesh, primitives)


@pytest.mark.parametrize("name", ["embedded", "sp4d"])
def test_every_prior_writes_masks_that_a_file_prior_reads(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, boxes: Boxes
) -> None:
    mesh, primitives = boxes
    if name == "embedded":
        prior = backends.load("prior", "embedded")[1].observe(mesh, primitives)
    else:
        prior = prior_from_frames(mesh, primitives, _sp4d_frames(mesh, primitives, 1), seed=0)
    assert prior.masks.ndim == 3 and len(prior.masks) == len(prior.views)
    assert len(prior.labels) == primitives.count and prior.labels.min() == 0
    save_masks(prior, mesh, tmp_path / "masks.npz")
    kept = load_masks(tmp_path / "masks.npz")
    for view, pose in zip(kept.cast(mesh), prior.views):
        np.testing.assert_allclose(view.camera_T_asset, pose, atol=1e-6)
    monkeypatch.setenv("MAM_SIM_PRIOR_FILE", str(tmp_path))
    again = FilePrior().observe(mesh, primitives)
    assert again.labels.tolist() == prior.labels.tolist()


def test_a_stage_keeps_the_prior_whole(tmp_path: Path, boxes: Boxes) -> None:
    prior = backends.load("prior", "embedded")[1].observe(*boxes)
    stage_artefacts.PRIOR.save(prior, tmp_path / "prior.npz")
    again = stage_artefacts.PRIOR.load(tmp_path / "prior.npz", tmp_path)
    for name in ("mobility", "affinity", "masks", "views", "labels"):
        np.testing.assert_array_equal(getattr(again, name), getattr(prior, name))
    assert again is not None and again.fov == pytest.approx(prior.fov)


def test_groups_by_affinity() -> None:
    affinity = np.eye(4)
    affinity[0, 1] = affinity[1, 0] = 0.9
    area = np.array([1.0, 1.0, 5.0, 0.5])
    assert groups(np.array([0.9, 0.9, 0.9, 0.9]), affinity, area).tolist() == [1, 1, 0, 2]
    assert groups(np.array([0.9, 0.9, 0.9, 0.1]), affinity, area).tolist() == [1, 1, 0, 0]
    assert groups(np.ones(1), np.ones((1, 1)), np.ones(1)).tolist() == [0]
