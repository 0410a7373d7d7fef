"""Collada, 3MF, USD, STEP and FBX, each against another reader or closed-form truth."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from mam_sim_formats.usd_layers import check_layers
from scipy.spatial.transform import Rotation

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door
from mam_pipeline.formats.mesh_files import load_mesh, read_file
from mam_pipeline.formats.readers import reader_of
from mam_pipeline.formats.soup import FileContent
from mam_pipeline.formats.suffixes import BUILTIN, ELSEWHERE, mesh_suffixes
from mam_pipeline.optional import MissingExtra, has
from mam_pipeline.run import kind_of
from mam_pipeline.types import FloatArray
from tests.pipeline.test_pictures import BIND, dae


def triangles(content: FileContent) -> FloatArray:
    """(F, 9) the corners of all triangles, in an order of their own."""
    found = np.concatenate([p.vertices[p.faces] for p in content.pieces]).reshape(-1, 9)
    return np.asarray(found[np.lexsort(found.round(4).T)])


def of_trimesh(path: Path) -> FloatArray:
    scene: Any = trimesh.load_scene(path, process=False)
    found = scene.to_geometry().triangles.reshape(-1, 9)
    return np.asarray(found[np.lexsort(found.round(4).T)])


def test_collada_stands_where_trimesh_puts_it_and_keeps_node_names(tmp_path: Path) -> None:
    file = tmp_path / "a.dae"
    file.write_text(dae(None))
    content = read_file(file)
    np.testing.assert_allclose(triangles(content), of_trimesh(file), atol=1e-9)
    assert [p.group for p in content.pieces] == ["lid", "box"]
    assert (content.up, content.metres_per_unit) == ("z", 0.01)
    assert content.materials[content.pieces[0].material].base_color == (1.0, 0.0, 0.0, 1.0)
    uv = content.pieces[0].uv
    assert uv is not None
    assert {tuple(row) for row in uv.tolist()} == {(0.0, 1.0), (1.0, 1.0), (0.0, 0.0)}


SKIN = """<library_controllers><controller id="c"><skin source="#g">
<bind_shape_matrix>1 0 0 0 0 1 0 0 0 0 1 2 0 0 0 1</bind_shape_matrix>
<source id="j"><Name_array id="ja" count="2">hip knee</Name_array><technique_common>
<accessor source="#ja" count="2"><param name="JOINT" type="name"/></accessor></technique_common>
</source><source id="b"><float_array id="ba" count="32">
1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 1 0 0 0 0 1 0 0 0 0 1 -10 0 0 0 1</float_array>
<technique_common><accessor source="#ba" count="2" stride="16">
<param name="TRANSFORM" type="float4x4"/></accessor></technique_common></source>
<source id="w"><float_array id="wa" count="2">1 0.5</float_array><technique_common>
<accessor source="#wa" count="2"><param name="WEIGHT" type="float"/></accessor></technique_common>
</source><joints><input semantic="JOINT" source="#j"/>
<input semantic="INV_BIND_MATRIX" source="#b"/></joints>
<vertex_weights count="4"><input semantic="JOINT" source="#j" offset="0"/>
<input semantic="WEIGHT" source="#w" offset="1"/><vcount>1 1 1 2</vcount>
<v>0 0 0 0 1 0 0 1 1 1</v></vertex_weights></skin></controller></library_controllers>"""


def test_a_collada_skin_stands_in_the_pose_of_its_joints(tmp_path: Path) -> None:
    nodes = f"""<node id="h" sid="hip" type="JOINT"><translate>0 0 1</translate>
    <node id="k" sid="knee" type="JOINT"><translate>0 0 10</translate><rotate>1 0 0 90</rotate>
    </node></node>
    <node id="n" name="leg"><instance_controller url="#c">{BIND}</instance_controller></node>"""
    file = tmp_path / "a.dae"
    file.write_text(dae(None, nodes, SKIN))
    (piece,) = read_file(file).pieces
    hip, knee = np.eye(4), np.eye(4)
    hip[2, 3] = 1
    knee[:3, :3], knee[2, 3] = Rotation.from_euler("x", 90, degrees=True).as_matrix(), 11
    bind = np.eye(4)
    bind[2, 3] = -10
    points = np.array([[0, 0, 0, 1], [10, 0, 0, 1], [0, 20, 0, 1], [0, 0, 30, 1.0]])
    points[:, 2] += 2
    first, second = points @ hip.T, points @ (knee @ bind).T
    wanted = np.stack([first[0], first[1], second[2], (first[3] + second[3]) / 2])[:, :3]
    found = np.unique(piece.vertices.round(6), axis=0)
    np.testing.assert_allclose(found, np.unique(wanted.round(6), axis=0), atol=1e-6)


def make_3mf(path: Path) -> None:
    """A tetrahedron twice, one face blue, the others red; one more with a colour per corner."""
    import lib3mf

    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    model.SetUnit(lib3mf.ModelUnit.Inch)

    def tetrahedron(name: str, size: float) -> Any:
        made = model.AddMeshObject()
        made.SetName(name)
        vertices, faces = [], []
        for point in np.vstack([np.zeros(3), np.diag([1, 2, 3]) * size]):
            position = lib3mf.Position()
            position.Coordinates[:] = [float(x) for x in point]
            vertices.append(position)
        for corners in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)):
            triangle = lib3mf.Triangle()
            triangle.Indices[:] = corners
            faces.append(triangle)
        made.SetGeometry(vertices, faces)
        return made

    lid = tetrahedron("lid", 10)
    group = model.AddBaseMaterialGroup()
    red = group.AddMaterial("red", wrapper.RGBAToColor(255, 0, 0, 255))
    blue = group.AddMaterial("blue", wrapper.RGBAToColor(0, 0, 255, 255))
    lid.SetObjectLevelProperty(group.GetResourceID(), red)
    one = lib3mf.TriangleProperties()
    one.ResourceID, one.PropertyIDs[:] = group.GetResourceID(), (blue, blue, blue)
    lid.SetTriangleProperties(1, one)
    pair = model.AddComponentsObject()
    pair.AddComponent(lid, wrapper.GetTranslationTransform(1, 2, 3))
    pair.AddComponent(lid, wrapper.GetScaleTransform(1, 1, -1))
    model.AddBuildItem(pair, wrapper.GetTranslationTransform(0, 0, 50))
    painted = tetrahedron("painted", 5)
    colors = model.AddColorGroup()
    keys = [colors.AddColor(wrapper.RGBAToColor(*c, 255)) for c in ((9, 8, 7), (90, 80, 70))]
    each = lib3mf.TriangleProperties()
    each.ResourceID = colors.GetResourceID()
    each.PropertyIDs[:] = (keys[0], keys[1], keys[1])
    painted.SetAllTriangleProperties([each] * 4)
    model.AddBuildItem(painted, wrapper.GetIdentityTransform())
    model.QueryWriter("3mf").WriteToFile(str(path))


def test_3mf_stands_where_trimesh_puts_it_and_keeps_its_colours(tmp_path: Path) -> None:
    file = tmp_path / "a.3mf"
    make_3mf(file)
    content = read_file(file)
    assert (content.up, content.metres_per_unit) == ("z", 0.0254)
    found, wanted = triangles(content), of_trimesh(file)
    np.testing.assert_allclose(np.sort(found, axis=0), np.sort(wanted, axis=0), atol=1e-5)
    areas = {(p.group, content.materials[p.material].name): len(p.faces) for p in content.pieces}
    assert areas == {
        ("lid", "red"): 3, ("lid", "blue"): 1, ("lid.001", "red"): 3, ("lid.001", "blue"): 1,
        ("painted", "colours"): 4,
    }  # fmt: skip
    painted = content.pieces[-1]
    assert painted.colors is not None
    assert painted.colors[painted.faces[0]].tolist() == [
        [9, 8, 7, 255], [90, 80, 70, 255], [90, 80, 70, 255],
    ]  # fmt: skip
    volumes = [trimesh.Trimesh(p.vertices, p.faces).volume for p in content.pieces[-1:]]
    assert volumes[0] > 0  # wound outwards


def test_a_3mf_that_is_no_archive_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.3mf").write_bytes(b"PK but no archive")
    with pytest.raises(InputError, match="is not a 3MF file"):
        read_file(tmp_path / "a.3mf")


needs_usd = pytest.mark.skipif(not has("pxr"), reason="needs the extra usd")


def make_usd(path: Path) -> None:
    """Polygons, a scaled box of faces by material, instances, a hidden prim, centimetres, Y up."""
    from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.Xform.Define(stage, "/root").AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
    UsdGeom.Xform.Define(stage, "/root/box").AddScaleOp().Set(Gf.Vec3f(10, 20, 30))
    mesh = UsdGeom.Mesh.Define(stage, "/root/box/mesh")
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 0.5, 1)])
    mesh.CreateFaceVertexCountsAttr([4, 3, 3, 3, 3])
    mesh.CreateFaceVertexIndicesAttr([3, 2, 1, 0, 0, 1, 4, 1, 2, 4, 2, 3, 4, 3, 0, 4])
    mesh.CreateSubdivisionSchemeAttr("none")
    subset = UsdGeom.Subset.CreateGeomSubset(mesh, "floor", "face", [0], "materialBind")
    for name, target, color in (("red", mesh, (1, 0, 0)), ("blue", subset, (0, 0, 1))):
        material = UsdShade.Material.Define(stage, f"/looks/{name}")
        shader = UsdShade.Shader.Define(stage, f"/looks/{name}/s")
        shader.CreateIdAttr("UsdPreviewSurface")
        shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(color)
        material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
        UsdShade.MaterialBindingAPI.Apply(target.GetPrim()).Bind(material)
    many = UsdGeom.PointInstancer.Define(stage, "/root/knobs")
    UsdGeom.Sphere.Define(stage, "/root/knobs/proto").CreateRadiusAttr(0.5)
    many.CreatePrototypesRel().SetTargets(["/root/knobs/proto"])
    many.CreateProtoIndicesAttr([0, 0])
    many.CreatePositionsAttr([(0, 0, 40), (5, 0, 40)])
    UsdGeom.Cube.Define(stage, "/root/hidden").MakeInvisible()
    stage.GetRootLayer().Save()


@needs_usd
@pytest.mark.parametrize("suffix", ["usda", "usdc", "usdz"])
def test_usd_is_as_large_as_its_own_library_says(tmp_path: Path, suffix: str) -> None:
    from pxr import Usd, UsdGeom, UsdUtils

    file = tmp_path / f"a.{'usda' if suffix == 'usdz' else suffix}"
    make_usd(file)
    if suffix == "usdz":
        UsdUtils.CreateNewUsdzPackage(str(file), str(tmp_path / "a.usdz"))
        file = tmp_path / "a.usdz"
    content = read_file(file)
    stage = Usd.Stage.Open(str(file))
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"])
    box = cache.ComputeWorldBound(stage.GetPseudoRoot()).ComputeAlignedRange()
    points = np.concatenate([p.vertices for p in content.pieces])
    np.testing.assert_allclose(points.min(0), np.array(box.GetMin()), atol=0.02)
    np.testing.assert_allclose(points.max(0), np.array(box.GetMax()), atol=0.02)
    assert (content.up, content.metres_per_unit) == ("y", 0.01)
    looks = {
        (p.group, content.materials[p.material].base_color[:3]): len(p.faces)
        for p in content.pieces[:2]
    }
    assert looks == {("box", (1.0, 0.0, 0.0)): 4, ("box", (0.0, 0.0, 1.0)): 2}
    assert len(content.pieces) == 4  # two instances, and nothing that is hidden
    solid: Any = trimesh.util.concatenate(
        [trimesh.Trimesh(p.vertices, p.faces) for p in content.pieces[:2]]
    )
    assert solid.volume == pytest.approx(10 * 20 * 30 / 3)


@needs_usd
@pytest.mark.parametrize(
    "text",
    [
        '#usda 1.0\n(\n    subLayers = [@{0}@]\n)\n',
        '#usda 1.0\ndef "a" (references = @{0}@)\n{{\n}}\n',
        '#usda 1.0\ndef "a" (payload = @{0}@)\n{{\n}}\n',
        '#usda 1.0\n(\n    subLayers = [@inner.usda@]\n)\n',
        '#usda 1.0\ndef "a" (clips = {{dictionary c = {{asset[] assetPaths = [@{0}@]}}}})\n'
        "{{\n}}\n",
    ],
)  # fmt: skip
@pytest.mark.parametrize("way", ["../other.usda", "link.usda", "pipe.usda"])
def test_usd_that_composes_a_foreign_file_is_refused_before_it_is_opened(
    tmp_path: Path, text: str, way: str
) -> None:
    make_usd(tmp_path / "other.usda")
    own = tmp_path / "own"
    own.mkdir()
    (own / "link.usda").symlink_to(tmp_path / "other.usda")
    os.mkfifo(own / "pipe.usda")  # opening it would wait for ever
    (own / "inner.usda").write_text(f'#usda 1.0\ndef "a" (references = @{way}@)\n{{\n}}\n')
    file = own / "a.usda"
    file.write_text(text.format(way))
    with pytest.raises(InputError, match=r"outside its folder|no ordinary file"):
        check_layers(file, Door(own))
    if way == "pipe.usda":
        with pytest.raises(InputError, match="no ordinary file"):
            read_file(file)


@needs_usd
def test_usd_that_composes_files_of_its_own_is_read(tmp_path: Path) -> None:
    make_usd(tmp_path / "inner.usda")
    (tmp_path / "a.usda").write_text("#usda 1.0\n(\n    subLayers = [@inner.usda@]\n)\n")
    assert len(read_file(tmp_path / "a.usda").pieces) == 4


FBX = """; FBX 7.4.0 project file
FBXHeaderExtension: {{ FBXVersion: 7400 }}
GlobalSettings: {{ Version: 1000
 Properties70: {{
  P: "UpAxis", "int", "Integer", "",1
  P: "UpAxisSign", "int", "Integer", "",1
  P: "UnitScaleFactor", "double", "Number", "",{unit}
 }} }}
