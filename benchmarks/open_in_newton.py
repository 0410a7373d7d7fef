"""What Newton makes of USD exports: bodies, joints, masses, friction; run where it is installed.

    pip install newton newton-usd-schemas usd-core scipy        (in an environment of its own)
    python benchmarks/open_in_newton.py FOLDER/object.usd ...

It needs nothing of this project, and no GPU. The joint that fixes the base to the world is one too.
"""

from __future__ import annotations

import importlib
import sys


def main(files: list[str]) -> None:
    """Print a line per file."""
    importlib.import_module("newton_usd_schemas")  # before USD is asked for schemas
    newton = importlib.import_module("newton")
    for file in files:
        builder = newton.ModelBuilder()
        builder.add_usd(file)
        model = builder.finalize(device="cpu")
        print(
            f"{file}: {model.body_count} bodies, {model.joint_count} joints, "
            f"{model.joint_dof_count} degrees of freedom, {model.shape_count} shapes, "
            f"{model.body_mass.numpy().sum():.3f} kg, "
            f"{getattr(model, 'constraint_mimic_count', 0)} couplings, "
            f"friction {model.joint_friction.numpy().round(3).tolist()}"
        )


if __name__ == "__main__":
    main(sys.argv[1:])
