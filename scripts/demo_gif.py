"""The README's animation: the example photo beside the video that scripts/demo.py made of it.

python scripts/demo_gif.py demo_out/opened/demo.mp4 docs/demo.gif
"""

from __future__ import annotations

import sys
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
from PIL import Image, ImageDraw, ImageFont

PHOTO = Path(__file__).resolve().parent.parent / "examples" / "nightstand.jpg"
HEIGHT = 340  # pixels of the pictures; the captions stand above
CAPTION = 34
GAP = 12
CROP = (0, 66, 512, 406)  # left, top, right, bottom of the video that is kept, pixels
FRAME_MS, LAST_MS = 110, 2000


def main(video: Path, out: Path) -> None:
    """Write the GIF; all frames share one palette, so that still parts stay still."""
    photo = Image.open(PHOTO).convert("RGB")
    side = min(photo.size)
    left, top = (photo.width - side) // 2, (photo.height - side) // 2
    photo = photo.crop((left, top, left + side, top + side)).resize((HEIGHT, HEIGHT))
    width = HEIGHT + GAP + CROP[2] - CROP[0]
    page = Image.new("RGB", (width, CAPTION + HEIGHT), "white")
    page.paste(photo, (0, CAPTION))
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(17)
    for x, text in ((2, "one photo"), (HEIGHT + GAP + 2, "its simulation, opened by a robot arm")):
        draw.text((x, 7), text, fill=(40, 40, 40), font=font)
    frames = []
    for shot in imageio.get_reader(video):
        frame = page.copy()
        frame.paste(Image.fromarray(np.asarray(shot)).crop(CROP), (HEIGHT + GAP, CAPTION))
        frames.append(frame)
    palette = frames[-1].quantize(256, dither=Image.Dither.NONE)
    small = [f.quantize(palette=palette, dither=Image.Dither.NONE) for f in frames]
    times = [FRAME_MS] * (len(small) - 1) + [LAST_MS]
    small[0].save(
        out, save_all=True, append_images=small[1:], duration=times, loop=0, optimize=True
    )
    print(out, f"{out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
