"""Hostile files that name others outside their folder: whether any is opened, copied or hangs.

    python benchmarks/door_attack.py [--only usd] [--out FILE.json]

Every place where a format names a file, times every way to lead out of the folder, goes through the
command line. The foreign folder is watched by inotify, so an opening by a native library counts as
well. An attack has failed when nothing there was opened, nothing hung, no traceback was printed,
and a file was either made without it or refused with one sentence.
"""

from __future__ import annotations

import ctypes
import io
import json
import os
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import trimesh
import tyro
from common import save
from PIL import Image

from mam_sim.cli import main as mam_sim

CONTROL = "control"
"""Not an attack: a file of the folder itself, which must be opened."""
NEVER = ("3MF entry", "URDF texture", "MJCF mesh")
"""Places of which no file is ever opened."""
SECONDS = 60.0
"""A command that takes longer hangs."""
_IN_ACCESS, _IN_OPEN, _IN_ISDIR = 0x1, 0x20, 0x40000000


@dataclass(frozen=True)
class Attack:
    """A hostile file and a command on it.

    Attributes:
        place: which name of which format. way: how it leads out. words: of the command line.
    """

    place: str
    way: str
    words: tuple[str, ...]
    folder: Path


@dataclass(frozen=True)
class Outcome:
    """What came of one: exit status (None: it hung), names that were opened, whether it crashed."""

    place: str
    way: str
    verb: str
    status: int | None
    opened: tuple[str, ...]
    traceback: bool
    said: str

    @property
    def held(self) -> bool:
        """Whether the attack failed; the control must succeed, or the others prove nothing."""
        if self.way == CONTROL:
            return any(name.startswith(("own.", "object.")) for name in self.opened)
        return self.status is not None and not self.opened and not self.traceback


class Watch:
    """Which files of a folder are opened."""

    def __init__(self, folder: Path) -> None:
        self.libc = ctypes.CDLL(None, use_errno=True)
        self.handle = self.libc.inotify_init()
        flags = _IN_ACCESS | _IN_OPEN
        assert self.libc.inotify_add_watch(self.handle, str(folder).encode(), flags) >= 0

    def opened(self) -> tuple[str, ...]:
        """Names since the last call."""
        found: dict[str, None] = {}
        while select.select([self.handle], [], [], 0)[0]:
            data, at = os.read(self.handle, 65536), 0
            while at < len(data):
                mask = int.from_bytes(data[at + 4 : at + 8], "little")
                length = int.from_bytes(data[at + 12 : at + 16], "little")
                name = data[at + 16 : at + 16 + length].rstrip(b"\0").decode()
                if name and not mask & _IN_ISDIR:
                    found[name] = None
                at += 16 + length
        return tuple(found)


def ways(secret: Path, folder: Path) -> Iterator[tuple[str, str]]:
    """(way, name that leads to `secret`) for a file in `folder`; links are laid there."""
    name, suffix = secret.name, secret.suffix
    shutil.copy(secret, folder / f"own{suffix}")
    yield CONTROL, f"own{suffix}"
    up = f"../foreign/{name}"
    yield "relative", up
    yield "relative through a folder", f"inner/../{up}"
    yield "absolute", str(secret)
    yield "file://", f"file://{secret}"
    yield "package://", f"package://x/../{up}"
    yield "percent encoding", up.replace("..", "%2e%2e")
    yield "backslashes", up.replace("/", "\\")
    (folder / "inner").mkdir(exist_ok=True)
    (folder / f"link{suffix}").symlink_to(secret)
    yield "link", f"link{suffix}"
    (folder / "linked").symlink_to(secret.parent)
    yield "linked folder", f"linked/{name}"
    (folder / f"loop{suffix}").symlink_to(f"loop{suffix}")
    yield "loop of links", f"loop{suffix}"
    os.mkfifo(folder / f"pipe{suffix}")
    yield "pipe", f"pipe{suffix}"


def box(folder: Path, suffix: str) -> bytes:
    """A small mesh, as bytes of a format."""
    mesh = trimesh.creation.box((0.3, 0.4, 0.8))
    mesh.export(folder / f"_{suffix}")
    data = (folder / f"_{suffix}").read_bytes()
    (folder / f"_{suffix}").unlink()
    return data


