"""Reading photos and options: hostile files, every common kind of picture, texts of errors."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from mam_pipeline.errors import ConfigError, InputError, MamSimError, NotThisKind
from mam_pipeline.photo.image import KEEP_SIDE, make_photo, read_photo
from mam_pipeline.photo.options import PhotoOptions, Rows, parse_layout, parse_options
from mam_pipeline.photo.reconstruct import reconstruct_photo


def picture(width: int = 120, height: int = 90) -> Image.Image:
    """Left half red, right half blue."""
    data = np.zeros((height, width, 3), np.uint8)
    data[:, : width // 2] = (200, 30, 20)
    data[:, width // 2 :] = (20, 30, 200)
    return Image.fromarray(data)


def is_red(pixel: np.ndarray) -> bool:
    return pixel[0] > 120 and pixel[2] < 100


@pytest.mark.parametrize(
    ("name", "mode"),
    [
        ("a.jpg", "RGB"), ("cmyk.jpg", "CMYK"), ("grey.png", "L"), ("alpha.png", "RGBA"),
        ("palette.png", "P"), ("one.png", "1"), ("a.gif", "P"), ("a.bmp", "RGB"),
        ("a.webp", "RGB"), ("a.tif", "RGB"), ("greyalpha.png", "LA"),
    ],
)  # fmt: skip
def test_common_kinds_are_read(tmp_path: Path, name: str, mode: str) -> None:
    file = tmp_path / name
    picture().convert(mode).save(file)
    photo = read_photo(file)
    assert photo.rgb.shape == (90, 120, 3)
    assert photo.rgb.dtype == np.uint8
    if mode in ("RGB", "CMYK", "RGBA", "P"):
        assert is_red(photo.rgb[45, 20]) and not is_red(photo.rgb[45, 100])


def test_sixteen_bit_png_keeps_its_range(tmp_path: Path) -> None:
    ramp = np.tile(np.linspace(0, 65535, 100), (80, 1)).astype(np.uint16)
    file = tmp_path / "deep.png"
    cv2.imwrite(str(file), ramp)
    grey = read_photo(file).rgb[40, :, 0]
    assert grey[0] < 5 and grey[-1] > 250 and (np.diff(grey.astype(int)) >= 0).all()


def test_exif_rotation_and_focal_length(tmp_path: Path) -> None:
    file = tmp_path / "turned.jpg"
    exif = Image.Exif()
    exif[0x0112] = 6  # turn by 90 degrees clockwise
    exif.get_ifd(0x8769)[0xA405] = 28
    picture(120, 90).save(file, exif=exif)
    photo = read_photo(file)
    assert photo.rgb.shape[:2] == (120, 90)
    assert is_red(photo.rgb[10, 45]) and not is_red(photo.rgb[110, 45])
    assert photo.focal == pytest.approx(28 / 43.27 * np.hypot(*photo.size), rel=1e-6)


def test_focal_length_is_dropped_for_cropped_pictures(tmp_path: Path) -> None:
    file = tmp_path / "crop.jpg"
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 28
    picture(120, 101).save(file, exif=exif)
    assert read_photo(file).focal is None


def test_large_pictures_are_reduced() -> None:
    photo = make_photo(np.zeros((3000, 2000, 3), np.uint8))
    assert max(photo.rgb.shape) == KEEP_SIDE
    assert photo.scale == pytest.approx(800 / 3000, rel=1e-3)


def test_bad_files_end_in_one_clear_sentence(tmp_path: Path) -> None:
    whole = tmp_path / "whole.jpg"
    noise = np.random.default_rng(0).integers(0, 255, (300, 300, 3)).astype(np.uint8)
    Image.fromarray(noise).save(whole)
    cases: dict[str, bytes] = {
        "truncated.jpg": whole.read_bytes()[:5000],
        "empty.jpg": b"",
        "text.png": b"this is no picture",
        "header.png": b"\x89PNG\r\n\x1a\n",
    }
    for name, data in cases.items():
        file = tmp_path / name
        file.write_bytes(data)
        with pytest.raises(InputError, match=name):
            read_photo(file)
    with pytest.raises(InputError, match="no photo at"):
        read_photo(tmp_path / "missing.jpg")
    picture(1, 1).save(tmp_path / "dot.png")
    with pytest.raises(InputError, match="1x1 pixels; at least 48"):
        read_photo(tmp_path / "dot.png")
    with pytest.raises(InputError, match="no photo at"):
        read_photo(tmp_path)


def test_too_many_pixels_are_refused_before_decoding(tmp_path: Path) -> None:
    file = tmp_path / "huge.png"
    Image.new("1", (13_000, 10_000)).save(file)
    with pytest.raises(InputError, match="megapixels"):
        read_photo(file)


def blank(kind: str) -> np.ndarray:
    rng = np.random.default_rng(1)
    x = np.tile(np.arange(320), (240, 1))
    if kind == "wall":
        return np.full((240, 320, 3), 200, np.uint8)
    if kind == "black":
        return np.zeros((240, 320, 3), np.uint8)
    if kind == "noise":
        return rng.integers(0, 255, (240, 320, 3)).astype(np.uint8)
    if kind == "gradient":
        return np.repeat((x * 255 // 320)[..., None], 3, axis=2).astype(np.uint8)
    picture = np.full((240, 320, 3), 235, np.uint8)  # a head and shoulders
    cv2.ellipse(picture, (160, 90), (45, 58), 0, 0, 360, (205, 160, 130), -1, cv2.LINE_AA)
    cv2.ellipse(picture, (160, 260), (110, 100), 0, 180, 360, (60, 70, 120), -1, cv2.LINE_AA)
    cv2.circle(picture, (143, 82), 5, (30, 30, 30), -1)
    cv2.circle(picture, (177, 82), 5, (30, 30, 30), -1)
    return picture


@pytest.mark.parametrize("kind", ["wall", "black", "noise", "gradient", "portrait"])
def test_what_is_no_box_is_refused(kind: str) -> None:
    try:
        made = reconstruct_photo(make_photo(blank(kind)), None, f"{kind}.png")
    except NotThisKind as error:
        assert f"{kind}.png" in str(error) and "--" in str(error)
        shown = set(error.pictures)
        assert shown in (set(), {"overlay", "front"})  # none where no box was looked for
    else:
        assert made.doubt is not None and f"{kind}.png" in made.doubt.told(f"{kind}.png", {})


def test_options_are_checked(tmp_path: Path) -> None:
    good = parse_options({"bbox": "10,20,110,220", "height": "0.7", "category": "Washing machine"})
    assert good.bbox == (10, 20, 110, 220) and good.height == 0.7
    assert good.category == "washing_machine"
    assert parse_options({"mask": None}) == PhotoOptions()
    for bad, message in (
        ({"layuot": "3 drawers"}, "did you mean 'layout'"),
        ({"bbox": "1,2,3"}, "bbox must be 4"),
        ({"bbox": [50, 0, 10, 90]}, "x0 < x1"),
        ({"front": [0, 0, 0, 9, 9, 9, 9, 0]}, "top left, top right"),
        ({"mask": tmp_path / "none.png"}, "no mask picture"),
        ({"height": -1}, "height must be metres"),
        ({"width": float("nan")}, "finite"),
        ({"category": "fridg"}, "did you mean 'fridge'"),
        ({"layout": "3 dragons"}, "is not understood"),
    ):
        with pytest.raises(ConfigError, match=message):
            parse_options(bad)


def test_layouts() -> None:
    def rows(text: str) -> Rows:
        (only,) = parse_layout(text).columns
        return only

    assert rows("3 drawers") == ((("drawer", 1),),) * 3
    assert rows("2x3 drawers") == ((("drawer", 3),),) * 2
    assert rows("2 drawers / 2 doors") == ((("drawer", 2),), (("door", 2),))
    assert rows("2 doors") == ((("door", 2),),)
    assert rows("1 shelf / drawer, 2 doors") == (
        (("open", 1),),
        (("drawer", 1), ("door", 2)),
    )
    columns = parse_layout("door | 4 drawers").columns
    assert columns == (((("door", 1),),), ((("drawer", 1),),) * 4)


def test_a_mask_that_selects_nothing_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "mask.png"
    Image.new("L", (320, 240)).save(file)
    with pytest.raises(ConfigError, match=r"selects 0\.0% of the picture"):
        reconstruct_photo(make_photo(blank("portrait")), parse_options({"mask": file}))
    with pytest.raises(MamSimError, match="outside the picture"):
        reconstruct_photo(make_photo(blank("wall")), parse_options({"bbox": "900,900,990,990"}))
