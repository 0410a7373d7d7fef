"""The table of kinds: that it is whole, and that its rules hold where it is broken."""

from __future__ import annotations

import math

import pytest

from mam_pipeline.evidence.kinds import (
    Kinds,
    ObjectKind,
    PartKind,
    UsualPart,
    index_of,
    kinds,
    usual_size,
)
from mam_pipeline.evidence.names import object_of, part_kind_of
from mam_pipeline.evidence.spec import Said
from mam_pipeline.package_data import table


def test_the_table_is_whole_and_its_english_words_are_found_in_names() -> None:
    """Reading it checks part kinds, ranges and words; see the refusals below."""
    assert len(kinds().objects) >= 300
    words = table("mam_pipeline.evidence", "kinds.yaml")
    for kind, languages in words["kind_words"].items():
        for word in languages["en"].split():
            found = object_of(word, Said("name", word))
            assert found is not None and found.word == kind
    for kind, languages in words["part_words"].items():
        for word in languages["en"].split():
            part = part_kind_of(word)
            assert part is not None and part.kind == kind


def test_a_kind_takes_what_it_does_not_say_from_what_it_is_like() -> None:
    known = kinds().objects
    fridge, oven, nightstand = known["refrigerator"], known["oven"], known["nightstand"]
    door, flap = fridge.part("door"), oven.part("flap")
    assert door is not None and (door.least, door.most, door.line) == (1, 4, "upright")
    assert flap is not None and (flap.line, flap.side) == ("level", ("bottom",))  # it drops
    assert fridge.part("knob") is None  # taken away
    assert "carcass" in nightstand.still and nightstand.size[1] == 0.55
    assert kinds().parts["door"].mirrored and kinds().parts["door"].opposite


def test_how_often_anything_moves_follows_from_its_parts() -> None:
    parts = (_part(0.5), _part(0.2))
    thing = ObjectKind("x", parts, (), (1.0, 1.0, 1.0), None)
    assert math.isclose(thing.moves, 1.0 - 0.5 * 0.8)
    assert 0.0 < kinds().objects["mug"].moves < 0.3  # seldom, never "never"


def test_sizes_are_asked_by_kind() -> None:
    size = usual_size("refrigerator")
    assert size is not None and size[0] < 1.8 < size[2]
    assert usual_size("gizmo") is None


def _part(often: float, kind: str = "door") -> UsualPart:
    return UsualPart(kind, "hinge", "upright", ("left",), (80.0, 120.0), 1, 2, often)


@pytest.mark.parametrize(
    "broken",
    [
        lambda: PartKind("x", "door", 0.5),  # type: ignore[arg-type]
        lambda: PartKind("x", "hinge", 1.5),
        lambda: PartKind("x", "hinge", 0.5, travel=(90.0, 80.0)),
        lambda: UsualPart("x", "fixed", "", (), None, 1, 1, 0.5),
        lambda: UsualPart("x", "hinge", "", (), None, 3, 2, 0.5),
        lambda: ObjectKind("x", (), (), (1.0, 0.5, 2.0), None),
        lambda: ObjectKind("x", (), (), (1.0, 1.0, 1.0), (3.0, 2.0, 5.0)),
        lambda: index_of({"a": {"en": "lid door"}, "b": {"fr": "Doors"}}),  # one word, two kinds
        lambda: Kinds({}, {"x": ObjectKind("x", (_part(0.5),), (), (1, 1, 1), None)}, {}, {}),
        lambda: Kinds({"door": PartKind("door", "hinge", 0.5)}, {}, {}, {}),  # no word
    ],
)  # fmt: skip
def test_a_contradiction_is_refused(broken: type) -> None:
    with pytest.raises(ValueError, match=r"kinds\.yaml"):
        broken()