URDF = """<robot name="r"><material name="m"><texture filename="{texture}"/></material>
<link name="base"><visual><geometry>{visual}</geometry><material name="m"/></visual>
<collision><geometry>{collision}</geometry></collision></link>
<link name="door"><visual><origin xyz="0.6 0 0"/><geometry><box size="0.1 1 1"/></geometry></visual>
</link><joint name="j" type="revolute"><parent link="base"/><child link="door"/>
<origin xyz="0 0.5 0"/><axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/>
</joint></robot>"""
BOX = '<box size="1 1 1"/>'
OBJ = "mtllib {library}\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\n"
OBJ += "f 1/1 3/1 2/1\nf 1/1 2/1 4/1\nf 1/1 4/1 3/1\nf 2/1 3/1 4/1\n"
USD = """#usda 1.0
(
 defaultPrim = "a"
 upAxis = "Z"
 metersPerUnit = 1
 {layers}
)
def Xform "a" {arcs}
{{
 def Mesh "m" (prepend apiSchemas = ["MaterialBindingAPI"])
 {{
  int[] faceVertexCounts = [3, 3, 3, 3]
  int[] faceVertexIndices = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]
  point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
  texCoord2f[] primvars:st = [(0, 0), (1, 0), (0, 1), (1, 1)] (
   interpolation = "vertex"
  )
  rel material:binding = </a/look>
 }}
 def Material "look"
 {{
  token outputs:surface.connect = </a/look/s.outputs:surface>
  def Shader "s"
  {{
   uniform token info:id = "UsdPreviewSurface"
   color3f inputs:diffuseColor.connect = </a/look/t.outputs:rgb>
   token outputs:surface
  }}
  def Shader "t"
  {{
   uniform token info:id = "UsdUVTexture"
   asset inputs:file = @{texture}@
   float3 outputs:rgb
  }}
 }}
}}
"""
DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_images><image id="i"><init_from>{name}</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON>
<newparam sid="f"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="a"><sampler2D><source>f</source></sampler2D></newparam>
<technique sid="t"><lambert><diffuse><texture texture="a" texcoord="U"/></diffuse></lambert>
</technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 1 0 0 0 1 0 0 0 1</float_array>
<technique_common><accessor source="#pa" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<source id="t"><float_array id="ta" count="6">0 0 1 0 0 1</float_array>
<technique_common><accessor source="#ta" count="3" stride="2"><param name="S" type="float"/>
<param name="T" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4" material="w"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="TEXCOORD" source="#t" offset="1" set="0"/>
<p>0 0 2 1 1 2 0 0 1 1 3 2 0 0 3 1 2 2 1 0 2 1 3 2</p></triangles></mesh></geometry>
</library_geometries><library_visual_scenes><visual_scene id="s"><node id="n">
<instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="w" target="#m"/></technique_common></bind_material></instance_geometry>
</node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
MJCF = """<mujoco><compiler meshdir="{folder}"/><asset><mesh name="m" file="{name}"/></asset>
<worldbody><body><joint type="hinge"/><geom type="mesh" mesh="m"/></body></worldbody></mujoco>"""


def _gltf(folder: Path, kind: str, name: str) -> str:
    scene = trimesh.Scene(trimesh.creation.box((0.3, 0.4, 0.8)))
    files = trimesh.exchange.gltf.export_gltf(scene)
    doc = json.loads(files["model.gltf"])
    for row in doc["buffers"]:
        (folder / row["uri"]).write_bytes(files[row["uri"]])
    if kind == "buffer":
        doc["buffers"][0]["uri"] = name
    else:
        doc["images"] = [{"uri": name}]
        doc["textures"] = [{"source": 0}]
        look = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
        doc["materials"] = [look]
        for mesh in doc["meshes"]:
            for primitive in mesh["primitives"]:
                primitive["material"] = 0
    return json.dumps(doc)


def _dae(_: Path, name: str) -> str:
    return DAE.format(name=name)


def _usdz(folder: Path, name: str) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr("a.usda", USD.format(layers="", arcs="", texture=name))
    return buffer.getvalue()


def _3mf(folder: Path, name: str) -> bytes:
    data, buffer = box(folder, "a.3mf"), io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(buffer, "w") as new:
        for inner in old.namelist():
            new.writestr(inner, old.read(inner))
        new.writestr(name, b"climbs out")
    return buffer.getvalue()


def _usd(part: str) -> Callable[[Path, str], str]:
    def text(_: Path, name: str) -> str:
        parts = {"layers": "", "arcs": "", "texture": ""}
        parts[part.partition(" ")[0]] = {
            "layers": f"subLayers = [@{name}@]",
            "arcs reference": f"(prepend references = @{name}@</a>)",
            "arcs payload": f"(prepend payload = @{name}@</a>)",
            "texture": name,
        }[part]
        return USD.format(**parts)

    return text


