"""What Drake makes of URDFs: bodies, joints, visuals, mass, and whether its parser takes them in
strict mode too; run where Drake is installed.

    pip install drake        (in an environment of its own)
    python benchmarks/open_in_drake.py ASSET/object.urdf ...

It needs nothing of this project. Bodies, joints and visuals are given as found / written.
"""

from __future__ import annotations

import importlib
import sys
import xml.etree.ElementTree as ET
from typing import Any


def main(files: list[str]) -> None:
    """Print a line per file."""
    drake = importlib.import_module("pydrake.all")
    for file in files:
        builder = drake.DiagramBuilder()
        plant, _ = drake.AddMultibodyPlantSceneGraph(builder, 0.001)
        model = drake.Parser(plant).AddModels(file)[0]
        plant.Finalize()
        bodies = [plant.get_body(i) for i in plant.GetBodyIndices(model)]
        joints = [plant.get_joint(i) for i in plant.GetJointIndices(model)]
        moving = [j for j in joints if j.num_velocities() == 1]
        shown = sum(len(plant.GetVisualGeometriesForBody(b)) for b in bodies)
        root = ET.parse(file).getroot()
        wanted = [j for j in root.findall("joint") if j.get("type") != "fixed"]
        print(
            f"{file}: bodies {len(bodies)}/{len(root.findall('link'))}, "
            f"joints {len(moving)}/{len(wanted)}, "
            f"visuals {shown}/{len(root.findall('link/visual'))}, "
            f"{sum(b.default_mass() for b in bodies):.3f} kg, strict: {strict(drake, file)}"
        )


def strict(drake: Any, file: str) -> str:
    """What the parser says where a warning is an error; "taken" if nothing."""
    plant = drake.MultibodyPlant(0.001)
    parser = drake.Parser(plant)
    parser.SetStrictParsing()
    try:
        parser.AddModels(file)
    except RuntimeError as error:
        return str(error).splitlines()[0]
    return "taken"


if __name__ == "__main__":
    main(sys.argv[1:])
