"""Any bytes give a result that is fit for use or an error of ours, in bounded time and memory.

Small valid files are changed at random: bytes, numbers in text, values in JSON and YAML. The usual
profile tries the same few dozen changes of each on every run; MAM_SIM_FUZZ=5000 tries that many
fresh ones.
"""

from __future__ import annotations

import copy
import json
import os
import random
import re
import resource
import struct
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mam_pipeline.asset.writer import write_asset
from mam_pipeline.check.lint import lint
from mam_pipeline.errors import MamSimError
from mam_pipeline.formats.mesh_files import read_file, save_glb
from mam_pipeline.formats.urdf.read import read_urdf
from mam_pipeline.types import Articulation, Joint, Link, Mesh

DEEP = int(os.environ.get("MAM_SIM_FUZZ", "0"))
SECONDS = 10.0
"""Of a processor, for one small file."""
MEMORY = 3 << 30
"""Bytes that reading one small file may take."""
HOSTILE_NUMBERS = (
    "-1", "0", "1", "3", "255", "65536", "4294967296", "-9223372036854775809", "1e999", "-1e39",
    "nan", "inf", "1e-320", "", "x", "1 2", "999999999999999999999", "0x10", "\u0663",
)  # fmt: skip
HOSTILE_VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 1, 2, 10**12, -(10**30), 0.5, 1e300, float("nan"), float("inf"), "", "x",
    "../../etc/passwd", "a" * 300, [], [[]], {}, {"x": 1}, [1, 2], [0, 0, 0], ["x"] * 3, [None],
)  # fmt: skip
usual = settings(
    max_examples=DEEP or 25,
    derandomize=not DEEP,
    deadline=None,
    database=None,
    suppress_health_check=list(HealthCheck),
)