def _mesh(name: str) -> str:
    return f'<mesh filename="{name}"/>'


MESHES: dict[str, tuple[str, str, Callable[[Path, str], str | bytes]]] = {
    # place: (file to write, foreign file that it names, its content)
    "OBJ mtllib": ("a.obj", "x.mtl", lambda f, n: OBJ.format(library=n)),
    "PLY TextureFile": ("a.ply", "x.png", lambda f, n: box(f, "a.ply").replace(
        b"comment", f"comment TextureFile {n}\ncomment".encode(), 1)),
    "DAE init_from": ("a.dae", "x.png", _dae),
    "glTF image": ("a.gltf", "x.png", lambda f, n: _gltf(f, "image", n)),
    "glTF buffer": ("a.gltf", "x.bin", lambda f, n: _gltf(f, "buffer", n)),
    "USD subLayers": ("a.usda", "x.usda", _usd("layers")),
    "USD reference": ("a.usda", "x.usda", _usd("arcs reference")),
    "USD payload": ("a.usda", "x.usda", _usd("arcs payload")),
    "USD texture": ("a.usda", "x.png", _usd("texture")),
    "USDZ texture": ("a.usdz", "x.png", _usdz),
    "3MF entry": ("a.3mf", "x.png", _3mf),
}  # fmt: skip


def attacks(scratch: Path, asset: Path) -> Iterator[Attack]:
    """All of them; each in a folder of its own beside `foreign`."""
    foreign = scratch / "foreign"
    count = 0

    def fresh() -> Path:
        nonlocal count
        count += 1
        folder = scratch / f"case_{count:03d}"
        folder.mkdir()
        return folder

    def each(secret: str) -> Iterator[tuple[str, str, Path]]:
        probe = fresh()
        for way, _ in ways(foreign / secret, probe):
            folder = fresh()
            name = dict(ways(foreign / secret, folder))[way]
            yield way, name, folder
        shutil.rmtree(probe)

    for place, (file, secret, content) in MESHES.items():
        for way, name, folder in each(secret):
            data = content(folder, name)
            (folder / file).write_bytes(data if isinstance(data, bytes) else data.encode())
            words = ("articulate", str(folder / file), "--out", str(folder / "out"))
            yield Attack(place, way, words, folder)
    for way, name, folder in each("x.png"):
        (folder / "a.obj").write_text(OBJ.format(library="a.mtl"))
        (folder / "a.mtl").write_text(f"newmtl m\nmap_Kd -s 1 1 1 {name}\nmap_Kd {name}\n")
        words = ("articulate", str(folder / "a.obj"), "--out", str(folder / "out"))
        yield Attack("MTL map_Kd", way, words, folder)
    verbs = (("check",), ("articulate", "--out"), ("view", "--html", "--out"))
    for slot, secret in (("visual", "x.obj"), ("collision", "x.obj"), ("texture", "x.png")):
        for way, name, folder in each(secret):
            parts = {"visual": BOX, "collision": BOX, "texture": "a.png"}
            parts[slot] = name if slot == "texture" else _mesh(name)
            (folder / "a.urdf").write_text(URDF.format(**parts))
            for verb, *more in verbs:
                out = [str(folder / "out")] if more else []
                yield Attack(
                    f"URDF {slot}", way, (verb, str(folder / "a.urdf"), *more, *out), folder
                )
    for way, name, folder in each("x.obj"):
        (folder / "a.xml").write_text(MJCF.format(folder=".", name=name))
        words = ("articulate", str(folder / "a.xml"), "--out", str(folder / "out"))
        yield Attack("MJCF mesh", way, words, folder)
        yield Attack("MJCF mesh", way, ("check", str(folder / "a.xml")), folder)
    yield from _on_assets(asset, each)


