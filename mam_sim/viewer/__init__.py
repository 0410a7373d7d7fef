"""Self-contained pages: an articulation with a slider for every joint, and a gallery of many."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from mam_pipeline.asset.card import AssetCard
from mam_pipeline.formats.gltf_write import glb_bytes
from mam_pipeline.render.motion import value_at
from mam_pipeline.types import Articulation, Joint, Mesh
from mam_sim import facts


def page(
    articulation: Articulation, name: str, card: AssetCard | None = None, photo: str = "",
    credit: str = "", film: str = "",
) -> str:  # fmt: skip
    """HTML that opens offline: geometry, pictures, joints and the script that draws them.

    Args:
        articulation: asset frame (metres, Z up, front towards -X). name: of the object.
        card: whose sizes and joints stand below the sliders. photo: data URL of the one that the
            object was made from; "" for none. credit: who made what it was made from.
        film: data URL of a robot's attempt at it; "" for none.
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
    script = resources.files("mam_sim.viewer").joinpath("viewer.js").read_text(encoding="utf-8")
    return _template("page.html.j2").render(
        name=name, asset=_inside_script(json.dumps(asset)), script=_inside_script(script),
        card=card, photo=photo, credit=credit, film=film,
        attempt="" if card is None else facts.attempt_sentence(card),
        size=None if card is None else facts.size_fact(card),
        mass=None if card is None else facts.mass_fact(card),
        verdict="" if card is None else facts.verdict(card),
        joints=[] if card is None else facts.joint_facts(card, card.movable),
    )  # fmt: skip


@dataclass(frozen=True)
class Shown:
    """An object of a gallery.

    Attributes:
        name: of it. link: of its page, from the gallery's folder. closed, opened: pictures as data
            URLs. joints: in words. fails: why its check fails, in words; "" where it passes.
        credit: who made what it was made from, and under which licence. attempt: what came of a
            robot's filmed attempt, in words; opens: whether it succeeded.
    """

    name: str
    link: str
    closed: str
    opened: str
    joints: str
    fails: str = ""
    credit: str = ""
    attempt: str = ""
    opens: bool = False


def gallery(objects: Sequence[Shown], title: str) -> str:
    """HTML with a picture of every object that opens under the pointer and leads to its page."""
    return _template("gallery.html.j2").render(objects=objects, title=title)


def _template(name: str) -> Template:
    return Environment(
        loader=PackageLoader("mam_sim", "viewer"), autoescape=True, undefined=StrictUndefined
    ).get_template(name)


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
