"""Runs P3-SAM inside its own environment: --task segment --input DIR --output DIR.

Set MAM_SIM_P3SAM="/path/to/p3sam-env/bin/python /path/to/runners/p3sam.py" and P3SAM_HOME to the
checkout of Hunyuan3D-Part. Written from the published source; not run on a GPU by this project.
"""

import argparse
import json
import os
import sys
from pathlib import Path


def main() -> None:
    """Read request.json and mesh.obj, write face_ids.npy and centroids.npy."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--task", choices=["segment"])
    parser.add_argument("--input", type=Path)
    parser.add_argument("--output", type=Path)
    args = parser.parse_args()
    request = json.loads((args.input / "request.json").read_text(encoding="utf-8"))
    home = Path(os.environ["P3SAM_HOME"]).resolve() / "P3-SAM" / "demo"
    source, target = (args.input / request["mesh"]).resolve(), args.output.resolve()
    # its modules are found through the working directory
    os.chdir(home)
    sys.path.insert(0, str(home))
    import numpy as np
    import trimesh
    from auto_mask import AutoMask

    mesh = trimesh.load(source, process=False)
    points, prompts = request["point_num"], request["prompt_num"]
    model = AutoMask(
        os.environ.get("P3SAM_CKPT") or None, points, prompts, request["threshold"], True
    )
    _, ids, cut = model.predict_aabb(
        mesh,
        point_num=points,
        prompt_num=prompts,
        threshold=request["threshold"],
        post_process=True,
        save_path=str(target),
        save_mid_res=False,
        show_info=False,
        clean_mesh_flag=False,
        seed=request["seed"],
        is_parallel=False,
        prompt_bs=request["prompt_bs"],
    )
    np.save(target / "face_ids.npy", np.asarray(ids, dtype=np.int64))
    np.save(target / "centroids.npy", np.asarray(cut.triangles_center, dtype=np.float64))


if __name__ == "__main__":
    main()
