"""One self-contained page that shows an articulation with a slider for every joint."""

from __future__ import annotations

import base64
import json
from importlib import resources

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from mam_pipeline.formats.gltf_write import glb_bytes
from mam_pipeline.render.motion import value_at
from mam_pipeline.types import Articulation, Joint, Mesh


def page(articulation: Articulation, name: str) -> str:
    """HTML that opens offline: geometry, pictures, joints and the script that draws them.

    Args:
        articulation: asset frame (metres, Z up, front towards -X). name: of the object.
    """
    mesh = articulation.mesh
    names = [link.name for link in articulation.links]
    by_link = Mesh(
        mesh.vertices, mesh.faces, mesh.materials, mesh.face_material, mesh.uv, mesh.colors,
        articulation.face_link, tuple(names),
    )  # fmt: skip
    asset = {
        "name": name,
        "links": names,
        "joints": [_joint(j, names) for j in articulation.joints],
        "bounds": mesh.bounds.tolist(),
        "glb": base64.b64encode(glb_bytes(by_link, up="z")).decode(),
    }
    environment = Environment(
        loader=PackageLoader("mam_sim", "viewer"), autoescape=True, undefined=StrictUndefined
    )
    script = resources.files("mam_sim.viewer").joinpath("viewer.js").read_text(encoding="utf-8")
    return environment.get_template("page.html.j2").render(
        name=name, asset=_inside_script(json.dumps(asset)), script=_inside_script(script)
    )


def _joint(joint: Joint, names: list[str]) -> dict[str, object]:
    """What the page needs to know of a joint; a free one makes a whole turn."""
    lower, upper = joint.lower, joint.upper
    if not np.isfinite([lower, upper]).all():
        lower, upper = -np.pi, np.pi
    return {
        "name": joint.name, "part": names[joint.child], "type": joint.type,
        "parent": joint.parent, "child": joint.child, "axis": joint.axis.tolist(),
        "origin": joint.origin.tolist(), "lower": lower, "upper": upper,
        "closed": value_at(joint, 0.0), "open": value_at(joint, 1.0),
    }  # fmt: skip


def _inside_script(text: str) -> str:
    """Text that cannot end the element that it stands in."""
    return text.replace("</", "<\\/").replace("<!--", "<\\!--")
