"""What Drake makes of URDFs and SDFs: bodies, joints, visuals, masses, limits, frames, and whether
its parser takes them in strict mode too; run where Drake is installed.

    pip install drake        (in an environment of its own)
    python benchmarks/open_in_drake.py ASSET/object.urdf ...

It needs nothing of this project. Bodies, joints and visuals are given as found / written. With
--json, the frames of all links are given for each of the configurations (joint name: value) that
standard input holds as a list; tests/conformance reads that.
"""

from __future__ import annotations

import importlib
import json
import sys
import xml.etree.ElementTree as ET
from importlib.metadata import version
from typing import Any


def opened(file: str, configurations: list[dict[str, float]]) -> dict[str, Any]:
    """One file as Drake has it; poses are (4, 4), links in the root link's frame."""
    drake = importlib.import_module("pydrake.all")
    builder = drake.DiagramBuilder()  # which holds the plant
    plant, _ = drake.AddMultibodyPlantSceneGraph(builder, 0.001)
    model = drake.Parser(plant).AddModels(file)[0]
    plant.Finalize()
    bodies = [plant.get_body(i) for i in plant.GetBodyIndices(model)]
    joints = [plant.get_joint(i) for i in plant.GetJointIndices(model)]
    moving = [j for j in joints if j.num_velocities() == 1]
    world = plant.world_body().name()
    held = {j.child_body().name() for j in joints if j.parent_body().name() != world}
    base = next(b.name() for b in bodies if b.name() not in held)
    context, poses = plant.CreateDefaultContext(), []
    for values in configurations:
        q = plant.GetPositions(context)
        for joint in moving:
            q[joint.position_start()] = values[joint.name()]
        plant.SetPositions(context, q)
        frames = {b.name(): plant.EvalBodyPoseInWorld(context, b) for b in bodies}
        root = frames[base].inverse()
        frames = {name: root.multiply(frame) for name, frame in frames.items()}
        poses.append({name: frame.GetAsMatrix4().tolist() for name, frame in frames.items()})
    ends = {j.name(): (j.position_lower_limits()[0], j.position_upper_limits()[0]) for j in moving}
    return {
        "version": version("drake"),
        "links": [b.name() for b in bodies],
        "joints": list(ends),
        "visuals": sum(len(plant.GetVisualGeometriesForBody(b)) for b in bodies),
        "masses": {b.name(): b.default_mass() for b in bodies},
        "limits": {name: pair for name, pair in ends.items() if abs(pair[0]) < float("inf")},
        "poses": poses,
    }


def strict(file: str) -> str:
    """What the parser says where a warning is an error; "taken" if nothing."""
    drake = importlib.import_module("pydrake.all")
    plant = drake.MultibodyPlant(0.001)
    parser = drake.Parser(plant)
    parser.SetStrictParsing()
    try:
        parser.AddModels(file)
    except RuntimeError as error:
        return str(error).splitlines()[0]
    return "taken"


def main(files: list[str]) -> None:
    """Print a line per file."""
    for file in files:
        found, root = opened(file, []), ET.parse(file).getroot()
        wanted = [j for j in root.iter("joint") if j.get("type") not in ("fixed", None)]
        print(
            f"{file}: bodies {len(found['links'])}/{sum(1 for _ in root.iter('link'))}, "
            f"joints {len(found['joints'])}/{len(wanted)}, "
            f"visuals {found['visuals']}/{sum(1 for _ in root.iter('visual'))}, "
            f"{sum(found['masses'].values()):.3f} kg, strict: {strict(file)}"
        )


if __name__ == "__main__":
    if "--json" in sys.argv:
        print(json.dumps(opened(sys.argv[1], json.load(sys.stdin))))
    else:
        main(sys.argv[1:])