@contextmanager
def bounded() -> Iterator[None]:
    """Fail where the block takes more time or memory than a small file may."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, hard))
    began = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
    assert time.process_time() - began < SECONDS


def ours(action: Callable[[], Any]) -> Any:
    """What the action gives, or None where it ends in an error of ours, of one sentence."""
    with bounded():
        try:
            return action()
        except MamSimError as error:
            assert str(error) and len(str(error)) < 2000
            return None


def changed(data: bytes, rng: random.Random) -> bytes:
    """Bytes with one to four changes."""
    out = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        numbers = list(re.finditer(rb"-?\d+\.?\d*", bytes(out)))
        kind = rng.randrange(6)
        a = rng.randrange(len(out) + 1)
        b = min(len(out), a + rng.randint(1, 40))
        if kind == 0 and out:
            out[rng.randrange(len(out))] = rng.randrange(256)
        elif kind == 1:
            del out[a:b]
        elif kind == 2:
            out[a:a] = out[a:b] * rng.randint(1, 3)
        elif kind == 3:
            del out[a:]
        elif numbers:
            found = rng.choice(numbers)
            out[found.start() : found.end()] = rng.choice(HOSTILE_NUMBERS).encode()
    return bytes(out)


def replaced(value: Any, rng: random.Random) -> Any:
    """Plain data with one to three values replaced by others, or keys taken away."""
    out = copy.deepcopy(value)
    for _ in range(rng.randint(1, 3)):
        places: list[tuple[Any, Any]] = []
        left = [out]
        while left:
            at = left.pop()
            keys = list(at) if isinstance(at, dict) else range(len(at))
            for key in keys:
                places.append((at, key))
                if isinstance(at[key], dict | list) and at[key]:
                    left.append(at[key])
        if not places:
            break
        at, key = rng.choice(places)
        if rng.random() < 0.15:
            del at[key]
        else:
            at[key] = copy.deepcopy(rng.choice(HOSTILE_VALUES))
    return out


def box() -> Any:
    return trimesh.creation.box(extents=(0.4, 0.5, 0.8))


def two_parts() -> Articulation:
    """A body and a door."""
    a = box()
    b = trimesh.creation.box(bounds=[[-0.25, -0.2, 0.0], [-0.22, 0.2, 0.4]])
    mesh = Mesh(np.vstack([a.vertices, b.vertices]), np.vstack([a.faces, b.faces + 8]))
    links = (Link("body", "body", np.arange(12), (0,)), Link("d", "door", np.arange(12, 24), (1,)))
    z = np.array([0.0, 0.0, 1.0])
    joint = Joint("j", "revolute", "hinge", 0, 1, z, np.array([-0.22, 0.2, 0.0]), 0.0, 1.5, 0, 1.5)
    return Articulation(mesh, links, (joint,))


@cache
def seeds() -> dict[str, bytes]:
    """A small valid file of every format, by suffix."""
    import tempfile

    out: dict[str, bytes] = {}
    for suffix in (".ply", ".stl", ".off", ".dae"):
        out[suffix] = trimesh.exchange.export.export_mesh(box(), None, suffix[1:]) or b""
    text = trimesh.exchange.ply.export_ply(box(), encoding="ascii")
    out["ascii.ply"] = text
    out["ascii.stl"] = str(trimesh.exchange.stl.export_stl_ascii(box())).encode()
    out[".obj"] = (
        b"mtllib a.mtl\no box\nv 0 0 0\nv 1 0 0 1 0 0\nv 1 1 0\nv 0 1 1\nvt 0 0\nvt 1 0.5\n"
        b"usemtl m\nf 1/1 2/2 3/1\nf -4 -2 -1\ng top\nf 1//1 2//1 3 4\n"
    )
    out[".mtl"] = b"newmtl m\nKd 0.5 0.25 1\nd 0.5\nPm 0.1\nPr 0.9\nmap_Kd -s 1 1 1 a.png\n"
    with tempfile.TemporaryDirectory() as folder:
        save_glb(two_parts().mesh, Path(folder) / "a.glb")
        out[".glb"] = (Path(folder) / "a.glb").read_bytes()
    return {k: v if isinstance(v, bytes) else str(v).encode() for k, v in out.items()}


def glb(doc: Any, binary: bytes) -> bytes:
    text = json.dumps(doc).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def fit(file: Path) -> None:
    """Read a mesh file; what comes out must be what later stages rely on."""
    content = ours(lambda: read_file(file))
    if content is None:
        return
    for piece in content.pieces:
        assert piece.vertices.shape[1:] == (3,) and piece.faces.shape[1:] == (3,)
        assert not len(piece.faces) or piece.faces.min() >= 0
        assert not len(piece.faces) or piece.faces.max() < len(piece.vertices)
        assert 0 <= piece.material < len(content.materials)
        assert piece.uv is None or np.isfinite(piece.uv).all()
    for material in content.materials:
        assert all(0.0 <= c <= 1.0 for c in material.base_color)
    assert content.metres_per_unit is None or 0.0 < content.metres_per_unit < np.inf


@pytest.mark.parametrize("name", sorted(seeds()))
@usual
@given(seed=st.integers(0, 2**32))
def test_a_mesh_file_of_any_bytes(
    name: str, seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.getbasetemp() / "fuzz_mesh"
    folder.mkdir(exist_ok=True)
    data = changed(seeds()[name], random.Random(seed))
    for other in (".obj", ".mtl"):
        (folder / f"a{other}").write_bytes(seeds()[other])
    suffix = "." + name.rpartition(".")[2]
    (folder / f"a{suffix}").write_bytes(data)
    fit(folder / ("a.obj" if suffix == ".mtl" else f"a{suffix}"))


@usual
@given(seed=st.integers(0, 2**32))
def test_a_gltf_document_of_any_values(seed: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    file = tmp_path_factory.getbasetemp() / "fuzz.glb"
    data = seeds()[".glb"]
    length = struct.unpack_from("<I", data, 12)[0]
    doc = json.loads(data[20 : 20 + length])
    file.write_bytes(glb(replaced(doc, random.Random(seed)), data[28 + length :]))
    fit(file)


@pytest.fixture(scope="module")
def asset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_asset(two_parts(), tmp_path_factory.mktemp("fuzz_asset") / "a", name="a").folder


@usual
@given(seed=st.integers(0, 2**32))
def test_a_urdf_of_any_bytes(seed: int, asset: Path) -> None:
    file = asset / "changed.urdf"
    file.write_bytes(changed((asset / "object.urdf").read_bytes(), random.Random(seed)))
    found = ours(lambda: read_urdf(file))
    findings = ours(lambda: lint(file))
    assert findings is not None  # the lint tells, it never refuses
    if found is not None:
        assert np.isfinite(found.mesh.vertices).all()
        assert all(np.isfinite([*j.axis, *j.origin]).all() for j in found.joints)
