"""`check_asset` accepts a true cabinet and rejects broken ones, each with the right reason."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import mam_pipeline
from mam_pipeline import thresholds
from mam_pipeline.asset.writer import write_asset
from mam_pipeline.check import REASONS, CheckReport, check_asset
from mam_pipeline.check.check import check_profile
from mam_pipeline.check.correct import written_and_checked
from mam_pipeline.check.drive import drive_urdf
from mam_pipeline.check.report import CLAUSES
from mam_pipeline.errors import InputError
from mam_pipeline.geometry.hinge_line import HingeBodies
from mam_pipeline.types import (
    Articulation,
    CollisionShape,
    Joint,
    Link,
    Mesh,
    RangeBasis,
    joint_motion,
)

pytestmark = pytest.mark.sim

Z = np.array([0.0, 0.0, 1.0])


def cabinet() -> Articulation:
    """A carcass with a divider, an inset door hinged on its left below, a drawer above."""

    def box(
        x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]
    ) -> trimesh.Trimesh:
        return trimesh.creation.box(bounds=np.array([x, y, z]).T)

    body = [
        box((0, 0.4), (-0.32, -0.3), (0, 0.8)),
        box((0, 0.4), (0.3, 0.32), (0, 0.8)),
        box((0.38, 0.4), (-0.3, 0.3), (0, 0.8)),
        box((0, 0.38), (-0.3, 0.3), (0, 0.02)),
        box((0, 0.38), (-0.3, 0.3), (0.5, 0.52)),
        box((0, 0.38), (-0.3, 0.3), (0.78, 0.8)),
    ]
    door = [box((0.0, 0.018), (-0.298, 0.298), (0.022, 0.498))]
    drawer = [
        box((0, 0.018), (-0.298, 0.298), (0.522, 0.778)),
        box((0.018, 0.36), (-0.29, -0.278), (0.53, 0.7)),
        box((0.018, 0.36), (0.278, 0.29), (0.53, 0.7)),
        box((0.348, 0.36), (-0.278, 0.278), (0.53, 0.7)),
        box((0.018, 0.348), (-0.278, 0.278), (0.53, 0.54)),
    ]
    solids = (body, door, drawer)
    whole: Any = trimesh.util.concatenate([s for group in solids for s in group])
    label = np.repeat([0, 1, 2], [12 * len(s) for s in solids])
    links = tuple(
        Link(n, n, np.flatnonzero(label == i)) for i, n in enumerate(("body", "door", "drawer"))
    )
    hinge = Joint(
        "hinge", "revolute", "hinge", 0, 1, Z, np.array([0.0, -0.299, 0.25]), 0, 1.6, 0, 1.6
    )
    slide = Joint("slide", "prismatic", "slide", 0, 2, np.array([-1.0, 0, 0]),
                  np.array([0.2, 0, 0.65]), 0, 0.28, 0, 0.28)  # fmt: skip
    return Articulation(Mesh(whole.vertices, whole.faces), links, (hinge, slide))


def with_joint(name: str, **changes: object) -> Articulation:
    truth = cabinet()
    joints = tuple(replace(j, **changes) if j.name == name else j for j in truth.joints)  # type: ignore[arg-type]
    return replace(truth, joints=joints)


def reasons(report: CheckReport, joint: str) -> tuple[str, ...]:
    return next(j.reasons for j in report.joints if j.name == joint)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_asset(cabinet(), tmp_path_factory.mktemp("good") / "a", name="a").folder


def test_the_true_cabinet_passes(good: Path) -> None:
    report = check_asset(good)
    assert report.reasons == ()
    assert report.passed and all(report.clauses[c] for c in CLAUSES)
    for joint in report.joints:
        assert joint.reached is not None and joint.reached > 0.99
        assert joint.hold_drift is not None and joint.hold_drift < 0.02


def test_an_asset_is_taken_by_a_gpu_and_by_drake_but_for_its_joint_friction(good: Path) -> None:
    assert check_profile(good, "physx-gpu").findings == ()
    assert check_profile(good, "drake").reasons == ("friction_refused",)


def tilted(axis: np.ndarray, degrees: float) -> np.ndarray:
    angle = np.radians(degrees)
    side = np.array([0.0, 1.0, 0.0])
    return np.cos(angle) * axis + np.sin(angle) * side


@pytest.mark.parametrize(
    ("joint", "changes", "code"),
    [
        ("slide", {"axis": tilted(np.array([-1.0, 0, 0]), 5.0)}, "penetration"),
        ("hinge", {"axis": tilted(Z, 5.0)}, "off_axis"),
        ("hinge", {"origin": np.array([0.0, -0.299 + 0.055, 0.25])}, "off_axis"),
        ("hinge", {"origin": np.array([0.0, -0.299 - 0.055, 0.25])}, "off_axis"),
        ("hinge", {"origin": np.array([-0.055, -0.299, 0.25])}, "off_axis"),
        ("hinge", {"lower": -0.8, "upper": 2.4}, "penetration"),
        ("slide", {"upper": 0.56}, "detached"),
        ("slide", {"lower": -0.14}, "penetration"),
        ("hinge", {"axis": tilted(Z, 2.0)}, "askew"),
    ],
)
def test_wrong_joints_are_rejected(
    tmp_path: Path, joint: str, changes: dict[str, object], code: str
) -> None:
    asset = write_asset(with_joint(joint, **changes), tmp_path / "a", name="a")
    report = check_asset(asset.folder, drive=False)
    assert not report.passed
    assert code in reasons(report, joint), report.joints


@pytest.mark.parametrize(("travel", "said"), [(0.35, ()), (0.9, ("detached",))])
def test_a_bare_front_goes_no_farther_than_its_body_is_deep(
    tmp_path: Path, travel: float, said: tuple[str, ...]
) -> None:
    """A front without a box touches nothing and is short, but rails of 0.9 m would not fit."""
    body, front = (
        trimesh.creation.box(bounds=b)
        for b in ([[0, -0.3, 0], [0.4, 0.3, 0.8]], [[-0.04, -0.3, 0.5], [-0.02, 0.3, 0.8]])
    )
    vertices = np.concatenate([body.vertices, front.vertices])
    faces = np.concatenate([body.faces, front.faces + len(body.vertices)])
    links = (Link("body", "body", np.arange(12)), Link("front", "drawer", np.arange(12, 24)))
    slide = Joint("slide", "prismatic", "slide", 0, 1, np.array([-1.0, 0, 0]), np.zeros(3),
                  0.0, travel, 0.0, travel)  # fmt: skip
    asset = write_asset(Articulation(Mesh(vertices, faces), links, (slide,)), tmp_path / "a",
                        name="a")  # fmt: skip
    report = check_asset(asset.folder, drive=False)
    assert reasons(report, "slide") == said


@pytest.mark.parametrize("may", [True, False])
def test_a_way_that_ends_in_a_wall_is_cut_and_said_so(tmp_path: Path, may: bool) -> None:
    truth = cabinet()
    wall = trimesh.creation.box(bounds=[[-0.3, -0.7, 0.0], [0.1, -0.45, 0.9]])
    mesh, count = truth.mesh, len(truth.mesh.vertices)
    body = np.append(truth.links[0].faces, len(mesh.faces) + np.arange(12))
    blocked = replace(
        with_joint("hinge", upper=2.9, open=2.9),
        mesh=Mesh(np.append(mesh.vertices, wall.vertices, 0),
                  np.append(mesh.faces, wall.faces + count, 0)),
        links=(replace(truth.links[0], faces=body), *truth.links[1:]),
    )  # fmt: skip
    write = partial(write_asset, out=tmp_path / "a", name="a")
    card = written_and_checked(blocked, write, correct=may)[0].card
    hinge = next(j for j in card.joints if j.name == "hinge")
    assert card.checks["executability"]["passed"] == may and hinge.upper is not None
    if may:
        assert 1.0 < hinge.upper < 2.4 and "hinge: way cut" in " ".join(card.notes)
    else:
        assert hinge.upper == 2.9 and "penetration" in card.checks["executability"]["reasons"]
    assert next(j for j in card.joints if j.name == "slide").upper == 0.28


@pytest.mark.parametrize("who", ["model", "user"])
def test_a_turn_without_end_that_meets_something_gets_ends(tmp_path: Path, who: str) -> None:
    """A bar on a plate, with a post on its way; what a user said of its turn is not changed."""
    plate, post, bar = (
        trimesh.creation.box(bounds=b)
        for b in (
            [[0, -0.3, -0.3], [0.05, 0.3, 0.3]],
            [[-0.1, 0.04, 0.12], [0, 0.08, 0.2]],
            [[-0.05, -0.2, -0.02], [0, 0.2, 0.02]],
        )
    )
    whole: Any = trimesh.util.concatenate([plate, post, bar])
    links = (Link("body", "body", np.arange(24)), Link("bar", "knob", np.arange(24, 36)))
    turn = Joint("turn", "continuous", "spin", 0, 1, np.array([-1.0, 0, 0]), np.zeros(3),
                 -np.inf, np.inf, provenance=who, basis=RangeBasis("given"))  # type: ignore[arg-type]  # fmt: skip
    made = Articulation(Mesh(whole.vertices, whole.faces), links, (turn,))
    card = written_and_checked(made, partial(write_asset, out=tmp_path / "a", name="a"))[0].card
    found, verdict = card.joints[0], card.checks["executability"]
    if who == "user":
        assert found.type == "continuous" and "penetration" in verdict["reasons"]
        return
    assert verdict["passed"] and found.type == "revolute", verdict
    assert found.upper is not None and 0.3 < found.upper < 1.1
    assert "turn: way cut to" in " ".join(card.notes)


def test_a_part_in_mid_air_is_told(tmp_path: Path) -> None:
    truth = cabinet()
    vertices = truth.mesh.vertices.copy()
    faces = np.concatenate([link.faces for link in truth.links if link.name == "door"])
    vertices[np.unique(truth.mesh.faces[faces])] -= [0.5, 0.0, 0.0]
    moved = replace(truth, mesh=Mesh(vertices, truth.mesh.faces))
    folder = write_asset(moved, tmp_path / "a", name="a").folder
    report = check_asset(folder, drive=False)
    assert [(f.where, f.warning) for f in report.findings if f.code == "mid_air"] == [
        ("hinge", True)
    ]


def test_a_body_that_collides_far_from_what_is_seen_of_it_is_told(good: Path) -> None:
    text = (good / "object.urdf").read_text()
    block = '<collision><origin xyz="-0.5 0 0.4"/><geometry><box size="0.5 0.5 0.5"/></geometry>'
    urdf = good / "off.urdf"
    urdf.write_text(re.sub(r'(<link name="body">)', rf"\1{block}</collision>", text))
    assert "collision_off" in check_asset(urdf, drive=False).reasons
    assert "collision_off" not in check_asset(good, drive=False).reasons


def test_a_door_may_swing_about_a_round_post() -> None:
    post = trimesh.creation.cylinder(0.03, 0.6, 32)
    door = trimesh.creation.box(bounds=[[-0.02, 0.034, -0.29], [0.02, 0.474, 0.29]])
    whole: Any = trimesh.util.concatenate([post, door])
    cut = np.arange(len(whole.faces)) < len(post.faces)
    bodies = HingeBodies(Mesh(whole.vertices, whole.faces), np.flatnonzero(~cut),
                         np.flatnonzero(cut))  # fmt: skip

    def gap(x: float) -> float:
        return bodies.line_gap(Z, np.array([x, 0.0, 0.0]), bodies.encloses)

    assert gap(0.0) < 0.01 and gap(0.02) > 0.02 and gap(0.05) > 0.02


def test_a_hull_that_fills_the_cavity_is_rejected(tmp_path: Path) -> None:
    corners = np.array([[x, y, z] for x in (0, 0.4) for y in (-0.32, 0.32) for z in (0, 0.8)])
    hull = trimesh.convex.convex_hull(corners)
    block = CollisionShape("convex", vertices=hull.vertices, faces=hull.faces)
    asset = write_asset(cabinet(), tmp_path / "a", name="a", collision={"body": [block]})
    report = check_asset(asset.folder, drive=False)
    assert "cavity_filled" in reasons(report, "slide")
    assert report.clauses["penetration"] is False


def broken(good: Path, folder: Path, pattern: str, text: str, count: int = 1) -> CheckReport:
    shutil.copytree(good, folder)
    urdf = folder / "object.urdf"
    changed, n = re.subn(pattern, text, urdf.read_text(), count=count)
    assert n
    urdf.write_text(changed)
    return check_asset(folder)


@pytest.mark.parametrize(
    ("pattern", "text", "code"),
    [
        (r'ixx="[^"]*"', 'ixx="0"', "bad_inertia"),
        (r'<mass value="[^"]*"', '<mass value="0"', "bad_inertia"),
        (r'ixx="[^"]*"', 'ixx="1e9"', "bad_inertia"),
        (r"visual/door.obj", "visual/nothing.obj", "mesh_missing"),
        (r"visual/door.obj", "../../elsewhere.obj", "mesh_outside"),
        (r"visual/door.obj", "/etc/passwd", "mesh_outside"),
        (r'<axis xyz="[^"]*"', '<axis xyz="nan 0 0"', "not_finite"),
        (r'<axis xyz="[^"]*"', '<axis xyz="0 0 0"', "bad_joint"),
        (r'lower="[^"]*"', 'lower="9"', "bad_limits"),
        (r"<limit [^>]*/>", "", "bad_limits"),
        (r'<parent link="body"', '<parent link="nobody"', "bad_tree"),
        (r'type="revolute"', 'type="floating"', "bad_joint"),
        (r"</robot>", "", "xml_unreadable"),
    ],
)
def test_broken_files_are_rejected(
    good: Path, tmp_path: Path, pattern: str, text: str, code: str
) -> None:
    everywhere = 0 if code == "bad_inertia" else 1
    report = broken(good, tmp_path / "a", pattern, text, everywhere)
    assert not report.passed
    assert code in report.reasons
    assert code in REASONS


def test_entities_are_never_expanded(tmp_path: Path) -> None:
    lol = '<!DOCTYPE robot [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]><robot name="&b;"/>'
    (tmp_path / "a.urdf").write_text(lol)
    assert check_asset(tmp_path / "a.urdf").reasons == ("xml_entities",)


def test_a_mesh_with_nan_is_rejected(good: Path, tmp_path: Path) -> None:
    shutil.copytree(good, tmp_path / "a")
    hull = tmp_path / "a" / "collision" / "bad.obj"
    hull.write_text("v nan 0 0\nv 0 1 0\nv 0 0 1\nv 1 0 0\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n")
    urdf = tmp_path / "a" / "object.urdf"
    extra = (
        '<collision><geometry><mesh filename="collision/bad.obj"/></geometry></collision></link>'
    )
    urdf.write_text(urdf.read_text().replace("</link>", extra, 1))
    assert "not_finite" in check_asset(tmp_path / "a").reasons


def test_without_friction_a_lid_sags(tmp_path: Path) -> None:
    lid = with_joint("hinge", axis=np.array([0.0, 1, 0]), upper=1.2, origin=np.array([0, 0, 0.023]))
    asset = write_asset(lid, tmp_path / "a", name="a")
    held = check_asset(asset.folder)
    assert "sags" not in held.reasons
    (asset.folder / "asset.json").unlink()
    urdf = asset.folder / "object.urdf"
    urdf.write_text(re.sub(r'friction="[^"]*"', 'friction="0"', urdf.read_text()))
    assert "sags" in reasons(check_asset(urdf), "hinge")


def drawer_behind_a_door() -> Articulation:
    """The cabinet's drawer, with a second door in front of it, hinged on the right."""
    truth = cabinet()
    front = trimesh.creation.box(bounds=[[-0.022, -0.298, 0.522], [-0.004, 0.298, 0.778]])
    mesh = truth.mesh
    count = len(mesh.faces)
    whole = Mesh(
        np.concatenate([mesh.vertices, front.vertices]),
        np.concatenate([mesh.faces, front.faces + len(mesh.vertices)]),
    )
    link = Link("front", "door", np.arange(count, count + 12))
    hinge = Joint("front_hinge", "revolute", "hinge", 0, 3, -Z, np.array([-0.004, 0.299, 0.65]),
                  0, 1.6, 0, 1.6)  # fmt: skip
    return Articulation(whole, (*truth.links, link), (*truth.joints, hinge))