def _on_assets(
    asset: Path, each: Callable[[str], Iterator[tuple[str, str, Path]]]
) -> Iterator[Attack]:
    """Assets of which the card, the URDF or a stage leads out."""
    exports = [("export", "--to", kind) for kind in ("mjcf", "usd", "usdz")]
    places = {"card urdf": "object.urdf", "asset mesh": "x.obj", "stages": "x.obj"}
    for place, secret in places.items():
        for way, name, folder in each(secret):
            copy = folder / "asset"
            shutil.copytree(asset, copy)
            for link in [p for p in folder.iterdir() if not p.is_dir() or p.is_symlink()]:
                link.rename(copy / link.name)  # names are meant from where they stand
            name = name.replace("../foreign", "../../foreign")
            if place == "card urdf":
                card = json.loads((copy / "asset.json").read_text())
                (copy / "asset.json").write_text(json.dumps({**card, "urdf": name}))
            elif place == "asset mesh":
                text = (copy / "object.urdf").read_text()
                old = text.partition('filename="')[2].partition('"')[0]
                (copy / "object.urdf").write_text(text.replace(old, name, 1))
            elif "/" in name or "\\" in name:
                continue  # stages name no files: only what lies there counts
            elif way == CONTROL:
                continue
            else:
                (copy / "stages" / "1_primitives").mkdir(parents=True, exist_ok=True)
                (copy / name).rename(copy / "stages" / "1_primitives" / f"x{Path(name).suffix}")
            out = str(folder / "out")
            again = ("articulate", str(copy / "object.urdf"), "--out", str(copy))
            verbs = [again] if place == "stages" else [
                ("check", str(copy)), ("collect", str(copy), "--episodes", "1", "--out", out),
                *((verb, str(copy), *more, "--out", out) for verb, *more in exports),
            ]  # fmt: skip
            for line in verbs:
                yield Attack(place, way, line, folder)


def run(attack: Attack, watch: Watch) -> Outcome:
    """One command in a process of its own."""
    log = attack.folder / "log"
    if attack.way == CONTROL:
        inner = attack.place in ("asset mesh", "card urdf")
        watch = Watch(attack.folder / "asset" if inner else attack.folder)
    watch.opened()
    child = os.fork()
    if child == 0:
        code = 70
        try:
            os.setsid()
            handle = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(handle, 1), os.dup2(handle, 2)
            code = mam_sim([*attack.words, "--quiet"])
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush(), sys.stderr.flush()
            os._exit(code)
    began, status = time.monotonic(), None
    while time.monotonic() - began < SECONDS:
        done, code = os.waitpid(child, os.WNOHANG)
        if done:
            status = os.waitstatus_to_exitcode(code)
            break
        time.sleep(0.02)
    else:
        os.killpg(child, signal.SIGKILL)
        os.waitpid(child, 0)
    said = log.read_text(errors="replace")
    shutil.rmtree(attack.folder / "out", ignore_errors=True)
    return Outcome(
        attack.place, attack.way, attack.words[0], status, watch.opened(),
        "Traceback" in said or status not in (None, 0, 1, 2, 3, 4), said[-600:],
    )  # fmt: skip


def main(only: str = "", out: Path | None = None) -> None:
    """Attack, and print what got through.

    Args:
        only: places that hold this text. out: JSON file for the figures.
    """
    rows: list[Outcome] = []
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        foreign = scratch / "foreign"
        foreign.mkdir()
        Image.new("RGB", (4, 4), (200, 10, 10)).save(foreign / "x.png")
        (foreign / "x.mtl").write_text("newmtl m\nKd 1 0 0\n")
        (foreign / "x.bin").write_bytes(bytes(4096))
        (foreign / "x.usda").write_text(USD.format(layers="", arcs="", texture=""))
        (foreign / "x.obj").write_text(OBJ.format(library=""))
        source = foreign / "object.urdf"
        plain = URDF.partition("<material")[0] + URDF.partition("</material>")[2]
        plain = plain.replace('<material name="m"/>', "")
        source.write_text(plain.format(visual=BOX, collision=BOX))
        assert mam_sim(["articulate", str(source), "--out", str(scratch / "asset"), "--quiet"]) < 2
        watch = Watch(foreign)
        for attack in attacks(scratch, scratch / "asset"):
            if only.lower() not in attack.place.lower():
                continue
            if attack.way == CONTROL and attack.place in NEVER:
                continue
            rows.append(run(attack, watch))
            if not rows[-1].held:
                print("GOT THROUGH", vars(rows[-1]), flush=True)
    print(f"{len(rows)} attacks, {sum(r.held for r in rows)} held")
    for place, count in Counter(r.place for r in rows).items():
        mine = [r for r in rows if r.place == place]
        codes = dict(Counter(str(r.status) for r in mine))
        print(f"  {place:<18} {count:>3}  held {sum(r.held for r in mine):>3}  exit {codes}")
    save(out, {"attacks": len(rows), "held": sum(r.held for r in rows),
               "rows": [vars(r) for r in rows]})  # fmt: skip


if __name__ == "__main__":
    tyro.cli(main)
