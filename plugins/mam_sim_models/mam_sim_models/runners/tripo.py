"""Runs TripoSR or TripoSG inside its own environment: --task reconstruct --input DIR --output DIR.

Set MAM_SIM_TRIPOSR (or MAM_SIM_TRIPOSG) to "<its python> <this file> triposr" (or triposg), and
TRIPOSR_HOME (or TRIPOSG_HOME) to the checkout. The steps are those of TripoSR's run.py and
gradio_app.py at d26e331, and of TripoSG's scripts/inference_triposg.py; not run by this project.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from PIL.Image import Image

GREY, WHITE = (127, 127, 127), (255, 255, 255)


def main() -> None:
    """Read image.png, write mesh.glb: Y up, its front along +Z."""
    parser = argparse.ArgumentParser()
    parser.add_argument("model", choices=["triposr", "triposg"])
    parser.add_argument("--task", choices=["reconstruct"])
    parser.add_argument("--input", type=Path)
    parser.add_argument("--output", type=Path)
    args = parser.parse_args()
    request = json.loads((args.input / "request.json").read_text(encoding="utf-8"))
    home = f"{args.model.upper()}_HOME"
    if not Path(os.environ.get(home, "")).is_dir() or not os.environ.get(home):
        sys.exit(f"{home} must name the checkout of {args.model}")
    sys.path.insert(0, str(Path(os.environ[home]).resolve()))
    from PIL import Image

    image = cut_out(Image.open(args.input / request["image"]).convert("RGBA"))
    make = triposr if args.model == "triposr" else triposg
    make(image, request["seed"]).export(args.output / "mesh.glb")


def triposr(image: Image, seed: int) -> Any:
    """A mesh with vertex colours; TripoSR draws no random numbers."""
    import torch
    from tsr.system import TSR

    device = "cuda:0" if torch.cuda.is_available() else "cpu"
    weights = os.environ.get("TRIPOSR_WEIGHTS", "stabilityai/TripoSR")
    model = TSR.from_pretrained(weights, config_name="config.yaml", weight_name="model.ckpt")
    model.renderer.set_chunk_size(8192)
    model.to(device)
    with torch.no_grad():
        codes = model([framed(image, 1 / 0.85, GREY)], device=device)
        mesh = model.extract_mesh(codes, True, resolution=256)[0]
    # its own frame: Z up, the camera of the picture on +X, Y to that camera's right
    mesh.apply_transform([[0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
    return mesh


def triposg(image: Image, seed: int) -> Any:
    """A mesh without colour."""
    import numpy as np
    import torch
    import trimesh
    from triposg.pipelines.pipeline_triposg import TripoSGPipeline

    device = "cuda" if torch.cuda.is_available() else "cpu"
    weights = os.environ.get("TRIPOSG_WEIGHTS", "pretrained_weights/TripoSG")
    kind = torch.float16 if device == "cuda" else torch.float32
    pipe = TripoSGPipeline.from_pretrained(weights).to(device, kind)
    with torch.no_grad():
        found = pipe(
            image=framed(image, 1.2, WHITE),
            generator=torch.Generator(device=device).manual_seed(seed),
            num_inference_steps=50,
            guidance_scale=7.0,
        ).samples[0]
    return trimesh.Trimesh(found[0].astype(np.float32), np.ascontiguousarray(found[1]))


def cut_out(image: Image) -> Image:
    """The object alone; a picture without transparency is cut out by rembg, as TripoSR does."""
    if image.getchannel("A").point(lambda a: 255 - a).getbbox() is not None:
        return image
    try:
        import rembg
    except ImportError:
        sys.exit("nothing in the picture is transparent and rembg is not installed: give --mask")
    found: Image = rembg.remove(image.convert("RGB"), session=rembg.new_session()).convert("RGBA")
    return found


def framed(image: Image, side: float, backdrop: tuple[int, int, int]) -> Image:
    """The object in the middle of a square of one colour.

    Args:
        side: of the square, in longer sides of the object.
    """
    from PIL import Image as pillow

    box = image.getchannel("A").getbbox()
    if box is None:
        sys.exit("nothing is left of the picture once its object is cut out")
    found = image.crop(box)
    length = max(round(max(found.size) * side), 1)
    square = pillow.new("RGBA", (length, length), (*backdrop, 255))
    square.alpha_composite(found, ((length - found.width) // 2, (length - found.height) // 2))
    return square.convert("RGB")


if __name__ == "__main__":
    main()
