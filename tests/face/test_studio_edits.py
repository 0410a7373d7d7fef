"""Edits of hints, picking, and the words for what was found; without a browser."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from mam_pipeline.types import Joint, KinematicTree, Mesh, PartNode, Primitives
from mam_sim.studio import edits
from mam_sim.studio.lines import Lines, lines_near, mesh_lines
from mam_sim.studio.picking import (
    Camera,
    Snap,
    area_around,
    faces_in_box,
    faces_near,
    primitives_in_box,
    snapped,
    snaps,
)
from mam_sim.studio.words import callings, dialogue_text, joint_text, line, verdict_text

Change = Callable[..., object]


def tree() -> KinematicTree:
    """A base, a door with a knob on it, and a drawer."""
    return KinematicTree((
        PartNode("base", "body", (0, 1), -1, "fixed"),
        PartNode("door", "door", (2, 3), 0, "hinge"),
        PartNode("knob", "knob", (4,), 1, "spin"),
        PartNode("drawer", "drawer", (5, 6), 0, "slide"),
    ))  # fmt: skip


def after(*changes: Change) -> dict[str, PartNode]:
    """The parts after edits, by name; the tree of each edit is that which the one before made."""
    from mam_pipeline.hints import Hints
    from mam_pipeline.parts.hints import apply_hints

    corners = np.concatenate([[[k, 0, 0], [k + 0.5, 0, 0], [k, 0, 0.5]] for k in range(7)])
    mesh, primitives = Mesh(corners, np.arange(21).reshape(7, 3)), Primitives(np.arange(7))
    hints, now = Hints(), tree()
    for change in changes:
        made = change(hints, now)
        assert isinstance(made, Hints)
        hints = edits.with_living_parents(made, now)
        now = apply_hints(tree(), primitives, mesh, hints)
    assert sorted(p for n in now.nodes for p in n.primitives) == list(range(7))
    return {n.name: n for n in now.nodes}


def parent(parts: dict[str, PartNode], name: str) -> str:
    return list(parts)[parts[name].parent]


def test_pieces_become_a_part_and_go_back() -> None:
    parts = after(lambda h, t: edits.make_part(h, t, [1, 5], "lid", "hinge"))
    assert parts["lid_0"].primitives == (1, 5) and parts["drawer"].primitives == (6,)
    parts = after(
        lambda h, t: edits.make_part(h, t, [1, 5], "lid", "hinge"),
        lambda h, t: edits.do_not_move(h, [5]),
        lambda h, t: edits.add_to(h, t, "drawer", [1]),
    )
    assert "lid_0" not in parts and parts["drawer"].primitives == (1, 6)


def test_what_hangs_on_a_part_stays_on_it_when_it_is_edited() -> None:
    for change in (
        lambda h, t: edits.set_kind(h, t, "door", "gate"),
        lambda h, t: edits.add_to(h, t, "door", [1]),
        lambda h, t: edits.set_subtype(h, t, "door", "slide"),
    ):
        assert parent(after(change), "knob") == "door"
    assert parent(after(lambda h, t: edits.rename(h, t, "door", "gate")), "knob") == "gate"
    fixed = after(
        lambda h, t: edits.set_kind(h, t, "knob", "dial"),
        lambda h, t: edits.set_subtype(h, t, "door", "fixed"),
    )
    assert "door" not in fixed and parent(fixed, "knob") == "base"


def test_merged_parts_move_as_the_first_and_carry_what_hung_on_both() -> None:
    parts = after(lambda h, t: edits.merge(h, t, "drawer", "door"))
    assert parts["drawer"].primitives == (2, 3, 5, 6) and parts["drawer"].subtype == "slide"
    assert parent(parts, "knob") == "drawer"
    parts = after(lambda h, t: edits.merge(h, t, "knob", "door"))
    assert parts["knob"].primitives == (2, 3, 4) and parent(parts, "knob") == "base"


def test_a_part_is_the_engines_again() -> None:
    parts = after(
        lambda h, t: edits.set_kind(h, t, "door", "gate"),
        lambda h, t: edits.as_the_engine_says(h, t, "door"),
    )
    assert parts["door"].kind == "door" and parts["door"].provenance == "inferred"


def test_a_box_on_the_screen_selects_what_is_seen_whole_in_it() -> None:
    import trimesh

    from mam_pipeline.render.tracer import Tracer

    places = [
        ((0.4, 0.5, 0.6), (0, 0, 0.3)),
        ((0.02, 0.46, 0.5), (-0.215, 0, 0.3)),
        ((0.04, 0.05, 0.05), (-0.245, 0.18, 0.3)),
    ]
    joined: Any = trimesh.util.concatenate([
        trimesh.creation.box(size, trimesh.transformations.translation_matrix(at)).subdivide()
        for size, at in places
    ])  # fmt: skip
    mesh = Mesh(joined.vertices, joined.faces)
    primitives = Primitives(np.repeat(np.arange(3), 48))
    tracer = Tracer(mesh.vertices, mesh.faces)
    ahead = np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]])  # looks along +X, Z up
    camera = Camera(np.array([-2.0, 0, 0.3]), ahead, 0.6, 1.0)

    def box(low: tuple[float, float], high: tuple[float, float]) -> list[int]:
        corners = np.array(low), np.array(high)
        return primitives_in_box(mesh, primitives.labels, tracer, camera, *corners)

    assert box((0, 0), (1, 1)) == [0, 1, 2]
    low, high = camera.screen(np.array([[-0.225, 0.23, 0.55], [-0.225, -0.23, 0.05]]))
    assert box(tuple(low - 0.005), tuple(high + 0.005)) == [1, 2], "the body reaches beyond it"
    knob = camera.screen(np.array([[-0.265, 0.18, 0.3]]))[0]
    assert box(tuple(knob - 0.06), tuple(knob + 0.06)) == [2]


def test_faces_are_taken_up_to_an_edge_under_a_brush_or_in_a_box() -> None:
    import trimesh

    from mam_pipeline.render.tracer import Tracer

    box = trimesh.creation.box((0.4, 0.5, 0.6)).subdivide().subdivide()
    twice = np.concatenate([box.faces, box.faces[:, ::-1]])  # both sides, as many files have it
    mesh, own = Mesh(box.vertices, twice), np.arange(len(twice))
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    front = np.flatnonzero(middles[:, 0] < -0.199)
    assert set(area_around(mesh, own, int(front[0]))) == set(front)
    at = np.array([-0.2, 0.0, 0.0])
    near = faces_near(mesh, own, int(front[0]), at, 0.1)
    assert front[0] in near and len(near) < len(front)
    assert np.all(np.linalg.norm(middles[near[near != front[0]]] - at, axis=1) <= 0.1)
    ahead = np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]])  # looks along +X, Z up
    camera = Camera(np.array([-2.0, 0, 0]), ahead, 0.6, 1.0)
    tracer = Tracer(mesh.vertices, mesh.faces)
    seen = faces_in_box(mesh, tracer, camera, np.zeros(2), np.ones(2))
    assert set(seen) == set(front), "what is hidden stays"


def test_an_axis_snaps_to_edges_and_circles_with_its_sign() -> None:
    import trimesh

    shapes = [trimesh.creation.box((0.4, 0.5, 0.6)), trimesh.creation.cylinder(0.05, 0.2)]
    for shape, left, want, what in (
        (shapes[0], ((0.02, 0.01, -1), (0.21, 0.24, 0.1)), (0.2, 0.25), "edge"),
        (shapes[1], ((0.1, 0.02, -1), (0.005, 0.0, 0.11)), (0.0, 0.0), "circle"),
    ):
        mesh = Mesh(shape.vertices, shape.faces)
        axis = np.array(left[0]) / np.linalg.norm(left[0])
        lines = [s for s in snaps(mesh, np.arange(len(mesh.faces))) if s.what == what]
        found = snapped(axis, np.array(left[1]), lines, mesh.diagonal)
        assert isinstance(found, Snap) and found.what == what
        assert np.allclose(found.axis, [0, 0, -1], atol=1e-6)
        assert np.allclose(found.origin[:2], want, atol=1e-6)


def test_words_say_where_a_line_runs_as_seen_from_the_front() -> None:
    box = np.array([[-0.22, -0.23, 0.0], [-0.2, 0.23, 0.6]])
    assert line("hinge", np.array([0, 0, 1.0]), np.array([-0.2, -0.23, 0.3]), box) == (
        "hinge at its right, upright"
    )
    assert line("slide", np.array([-1.0, 0, 0]), np.zeros(3), box) == "slide out to the front"
    joint = Joint("j", "revolute", "hinge", 0, 1, np.array([0, 0, 1.0]),
                  np.array([-0.2, 0.23, 0.3]), 0.0, np.pi / 2, confidence=0.4)  # fmt: skip
    runs = line("hinge", joint.axis, joint.origin, box)
    text = joint_text(joint, "door_0", "door", runs, "mesh")
    assert "at its left, upright" in text and "0 to 90 °" in text
    assert "Inferred, 40 % sure. Please look at it." in text
    assert "runs into another" in verdict_text(False, True, ["penetration"], [], [])


def test_a_language_models_answers_are_told_and_what_was_overruled() -> None:
    part = {"name": "door", "kind": "door", "is_base": False, "pieces": [1, 2], "confidence": 0.9}
    mount = {"name": "door", "parent": "body", "motion": "hinge", "confidence": 0.8, "axis": "z",
             "second_best": "slide", "side": "+y", "opens": "-x"}  # fmt: skip
    talk = [{"question": "Which pieces?\nSay.", "parts": [part]},
            {"question": "How?", "mounts": [mount]}]  # fmt: skip
    text = dialogue_text({"dialogue": talk}, ["door"])
    assert "> Which pieces?\n> Say." in text and "pieces 1, 2; 90 % sure" in text
    assert "hinge, axis z, side +y, 80 % sure; else slide; *you said otherwise*" in text
    assert "otherwise" not in dialogue_text({"dialogue": talk}, [])
    assert dialogue_text({}, []) == ""
    one: list[dict[str, Any]] = [
           {"question": "How?", "base": "body", "parts": [{**mount, **part, "parent": None}]},
           {"question": "So?", "joints": [{"name": "door", "ok": False, "upper": 60.0}],
            "transfers": [{"pieces": [2], "to": "body"}]}]  # fmt: skip
    del one[0]["parts"][0]["is_base"]
    text = dialogue_text({"dialogue": one}, [])
    assert "pieces 1, 2;" in text and "hangs on body: hinge, axis z" in text
    assert "**door**: upper 60.0" in text and "pieces 2 belong to **body**" in text


def lines_of(shape: Any) -> Lines:
    return mesh_lines(Mesh(shape.vertices, shape.faces), np.zeros(len(shape.faces), np.int64))


def test_straight_edges_are_one_line_each_however_their_faces_are_cut_wound_or_doubled() -> None:
    import trimesh

    box = trimesh.creation.box((0.4, 0.5, 0.6))
    fine = box.subdivide().subdivide().subdivide()
    both = trimesh.Trimesh(
        fine.vertices, np.concatenate([fine.faces, fine.faces[:, ::-1]]), process=False
    )
    mixed = fine.copy()
    mixed.faces[::3] = mixed.faces[::3, ::-1]
    soup = trimesh.Trimesh(**trimesh.triangles.to_kwargs(fine.triangles), process=False)
    for shape in (box, fine, both, mixed, soup):
        lines = lines_of(shape)
        assert np.allclose(np.sort(lines.length), np.repeat([0.4, 0.5, 0.6], 4))
        assert not lines.round.any()
        k = int(np.argmin(np.linalg.norm(lines.origin - [0.2, 0.25, 0.0], axis=1)))
        assert np.allclose(lines.origin[k], [0.2, 0.25, 0.0])
        assert abs(lines.axis[k, 2]) == pytest.approx(1)
    sheet = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 0]], [[0, 1, 2], [0, 2, 3]])
    assert np.allclose(np.sort(lines_of(sheet).length), [1, 1, 2, 2]), "where it ends, not across"
    assert not len(lines_of(trimesh.creation.icosphere(3)).axis), "a ball has no edge"


def test_a_narrow_side_has_a_line_in_its_middle() -> None:
    import trimesh

    door = lines_of(trimesh.creation.box((0.04, 0.6, 2.0)))
    upright = np.abs(door.axis[:, 2]) > 0.999
    assert np.allclose(np.sort(door.origin[upright][:, 1]), np.repeat([-0.3, 0.3], 3))
    middle = door.origin[upright & (np.abs(door.origin[:, 0]) < 1e-9)]
    assert np.allclose(np.sort(middle[:, 1]), [-0.3, 0.3]), "one on each side, not in between"
    turned = trimesh.creation.box((0.04, 0.6, 2.0)).subdivide()
    turned.faces[::2] = turned.faces[::2, [1, 2, 0]]
    assert len(lines_of(turned).axis) == len(door.axis)


def test_round_rims_give_their_middle_axis_and_what_is_across() -> None:
    import trimesh

    for sections in (10, 16, 32, 300):
        tube = trimesh.creation.annulus(0.02, 0.05, 0.2, sections=sections)
        lines = lines_of(tube.subdivide())
        rims = np.flatnonzero(lines.round)
        assert np.allclose(np.sort(lines.length[rims]), [0.04, 0.04, 0.1, 0.1], rtol=0.03)
        assert np.allclose(np.abs(lines.axis[rims, 2]), 1, atol=1e-6)
        assert np.allclose(lines.origin[rims, :2], 0, atol=1e-6)
    half = trimesh.creation.cylinder(0.05, 0.2).slice_plane([0, 0, 0], [1, 0, 0])
    lines = lines_of(half)
    assert np.allclose(lines.origin[lines.round][:, :2], 0, atol=1e-6), "half a rim has it too"
    assert not lines_of(trimesh.creation.box((0.4, 0.5, 0.6))).round.any()


def test_the_line_that_is_seen_comes_first_and_the_hidden_ones_from_front_to_back() -> None:
    import trimesh

    from mam_pipeline.render.tracer import Tracer

    ahead = trimesh.transformations.translation_matrix((-0.3, 0, 0))
    front = trimesh.creation.box((0.02, 0.5, 0.6), ahead)
    inner, back = (trimesh.creation.box(size) for size in ((0.1, 0.2, 0.2), (0.4, 0.204, 0.204)))
    shapes = front, inner, back
    joined: Any = trimesh.util.concatenate(shapes)
    mesh = Mesh(joined.vertices, joined.faces)
    owner = np.repeat(np.arange(3), [len(shape.faces) for shape in shapes])
    lines, tracer = mesh_lines(mesh, owner), Tracer(mesh.vertices, mesh.faces)
    eye = np.array([-3.0, 0.0, 0.0])

    def hits(y: float, z: float) -> list[tuple[int, bool, float]]:
        ray = np.array([-0.3, y, z]) - eye
        found = lines_near(lines, tracer, eye, ray / np.linalg.norm(ray), mesh.diagonal)
        return [(int(lines.owner[h.line]), h.hidden, float(lines.origin[h.line][0])) for h in found]

    seen = hits(0.249, 0.0)
    assert seen[0][:2] == (0, False) and seen[0][2] == pytest.approx(-0.31)
    behind = hits(0.094, 0.0)
    assert [hidden for _, hidden, _ in behind] == [True] * len(behind) and len(behind) >= 4
    assert {o for o, _, _ in behind} == {1, 2}
    assert [x for _, _, x in behind] == sorted(x for _, _, x in behind), "from front to back"
    assert not hits(0.17, 0.0), "no edge is near"


def test_parts_are_called_by_their_place_as_seen_from_the_front() -> None:
    def at(*places: tuple[str, str, float, float]) -> dict[str, str]:
        return callings({n: (kind, np.array([0.0, y, z])) for n, kind, y, z in places})

    assert at(("door_0", "door", 0, 0)) == {"door_0": "door"}
    two = at(("door_0", "door", -0.3, 0.5), ("door_1", "door", 0.3, 0.5), ("base", "body", 0, 0))
    assert two == {"door_1": "left door", "door_0": "right door", "base": "base"}
    assert list(two) == ["door_1", "door_0", "base"]
    above = at(("drawer_0", "drawer", 0, 0.1), ("drawer_1", "drawer", 0, 0.4))
    assert above == {"drawer_1": "upper drawer", "drawer_0": "lower drawer"}
    grid = [(f"drawer_{k}", "drawer", 0.3 - 0.6 * (k % 2), 0.3 * (k // 2)) for k in range(4)]
    assert at(*grid) == {
        "drawer_2": "drawer 1", "drawer_3": "drawer 2", "drawer_0": "drawer 3",
        "drawer_1": "drawer 4",
    }  # fmt: skip
    own = at(("glass_door", "door", 0.3, 0), ("door_1", "door", -0.3, 0))
    assert own == {"glass_door": "glass door", "door_1": "door"}
