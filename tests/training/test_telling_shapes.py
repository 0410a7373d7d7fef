"""Training objects whose shapes tell how they move."""

import numpy as np

from mam_pipeline.types import FloatArray
from mam_training.parts.corpus import generated
from mam_world.object import WorldObject


def points_of(made: WorldObject, link: int) -> FloatArray:
    return made.soup.vertices[made.soup.faces[made.soup.face_link == link]].reshape(-1, 3)


def test_knobs_stand_out_and_buttons_hardly() -> None:
    ratio: dict[str, list[float]] = {"knob": [], "button": []}
    for seed in range(90):
        made = generated("abstract_fascia", seed, solids=False)
        for joint in made.articulation.joints:
            kind = made.articulation.links[joint.child].name.split("_")[0]
            if kind not in ratio:
                continue
            assert joint.subtype == ("spin" if kind == "knob" else "slide")
            points = points_of(made, joint.child)
            across = np.linalg.svd(np.eye(3) - np.outer(joint.axis, joint.axis))[0][:, :2]
            wide = np.ptp(points @ across, axis=0).max()
            ratio[kind].append(float(np.ptp(points @ joint.axis) / wide))
    assert len(ratio["knob"]) > 20 and len(ratio["button"]) > 20
    assert np.median(ratio["knob"]) > 2 * np.median(ratio["button"])


def test_lids_are_hinged_away_from_their_catches_and_at_the_upper_edge() -> None:
    caught = sloping = 0
    for seed in range(80):
        made = generated("abstract_lid", seed, solids=False)
        links = [link.name for link in made.articulation.links]
        joint = next(j for j in made.articulation.joints if links[j.child] == "lid")
        lid = points_of(made, joint.child)
        assert abs(joint.axis[2]) < 1e-9
        ahead = np.cross(joint.axis, (0, 0, 1.0))
        away = np.abs((lid - joint.origin) @ ahead)
        run = away.max()
        rise = lid[away < 0.3 * run, 2].min() - lid[away > 0.7 * run, 2].min()
        if joint.closed == 0 and abs(rise) > 0.1 * run:  # one that stands open tells nothing
            assert rise > 0  # falls away from its hinge
            sloping += 1
        for k, name in enumerate(links):
            if name.startswith("latch"):
                off = np.abs((points_of(made, k).mean(axis=0) - joint.origin) @ ahead)
                assert off > 0.7 * run
                caught += 1
    assert caught > 5 and sloping > 5


def test_beams_tip_about_level_pins() -> None:
    tips = []
    for seed in range(60):
        made = generated("abstract_beam", seed, solids=False)
        links = [link.name for link in made.articulation.links]
        joint = next(j for j in made.articulation.joints if links[j.child] == "beam")
        level = abs(joint.axis[2]) < 1e-9
        assert level == (joint.subtype == "hinge")
        tips.append(level)
    assert 0.75 < np.mean(tips) < 1.0
