"""A joint that physics stops is put to sleep where others move, with all that is known of it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from mam_pipeline.asset.writer import write_asset
from mam_pipeline.check.asleep import put_to_sleep
from mam_pipeline.check.correct import written_and_checked
from mam_pipeline.types import Articulation, Coupling, DormantPart, Link, Mesh
from tests.pipeline.test_check import cabinet, with_joint

pytestmark = pytest.mark.sim


def blocked_door(**changes: Any) -> Articulation:
    """The cabinet with a post before its door, which cannot open."""
    post = trimesh.creation.box(bounds=[[-0.03, 0.1, 0.05], [-0.005, 0.2, 0.45]])
    truth = with_joint("hinge", **changes)
    count = len(truth.mesh.faces)
    mesh = Mesh(np.append(truth.mesh.vertices, post.vertices, 0),
                np.append(truth.mesh.faces, post.faces + len(truth.mesh.vertices), 0))  # fmt: skip
    body = np.append(truth.links[0].faces, count + np.arange(12))
    return replace(truth, mesh=mesh, links=(replace(truth.links[0], faces=body), *truth.links[1:]))


@pytest.mark.parametrize("who", ["", "door", "user"])
def test_a_joint_that_physics_stops_is_dormant_where_others_move(tmp_path: Path, who: str) -> None:
    """Who says that it moves has an asset that fails."""
    made = blocked_door(provenance="user" if who == "user" else "inferred")
    write = partial(write_asset, out=tmp_path / "a", name="a")
    card = written_and_checked(made, write, accepted=[who])[0].card
    verdict = card.checks["executability"]
    if who:
        assert "penetration" in verdict["reasons"] and not card.dormant
        return
    assert verdict["passed"] and [j.name for j in card.movable] == ["slide"]
    (row,) = card.dormant
    assert (row.name, row.child, row.upper) == ("hinge", "door", 1.6)
    assert "a part runs into another" in row.dormant
    assert any(note.startswith("hinge: dormant, as the check stops it") for note in card.notes)


def test_a_joint_whose_line_is_doubted_is_not_put_to_sleep(tmp_path: Path) -> None:
    beside = with_joint("hinge", origin=np.array([0.0, -0.36, 0.25]), upper=1.2, open=1.2)
    card = written_and_checked(beside, partial(write_asset, out=tmp_path / "a", name="a"))[0].card
    assert len(card.movable) == 2 and card.checks["executability"]["reasons"] == ["off_axis"]


def test_nothing_is_put_to_sleep_where_nothing_else_would_move(tmp_path: Path) -> None:
    truth = blocked_door()
    body = np.concatenate([truth.links[k].faces for k in (0, 2)])
    alone = replace(truth, joints=truth.joints[:1],
                    links=(replace(truth.links[0], faces=body), truth.links[1]))  # fmt: skip
    card = written_and_checked(alone, partial(write_asset, out=tmp_path / "a", name="a"))[0].card
    assert len(card.movable) == 1 and "penetration" in card.checks["executability"]["reasons"]


def test_what_hangs_on_a_sleeping_part_hangs_on_what_holds_it_and_what_follows_it_sleeps() -> None:
    truth = cabinet()
    hinge, slide = truth.joints
    chain = replace(truth, joints=(hinge, replace(slide, parent=1)))
    found = put_to_sleep(chain, {"hinge": "why"})
    (left,), (door,) = found.joints, found.dormant
    assert (left.name, left.parent, left.child) == ("slide", 0, 1)
    assert (door.joint.parent, door.joint.dormant) == (0, "why")
    assert [link.name for link in found.links] == ["body", "drawer"]
    assert {*found.links[0].faces} == {*truth.links[0].faces, *truth.links[1].faces}
    knob = DormantPart(
        Link("knob", "knob", door.link.faces[:4]), replace(slide, parent=1, child=-1)
    )
    both = put_to_sleep(replace(chain, dormant=(knob,)), {"hinge": "why"}).dormant
    assert [d.joint.parent for d in both] == [0, 0]
    assert not {*both[0].link.faces} & {*both[1].link.faces}
    after = replace(truth, joints=(hinge, replace(slide, coupling=Coupling("hinge", 0.1, 0.0))))
    asleep = put_to_sleep(after, {"hinge": "why"})
    assert not asleep.joints and len(asleep.links) == 1
    assert [d.joint.dormant for d in asleep.dormant] == ["why", "it follows hinge"]
