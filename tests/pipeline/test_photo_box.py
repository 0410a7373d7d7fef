"""The box of a photo: what the network sees, and the box that is fitted to it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from mam_pipeline.photo import box_network, front_network
from mam_pipeline.photo.box_network import CORNERS, counted, look_at_photo
from mam_pipeline.photo.camera import FACES
from mam_pipeline.photo.find import find_object
from mam_pipeline.photo.image import make_photo
from mam_pipeline.photo.network import load_network
from mam_pipeline.photo.options import PhotoOptions
from mam_pipeline.photo.score import polygon_iou
from mam_world.photos.painted_photo import PaintedPhoto, paint_photo

FRONT = list(FACES["front"])


def painted(seed: int) -> PaintedPhoto:
    return paint_photo(np.random.default_rng([31, seed]))


@pytest.mark.parametrize("module", [box_network, front_network])
def test_the_networks_in_numpy_are_those_that_were_trained(module: object) -> None:
    torch = pytest.importorskip("torch")
    model = pytest.importorskip("mam_training.photo.network_model")
    weights, answers = module.WEIGHTS, sum(module.MAPS.values())  # type: ignore[attr-defined]
    with np.load(weights) as kept:
        state = {k: torch.from_numpy(kept[k].astype(np.float32)) for k in kept}
    network = model.Network(answers, len(state["decoder.leave.weight"][0]))
    network.load_state_dict(state)
    image = np.random.default_rng(0).integers(0, 255, (256, 384, 3)).astype(np.uint8)
    with torch.no_grad():
        raw = network(torch.from_numpy(image.transpose(2, 0, 1)[None].copy()))[0].numpy()
    assert np.allclose(load_network(weights)(image, (256, 384)), raw, atol=2e-3)


def test_a_trained_network_is_read_again_as_it_was_saved(tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    training = pytest.importorskip("mam_training.photo.train_box")
    config = training.BoxTraining(count=4, batch=1, channels=8, start="", real=0.0)
    network = training.train(config)
    training.save(network, tmp_path / "network.npz")
    image = painted(0).picture[:96, :128]
    with torch.no_grad():
        raw = network(torch.from_numpy(image.transpose(2, 0, 1)[None].copy()))[0].numpy()
    read = load_network(tmp_path / "network.npz")(image, (96, 128))
    assert np.allclose(read, raw, atol=0.05 * np.abs(raw).max())


def test_places_that_are_sure_outvote_the_others() -> None:
    h, w = 30, 40
    body = np.zeros((h, w), np.float32)
    body[5:25, 5:35] = 1.0
    y, x = np.mgrid[0:h, 0:w] + 0.5
    true = np.array([[3.0 + k, 7.0 + 2 * k] for k in range(CORNERS)])
    way = (true[:, :, None, None] - np.stack([x, y])) / ((h + w) / 2)
    spread = np.full((CORNERS, h, w), -5.0, np.float32)
    way[:, :, 5:19], spread[:, 5:19] = 9.0, 0.0  # two thirds say nonsense, without conviction
    at, off = counted(body, way.reshape(-1, h, w).astype(np.float32), spread)
    assert np.allclose(at, true, atol=1e-3)
    assert np.allclose(off, np.exp(-5.0) * (h + w) / 2)


def test_painted_photos_are_the_same_again_and_their_boxes_are_found() -> None:
    assert (painted(0).picture == painted(0).picture).all()
    overlap, sure = [], []
    for seed in range(8):
        one = painted(seed)
        photo = make_photo(one.picture)
        found = find_object(photo, PhotoOptions())
        overlap.append(polygon_iou(found.quad / photo.scale, one.corners[FRONT]))
        sure.append(found.doubt)
    assert np.median(overlap) > 0.85
    assert np.mean(np.array(overlap)[np.array(sure) < 0.05]) > 0.85


def test_only_the_window_that_is_pointed_at_is_looked_at() -> None:
    left, right = (cv2.resize(painted(k).picture, (300, 280)) for k in (1, 2))
    both = np.hstack([left, right])
    alone = look_at_photo(np.ascontiguousarray(right)).corners[FRONT].mean(axis=0)
    bbox = (300 + 24, 22, 300 + 276, 258)  # with its room nearly the right half
    photo = make_photo(np.asarray(both, np.uint8))
    found = find_object(photo, PhotoOptions(bbox=bbox))
    assert np.abs((found.quad / photo.scale).mean(axis=0) - alone - [300, 0]).max() < 40
