"""Reading a photo: any common file becomes upright 8-bit RGB, with alpha and focal length."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps, UnidentifiedImageError

from mam_pipeline.errors import InputError

MAX_PIXELS = 120_000_000
KEEP_SIDE = 2400  # textures are cut from a picture of at most this side
WORK_SIDE = 800  # geometry is found at this size
MIN_SIDE = 48
MAX_ASPECT = 6.0
STANDARD_ASPECTS = (3 / 2, 4 / 3, 16 / 9)


@dataclass(frozen=True)
class Photo:
    """An upright photo.

    Attributes:
        rgb: (H, W, 3) uint8, at most KEEP_SIDE on the long side.
        small: (h, w, 3) uint8, at most WORK_SIDE on the long side: where geometry is found.
        scale: small pixels per pixel of the file (upright).
        alpha: (h, w) float 0..1 at the small size, or None when opaque.
        focal: focal length in small pixels from EXIF, or None.
    """

    rgb: NDArray[np.uint8]
    small: NDArray[np.uint8]
    scale: float
    alpha: NDArray[np.float64] | None = None
    focal: float | None = None

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the small picture."""
        return self.small.shape[1], self.small.shape[0]


def read_photo(path: Path) -> Photo:
    """Read a photo from a file.

    Raises:
        InputError: missing, not a picture, truncated, or too small or too large to use.
    """
    if not path.is_file():
        raise InputError(f"no photo at {path}")
    if path.stat().st_size == 0:
        raise InputError(f"{path.name} is empty (0 bytes)")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(path) as file:
                if file.width * file.height > MAX_PIXELS:
                    raise InputError(
                        f"{path.name} has {file.width}x{file.height} pixels; "
                        f"at most {MAX_PIXELS // 1_000_000} megapixels can be read: scale it down"
                    )
                _usable_shape(path.name, file.width, file.height)
                if file.format == "JPEG":  # decode large JPEGs at a fraction of their size
                    full = file.size
                    file.draft(None, (KEEP_SIDE, KEEP_SIDE))
                else:
                    full = file.size
                focal35 = _focal35(file)
                file.load()
                image = ImageOps.exif_transpose(_reduced(file)) or file
                rgb, alpha = _to_rgb(image)
    except InputError:
        raise
    except UnidentifiedImageError as error:
        raise InputError(
            f"{path.name} is not a picture that can be read{_what_it_is(path)}"
        ) from error
    except Exception as error:  # Pillow raises many kinds on broken files
        raise InputError(f"{path.name} cannot be read as a picture: {error}") from error
    return make_photo(rgb, alpha, focal35, max(full))


def _usable_shape(name: str, width: int, height: int) -> None:
    if min(width, height) < MIN_SIDE:
        raise InputError(
            f"{name} is {width}x{height} pixels; at least {MIN_SIDE} on each side are needed"
        )
    if max(width, height) > MAX_ASPECT * min(width, height):
        raise InputError(
            f"{name} is {width}x{height} pixels: too narrow to show an object; "
            f"the long side may be at most {MAX_ASPECT:g} times the short one"
        )


def _reduced(image: Image.Image) -> Image.Image:
    """A very large picture brought near KEEP_SIDE before it is converted: conversions copy it.

    Deep greys are thinned out, other modes are averaged; EXIF stays with the picture.
    """
    factor = max(image.size) // KEEP_SIDE
    if factor < 2:
        return image
    exif = image.info.get("exif")
    if image.mode.startswith("I") or image.mode == "F":
        small = Image.fromarray(np.asarray(image)[::factor, ::factor])
    else:
        if image.mode == "P":
            image = image.convert("RGBA" if "transparency" in image.info else "RGB")
        elif image.mode == "1":
            image = image.convert("L")
        small = image.reduce(factor)
    if exif:
        small.info["exif"] = exif
    return small


def _what_it_is(path: Path) -> str:
    """A word on common files that are taken for pictures."""
    with path.open("rb") as file:
        head = file.read(32)
    if head[4:8] == b"ftyp" and head[8:12] in (b"heic", b"heix", b"mif1", b"hevc", b"avif"):
        return ": it is a HEIC or AVIF file; convert it to JPEG or PNG"
    if head.startswith(b"%PDF"):
        return ": it is a PDF file; export the page as PNG"
    if b"\0" not in head and all(c >= 9 for c in head):
        return ": it holds text"
    return ""


def make_photo(
    rgb: NDArray[np.uint8],
    alpha: NDArray[np.float64] | None = None,
    focal35: float | None = None,
    file_side: int | None = None,
) -> Photo:
    """Build a Photo from upright RGB (H, W, 3) uint8; `file_side` is the file's long side."""
    side = max(rgb.shape[:2])
    if side > KEEP_SIDE:
        rgb = _resize(rgb, KEEP_SIDE / side)
    small = _resize(rgb, WORK_SIDE / max(rgb.shape[:2]))
    h, w = small.shape[:2]
    if alpha is not None:
        alpha = np.asarray(cv2.resize(alpha, (w, h), interpolation=cv2.INTER_AREA), np.float64)
    focal = None
    aspect = max(w, h) / min(w, h)
    if focal35 and any(abs(aspect - a) < 0.02 for a in STANDARD_ASPECTS):
        focal = focal35 / 43.27 * float(np.hypot(w, h))
    return Photo(rgb, small, max(w, h) / (file_side or side), alpha, focal)


def _resize(rgb: NDArray[np.uint8], scale: float) -> NDArray[np.uint8]:
    size = (max(1, round(rgb.shape[1] * scale)), max(1, round(rgb.shape[0] * scale)))
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    return np.ascontiguousarray(cv2.resize(rgb, size, interpolation=how)).astype(np.uint8)


def _to_rgb(image: Image.Image) -> tuple[NDArray[np.uint8], NDArray[np.float64] | None]:
    if image.mode in ("I", "I;16", "I;16B", "I;16L", "F"):  # 16-bit and float greys
        grey = np.asarray(image, dtype=np.float64)
        top = 65535.0 if grey.max() > 255 else 255.0
        byte = np.clip(grey / max(top, grey.max()) * 255, 0, 255).astype(np.uint8)
        return np.ascontiguousarray(np.repeat(byte[..., None], 3, axis=2)), None
    alpha = None
    if image.mode in ("RGBA", "LA", "PA", "La", "RGBa") or "transparency" in image.info:
        rgba = image.convert("RGBA")
        alpha = np.asarray(rgba.getchannel("A"), dtype=np.float64) / 255.0
        white = Image.new("RGBA", rgba.size, (255, 255, 255, 255))
        image = Image.alpha_composite(white, rgba)
        if alpha.min() > 0.98:
            alpha = None
    return np.ascontiguousarray(np.asarray(image.convert("RGB"), dtype=np.uint8)), alpha


def _focal35(image: Image.Image) -> float | None:
    try:
        value = image.getexif().get_ifd(0x8769).get(0xA405)
        focal = float(value) if value else 0.0
    except Exception:  # broken EXIF blocks are common and never worth failing for
        return None
    return focal if 8.0 <= focal <= 400.0 else None
