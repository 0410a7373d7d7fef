"""Hostile inputs to `make-env`: a sensible answer or one clear sentence, and nothing half written.

Files that no photograph is made of end with status 2, pictures without a closed box with 3 or 4.
"""

from __future__ import annotations

import io
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from mam_pipeline.errors import ConfigError, NotThisKind
from mam_pipeline.hints import parse_hints
from mam_pipeline.photo.find import find_object
from mam_pipeline.photo.image import make_photo, read_photo
from mam_pipeline.photo.options import PhotoOptions, parse_options
from mam_pipeline.photo.reconstruct import reconstruct_photo
from mam_sim.cli import main

pytestmark = pytest.mark.sim

ROOT = Path(__file__).resolve().parents[2]


def encoded(image: Image.Image, kind: str, **more: object) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, format=kind, **more)
    return buffer.getvalue()


def noise(width: int = 300, height: int = 200) -> Image.Image:
    data = np.random.default_rng(0).integers(0, 255, (height, width, 3)).astype(np.uint8)
    return Image.fromarray(data)


def bomb() -> bytes:
    """A PNG of a few kB that claims 30 000 x 30 000 pixels."""

    def chunk(tag: bytes, data: bytes) -> bytes:
        body = tag + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    head = struct.pack(">IIBBBBB", 30_000, 30_000, 1, 0, 0, 0, 0)
    rows = zlib.compress(b"\0" * 3751 * 2000, 9)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


UNREADABLE: dict[str, tuple[Callable[[], bytes], str]] = {
    "empty.jpg": (lambda: b"", "is empty"),
    "text.jpg": (lambda: b"dear reader, this is no picture\n" * 9, "it holds text"),
    "truncated.jpg": (lambda: encoded(noise(), "JPEG")[:9000], "cannot be read"),
    "truncated.png": (lambda: encoded(noise(), "PNG")[:9000], "cannot be read"),
    "header.png": (lambda: b"\x89PNG\r\n\x1a\n", "not a picture"),
    "phone.heic": (lambda: b"\0\0\0\x18ftypheic" + b"\0" * 400, "HEIC"),
    "renamed.jpg": (lambda: b"\0\0\0\x1cftypmif1" + b"\0" * 400, "HEIC"),
    "page.png": (lambda: b"%PDF-1.7\n" + b"\0\1\2" * 90, "PDF"),
    "dot.png": (lambda: encoded(Image.new("RGB", (1, 1)), "PNG"), "1x1 pixels"),
    "thin.png": (lambda: encoded(Image.new("RGB", (6000, 60), "tan"), "PNG"), "too narrow"),
    "bomb.png": (bomb, "bomb.png"),
    "random.webp": (lambda: np.random.default_rng(1).bytes(5000), "not a picture"),
}  # fmt: skip


