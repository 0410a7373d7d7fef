"""The worst frame of a check as a picture: the failing joint where it fails, its part tinted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from mam_pipeline import folders
from mam_pipeline.check.report import CheckReport, JointReport
from mam_pipeline.claims import png_mark
from mam_pipeline.render.mesh_pictures import contact_sheet, posed, render_mesh
from mam_pipeline.types import Articulation

_STILL, _MOVED, _FAILED = (185, 188, 194), (90, 150, 220), (222, 88, 72)


def save_worst_frame(articulation: Articulation, report: CheckReport, path: Path) -> None:
    """Save a PNG of the joint that fails worst (the first one when all is well), from two sides."""
    worst = max(report.joints, key=_badness, default=None)
    values = {j.name: 0.0 for j in articulation.joints}
    colors = np.tile(np.array(_STILL, np.uint8), (len(articulation.mesh.faces), 1))
    if worst is not None:
        joint = next(j for j in articulation.joints if j.name == worst.name)
        upper = worst.upper if worst.upper is not None else np.pi / 2
        lower = worst.lower if worst.lower is not None else 0.0
        end = upper if abs(upper) >= abs(lower) else lower
        at = worst.penetration_at if worst.penetration else None
        values[joint.name] = end if at is None else at
        for index in articulation.carried_links(joint):
            faces = articulation.links[index].faces
            colors[faces] = _FAILED if worst.reasons else _MOVED
    mesh = posed(articulation, values)
    views = [render_mesh(mesh, (480, 480), a, 25.0, colors) for a in (-35.0, 145.0)]
    path.parent.mkdir(parents=True, exist_ok=True)
    with folders.new_file(path) as part:
        Image.fromarray(contact_sheet(views, 2)).save(part, format="PNG", pnginfo=png_mark())


def _badness(joint: JointReport) -> tuple[int, float]:
    measures = (joint.penetration, joint.gap, joint.line_gap, joint.filled)
    return len(joint.reasons), max((m or 0.0) for m in measures)
