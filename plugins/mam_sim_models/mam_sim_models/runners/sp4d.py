"""Runs SP4D inside its own environment: --task parts --input DIR --output DIR.

Set MAM_SIM_SP4D="/path/to/sp4d-env/bin/python /path/to/runners/sp4d.py" and SP4D_HOME to the
checkout of generative-models (branch sp4d) with checkpoints/sp4d.safetensors. Written from the
published source; not run on a GPU by this project.
"""

import argparse
import json
import os
import sys
from pathlib import Path


def main() -> None:
    """Read frames/0..3.png, write maps.npz with `frames` (4, 12, H, 2H, 3) uint8."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--task", choices=["parts"])
    parser.add_argument("--input", type=Path)
    parser.add_argument("--output", type=Path)
    args = parser.parse_args()
    request = json.loads((args.input / "request.json").read_text(encoding="utf-8"))
    source, target = (args.input / request["frames"]).resolve(), args.output.resolve()
    home = Path(os.environ["SP4D_HOME"]).resolve()
    os.chdir(home)
    sys.path.insert(0, str(home))
    import imageio.v3 as iio
    import numpy as np
    from scripts.sampling.simple_video_sample_sp4d import sample

    sample(
        input_path=str(source),
        model_path="checkpoints/sp4d.safetensors",
        output_folder=str(target / "raw"),
        seed=request["seed"],
        n_frames=4,
        image_frame_ratio=0.9,
    )
    videos = sorted((target / "raw").rglob("*.mp4"))
    if len(videos) < 4:
        sys.exit(f"SP4D wrote {len(videos)} videos, 4 were expected")
    frames = np.stack([np.stack(list(iio.imiter(v))[:12]) for v in videos[-4:]])
    np.savez_compressed(target / "maps.npz", frames=frames.astype(np.uint8))


if __name__ == "__main__":
    main()