def test_a_drawer_behind_a_door_is_tested_with_the_door_open(tmp_path: Path) -> None:
    asset = write_asset(drawer_behind_a_door(), tmp_path / "a", name="a")
    report = check_asset(asset.folder)
    slide = next(j for j in report.joints if j.name == "slide")
    assert slide.after == ("front_hinge",)
    assert report.passed, report.reasons
    assert all(j.after == () for j in report.joints if j.name != "slide")


def test_other_joints_are_closed_while_one_is_tested(tmp_path: Path) -> None:
    """The source's pose may be an open one: the door in front counts where it is closed."""
    truth = drawer_behind_a_door()
    opened = joint_motion("revolute", -Z, np.array([-0.004, 0.299, 0.65]), 1.6)
    vertices = truth.mesh.vertices.copy()
    vertices[-8:] = vertices[-8:] @ opened[:3, :3].T + opened[:3, 3]
    turned = replace(truth.joints[2], lower=-1.6, upper=0.0, closed=-1.6, open=0.0)
    ajar = replace(truth, mesh=Mesh(vertices, truth.mesh.faces),
                   joints=(*truth.joints[:2], turned))  # fmt: skip
    report = check_asset(write_asset(ajar, tmp_path / "a", name="a").folder)
    assert report.passed, report.reasons
    assert next(j for j in report.joints if j.name == "slide").after == ("front_hinge",)


