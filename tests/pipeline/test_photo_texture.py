"""Surfaces of a twin: no printed handle under the modelled one, and no strip of background."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mam_pipeline.photo.image import make_photo
from mam_pipeline.photo.texture import color_of, without, without_background

WALL, WOOD, TOP, KNOB = (225, 225, 220), (150, 90, 40), (70, 40, 25), (20, 20, 25)


def chest() -> NDArray[np.uint8]:
    """A brown front with a dark top board at (150, 100) to (650, 500) before a light wall."""
    image = np.full((600, 800, 3), WALL, np.uint8)
    image[100:500, 150:650] = WOOD
    image[100:112, 150:650] = TOP
    image[290:310, 390:410] = KNOB
    return image


def quad(more: float = 0.0) -> NDArray[np.float64]:
    """Corners of the front, `more` pixels further out on its left."""
    return np.array([[150 - more, 100], [650, 100], [650, 500], [150 - more, 500]])


def test_a_handle_is_painted_over_with_what_is_around_it() -> None:
    front = chest()[100:500, 150:650]
    box = ((390 - 150) / 500, (290 - 100) / 400, (410 - 150) / 500, (310 - 100) / 400)
    clean = without(front, [box]).astype(int)
    assert np.abs(clean[185:215, 235:265] - WOOD).max() <= 6
    assert (clean[:100] == front[:100]).all()


def test_a_handle_has_the_colour_of_the_photo() -> None:
    front = chest()[100:500, 150:650]
    assert np.array(color_of(front, (238, 188, 262, 212))) * 255 == pytest.approx(KNOB, abs=2)


def test_a_strip_of_wall_is_no_part_of_the_front() -> None:
    photo = make_photo(chest())
    seen = without_background(photo, quad(8.0), 508 / 400, 508)
    assert np.abs(seen[150:250, :20].astype(int) - WOOD).max() <= 6
    joined = without_background(photo, quad(8.0), 508 / 400, 508, ("left",))
    assert np.abs(joined[150:250, :4].astype(int) - WALL).max() <= 12  # another face is there


def test_a_board_along_the_rim_stays() -> None:
    seen = without_background(make_photo(chest()), quad(), 500 / 400, 500)
    assert np.abs(seen[3:8, 50:450].astype(int) - TOP).max() <= 6
