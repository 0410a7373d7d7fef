"""SAPIEN without a graphics driver: loading a URDF for physics alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import sapien
from sapien.wrapper.urdf_loader import URDFLoader

from mam_pipeline.formats.urdf.admit import through_door


class PhysicsLoader(URDFLoader):
    """SAPIEN's URDF loader without visuals, so that no render device is asked for."""

    def _build_link(self, link: Any, link_builder: Any) -> None:
        link.visuals = []
        through_door(link, Path(self.urdf_dir))
        super()._build_link(link, link_builder)

    def parse(self, *args: Any, **kwargs: Any) -> Any:
        """Without SAPIEN's coupling of mimic joints, which takes 1 / multiplier for siblings."""
        parsed = super().parse(*args, **kwargs)
        for builder in parsed[0]:
            builder.mimic_joint_records = []
        return parsed


def physics_scene(timestep: float = 1 / 200) -> sapien.Scene:
    """An empty scene with CPU physics only; no Vulkan driver is needed."""
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    scene.set_timestep(timestep)
    return scene


def load_physics(scene: sapien.Scene, urdf: Path, fix_root: bool = True) -> Any:
    """Load a URDF's bodies, collision shapes and joints; returns the SAPIEN articulation."""
    loader = PhysicsLoader()
    loader.scene = scene
    loader.fix_root_link = fix_root
    before = sapien.physx.get_body_config()
    # friction in a chain of links is held only by a solver that has converged
    sapien.physx.set_body_config(solver_position_iterations=255, solver_velocity_iterations=4)
    try:
        return loader.load(str(urdf))
    finally:
        sapien.physx.set_body_config(before)