def test_driving_ends_with_its_budget_of_steps_and_says_so(
    good: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mam_pipeline.check.drive.drive_urdf", partial(drive_urdf, budget=10))
    report = check_asset(good)
    assert not report.passed and report.reasons == ("not_finished",)
    assert report.clauses["reach"] is False and "not_finished" in REASONS


def test_what_is_too_much_to_sweep_is_said_before_it_is_tried(
    good: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mam_pipeline.check.check.MAX_SWEEP", 10)
    monkeypatch.setattr("mam_pipeline.check.check.sweep_joint", None)
    assert check_asset(good).reasons == ("too_large",)


def test_no_clock_decides_anything_here() -> None:
    """Clocks are read to tell how long something took, and where a network or a program is awaited.

    Seconds that are recorded go into `seconds` or a report, never into a comparison.
    """
    allowed = {"models/transports.py", "guarded.py"}
    root = Path(mam_pipeline.__file__).parent
    for file in root.rglob("*.py"):
        if file.relative_to(root).as_posix() in allowed:
            continue
        text = file.read_text(encoding="utf-8")
        assert not re.search(r"[<>]=?[^=\n]*\b(monotonic|process_time|perf_counter)\(", text), file
        assert not re.search(r"\b(monotonic|process_time|perf_counter)\(\)[^\n]*[<>]", text), file
        assert "setitimer" not in text and "SIGALRM" not in text, file


@pytest.mark.parametrize(
    "name", ["../a.obj", "package://../../a.obj", "file:///etc/passwd", "link"]
)
def test_no_mesh_outside_the_folder_is_read(good: Path, tmp_path: Path, name: str) -> None:
    shutil.copytree(good, tmp_path / "a")
    shutil.copy(good / "visual" / "door.obj", tmp_path / "a.obj")
    if name == "link":
        name = "visual/link.obj"
        (tmp_path / "a" / name).symlink_to(tmp_path / "a.obj")
    urdf = tmp_path / "a" / "object.urdf"
    urdf.write_text(urdf.read_text().replace("visual/door.obj", name, 1))
    assert check_asset(tmp_path / "a").reasons[0] in ("mesh_outside", "mesh_missing")


def test_huge_files_are_not_read(good: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(thresholds, "MAX_MESH_BYTES", 1000)
    assert "too_large" in check_asset(good).reasons
    monkeypatch.setattr(thresholds, "MAX_XML_BYTES", 100)
    assert check_asset(good).reasons == ("xml_unreadable",)


def test_nothing_to_check(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no asset or URDF"):
        check_asset(tmp_path / "nothing")
    with pytest.raises(InputError, match="0 URDF files"):
        check_asset(tmp_path)


def test_the_verb_returns_zero_or_one(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from mam_sim.cli import main

    assert main(["check", str(good), "--out", str(tmp_path / "r.json")]) == 0
    assert "passes" in capsys.readouterr().out
    (tmp_path / "a.urdf").write_text('<robot name="a"/>')
    assert main(["check", str(tmp_path / "a.urdf"), "--no-drive"]) == 1
    assert "no_surface" in capsys.readouterr().out
    assert main(["check", str(tmp_path / "none")]) == 2


def test_a_slide_that_leaves_its_guide_is_cut_and_said_so(tmp_path: Path) -> None:
    far = with_joint("slide", upper=0.9, open=0.9)
    card = written_and_checked(far, partial(write_asset, out=tmp_path / "a", name="a"))[0].card
    slide = next(j for j in card.joints if j.name == "slide")
    assert card.checks["executability"]["passed"] and slide.upper is not None
    assert 0.28 < slide.upper < 0.6 and "slide: way cut to" in " ".join(card.notes)
