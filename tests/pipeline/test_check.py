"""`check_asset` accepts a true cabinet and rejects broken ones, each with the right reason."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mam_pipeline.asset.writer import write_asset
from mam_pipeline.check import REASONS, CheckReport, check_asset
from mam_pipeline.check.report import CLAUSES
from mam_pipeline.errors import InputError
from mam_pipeline.types import Articulation, CollisionShape, Joint, Link, Mesh

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
    whole = trimesh.util.concatenate([s for group in solids for s in group])
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
    ],
)
def test_wrong_joints_are_rejected(
    tmp_path: Path, joint: str, changes: dict[str, object], code: str
) -> None:
    asset = write_asset(with_joint(joint, **changes), tmp_path / "a", name="a")
    report = check_asset(asset.folder, drive=False)
    assert not report.passed
    assert code in reasons(report, joint), report.joints


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
        (r"visual/door.glb", "visual/nothing.glb", "mesh_missing"),
        (r"visual/door.glb", "../../elsewhere.glb", "mesh_outside"),
        (r"visual/door.glb", "/etc/passwd", "mesh_outside"),
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


def test_nothing_to_check(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no asset or URDF"):
        check_asset(tmp_path / "nothing")
    with pytest.raises(InputError, match="0 URDF files"):
        check_asset(tmp_path)


def test_the_verb_returns_zero_or_one(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from mam_sim.cli import main

    assert main(["check", str(good), "--json", str(tmp_path / "r.json")]) == 0
    assert "passes" in capsys.readouterr().out
    (tmp_path / "a.urdf").write_text('<robot name="a"/>')
    assert main(["check", str(tmp_path / "a.urdf"), "--no-drive"]) == 1
    assert "no_surface" in capsys.readouterr().out
    assert main(["check", str(tmp_path / "none")]) == 2
