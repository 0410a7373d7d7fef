"""Export of an asset folder to MuJoCo's MJCF, from the folder's own URDF and card."""

from __future__ import annotations

import shutil
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mam_pipeline.asset.card import Asset, CardJoint
from mam_pipeline.formats.gltf import read_gltf
from mam_pipeline.formats.obj import write_obj
from mam_pipeline.formats.soup import join
from mam_pipeline.formats.urdf_writer import numbers
from mam_pipeline.ground_truth import parse_urdf
from mam_pipeline.types import Mesh

_GROUP = {"visual": "2", "collision": "3"}


def export_mjcf(asset: Asset, path: str | Path | None = None) -> Path:
    """Write object.xml and its meshes (folder `mjcf/` beside it); returns the XML's path.

    Bodies, masses, joint frames and limits are those of the URDF; friction is the card's Coulomb
    friction (`frictionloss`). Parent and child do not collide, as in SAPIEN. The base is fixed.

    Args:
        asset: the folder. path: of the XML; default ASSET/object.xml.
    """
    target = Path(path) if path is not None else asset.folder / "object.xml"
    target.parent.mkdir(parents=True, exist_ok=True)
    text = _Exporter(asset, target).text()
    target.write_text(text, encoding="utf-8")
    return target


@dataclass
class _Exporter:
    """One export: the XML under construction and the mesh files that it names."""

    asset: Asset
    target: Path

    def text(self) -> str:
        self.robot = parse_urdf(self.asset.urdf_path)
        self.links = {link.name: link for link in self.robot.links}
        self.cards = {j.name: j for j in self.asset.card.joints}
        self.meshes = self.target.parent / "mjcf"
        self.meshes.mkdir(exist_ok=True)
        root = ET.Element("mujoco", model=self.robot.name or "object")
        ET.SubElement(root, "compiler", angle="radian", meshdir="mjcf", texturedir="mjcf",
                      balanceinertia="false", discardvisual="false")  # fmt: skip
        ET.SubElement(root, "option", timestep="0.002", integrator="implicitfast")
        self.assets = ET.SubElement(root, "asset")
        world = ET.SubElement(root, "worldbody")
        moved = {j.child for j in self.robot.joints}
        for link in self.robot.links:
            if link.name not in moved:
                self._body(world, link.name, None)
        contact = ET.SubElement(root, "contact")
        for joint in self.robot.joints:
            # MuJoCo's own filter leaves out parents that are fixed to the world
            ET.SubElement(contact, "exclude", body1=joint.parent, body2=joint.child)
        ET.indent(root, " ")
        return ET.tostring(root, encoding="unicode") + "\n"

    def _body(self, parent: ET.Element, name: str, joint: Any) -> None:
        origin = np.eye(4) if joint is None or joint.origin is None else joint.origin
        body = ET.SubElement(parent, "body", {"name": name, **_pose(origin)})
        if joint is not None and joint.type != "fixed":
            self._joint(body, joint)
        link = self.links[name]
        if link.inertial is not None and link.inertial.mass:
            self._inertial(body, link.inertial)
        for kind, shapes in (("visual", link.visuals), ("collision", link.collisions)):
            for i, shape in enumerate(shapes):
                self._geom(body, f"{name}_{kind}_{i}", kind, shape)
        for child in self.robot.joints:
            if child.parent == name:
                self._body(body, child.child, child)

    def _joint(self, body: ET.Element, joint: Any) -> None:
        kind = "slide" if joint.type == "prismatic" else "hinge"
        card: CardJoint | None = self.cards.get(joint.name)
        element = ET.SubElement(body, "joint", name=joint.name, type=kind, axis=numbers(joint.axis))
        if joint.type != "continuous" and joint.limit is not None:
            element.set("limited", "true")
            element.set("range", numbers([joint.limit.lower, joint.limit.upper]))
        if card is not None:
            element.set("damping", numbers([card.damping]))
            element.set("frictionloss", numbers([card.friction]))

    @staticmethod
    def _inertial(body: ET.Element, inertial: Any) -> None:
        origin = np.eye(4) if inertial.origin is None else inertial.origin
        m = origin[:3, :3] @ inertial.inertia @ origin[:3, :3].T
        full = [m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2]]
        ET.SubElement(body, "inertial", pos=numbers(origin[:3, 3]),
                      mass=numbers([inertial.mass]), fullinertia=numbers(full))  # fmt: skip

    def _geom(self, body: ET.Element, name: str, kind: str, shape: Any) -> None:
        common = {"name": name, "group": _GROUP[kind], "density": "0"}
        common |= _pose(np.eye(4) if shape.origin is None else shape.origin)
        if kind == "visual":
            common |= {"contype": "0", "conaffinity": "0"}
        g = shape.geometry
        if g.box is not None:
            size = numbers(np.asarray(g.box.size) / 2)
            ET.SubElement(body, "geom", common, type="box", size=size)
        elif g.cylinder is not None:
            size = numbers([g.cylinder.radius, g.cylinder.length / 2])
            ET.SubElement(body, "geom", common, type="cylinder", size=size)
        elif g.sphere is not None:
            ET.SubElement(body, "geom", common, type="sphere", size=numbers([g.sphere.radius]))
        elif g.mesh is not None:
            source = self.asset.urdf_path.parent / g.mesh.filename
            if source.suffix.lower() == ".glb":
                self._textured(body, name, common, source)
            else:
                shutil.copyfile(source, self.meshes / source.name)
                ET.SubElement(self.assets, "mesh", name=name, file=source.name)
                ET.SubElement(body, "geom", common, type="mesh", mesh=name)

    def _textured(self, body: ET.Element, name: str, common: dict[str, str], source: Path) -> None:
        """MuJoCo reads one material per mesh, so a visual becomes one OBJ per material."""
        content = read_gltf(source)
        mesh = join(content.pieces, content.materials)
        assert mesh.face_material is not None
        for k in np.unique(mesh.face_material):
            part = mesh.submesh(mesh.face_material == k)
            if _flat(part):  # MuJoCo refuses meshes without volume
                continue
            label, material = f"{name}_{k}", mesh.materials[k]
            file = f"{source.stem}_{k}.obj"
            write_obj(part, self.meshes / file)
            (self.meshes / file).with_suffix(".mtl").unlink()
            look = {"name": label, "rgba": numbers(material.base_color)}
            if material.image is not None and material.image_format == "png":
                picture = f"{source.stem}_{k}.png"
                (self.meshes / picture).write_bytes(material.image)
                ET.SubElement(self.assets, "texture", name=label, type="2d", file=picture)
                look["texture"] = label
            ET.SubElement(self.assets, "material", look)
            # the inertia of a visual is not used; "shell" accepts open surfaces
            ET.SubElement(self.assets, "mesh", name=label, file=file, inertia="shell")
            more = {**common, "name": label, "type": "mesh", "mesh": label, "material": label}
            ET.SubElement(body, "geom", more)


def _flat(mesh: Mesh) -> bool:
    points = mesh.vertices - mesh.vertices.mean(axis=0)
    spread = np.linalg.eigvalsh(points.T @ points)
    return len(mesh.vertices) < 4 or bool(spread[0] <= 1e-10 * spread[-1])


def _pose(matrix: Any) -> dict[str, str]:
    out = {"pos": numbers(np.asarray(matrix)[:3, 3])}
    turn = np.asarray(matrix)[:3, :3]
    if not np.allclose(turn, np.eye(3), atol=1e-12):
        x, y, z, w = Rotation.from_matrix(turn).as_quat()
        out["quat"] = numbers([w, x, y, z])
    return out