@pytest.mark.parametrize("name", UNREADABLE)
def test_what_is_no_picture_ends_in_one_sentence(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make, words = UNREADABLE[name]
    (tmp_path / name).write_bytes(make())
    assert main(["make-env", str(tmp_path / name), "--out", str(tmp_path / "asset")]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said.startswith("mam-sim: ") and name in said and words in said
    assert "Traceback" not in said and len(said) < 300
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_folders_and_missing_files_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "folder.jpg").mkdir()
    for name in ("folder.jpg", "nothing.jpg"):
        assert main(["make-env", str(tmp_path / name), "--out", str(tmp_path / "asset")]) == 2
        assert name in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["folder.jpg"]


def portrait() -> Image.Image:
    """A head and shoulders before a wall."""
    image = np.full((320, 280, 3), 225, np.uint8)
    image[:, :, 2] = 205
    cv2.ellipse(image, (140, 335), (125, 130), 0, 180, 360, (50, 60, 110), -1, cv2.LINE_AA)
    cv2.rectangle(image, (118, 170), (162, 225), (195, 150, 120), -1)
    cv2.ellipse(image, (140, 120), (58, 76), 0, 0, 360, (205, 160, 130), -1, cv2.LINE_AA)
    cv2.ellipse(image, (140, 84), (64, 56), 0, 180, 360, (60, 40, 25), -1, cv2.LINE_AA)
    for x in (118, 162):
        cv2.ellipse(image, (x, 114), (11, 6), 0, 0, 360, (250, 250, 250), -1, cv2.LINE_AA)
        cv2.circle(image, (x, 114), 5, (40, 60, 40), -1, cv2.LINE_AA)
    cv2.ellipse(image, (140, 160), (22, 8), 0, 0, 180, (150, 60, 60), -1, cv2.LINE_AA)
    return Image.fromarray(image)


def landscape() -> Image.Image:
    """Hills under a sky: long soft curves, no box."""
    y, x = np.mgrid[0:240, 0:360]
    image = np.stack([140 - y // 4, 180 - y // 4, 235 - y // 8], -1).astype(np.uint8)
    for k, (base, tone) in enumerate(((120, 90), (155, 70), (190, 50))):
        hill = base + 22 * np.sin(x / (38.0 + 9 * k) + k) + 9 * np.sin(x / 13.0 + 2 * k)
        image[y > hill] = (tone // 2, tone, tone // 3)
    return Image.fromarray(cv2.GaussianBlur(image, (0, 0), 1.0))


NOTHING: dict[str, Callable[[], Image.Image]] = {
    "wall.png": lambda: Image.new("RGB", (320, 240), (203, 200, 190)),
    "black.jpg": lambda: Image.new("L", (320, 240), 0),
    "noise.png": noise,
    "gradient.png": lambda: Image.linear_gradient("L").resize((320, 240)),
    "portrait.jpg": portrait,
    "landscape.png": landscape,
    "clear.png": lambda: Image.new("RGBA", (300, 300), (0, 0, 0, 0)),
}  # fmt: skip


@pytest.mark.parametrize("name", NOTHING)
def test_pictures_without_a_box_end_with_three_or_four(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    NOTHING[name]().save(tmp_path / name)
    status = main(["make-env", str(tmp_path / name), "--out", str(tmp_path / "asset")])
    said = capsys.readouterr().err
    assert status in (3, 4) and name in said and "--" in said and "Traceback" not in said
    left = {p.name for p in tmp_path.iterdir()}
    assert left in ({name}, {name, "asset-overlay.png", "asset-front.png"})


def example(width: int = 420) -> Image.Image:
    image = Image.open(ROOT / "examples" / "nightstand.jpg").convert("RGB")
    return image.resize((width, round(image.height * width / image.width)), Image.Resampling.BOX)


def turned(path: Path) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6  # stored lying on its side
    example().rotate(90, expand=True).save(path, exif=exif, quality=92)


def deep(path: Path) -> None:
    grey = np.asarray(example().convert("L")).astype(np.uint16) * 257
    cv2.imwrite(str(path), grey)


def animated(path: Path) -> None:
    frames = [example(), noise(420, 420)]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=90)


def see_through(path: Path) -> None:
    image = example().convert("RGBA")
    data = np.array(image)
    data[..., 3] = np.where(data[..., :3].min(axis=2) > 235, 0, 255)
    Image.fromarray(data).save(path)


ODD: dict[str, Callable[[Path], None]] = {
    "deep16.png": deep,
    "alpha.png": see_through,
    "palette.png": lambda p: example().quantize(96).save(p),
    "grey.jpg": lambda p: example().convert("L").save(p, quality=92),
    "large.png": lambda p: example(2600).save(p, compress_level=1),
    "small.jpg": lambda p: example(150).save(p, quality=85),
}  # fmt: skip
SAME: dict[str, Callable[[Path], None]] = {
    "cmyk.jpg": lambda p: example().convert("CMYK").save(p, quality=92),
    "turned.jpg": turned,
    "still.gif": lambda p: example().save(p),
    "animated.webp": animated,
}


@pytest.mark.parametrize("name", SAME)
def test_other_encodings_give_the_same_picture(name: str, tmp_path: Path) -> None:
    SAME[name](tmp_path / name)
    shown = read_photo(tmp_path / name).rgb.astype(int)
    wanted = np.asarray(example(), dtype=int)
    assert shown.shape == wanted.shape and np.abs(shown - wanted).mean() < 6


@pytest.mark.parametrize("name", ODD)
def test_odd_encodings_of_a_good_photo_are_understood(name: str, tmp_path: Path) -> None:
    ODD[name](tmp_path / name)
    try:
        made = reconstruct_photo(read_photo(tmp_path / name), PhotoOptions(height=0.55), name)
    except NotThisKind as stop:
        assert name == "small.jpg", stop
        return
    if made.doubt is not None:
        assert name == "small.jpg", made.doubt  # at 150 pixels it may ask
        return
    assert [p.kind for p in made.hints.parts[1:]] == ["drawer"] * 3
    assert made.details["size"][0] == pytest.approx(0.45, rel=0.08)


@pytest.mark.parametrize("mode", ["RGBA", "P", "I;16", "JPEG"])
def test_fifty_megapixels_fit_in_a_gigabyte(mode: str, tmp_path: Path) -> None:
    script = (
        "import sys; from pathlib import Path; from PIL import Image\n"
        "from mam_pipeline.photo.image import read_photo\n"
        "photo = read_photo(Path(sys.argv[1]))\n"
        "print(max(photo.rgb.shape), int(Path('/proc/self/status').read_text()"
        ".split('VmHWM:')[1].split()[0]) // 1024)"  # ru_maxrss would count the parent's pages
    )
    path = tmp_path / ("large.jpg" if mode == "JPEG" else "large.png")
    if mode == "I;16":
        cv2.imwrite(str(path), np.full((7072, 7072), 9000, np.uint16), [16, 1])
    else:
        image = Image.new("RGB" if mode == "JPEG" else mode, (7072, 7072))
        options: dict[str, Any] = {} if mode == "JPEG" else {"compress_level": 1}
        image.save(path, **options)
    done = subprocess.run(
        [sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=True
    )
    side, megabytes = map(int, done.stdout.split())
    assert 1800 <= side <= 2400 and megabytes < 1024


def test_a_whole_photo_fits_in_a_gigabyte() -> None:
    script = (
        "import sys; from pathlib import Path\n"
        "from mam_pipeline.photo.reconstruct import EmbeddedReconstructor as R\n"
        "R().reconstruct(Path(sys.argv[1]), {'accept_low_confidence': True})\n"
        "print(int(Path('/proc/self/status').read_text().split('VmHWM:')[1].split()[0]) // 1024)"
    )
    photo = ROOT / "examples" / "cabinet.jpg"
    done = subprocess.run(
        [sys.executable, "-c", script, str(photo)], capture_output=True, text=True, check=True
    )
    assert int(done.stdout) < 1024


FAR = (-1e9, -1e9, 1e9, -1e9, 1e9, 1e9, -1e9, 1e9)
BESIDE = (-40.0, -30.0, 440.0, -30.0, 440.0, 400.0, -40.0, 400.0)


@pytest.mark.parametrize("by", ["flag", "hints"])
def test_corners_of_a_front_may_lie_beside_the_photo_and_not_far_from_it(by: str) -> None:
    """A front that reaches over the edge is cut by it; one of kilometres would be drawn in full."""
    photo = make_photo(np.asarray(example(), dtype=np.uint8))
    for corners in (BESIDE, FAR):
        given: dict[str, object] = {"front": corners}
        if by == "hints":
            body = {"name": "body", "kind": "body",
                    "box": {"center": [0, 0, 0.4], "size": [0.4, 0.5, 0.8]}}  # fmt: skip
            given = {"hints": parse_hints({"photo_front": list(corners), "parts": [body]})}
        options = parse_options(given)
        if corners is FAR:
            with pytest.raises(ConfigError, match="far from the photo"):
                find_object(photo, options)
        else:
            assert np.isfinite(find_object(photo, options).quad).all()
