"""3MF and USD files that draw little as written and without end as composed: counted before."""

from __future__ import annotations

import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from mam_pipeline.errors import InputError
from mam_pipeline.formats.mesh_files import read_file
from mam_pipeline.formats.soup import LIMITS

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
TETRA = (
    '<object id="1" type="model"><mesh><vertices><vertex x="0" y="0" z="0"/>'
    '<vertex x="9" y="0" z="0"/><vertex x="0" y="9" z="0"/><vertex x="0" y="0" z="9"/></vertices>'
    '<triangles><triangle v1="0" v2="2" v3="1"/><triangle v1="0" v2="1" v3="3"/>'
    '<triangle v1="0" v2="3" v3="2"/><triangle v1="1" v2="2" v3="3"/></triangles></mesh></object>'
)
PACKAGE = "http://schemas.openxmlformats.org/package/2006"
RELS = (
    f'<Relationships xmlns="{PACKAGE}/relationships"><Relationship Target="/3D/3dmodel.model" '
    'Id="rel0" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>'
    "</Relationships>"
)
TYPES = (
    f'<Types xmlns="{PACKAGE}/content-types"><Default Extension="rels" ContentType="application/'
    'vnd.openxmlformats-package.relationships+xml"/><Default Extension="model" '
    'ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>'
)


def doubled(count: int) -> str:
    """A tetrahedron, and objects that each hold the one before twice; the last is built."""
    rows = [TETRA]
    for i in range(2, count + 2):
        twice = f'<component objectid="{i - 1}"/>' * 2
        rows.append(f'<object id="{i}" type="model"><components>{twice}</components></object>')
    return model("".join(rows), f'<item objectid="{count + 1}"/>')


def model(resources: str, build: str = '<item objectid="1"/>') -> str:
    return (
        f'<model unit="millimeter" xmlns="{CORE}"><resources>{resources}</resources>'
        f"<build>{build}</build></model>"
    )


def archive(text: str, more: int = 0) -> Callable[[Path], None]:
    def write(file: Path) -> None:
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as out:
            out.writestr("[Content_Types].xml", TYPES)
            out.writestr("_rels/.rels", RELS)
            with out.open("3D/3dmodel.model", "w") as stream:
                stream.write(text.encode())
                for _ in range(more):
                    stream.write(b" " * (1 << 20))

    return write


def nested(inner: str) -> str:
    holds = (
        '<object id="{}" type="model"><components><component objectid="{}"/></components></object>'
    )
    return model(TETRA + holds.format(2, inner) + holds.format(3, 2), '<item objectid="3"/>')


MESH = """def Mesh "m" {
 int[] faceVertexCounts = [3, 3, 3, 3]
 int[] faceVertexIndices = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]
 point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
}
"""


def stage(body: str, default: str = "a") -> Callable[[Path], None]:
    head = f'#usda 1.0\n(\n defaultPrim = "{default}"\n upAxis = "Z"\n metersPerUnit = 1\n)\n'

    def write(file: Path) -> None:
        file.write_text(head + body)

    return write


def referenced(count: int, arc: str = "references") -> Callable[[Path], None]:
    """Prims that each compose the one before twice."""
    kind = "class" if arc == "inherits" else "def Xform"
    rows = [f'{kind} "a0" {{\n{MESH}}}\n']
    for i in range(1, count + 1):
        two = "".join(f'def "{n}" ({arc} = </a{i - 1}>) {{}}\n' for n in "lr")
        rows.append(f'{kind} "a{i}" {{\n{two}}}\n')
    rows.append(f'def Xform "a" ({arc} = </a{count}>) {{}}\n')
    return stage("".join(rows))


def instancer(count: int, index: int = 0) -> Callable[[Path], None]:
    indices, places = ",".join([str(index)] * count), ",".join(["(0, 0, 0)"] * count)
    return stage(
        'def Xform "a" {\n def PointInstancer "i" {\n  rel prototypes = </a/i/p>\n'
        f"  int[] protoIndices = [{indices}]\n  point3f[] positions = [{places}]\n"
        f'  def Xform "p" {{\n{MESH}}}\n }}\n}}\n'
    )


def variants(count: int) -> Callable[[Path], None]:
    rows = [f'def Xform "a0" {{\n{MESH}}}\n']
    for i in range(1, count + 1):
        two = "".join(f'def "{n}" (references = </a{i - 1}>) {{}}\n' for n in "lr")
        rows.append(
            f'def Xform "a{i}" (variants = {{ string v = "x" }}\n prepend variantSets = "v") {{\n'
            f'variantSet "v" = {{ "x" {{\n{two}}} }}\n}}\n'
        )
    return stage("".join(rows), f"a{count}")


PAIRS: dict[str, tuple[Callable[[Path], None], Callable[[Path], None], str]] = {
    # rule: (a file that passes, one that fails, what is said)
    "components.3mf": (archive(doubled(3)), archive(doubled(40)), "nodes; simplify it"),
    "items.3mf": (
        archive(model(TETRA, '<item objectid="1"/>' * 3)),
        archive(model(TETRA, '<item objectid="1"/>' * (LIMITS.nodes + 1))),
        "nodes; simplify it",
    ),
    "itself.3mf": (archive(nested("1")), archive(nested("3")), "holds itself"),
    "size.3mf": (archive(model(TETRA), 1), archive(model(TETRA), 1100), "unpacks to 1100 MiB"),
    "entity.3mf": (
        archive(model(TETRA)),
        archive('<!DOCTYPE m [<!ENTITY a "b">]>' + model(TETRA)),
        "DOCTYPE or entity",
    ),
    "references.usda": (referenced(3), referenced(30), "nodes; simplify it"),
    "inherits.usda": (referenced(3, "inherits"), referenced(30, "inherits"), "nodes; simplify it"),
    "payload.usda": (referenced(3, "payload"), referenced(30, "payload"), "nodes; simplify it"),
    "variants.usda": (variants(3), variants(30), "nodes; simplify it"),
    "instances.usda": (instancer(50), instancer(200_000), "nodes; simplify it"),
    "prototype.usda": (instancer(1), instancer(1, 7), "names a missing prototype"),
}


@pytest.mark.parametrize("name", PAIRS)
def test_what_would_be_drawn_is_counted_before_it_is(tmp_path: Path, name: str) -> None:
    pytest.importorskip("lib3mf" if name.endswith("3mf") else "pxr")
    passes, fails, said = PAIRS[name]
    good, bad = tmp_path / f"pass_{name}", tmp_path / f"fail_{name}"
    passes(good)
    fails(bad)
    content = read_file(good)
    assert sum(len(p.faces) for p in content.pieces) % 4 == 0
    began = time.process_time() + sum(time_of_children())
    with pytest.raises(InputError, match=said) as caught:
        read_file(bad)
    assert time.process_time() + sum(time_of_children()) - began < 4.0
    assert "\n" not in str(caught.value)


def time_of_children() -> tuple[float, float]:
    import resource

    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime, used.ru_stime


def test_as_many_are_drawn_as_are_composed(tmp_path: Path) -> None:
    """Three doublings: 3MF builds the last, eight tetrahedra; USD shows all, 1 + 2 + 4 + 8 + 8."""
    rows = (("a.3mf", archive(doubled(3)), 8), ("a.usda", referenced(3), 23))
    for name, write, tetrahedra in rows:
        write(tmp_path / name)
        faces = sum(len(p.faces) for p in read_file(tmp_path / name).pieces)
        assert faces == 4 * tetrahedra, name
