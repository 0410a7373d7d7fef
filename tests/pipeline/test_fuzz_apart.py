"""3MF, USD, FBX and STEP files of any bytes: a result that is fit for use, or an error of ours.

USD, FBX and STEP are read by native libraries in a process of their own, so a crash of theirs must
come out as one sentence as well. MAM_SIM_FUZZ=500 tries that many changes of each.
"""

from __future__ import annotations

import io
import random
import time
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mam_pipeline.formats import apart
from mam_pipeline.formats.urdf.read import read_urdf
from mam_pipeline.optional import has
from tests.pipeline.test_bounds_composed import archive, doubled, instancer, referenced, variants
from tests.pipeline.test_fuzz import DEEP, changed, fit, ours, usual
from tests.pipeline.test_other_formats import FBX, faceted_step, make_3mf, make_usd

MJCF = b"""<mujoco model="cabinet"><compiler angle="degree"/><worldbody><body name="cabinet">
<geom type="box" size="0.2 0.2 0.2"/><replicate count="2" offset="0 0 1"><body name="door">
<joint name="hinge" axis="0 0 1" range="0 90"/><geom type="capsule" size="0.01 0.1" mass="1.5"/>
</body></replicate></body></worldbody></mujoco>"""
few = settings(usual, max_examples=DEEP or 3)
SECONDS = 30.0
"""On the clock, for a process and one small file on a busy machine."""


COMPOSED = {
    "components.3mf": archive(doubled(3)), "references.usda": referenced(2),
    "inherits.usda": referenced(2, "inherits"), "instances.usda": instancer(4),
    "variants.usda": variants(2),
}  # fmt: skip
"""Files that name their own parts more than once."""


@cache
def seed_file(kind: str) -> bytes:
    """A small valid file of a kind."""
    import tempfile

    if kind == "step":
        return faceted_step((300.0, 400.0, 800.0)).encode()
    if kind == "fbx":
        return FBX.format(unit=2.54).encode()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"a.{kind}"
        if kind in COMPOSED:
            COMPOSED[kind](file)
            return file.read_bytes()
        make: Callable[[Path], None] = make_3mf if kind == "3mf" else make_usd
        make(file)
        return file.read_bytes()


def changed_archive(data: bytes, rng: random.Random) -> bytes:
    """A ZIP archive with one of its files changed."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(buffer, "w") as new:
        names = old.namelist()
        spoilt = rng.choice([n for n in names if n.endswith(".model")] or names)
        for name in names:
            content = old.read(name)
            new.writestr(name, changed(content, rng) if name == spoilt else content)
    return buffer.getvalue()


@pytest.mark.parametrize("inside", [False, True])
@usual
@given(seed=st.integers(0, 2**32))
def test_a_3mf_file_of_any_bytes(
    inside: bool, seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    pytest.importorskip("lib3mf")
    change = changed_archive if inside else changed
    file = tmp_path_factory.getbasetemp() / "fuzz.3mf"
    file.write_bytes(change(seed_file("3mf"), random.Random(seed)))
    fit(file)


@pytest.mark.parametrize(
    ("kind", "module"),
    [("usda", "pxr"), ("usdc", "pxr"), ("fbx", "assimp_py"), ("step", "cascadio")],
)
@few
@given(seed=st.integers(0, 2**32))
def test_a_file_of_any_bytes_for_a_native_reader(
    kind: str, module: str, seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    if not has(module):
        pytest.skip(f"needs {module}")
    file = tmp_path_factory.getbasetemp() / f"fuzz.{kind}"
    file.write_bytes(changed(seed_file(kind), random.Random(seed)))
    began = time.monotonic()
    fit(file)
    assert time.monotonic() - began < min(SECONDS, apart.BOUNDS.seconds)


@pytest.mark.parametrize("kind", COMPOSED)
@few
@given(seed=st.integers(0, 2**32))
def test_a_composed_file_of_any_bytes(
    kind: str, seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    suffix = kind.rpartition(".")[2]
    if not has("lib3mf" if suffix == "3mf" else "pxr"):
        pytest.skip(f"needs the reader of {suffix}")
    change = changed_archive if suffix == "3mf" else changed
    file = tmp_path_factory.getbasetemp() / f"fuzz_composed.{suffix}"
    file.write_bytes(change(seed_file(kind), random.Random(seed)))
    fit(file)


@few
@given(seed=st.integers(0, 2**32))
def test_an_mjcf_of_any_bytes(seed: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    if not has("mujoco"):
        pytest.skip("needs mujoco")
    from mam_pipeline.formats.mjcf import urdf_of_mjcf

    folder = tmp_path_factory.getbasetemp() / "fuzz_mjcf"
    folder.mkdir(exist_ok=True)
    file = folder / "a.xml"
    file.write_bytes(changed(MJCF, random.Random(seed)))
    found = ours(lambda: urdf_of_mjcf(file, folder / "out"))
    assert found is None or ours(lambda: read_urdf(found)) is not None
