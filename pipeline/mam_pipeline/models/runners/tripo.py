"""Runs TripoSR or TripoSG inside its own environment: --task reconstruct --input DIR --output DIR.

Set MAM_SIM_TRIPOSR (or MAM_SIM_TRIPOSG) to "<its python> <this file> triposr" (or triposg) and
TRIPO_HOME to the checkout. Written from the published sources; not run by this project.
"""

import argparse
import json
import os
import sys
from pathlib import Path


def main() -> None:
    """Read image.png, write mesh.glb."""
    parser = argparse.ArgumentParser()
    parser.add_argument("model", choices=["triposr", "triposg"])
    parser.add_argument("--task", choices=["reconstruct"])
    parser.add_argument("--input", type=Path)
    parser.add_argument("--output", type=Path)
    args = parser.parse_args()
    request = json.loads((args.input / "request.json").read_text())
    sys.path.insert(0, str(Path(os.environ["TRIPO_HOME"]).resolve()))
    import torch
    from PIL import Image

    device = "cuda" if torch.cuda.is_available() else "cpu"
    image = Image.open(args.input / request["image"])
    grey = Image.new("RGBA", image.size, (127, 127, 127, 255))
    grey.alpha_composite(image)
    if args.model == "triposr":
        from tsr.system import TSR

        names = {"config_name": "config.yaml", "weight_name": "model.ckpt"}
        model = TSR.from_pretrained("stabilityai/TripoSR", **names)
        model.renderer.set_chunk_size(8192)
        model.to(device)
        codes = model([grey.convert("RGB")], device)
        mesh = model.extract_mesh(codes, True, resolution=256)[0]
    else:
        import trimesh
        from triposg.pipelines.pipeline_triposg import TripoSGPipeline

        weights = os.environ.get("TRIPOSG_WEIGHTS", "pretrained_weights/TripoSG")
        pipe = TripoSGPipeline.from_pretrained(weights).to(device, torch.float16)
        generator = torch.Generator(device=device).manual_seed(request["seed"])
        found = pipe(
            image=grey.convert("RGB"),
            generator=generator,
            num_inference_steps=50,
            guidance_scale=7.0,
        ).samples[0]
        mesh = trimesh.Trimesh(found[0], found[1], process=False)
    mesh.export(args.output / "mesh.glb")


if __name__ == "__main__":
    main()
