"""What batch and rank are given and keep, with any values: rows, or an error (see test_fuzz)."""

from __future__ import annotations

import json
import random
from dataclasses import asdict
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mam_sim.batch.inputs import find_inputs
from mam_sim.batch.record import Record
from mam_sim.rank.run import Examine, Subject, Verdict
from tests.pipeline.test_fuzz import changed, ours, replaced, usual

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
LIST = "a.obj\n# a note\nbelow/*.obj\n**\nlist.txt\n../a.obj\na.obj\n"
URDF = "<robot name='r'><link name='a'/></robot>"


@usual
@given(seed=st.integers(0, 2**32))
def test_a_batch_list_of_any_bytes(seed: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder, rng = _folder(tmp_path_factory, "fuzz_list"), random.Random(seed)
    (folder / "a.obj").write_text(OBJ)
    (folder / "list.txt").write_bytes(changed(LIST.encode(), rng))
    for item in ours(lambda: find_inputs([str(folder / "list.txt")])) or ():
        assert item.fault or item.path.is_file()


@usual
@given(seed=st.integers(0, 2**32))
def test_a_record_of_any_values(seed: int) -> None:
    rng = random.Random(seed)
    record = Record("a-1", "a.glb", "1", "k", "passes", joints=("j",), confidences=(0.5,))
    text = json.dumps(replaced(asdict(record), rng)).encode()
    found = ours(lambda: Record.parse(changed(text, rng) if rng.random() < 0.5 else text))
    assert found is None or isinstance(found.readable, Record)


@usual
@given(seed=st.integers(0, 2**32))
def test_what_is_ranked_of_any_bytes(seed: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder, rng = _folder(tmp_path_factory, "fuzz_rank"), random.Random(seed)
    (folder / "a.urdf").write_bytes(changed(URDF.encode(), rng))
    (folder / "asset.json").write_bytes(changed(b'{"schema": 2, "urdf": "a.urdf"}', rng))
    for path in (folder, folder / "a.urdf"):
        subject = ours(partial(Subject.of, path))
        assert subject.fault or subject.path.exists()
        task = Examine(subject, folder)
        verdict = replaced(asdict(Verdict(subject.name, str(path))), rng)
        task.file.parent.mkdir(exist_ok=True)
        task.file.write_bytes(changed(json.dumps(verdict).encode(), rng))
        row = ours(partial(getattr, task, "known"))
        assert row is None or row.name == subject.name


def _folder(factory: pytest.TempPathFactory, name: str) -> Path:
    folder = factory.getbasetemp() / name
    folder.mkdir(exist_ok=True)
    return folder
