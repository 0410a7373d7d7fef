"""Cuts in a hints file: faces become a primitive of their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mam_pipeline.errors import ConfigError
from mam_pipeline.hints import Hints, load_hints, save_hints
from mam_pipeline.parts.cut import with_cuts, with_cuts_in_tree
from mam_pipeline.types import KinematicTree, PartNode, Primitives

LABELS = np.array([0, 0, 0, 1, 1, 2])


def test_what_is_cut_off_gets_the_next_number_and_stays_with_its_part() -> None:
    before = Primitives(LABELS)
    after = with_cuts(before, Hints(cut=((1, 2), (4,), (2,))))
    assert after.labels.tolist() == [0, 3, 5, 1, 4, 2]
    tree = KinematicTree((
        PartNode("base", "body", (0, 2), -1, "fixed"), PartNode("door", "door", (1,), 0, "hinge"),
    ))  # fmt: skip
    grown = with_cuts_in_tree(tree, before, after)
    assert [n.primitives for n in grown.nodes] == [(0, 2, 3, 5), (1, 4)]
    assert with_cuts(before, None) is before and with_cuts_in_tree(tree, before, before) is tree


def test_a_fused_surface_stays_one_and_its_fronts_keep_their_faces() -> None:
    fronts = np.array([[False, True, True]])
    before = Primitives(LABELS, np.array([[0, 1], [3, 2]]), fronts=fronts)
    after = with_cuts(before, Hints(cut=((3,),)))
    assert before.is_fused and after.is_fused
    # 1 and its cut are node 4, with 0 they are 5, with 2 all
    assert after.merges.tolist() == [[1, 3], [0, 4], [5, 2]]
    assert after.fronts.tolist() == [[False, True, True, True]]


def test_a_cut_that_cannot_be_is_said_in_a_sentence(tmp_path: Path) -> None:
    for faces, why in (
        ((), "names no face"), ((6,), "no face 6; there are 6"), ((2, 3), "make two"),
        ((3, 4), "the whole of primitive 1"),
    ):  # fmt: skip
        with pytest.raises(ConfigError, match=why):
            with_cuts(Primitives(LABELS), Hints(cut=(faces,)))
    file = tmp_path / "hints.yaml"
    save_hints(Hints(cut=((1, 2), (4,))), file)
    assert load_hints(file).cut == ((1, 2), (4,))
    with pytest.raises(ConfigError, match=r"hints.yaml: cut 2 takes the whole"):
        with_cuts(Primitives(np.array([0, 1, 1, 1, 2])), load_hints(file))