Objects: {{
 Geometry: 1, "Geometry::tetra", "Mesh" {{
  Vertices: *12 {{ a: 0,0,0,10,0,0,0,20,0,0,0,30 }}
  PolygonVertexIndex: *12 {{ a: 0,2,-2,0,1,-4,0,3,-3,1,2,-4 }}
  LayerElementMaterial: 0 {{ MappingInformationType: "AllSame"
   ReferenceInformationType: "IndexToDirect"
   Materials: *1 {{ a: 0 }} }}
  Layer: 0 {{ LayerElement: {{ Type: "LayerElementMaterial"
   TypedIndex: 0 }} }}
 }}
 Model: 2, "Model::lid", "Mesh" {{ Properties70: {{
  P: "Lcl Translation", "Lcl Translation", "", "A",1,2,3
  P: "Lcl Rotation", "Lcl Rotation", "", "A",0,0,90
 }} }}
 Material: 3, "Material::red", "" {{ Version: 102
  ShadingModel: "phong"
  Properties70: {{
  P: "DiffuseColor", "Color", "", "A",1,0,0
 }} }}
}}
Connections: {{
 C: "OO",2,0
 C: "OO",1,2
 C: "OO",3,2
}}
"""


@pytest.mark.skipif(not has("assimp_py"), reason="needs plugins/mam_sim_formats")
def test_fbx_is_in_its_unit_and_place(tmp_path: Path) -> None:
    file = tmp_path / "a.fbx"
    file.write_text(FBX.format(unit=2.54))
    content = read_file(file)
    (piece,) = content.pieces
    points = np.array([[0, 0, 0], [10, 0, 0], [0, 20, 0], [0, 0, 30.0]])
    turned = points @ Rotation.from_euler("z", 90, degrees=True).as_matrix().T + [1, 2, 3]
    found = np.unique(piece.vertices.round(4) + 0.0, axis=0)
    np.testing.assert_allclose(found, np.unique(turned.round(4) + 0.0, axis=0), atol=1e-4)
    assert piece.group == "lid"
    assert content.metres_per_unit == pytest.approx(0.0254)
    assert content.materials[piece.material].base_color == (1.0, 0.0, 0.0, 1.0)
    assert load_mesh(file).mesh.bounds[1, 2] == pytest.approx(0.254)


def faceted_step(extents: tuple[float, float, float]) -> str:
    """A box of six planar faces as STEP AP214, millimetres."""
    lines: list[str] = []

    def add(text: str) -> int:
        lines.append(text)
        return len(lines)

    corners = []
    for bits in np.ndindex(2, 2, 2):
        x, y, z = (float(b) * e for b, e in zip(bits, extents))
        point = add(f"CARTESIAN_POINT('',({x!r},{y!r},{z!r}))")
        corners.append(f"#{point}")

    def normal(ring: tuple[int, ...]) -> str:
        a, b, c = (np.array(np.unravel_index(i, (2, 2, 2))) for i in ring[:3])
        x, y, z = (float(v) for v in np.cross(b - a, c - b))
        along = add(f"DIRECTION('',({x!r},{y!r},{z!r}))")
        return f"#{along}"

    faces = []
    rings = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    for ring in rings:
        place = add(f"AXIS2_PLACEMENT_3D('',{corners[ring[0]]},{normal(ring)},$)")
        plane = add(f"PLANE('',#{place})")
        loop = add(f"POLY_LOOP('',({','.join(corners[i] for i in ring)}))")
        bound = add(f"FACE_OUTER_BOUND('',#{loop},.T.)")
        faces.append(add(f"FACE_SURFACE('',(#{bound}),#{plane},.T.)"))
    shell = add(f"CLOSED_SHELL('',({','.join(f'#{f}' for f in faces)}))")
    solid = add(f"FACETED_BREP('tray',#{shell})")
    length = add("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))")
    angle = add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
    solid_angle = add("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())")
    context = add(
        "(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNIT_ASSIGNED_CONTEXT("
        f"(#{length},#{angle},#{solid_angle}))REPRESENTATION_CONTEXT('',''))"
    )
    shape = add(f"FACETED_BREP_SHAPE_REPRESENTATION('',(#{solid}),#{context})")
    application = add("APPLICATION_CONTEXT('automotive design')")
    mechanical = add(f"PRODUCT_CONTEXT('',#{application},'mechanical')")
    product = add(f"PRODUCT('tray','tray','',(#{mechanical}))")
    formation = add(f"PRODUCT_DEFINITION_FORMATION('','',#{product})")
    frame = add(f"PRODUCT_DEFINITION_CONTEXT('part definition',#{application},'design')")
    definition = add(f"PRODUCT_DEFINITION('design','',#{formation},#{frame})")
    whole = add(f"PRODUCT_DEFINITION_SHAPE('','',#{definition})")
    add(f"SHAPE_DEFINITION_REPRESENTATION(#{whole},#{shape})")
    body = "\n".join(f"#{i}={text};" for i, text in enumerate(lines, start=1))
    return (
        "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\n"
        "FILE_NAME('','2020-01-01T00:00:00',(''),(''),'','','');\n"
        "FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));\nENDSEC;\nDATA;\n"
        f"{body}\nENDSEC;\nEND-ISO-10303-21;\n"
    )


@pytest.mark.skipif(not has("cascadio"), reason="needs plugins/mam_sim_formats")
def test_step_is_in_metres_with_z_up(tmp_path: Path) -> None:
    file = tmp_path / "a.step"
    file.write_text(faceted_step((300.0, 400.0, 800.0)))
    content = read_file(file)
    assert (content.up, content.metres_per_unit) == ("z", 1.0)
    (piece,) = content.pieces
    solid: Any = trimesh.Trimesh(piece.vertices, piece.faces)
    np.testing.assert_allclose(solid.extents, [0.3, 0.4, 0.8], atol=1e-6)
    assert abs(solid.area - 2 * (0.12 + 0.24 + 0.32)) < 1e-6


@pytest.mark.parametrize(
    ("name", "module"), [("a.step", "cascadio"), ("a.fbx", "assimp_py"), ("a.usda", "pxr")]
)
def test_broken_files_of_native_readers_are_one_sentence(
    tmp_path: Path, name: str, module: str
) -> None:
    if not has(module):
        pytest.skip(f"needs {module}")
    (tmp_path / name).write_bytes(b"ISO-10303-21; not really")
    with pytest.raises(InputError, match="cannot be read as") as error:
        read_file(tmp_path / name)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "way"),
    [("a.fbx", "; or convert it in Blender: blender -b"), ("a.STEP", "freecadcmd -c"),
     ("a.igs", "write\\('a.stl'\\)"), ("a.usdz", "$")],
)  # fmt: skip
def test_without_the_package_of_readers_the_way_out_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, way: str
) -> None:
    (tmp_path / name).write_bytes(b"something")
    assert mesh_suffixes()[: len(BUILTIN)] == BUILTIN and set(ELSEWHERE) <= set(mesh_suffixes())
    assert all(reader_of(suffix) is not None for suffix in mesh_suffixes())
    monkeypatch.setattr("mam_pipeline.registry.installed", lambda _group: ())
    with pytest.raises(MissingExtra, match=rf"pip install \./plugins/mam_sim_formats.*{way}"):
        read_file(tmp_path / name)
    assert kind_of(tmp_path / name) == "mesh"  # it is known, so a batch has a row for it


@needs_usd
def test_a_look_that_usd_cannot_read_is_named_and_the_shape_is_read(tmp_path: Path) -> None:
    make_usd(tmp_path / "inner.usda")
    (tmp_path / "look.mtlx").write_text('<?xml version="1.0"?><materialx version="1.38"/>')
    (tmp_path / "a.usda").write_text(
        "#usda 1.0\n(\n    subLayers = [@inner.usda@]\n)\n"
        'def Scope "Looks" (prepend references = @./look.mtlx@</MaterialX>)\n{\n}\n'
    )
    found = read_file(tmp_path / "a.usda")
    assert len(found.pieces) == 4
    assert any("look.mtlx" in note for note in found.notes)
