"""Materials, bearings and masses by kind: the closed forms, and where exports have them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml
from mam_sim_formats.mjcf_export import export_mjcf
from mam_sim_formats.usd_export import export_usd

from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.dynamics import DYNAMICS, catch_pull, gravity_load, rubbing, with_dynamics
from mam_pipeline.asset.inertia import link_inertials
from mam_pipeline.asset.matter import (
    BOARD,
    RULE,
    bearing_of,
    catch_of,
    made_alike,
    material_of,
    usual_mass,
    weighted,
)
from mam_pipeline.asset.writer import write_asset
from mam_pipeline.check.check import check_asset
from mam_pipeline.evidence.kinds import kinds
from mam_pipeline.evidence.read import named_size
from mam_pipeline.holding import Catch
from mam_pipeline.types import Articulation, Inertial, Joint, Link, Mesh

G = 9.81
PRODUCTS = Path(__file__).resolve().parents[2] / "benchmarks/masses.yaml"


def cabinet(part: str, lines: tuple[float, float, float] = (-1, 0, 0)) -> Articulation:
    """A solid base and a part of 0.4 x 0.1 x 0.2 m at its front, on a slide."""
    base, front = trimesh.creation.box((0.4, 0.5, 0.8)), trimesh.creation.box((0.4, 0.1, 0.2))
    front.apply_translation([-0.5, 0, 0])
    whole: Any = trimesh.util.concatenate([base, front])
    links = (Link("base", "body", np.arange(12)), Link("part", part, np.arange(12, 24)))
    joint = Joint("j", "prismatic", "slide", 0, 1, np.array(lines, float), np.zeros(3), 0, 0.3)
    return Articulation(Mesh(whole.vertices, whole.faces), links, (joint,))


def test_every_kind_of_object_and_part_is_of_something_known() -> None:
    for name in kinds().objects:
        assert material_of("body", name).density > 0
    assert made_alike() <= set(kinds().parts) | {"faucet", "tap"}
    for name in kinds().parts:
        for type_ in ("prismatic", "revolute", "continuous"):
            low, high = bearing_of(name, type_).spread
            assert 0 < low <= 1 <= high


def test_a_handle_is_metal_and_a_door_is_what_its_object_is_of() -> None:
    assert material_of("handle", "refrigerator").name == "zinc casting"
    assert material_of("door", "refrigerator").name == "steel sheet"
    assert material_of("door", "wardrobe").name == material_of("door").name == BOARD


def test_a_drawer_asks_for_more_when_it_weighs_more() -> None:
    """On runners: a force of its own and a share of the weight, whatever the spread."""
    made = cabinet("drawer")
    light = link_inertials(made)
    heavy = [replace(b, mass=3 * b.mass) for b in light]
    bearing = bearing_of("drawer", "prismatic")
    for bodies in (light, heavy):
        (joint,) = with_dynamics(made, bodies).joints
        running = bearing.force + bearing.share * G * bodies[1].mass
        assert joint.friction == pytest.approx(running)
        assert joint.friction_range == pytest.approx(np.array(bearing.spread) * running)


def test_what_gravity_pulls_is_held_beyond_what_the_bearing_asks_for() -> None:
    made = cabinet("sash", (0, 0, 1))
    bodies = link_inertials(made)
    (joint,) = with_dynamics(made, bodies).joints
    weight = G * bodies[1].mass
    bearing = bearing_of("sash", "prismatic")
    assert joint.friction == pytest.approx(
        bearing.force + bearing.share * weight + DYNAMICS.hold * weight
    )
    assert joint.friction_range[0] > weight  # the easiest that is drawn holds it still


def test_what_fingers_turn_has_a_torque_whatever_its_size() -> None:
    bearing = bearing_of("knob", "continuous")
    assert bearing.friction(1.0, 0.01, False) == bearing.friction(1.0, 0.3, False) == 0.02


def test_mass_follows_size_between_what_a_kind_weighs_at_its_ends() -> None:
    fridge = kinds().objects["refrigerator"]
    for size, mass in zip(fridge.size, fridge.mass or ()):
        found = usual_mass(fridge, size)
        assert found is not None and found[1] == pytest.approx(mass)
        assert found[0] < 1.001 * found[1] < 1.002 * found[2]
    assert usual_mass(fridge, 0.9 * fridge.size[0] / RULE.size) is None  # a model of one
    assert usual_mass(kinds().objects["curtain"], 2.0) is None  # nobody knows


def test_a_machine_is_heavy_in_its_body_and_furniture_everywhere() -> None:
    body = Inertial(5.0, np.zeros(3), np.eye(3), "walls")
    door = Inertial(2.0, np.zeros(3), np.eye(3), "walls")
    washer = kinds().objects["washer"]
    base, front = weighted([body, door], "washer", washer.size[1])
    assert washer.mass is not None and base.mass + front.mass == pytest.approx(washer.mass[1])
    assert front.mass == 2.0
    assert base.inertia[0, 0] == pytest.approx(base.mass / 5.0)
    assert "washer" in base.material and front.material == "walls"
    assert front.mass_range[0] < front.mass < front.mass_range[1]
    heavy = [replace(b, mass=50 * b.mass) for b in (body, door)]  # walls drawn too thick
    assert sum(b.mass for b in weighted(heavy, "washer", washer.size[1])) == pytest.approx(
        washer.mass[1]
    )


def test_furniture_weighs_what_its_boards_and_its_kind_say() -> None:
    wardrobe = kinds().objects["wardrobe"]
    least, usual, most = usual_mass(wardrobe, 2.0) or (0.0, 0.0, 0.0)
    for total, wanted in ((7.0, least), (1.3 * usual, 1.3**0.5 * usual), (9 * usual, most)):
        bodies = [Inertial(share * total, np.zeros(3), np.eye(3), "b") for share in (5 / 7, 2 / 7)]
        a, b = weighted(bodies, "wardrobe", 2.0)
        assert a.mass / b.mass == pytest.approx(2.5)
        assert a.mass + b.mass == pytest.approx(wanted)


def test_products_that_did_not_set_the_table_weigh_what_it_says() -> None:
    """Every other product of each kind was kept out of it: at least four of five are within."""
    data = yaml.safe_load(PRODUCTS.read_text(encoding="utf-8"))["masses"]
    assert len(data) >= 20
    within = []
    for row in data.values():
        thing = row.get("thing") or named_size(row["categories"][0].replace("_", " "))[0]
        for _, size, mass in row["products"][1::2]:
            low, _, high = usual_mass(kinds().objects[thing], size) or (0.0, 0.0, 0.0)
            within.append(low <= mass <= high)
    assert np.mean(within) >= 0.8


@pytest.fixture(scope="module")
def asset(tmp_path_factory: pytest.TempPathFactory) -> Asset:
    return write_asset(cabinet("drawer"), tmp_path_factory.mktemp("m") / "a", name="a")


def test_contact_friction_is_where_each_program_reads_it(asset: Asset, tmp_path: Path) -> None:
    mu = material_of("drawer").friction
    robot = ET.parse(asset.urdf_path).getroot()
    assert {g.get("reference"): float(g.findtext("mu1") or 0) for g in robot.findall("gazebo")} == {
        "base": mu, "part": mu
    }  # fmt: skip
    drake = "{http://drake.mit.edu}"
    pieces = robot.findall("link/collision")
    found = [p.find(f"{drake}proximity_properties/{drake}mu_dynamic") for p in pieces]
    assert pieces and all(e is not None and float(e.get("value") or 0) == mu for e in found)
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(export_mjcf(asset, tmp_path / "a.xml")))
    touching = model.geom_contype != 0
    assert touching.any() and np.allclose(model.geom_friction[touching, 0], mu)
    usd = pytest.importorskip("pxr.Usd")
    from pxr import UsdPhysics, UsdShade

    stage = usd.Stage.Open(str(export_usd(asset, tmp_path / "a.usda")))
    for prim in stage.Traverse():
        if prim.HasAPI(UsdPhysics.CollisionAPI):
            bound, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")
            api = UsdPhysics.MaterialAPI(bound.GetPrim())
            assert api.GetDynamicFrictionAttr().Get() == pytest.approx(mu)


def hinged(part: str) -> Articulation:
    """As `cabinet`, on an upright hinge beside the part."""
    made = cabinet(part)
    (slide,) = made.joints
    place = np.array([-0.3, -0.05, 0.0])
    hinge = replace(slide, type="revolute", subtype="hinge", axis=np.array([0, 0, 1.0]),
                    origin=place, upper=1.5, open=1.5)  # fmt: skip
    return replace(made, joints=(hinge,))


def test_a_fridge_door_has_a_gasket_and_a_cabinet_door_has_not() -> None:
    made = hinged("door")
    bodies = link_inertials(made)
    (plain,) = with_dynamics(made, bodies).joints
    (door,) = with_dynamics(made, bodies, "refrigerator").joints
    kind = catch_of("door", "refrigerator")
    assert kind is not None and plain.catch is None and door.catch is not None
    arm = float(np.hypot(0.4, 0.1))  # of its farthest corner
    assert door.catch.force == pytest.approx(kind.force * arm)
    assert (door.friction, door.damping) == (plain.friction, plain.damping)
    pulls = [catch_pull(door, share * door.catch.width) for share in (-0.1, 0, 0.25, 1, 2)]
    assert pulls == pytest.approx(np.array([-1, -1, -0.75, 0, 0]) * door.catch.force)


def test_what_a_person_says_of_a_catch_goes_before_the_table() -> None:
    made = hinged("door")
    (hinge,) = made.joints
    made = replace(made, joints=(replace(hinge, catch=Catch()),))
    (door,) = with_dynamics(made, link_inertials(made), "refrigerator").joints
    assert door.catch == Catch() and catch_pull(door, 0.0) == 0.0


def dropping(part: str) -> Articulation:
    """As `cabinet`, on a level hinge at the lower edge of the part."""
    made = cabinet(part)
    (slide,) = made.joints
    hinge = replace(slide, type="revolute", subtype="hinge", axis=np.array([0, -1.0, 0]),
                    origin=np.array([-0.3, 0.0, -0.1]), upper=1.5, open=1.5)  # fmt: skip
    return replace(made, joints=(hinge,))


def test_springs_carry_the_door_of_an_oven_and_friction_that_of_an_unknown_thing() -> None:
    made = dropping("door")
    bodies = link_inertials(made)
    (plain,) = with_dynamics(made, bodies).joints
    (door,) = with_dynamics(made, bodies, "oven").joints
    load, _, arm = gravity_load(made, made.joints[0], bodies)
    bearing = bearing_of("door", "revolute")
    assert plain.balance is None and rubbing(plain) == (plain.friction, plain.friction_range)
    # a simulator without springs holds it as it holds any other door
    assert door.friction == plain.friction >= DYNAMICS.hold * load > 0
    assert door.balance is not None and door.balance.source
    friction, between = rubbing(door)
    assert friction == pytest.approx(bearing.force * arm)
    assert between == pytest.approx([s * friction for s in bearing.spread])
    # beside its hinge it weighs nothing on it
    (upright,) = with_dynamics(hinged("door"), link_inertials(hinged("door")), "oven").joints
    assert upright.balance is None


@pytest.mark.parametrize(("made", "carried"), [("hung", True), ("hinged at its foot", False)])
def test_the_sash_of_a_window_hangs_on_balances_where_it_slides(made: str, carried: bool) -> None:
    window = cabinet("sash", (0, 0, 1)) if carried else dropping("sash")
    (joint,) = with_dynamics(window, link_inertials(window), "window").joints
    assert (joint.balance is not None) is carried, made


def test_a_door_on_springs_starts_with_what_rubs_and_stays_where_it_is_left(tmp_path: Path) -> None:
    asset = write_asset(dropping("door"), tmp_path / "a", name="a", thing="oven")
    (joint,) = asset.card.joints
    (found,) = check_asset(asset.folder).joints
    assert joint.catch is not None
    wanted = rubbing(joint)[0] + joint.catch.force
    assert found.breakaway == pytest.approx(wanted, rel=0.1)
    assert found.let_go == 0.0 and found.reached == pytest.approx(1.0, abs=1e-3)
    # the same, held by friction alone
    card = replace(asset.card, joints=[replace(joint, balance=None)])
    card.save(asset.folder)
    (held,) = check_asset(asset.folder).joints
    assert held.breakaway is not None and held.breakaway - joint.catch.force > 3 * rubbing(joint)[0]
    assert held.let_go == 0.0
