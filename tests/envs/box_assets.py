"""Small asset folders of boxes whose joints are known exactly: a drawer, a door, a button."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from mam_pipeline.asset.card import Asset, AssetCard, CardGrasp, CardJoint, CardPart

WALL = 0.015
Box = tuple[tuple[float, float, float], tuple[float, float, float]]  # centre, size


def _link(name: str, boxes: list[Box], at: np.ndarray, mass: float) -> str:
    rows = []
    for k, (centre, size) in enumerate(boxes):
        xyz = " ".join(f"{c - o:.6f}" for c, o in zip(centre, at))
        shape = f'<origin xyz="{xyz}"/><geometry><box size="{size[0]} {size[1]} {size[2]}"/>'
        rows.append(f'<visual name="v{k}">{shape}</geometry></visual>')
        rows.append(f"<collision>{shape}</geometry></collision>")
    middle = np.mean([b[0] for b in boxes], axis=0) - at
    inertia = 'ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"'
    rows.append(
        f'<inertial><origin xyz="{middle[0]} {middle[1]} {middle[2]}"/>'
        f'<mass value="{mass}"/><inertia {inertia}/></inertial>'
    )
    return f'<link name="{name}">{"".join(rows)}</link>'


def _carcass(d: float, w: float, h: float) -> list[Box]:
    t = WALL
    return [
        ((d / 2 - t / 2, 0, h / 2), (t, w, h)),
        ((0, w / 2 - t / 2, h / 2), (d, t, h)),
        ((0, -w / 2 + t / 2, h / 2), (d, t, h)),
        ((0, 0, t / 2), (d, w - 2 * t, t)),
        ((0, 0, h - t / 2), (d, w - 2 * t, t)),
    ]


def write_asset(folder: Path, kind: str) -> Path:
    """Write a "drawer" or "door" asset: carcass 0.36 x 0.36 x 0.4 m, bar handle in front."""
    d, w, h, t = 0.36, 0.36, 0.4, WALL
    front = -d / 2
    folder.mkdir(parents=True)
    if kind == "drawer":
        gap = 0.006
        inner = w - 2 * t - 2 * gap
        z0, z1 = t + gap, h - t - gap
        boxes: list[Box] = [
            ((front + t / 2, 0, (z0 + z1) / 2), (t, inner, z1 - z0)),
            ((0, 0, z0 + t / 2), (d - 0.06, inner, t)),
            ((front - 0.04, 0, 0.2), (0.012, 0.14, 0.012)),
            ((front - 0.02, 0.06, 0.2), (0.04, 0.012, 0.012)),
            ((front - 0.02, -0.06, 0.2), (0.04, 0.012, 0.012)),
        ]
        axis: tuple[float, ...] = (-1, 0, 0)
        origin: tuple[float, ...] = (0, 0, 0.2)
        kind_, sub, upper = "prismatic", "slide", 0.25
        grasp = CardGrasp(
            "joint_1", "part_1", "handle", [front - 0.04, 0, 0.2], [1, 0, 0], [0, 0, 1], 0.012
        )
    else:
        boxes = [
            ((front - t / 2 - 0.002, 0, h / 2), (t, w, h)),
            ((front - 0.055, -0.13, 0.2), (0.012, 0.012, 0.14)),
            ((front - 0.035, -0.13, 0.26), (0.04, 0.012, 0.012)),
            ((front - 0.035, -0.13, 0.14), (0.04, 0.012, 0.012)),
        ]
        # hinge on the left side seen from the front (+y); positive q swings the door towards -x
        axis, origin = (0, 0, -1), (front - 0.002, w / 2, 0.2)
        kind_, sub, upper = "revolute", "hinge", np.pi / 2
        grasp = CardGrasp(
            "joint_1", "part_1", "handle", [front - 0.055, -0.13, 0.2], [1, 0, 0], [0, 1, 0], 0.012
        )
    at = np.array(origin, dtype=float)
    urdf = (
        f'<robot name="{kind}">{_link("base", _carcass(d, w, h), np.zeros(3), 5.0)}'
        f"{_link('part_1', boxes, at, 1.0)}"
        f'<joint name="joint_1" type="{kind_}"><origin xyz="{at[0]} {at[1]} {at[2]}"/>'
        f'<axis xyz="{axis[0]} {axis[1]} {axis[2]}"/><parent link="base"/><child link="part_1"/>'
        f'<limit lower="0" upper="{upper}" effort="50" velocity="2"/></joint></robot>'
    )
    (folder / "object.urdf").write_text(urdf, encoding="utf-8")
    joint = CardJoint(
        "joint_1",
        kind_,  # type: ignore[arg-type]
        sub,  # type: ignore[arg-type]
        "base",
        "part_1",
        list(axis),
        list(origin),
        0.0,
        float(upper),
        0.0,
        float(upper),
        damping=0.5,
        friction=0.1,
    )
    card = AssetCard(
        name=f"box_{kind}",
        parts=[CardPart("base", "body", "body"), CardPart("part_1", kind, kind)],
        joints=[joint],
        grasps=[grasp],
        bounds=[[-0.25, -0.18, 0.0], [0.18, 0.18, 0.4]],
    )
    card.save(folder)
    return folder


def write_tray(folder: Path, d: float = 0.36, w: float = 0.36, h: float = 0.2) -> Path:
    """A chest with one drawer that has walls all round: d x w x h metres."""
    front, t, gap = -d / 2, 0.012, 0.006
    inner, z0, z1 = w - 2 * WALL - 2 * gap, WALL + gap, h - WALL - gap
    deep, tall, handle = d - 0.04, 0.6 * (z1 - z0), 0.5 * h
    low = z0 + 0.5 * tall
    boxes: list[Box] = [
        ((front + t / 2, 0, (z0 + z1) / 2), (t, inner, z1 - z0)),
        ((front + deep / 2, 0, z0 + t / 2), (deep, inner, t)),
        ((front + deep - t / 2, 0, low), (t, inner, tall)),
        ((front + deep / 2, (inner - t) / 2, low), (deep, t, tall)),
        ((front + deep / 2, (t - inner) / 2, low), (deep, t, tall)),
        ((front - 0.04, 0, handle), (0.012, 0.14, 0.012)),
        ((front - 0.02, 0.06, handle), (0.04, 0.012, 0.012)),
        ((front - 0.02, -0.06, handle), (0.04, 0.012, 0.012)),
    ]
    at, upper = np.array([0.0, 0.0, handle]), 0.7 * d
    folder.mkdir(parents=True)
    (folder / "object.urdf").write_text(
        f'<robot name="tray">{_link("base", _carcass(d, w, h), np.zeros(3), 5.0)}'
        f"{_link('part_1', boxes, at, 1.0)}"
        f'<joint name="joint_1" type="prismatic"><origin xyz="0 0 {handle}"/><axis xyz="-1 0 0"/>'
        '<parent link="base"/><child link="part_1"/>'
        f'<limit lower="0" upper="{upper}" effort="50" velocity="2"/></joint></robot>',
        encoding="utf-8",
    )
    joint = CardJoint(
        "joint_1", "prismatic", "slide", "base", "part_1", [-1, 0, 0], at.tolist(), 0.0, upper, 0.0,
        upper, damping=0.5, friction=0.1,
    )  # fmt: skip
    held = [front - 0.04, 0, handle]
    AssetCard(
        name="box_tray",
        parts=[CardPart("base", "body", "body"), CardPart("part_1", "drawer", "drawer")],
        joints=[joint],
        grasps=[CardGrasp("joint_1", "part_1", "handle", held, [1, 0, 0], [0, 0, 1], 0.012)],
        bounds=[[front - 0.05, -w / 2, 0.0], [d / 2, w / 2, h]],
    ).save(folder)
    return folder


def write_button(folder: Path) -> Path:
    """A box of 0.3 m with a button in its front that goes 6 mm in towards +x."""
    folder.mkdir(parents=True)
    body: list[Box] = [((0, 0, 0.15), (0.3, 0.3, 0.3))]
    knob: list[Box] = [((-0.155, 0, 0.15), (0.01, 0.03, 0.03))]
    at = np.array([-0.155, 0.0, 0.15])
    urdf = (
        f'<robot name="button">{_link("base", body, np.zeros(3), 5.0)}'
        f"{_link('part_1', knob, at, 0.02)}"
        f'<joint name="joint_1" type="prismatic"><origin xyz="{at[0]} {at[1]} {at[2]}"/>'
        f'<axis xyz="1 0 0"/><parent link="base"/><child link="part_1"/>'
        f'<limit lower="0" upper="0.006" effort="50" velocity="2"/></joint></robot>'
    )
    (folder / "object.urdf").write_text(urdf, encoding="utf-8")
    joint = CardJoint(
        "joint_1", "prismatic", "slide", "base", "part_1", [1, 0, 0], at.tolist(), 0.0, 0.006, 0.0,
        0.006, damping=0.5, friction=0.1,
    )  # fmt: skip
    front = [-0.16, 0.0, 0.15]
    AssetCard(
        name="box_button",
        parts=[CardPart("base", "body", "body"), CardPart("part_1", "button", "button")],
        joints=[joint],
        grasps=[CardGrasp("joint_1", "part_1", "push", front, [1, 0, 0], [0, 0, 1], 0.0)],
        bounds=[[-0.16, -0.15, 0.0], [0.15, 0.15, 0.3]],
    ).save(folder)
    return folder


def write_stack(folder: Path) -> Path:
    """Two of the drawers above each other in one asset: joint_1 below, joint_2 above."""
    write_asset(folder, "drawer")
    urdf = (folder / "object.urdf").read_text(encoding="utf-8")
    upper = urdf[urdf.index("<link") : urdf.index("</robot>")]
    for old, new in (("base", "base_2"), ("part_1", "part_2"), ("joint_1", "joint_2")):
        upper = upper.replace(f'"{old}"', f'"{new}"')
    upper += (
        '<joint name="on_top" type="fixed"><origin xyz="0 0 0.4"/><parent link="base"/>'
        '<child link="base_2"/></joint>'
    )
    (folder / "object.urdf").write_text(urdf.replace("</robot>", upper + "</robot>"), "utf-8")
    card = Asset.load(folder).card
    joint, grasp = card.joints[0], card.grasps[0]
    second = replace(joint, name="joint_2", parent="base_2", child="part_2", origin=[0.0, 0.0, 0.6])
    x, y, z = grasp.position
    held = replace(grasp, joint="joint_2", link="part_2", position=[x, y, z + 0.4])
    replace(
        card,
        name="box_stack",
        parts=[*card.parts, CardPart("part_2", "drawer", "drawer")],
        joints=[joint, second],
        grasps=[grasp, held],
        bounds=[[-0.25, -0.18, 0.0], [0.18, 0.18, 0.8]],
    ).save(folder)
    return folder


def without_range(folder: Path) -> Path:
    """Take nearly all of its range from the joint of a drawer asset: no arm can operate it."""
    card = json.loads((folder / "asset.json").read_text())
    card["joints"][0] |= {"upper": 0.0001, "open": 0.0001}
    (folder / "asset.json").write_text(json.dumps(card))
    urdf = folder / "object.urdf"
    urdf.write_text(urdf.read_text().replace('upper="0.25"', 'upper="0.0001"'))
    return folder
