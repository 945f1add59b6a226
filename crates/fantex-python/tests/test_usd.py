"""Models in USD, against numbers that were put into the stages."""

import io
import json
import os
import subprocess
import sys

import numpy as np
import pytest

import fantex
import fantex.usd

pytest.importorskip("pxr")

from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdUtils, Vt  # noqa: E402

QUAD = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]


def new_stage(path):
    """In metres with y up, which stay as they are."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    return stage


def quad(stage, path="/quad", points=QUAD, st=((0, 0), (1, 0), (1, 1), (0, 1))):
    """A square of one polygon, with coordinates of its corners."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    if st is not None:
        primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
            "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
        )
        primvar.Set(Vt.Vec2fArray([Gf.Vec2f(*row) for row in st]))
    return mesh


def surface(stage, path="/material", **values):
    """A material: numbers of its inputs."""
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, f"{path}/surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    for name, value in values.items():
        kind = Sdf.ValueTypeNames.Color3f if isinstance(value, tuple) else Sdf.ValueTypeNames.Float
        shader.CreateInput(name, kind).Set(value)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    return material, shader


def texture(stage, shader, inputs, file, name="image", space=None, transform=None, **more):
    """An image of some of a material's inputs: their names, and from which channels."""
    path = shader.GetPath().GetParentPath()
    reader = UsdShade.Shader.Define(stage, path.AppendChild(f"{name}_st"))
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.Token).Set("st")
    source = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    if transform is not None:
        node = UsdShade.Shader.Define(stage, path.AppendChild(f"{name}_transform"))
        node.CreateIdAttr("UsdTransform2d")
        node.CreateInput("in", Sdf.ValueTypeNames.Float2).ConnectToSource(source)
        node.CreateInput("rotation", Sdf.ValueTypeNames.Float).Set(transform["rotation"])
        node.CreateInput("scale", Sdf.ValueTypeNames.Float2).Set(Gf.Vec2f(*transform["scale"]))
        node.CreateInput("translation", Sdf.ValueTypeNames.Float2).Set(Gf.Vec2f(*transform["translation"]))
        source = node.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    image = UsdShade.Shader.Define(stage, path.AppendChild(name))
    image.CreateIdAttr("UsdUVTexture")
    image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(str(file)))
    image.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(source)
    for wrap in ("wrapS", "wrapT"):
        image.CreateInput(wrap, Sdf.ValueTypeNames.Token).Set("repeat")
    if space is not None:
        image.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(space)
    for key, value in more.items():
        image.CreateInput(key, Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*value))
    for key, channel in inputs.items():
        kind = Sdf.ValueTypeNames.Float3 if channel == "rgb" else Sdf.ValueTypeNames.Float
        shader.CreateInput(key, kind).ConnectToSource(image.CreateOutput(channel, kind))


def bind(mesh, material):
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)


def picture(path, texels):
    path.write_bytes(fantex._native.encode_png(np.asarray(texels, np.uint8)))


def linear(encoded):
    encoded = np.asarray(encoded) / 255
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def srgb(light):
    """Bytes of linear light."""
    light = np.asarray(light)
    return np.rint(255 * np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)).astype(int)


def images_of(glb):
    """The bytes of the images of a model's only material, by the names of its textures."""
    Image = pytest.importorskip("PIL.Image")
    length = int.from_bytes(glb[12:16], "little")
    scene, data = json.loads(glb[20 : 20 + length]), glb[28 + length :]
    (material,) = scene["materials"]
    slots = {**material, **material["pbrMetallicRoughness"]}

    def image(slot):
        view = scene["bufferViews"][scene["images"][scene["textures"][slot["index"]]["source"]]["bufferView"]]
        return np.asarray(Image.open(io.BytesIO(data[view["byteOffset"] :][: view["byteLength"]])))

    return {name: image(slot) for name, slot in slots.items() if name.endswith("Texture")}


def smooth(columns=64, rows=64, seed=0):
    """A picture of RGBA whose channels change slowly and differ, brighter upwards in its second."""
    x, y = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows)
    waves = [np.sin(2 * np.pi * (k * x + (3 - k) * y) + seed + k) for k in range(4)]
    return np.rint(128 + 90 * np.stack(waves, 2)).astype(np.uint8)


def looked_up(texels, u, v):
    """The nearest texel's numbers, v upwards, repeated."""
    rows, columns = texels.shape[:2]
    x, y = np.floor(np.mod(u, 1) * columns).astype(int), np.floor(np.mod(1 - v, 1) * rows).astype(int)
    return texels[np.clip(y, 0, rows - 1), np.clip(x, 0, columns - 1)]


def points_of_quad(count=2000, seed=3):
    return np.random.default_rng(seed).uniform(0.02, 0.98, (count, 2))


def baked(path, tmp_path, **more):
    return fantex.bake(path, tmp_path / "a.fan", format="float", overwrite=True, **{"texels": 40_000, **more})


def test_colors_and_places(tmp_path):
    """A box of polygons with a colour for each, turned, moved and scaled."""
    path = tmp_path / "box.usda"
    stage = new_stage(path)
    parent = UsdGeom.Xform.Define(stage, "/parent")
    parent.AddTranslateOp().Set((1000, 2, 3))
    parent.AddRotateZOp().Set(90)
    mesh = UsdGeom.Mesh.Define(stage, "/parent/box")
    mesh.AddScaleOp().Set((2, 1, 1))
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    mesh.CreatePointsAttr(corners.tolist())
    mesh.CreateFaceVertexCountsAttr([4] * 6)
    mesh.CreateFaceVertexIndicesAttr(sum(sides, []))
    colors = np.random.default_rng(1).random((6, 3))
    UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, "uniform").Set(
        Vt.Vec3fArray([Gf.Vec3f(*map(float, row)) for row in colors])
    )
    stage.Save()
    mesh = fantex.Mesh.load(path)
    assert len(mesh.faces) == 12 and len(mesh.positions) == 8
    assert any("subdivision surfaces" in note for note in mesh.notes)

    def world(points):
        x, y, z = (points * (2, 1, 1)).T
        return np.stack([1000 - y, 2 + x, 3 + z], 1)

    np.testing.assert_allclose(mesh.bounds, [[999, 2, 3], [1000, 4, 4]], atol=1e-9)
    a, b, c = mesh.positions[mesh.faces].transpose(1, 0, 2)
    volume = np.einsum("ij,ij->", a - mesh.bounds[0], np.cross(b - a, c - a)) / 6
    assert abs(volume - 2) < 1e-6  # outwards
    asset = baked(path, tmp_path)
    centres = world(np.array([corners[side].mean(0) for side in sides]))
    np.testing.assert_allclose(asset.sample(centres)[:, :3], colors, atol=2e-3)
    # An open stage is as good.
    assert len(fantex.Mesh.of(stage).faces) == 12 and fantex.info(path)["triangles"] == 12


@pytest.mark.parametrize("package", [False, True])
def test_textures_of_a_preview_surface(tmp_path, package):
    """Colour from an image that is turned, roughness and metal from channels of others, normals; also out of a package."""
    path = tmp_path / "quad.usda"
    stage = new_stage(path)
    material, shader = surface(stage, metallic=0.25)
    color, rough = smooth(), smooth(seed=2)
    picture(tmp_path / "color.png", color)
    picture(tmp_path / "rough.png", rough)
    move = {"rotation": 90.0, "scale": (2.0, 1.0), "translation": (0.25, 0.5)}
    texture(stage, shader, {"diffuseColor": "rgb"}, "color.png", space="sRGB", transform=move, scale=(0.5, 1, 1, 1))
    texture(stage, shader, {"roughness": "r"}, "rough.png", "rough", space="raw", scale=(0.5,) * 4, bias=(0.25,) * 4)
    bind(quad(stage), material)
    stage.Save()
    if package:
        path = tmp_path / "quad.usdz"
        assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(tmp_path / "quad.usda")), str(path))
        (tmp_path / "color.png").unlink()
        (tmp_path / "rough.png").unlink()
    asset = baked(path, tmp_path)
    places = points_of_quad()
    points = np.column_stack([places, np.zeros(len(places))])
    # Scale, then turn to the left, then move.
    s, t = places[:, 0] * 2, places[:, 1]
    expected = linear(looked_up(color, -t + 0.25, s + 0.5)[:, :3]) * (0.5, 1, 1)
    found = asset.sample(points)[:, :3]
    assert np.abs(found - expected).mean() < 0.02
    shine = asset.sample(points, channel="orm")
    expected = looked_up(rough, *places.T)[:, 0] / 255 * 0.5 + 0.25
    assert np.abs(shine[:, 1] - expected).mean() < 0.02
    np.testing.assert_allclose(shine[:, 2], 0.25, atol=0.01)


def test_opacity_and_emission(tmp_path):
    path = tmp_path / "quad.usda"
    stage = new_stage(path)
    material, shader = surface(stage, emissiveColor=(0.5, 4.0, 1.0), diffuseColor=(0.2, 0.4, 0.6))
    mask = smooth()
    picture(tmp_path / "mask.png", mask)
    texture(stage, shader, {"opacity": "g"}, "mask.png", space="raw")
    bind(quad(stage), material)
    stage.Save()
    asset = baked(path, tmp_path)
    places = points_of_quad()
    points = np.column_stack([places, np.zeros(len(places))])
    rgba = asset.sample(points)
    np.testing.assert_allclose(rgba[:, :3], np.broadcast_to((0.2, 0.4, 0.6), (len(points), 3)), atol=0.01)
    assert np.abs(rgba[:, 3] - looked_up(mask, *places.T)[:, 1] / 255).mean() < 0.02
    assert asset.materials[0].alpha == "blend"
    (made,) = {material.emission for material in asset.materials}
    np.testing.assert_allclose(made, (0.5, 4, 1), rtol=1e-3)


def test_subsets_tiles_and_bare_faces(tmp_path):
    """Two materials on parts of a mesh, one of them in UDIM tiles; the rest has its colours."""
    path = tmp_path / "strip.usda"
    stage = new_stage(path)
    mesh = UsdGeom.Mesh.Define(stage, "/strip")
    # Four squares side by side; the coordinates of the first two are tiles of their own.
    mesh.CreatePointsAttr([(x, y, 0) for x in range(5) for y in (0, 1)])
    mesh.CreateFaceVertexCountsAttr([4] * 4)
    mesh.CreateFaceVertexIndicesAttr(sum(([2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 1] for k in range(4)), []))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    primvars = UsdGeom.PrimvarsAPI(mesh)
    st = [(x, y) for x in range(5) for y in (0, 1)]
    primvars.CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex").Set(
        Vt.Vec2fArray([Gf.Vec2f(*row) for row in st])
    )
    primvars.CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, "constant").Set([(0.1, 0.7, 0.3)])
    tiled, shader = surface(stage, "/tiled")
    images = [smooth(seed=1), smooth(seed=4)]
    for k, image in enumerate(images):
        picture(tmp_path / f"t.{1001 + k}.png", image)
    texture(stage, shader, {"diffuseColor": "rgb"}, "t.<UDIM>.png", space="sRGB")
    plain, _ = surface(stage, "/plain", diffuseColor=(0.9, 0.1, 0.1))
    for name, faces, material in (("a", [0, 1], tiled), ("b", [2], plain)):
        subset = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).CreateMaterialBindSubset(name, faces)
        UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(material)
    stage.Save()
    loaded = fantex.Mesh.load(path)
    assert loaded.info["materials"] == 4 and len(loaded.positions) == 10
    asset = baked(path, tmp_path, texels=80_000)
    places = points_of_quad()
    for k, image in enumerate(images):
        found = asset.sample(np.column_stack([places + (k, 0), np.zeros(len(places))]))[:, :3]
        assert np.abs(found - linear(looked_up(image, *places.T)[:, :3])).mean() < 0.02, k
    found = asset.sample([[2.5, 0.5, 0], [3.5, 0.5, 0]])[:, :3]
    np.testing.assert_allclose(found, [[0.9, 0.1, 0.1], [0.1, 0.7, 0.3]], atol=0.02)


def test_instances(tmp_path):
    """References that are instanced, an instancer of points with turned and hidden copies, and what is not shown."""
    path = tmp_path / "many.usda"
    stage = new_stage(path)
    quad(stage, "/library/quad")
    UsdGeom.Xform.Define(stage, "/library").MakeInvisible()
    source = stage.OverridePrim("/source")
    source.SetSpecifier(Sdf.SpecifierClass)
    quad(stage, "/source/quad")
    for k in range(2):
        copy = UsdGeom.Xform.Define(stage, f"/copy{k}")
        copy.GetPrim().GetReferences().AddInternalReference("/source")
        copy.GetPrim().SetInstanceable(True)
        copy.AddTranslateOp().Set((10 + 2 * k, 0, 0))
    guide = quad(stage, "/guide")
    guide.CreatePurposeAttr(UsdGeom.Tokens.guide)
    UsdGeom.Sphere.Define(stage, "/ball")
    instancer = UsdGeom.PointInstancer.Define(stage, "/field")
    instancer.AddTranslateOp().Set((0, 100, 0))
    prototype = UsdGeom.Xform.Define(stage, "/field/leaf")
    prototype.AddScaleOp().Set((3, 1, 1))
    quad(stage, "/field/leaf/quad")
    instancer.CreatePrototypesRel().SetTargets(["/field/leaf"])
    instancer.CreateProtoIndicesAttr([0, 0, 0])
    instancer.CreatePositionsAttr([(0, 0, 0), (20, 0, 0), (40, 0, 0)])
    half = np.sqrt(0.5)
    turned = Gf.Quath(half, Gf.Vec3h(0, 0, half))
    instancer.CreateOrientationsAttr([Gf.Quath(1), turned, Gf.Quath(1)])
    instancer.CreateInvisibleIdsAttr([2])
    torn = UsdGeom.PointInstancer.Define(stage, "/torn")
    torn.CreatePrototypesRel().SetTargets(["/field/leaf"])
    torn.CreateProtoIndicesAttr([0, 7])
    torn.CreatePositionsAttr([(0, 0, 0), (20, 0, 0)])
    stage.Save()
    mesh = fantex.Mesh.load(path)
    assert len(mesh.faces) == 8
    notes = "\n".join(mesh.notes)
    assert "left out of type Sphere, which are no meshes: 1" in notes
    assert "/torn is left out: some of its instances name no prototype" in notes
    boxes = sorted(tuple(np.rint(mesh.positions[mesh.faces[pair].ravel()] * 1000).min(0)) for pair in np.arange(8).reshape(-1, 2))
    spans = sorted(tuple(np.rint(np.ptp(mesh.positions[mesh.faces[pair].ravel()], 0) * 100)) for pair in np.arange(8).reshape(-1, 2))
    assert [tuple(map(int, box)) for box in boxes] == [(0, 100000, 0), (10000, 0, 0), (12000, 0, 0), (19000, 100000, 0)]
    assert spans == [(100, 100, 0), (100, 100, 0), (100, 300, 0), (300, 100, 0)]


def test_polygons(tmp_path):
    """A concave polygon, one that is a hole, one too short, corners that run the other way round."""
    path = tmp_path / "polygons.usda"
    stage = new_stage(path)
    mesh = UsdGeom.Mesh.Define(stage, "/mesh")
    # An L of area 3, a square of area 1 that is a hole, and two corners that are no polygon.
    ell = [(0, 0, 0), (2, 0, 0), (2, 1, 0), (1, 1, 0), (1, 2, 0), (0, 2, 0)]
    mesh.CreatePointsAttr(ell + [(5, 0, 0), (6, 0, 0), (6, 1, 0), (5, 1, 0)])
    mesh.CreateFaceVertexCountsAttr([6, 2, 4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3, 4, 5, 0, 1, 6, 7, 8, 9])
    mesh.CreateHoleIndicesAttr([2])
    mesh.CreateOrientationAttr(UsdGeom.Tokens.leftHanded)
    stage.Save()
    mesh = fantex.Mesh.load(path)
    a, b, c = mesh.positions[mesh.faces].transpose(1, 0, 2)
    cross = np.cross(b - a, c - a)
    assert len(mesh.faces) == 4 and np.isclose(cross[:, 2].sum() / 2, -3) and (cross[:, 2] < 0).all()


def test_times(tmp_path):
    path = tmp_path / "moving.usda"
    stage = new_stage(path)
    move = quad(stage).AddTranslateOp()
    move.Set((1, 0, 0), 10)
    move.Set((3, 0, 0), 20)
    stage.Save()
    assert fantex.Mesh.load(path).bounds[0, 0] == 1
    fantex.usd.write_glb(path, tmp_path / "late.glb", time=15)
    assert np.isclose(fantex.Mesh.load(tmp_path / "late.glb").bounds[0, 0], 2)


def test_models_for_other_programs(tmp_path):
    """Metres and y up, from centimetres and z up."""
    path = tmp_path / "tower.usda"
    stage = new_stage(path)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    quad(stage, points=[(100, 200, 0), (100, 200, 500), (100, 300, 500), (100, 300, 0)])
    stage.Save()
    own = fantex.Mesh.load(path, keep_units=True), fantex.Mesh.of(stage, keep_units=True)
    for mesh in own:
        np.testing.assert_allclose(mesh.bounds, [[100, 200, 0], [100, 300, 500]])
    for mesh in (fantex.Mesh.load(path), fantex.Mesh.of(stage)):
        np.testing.assert_allclose(mesh.bounds, [[1, 0, -3], [1, 5, -2]], atol=1e-6)
        assert not any("metersPerUnit" in note for note in mesh.notes)
    program = [sys.executable, "-W", "error", "-m", "fantex.usd"]
    output = tmp_path / "tower.glb"
    assert subprocess.run([*program, path, output], capture_output=True, cwd=tmp_path).returncode == 0
    np.testing.assert_allclose(fantex.Mesh.load(output).bounds, [[1, 0, -3], [1, 5, -2]], atol=1e-6)
    trimesh = pytest.importorskip("trimesh")
    np.testing.assert_allclose(trimesh.load(output).bounds, [[1, 0, -3], [1, 5, -2]], atol=1e-6)
    again = subprocess.run([*program, path, output], capture_output=True, text=True, cwd=tmp_path)
    assert again.returncode == 1 and "exists; give --force to replace it" in again.stderr
    with pytest.raises(FileExistsError):
        fantex.usd.write_glb(path, output)
    with pytest.raises(ValueError, match="a .glb file is written"):
        fantex.usd.write_glb(path, tmp_path / "tower.obj")
    # Before it is read.
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        fantex.usd.write_glb(tmp_path / "none.usda", tmp_path / "none" / "tower.glb")


def test_exports_stand_as_their_stage(tmp_path):
    """Into a bake and out again, as USD and as glTF, a tower in centimetres with z up has the height and the place that its own stage says."""
    path = tmp_path / "tower.usda"
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    quad(stage, points=[(100, 200, 0), (100, 200, 500), (100, 300, 500), (100, 300, 0)]).CreateDisplayColorAttr([(1, 0, 0)])
    stage.Save()
    asset = fantex.bake(stage, tmp_path / "tower.fan", texels=5000)
    asset.export_fans(tmp_path / "fans.usda")
    written = Usd.Stage.Open(str(tmp_path / "fans.usda"))
    assert UsdGeom.GetStageUpAxis(written) == UsdGeom.Tokens.y
    box = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"]).ComputeWorldBound(written.GetPseudoRoot()).ComputeAlignedRange()
    metres = np.array([box.GetMin(), box.GetMax()]) * UsdGeom.GetStageMetersPerUnit(written)
    np.testing.assert_allclose(metres, [[1, 0, -3], [1, 5, -2]], atol=1e-6)
    asset.export(tmp_path / "tower.glb", resolution=256)
    trimesh = pytest.importorskip("trimesh")
    np.testing.assert_allclose(trimesh.load(tmp_path / "tower.glb").bounds, [[1, 0, -3], [1, 5, -2]], atol=1e-6)


def test_units_that_are_none(tmp_path):
    stage = Usd.Stage.CreateInMemory()
    quad(stage)
    mesh = fantex.Mesh.of(stage)
    # USD's own default is a centimetre.
    np.testing.assert_allclose(mesh.bounds, [[0, 0, 0], [0.01, 0.01, 0]], atol=1e-9)
    assert any("has no metersPerUnit; its unit is taken for 0.01 m" in note for note in mesh.notes)
    assert not any("metersPerUnit" in note for note in fantex.Mesh.of(stage, keep_units=True).notes)
    UsdGeom.SetStageMetersPerUnit(stage, 0)
    with pytest.raises(fantex.Error, match="metersPerUnit = 0.0; expected a number above 0"):
        fantex.Mesh.of(stage)
    for given in (mesh, (QUAD, [(0, 1, 2)]), "model.glb"):
        with pytest.raises(ValueError, match="keep_units= is for USD"):
            fantex.Mesh.of(given, keep_units=True)


@pytest.mark.parametrize("suffix", ["tif", "webp", "exr"])
def test_numbers_in_other_formats_are_numbers(tmp_path, suffix):
    """Maps of numbers, which glTF's two formats do not hold, keep their numbers; colours of the same file are colours."""
    numbers = np.tile(np.uint8([255, 128, 51]), (4, 4, 1))
    file = tmp_path / f"map.{suffix}"
    if suffix == "exr":
        exr = pytest.importorskip("OpenEXR")
        header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
        exr.File(header, {"RGB": (numbers / np.float32(255)).astype(np.float32)}).write(str(file))
    else:
        from PIL import Image

        Image.fromarray(numbers).save(file, **({"lossless": True} if suffix == "webp" else {}))
    numbers_in, colors_in = {"space": "auto" if suffix == "exr" else "raw"}, {"space": "auto"}
    normals_in = {**numbers_in, "scale": (2, 2, 2, 1), "bias": (-1, -1, -1, 0)}
    of_numbers = [
        ({"normal": "rgb"}, normals_in),
        ({"roughness": "g", "metallic": "b"}, numbers_in),
        ({"occlusion": "r"}, numbers_in),
    ]
    of_colors = [({"diffuseColor": "rgb"}, colors_in), ({"emissiveColor": "rgb"}, colors_in)]
    # Integers of colours are sRGB, floats are light.
    colors = srgb(numbers[0, 0] / 255) if suffix == "exr" else numbers[0, 0]
    for inputs in (of_numbers, of_colors + of_numbers):
        stage = Usd.Stage.CreateInMemory()
        material, shader = surface(stage)
        for k, (names, more) in enumerate(inputs):
            texture(stage, shader, names, file, f"image{k}", **more)
        bind(quad(stage), material)
        images = images_of(fantex.usd.glb_of(stage)[0])
        assert len(images) == len(inputs)
        for name, texels in images.items():
            expected = colors if name in ("baseColorTexture", "emissiveTexture") else numbers[0, 0]
            assert np.abs(texels[..., :3].astype(int) - expected).max() <= 1, (name, texels[0, 0], expected)


def test_what_eight_bits_do_not_hold(tmp_path):
    """Light above 1 is a factor of its image; numbers that are rounded are told of."""
    # Radiance: three mantissas and the exponent that they share, 4, 1 and 0.125.
    texels = bytes([128, 32, 4, 131]) * 16
    (tmp_path / "a.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 4\n" + texels)
    stage = Usd.Stage.CreateInMemory()
    material, shader = surface(stage)
    texture(stage, shader, {"emissiveColor": "rgb"}, tmp_path / "a.hdr", "light", space="auto")
    texture(stage, shader, {"roughness": "b"}, tmp_path / "a.hdr", "rough", space="auto")
    bind(quad(stage), material)
    glb, notes = fantex.usd.glb_of(stage)
    (described,) = json.loads(glb[20 : 20 + int.from_bytes(glb[12:16], "little")])["materials"]
    assert described["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"] == 4
    assert abs(linear(images_of(glb)["emissiveTexture"][0, 0, 1]) - 0.25) < 0.005
    (note,) = (note for note in notes if "a.hdr" in note)
    assert "a.hdr are rounded to 8 bits" in note


def test_the_bottle(tmp_path, bottle):
    """A model with all its maps is the same in USD, and its normal map counts."""
    path = tmp_path / "bottle.usda"
    model = fantex.Mesh.load(bottle)
    stage = new_stage(path)
    trimesh = pytest.importorskip("trimesh")
    (part,) = trimesh.load(bottle).geometry.values()
    mesh = UsdGeom.Mesh.Define(stage, "/bottle")
    # As the model's node.
    mesh.AddRotateYOp().Set(180)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(part.vertices.astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr([3] * len(part.faces))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(part.faces.ravel().astype(np.int32)))
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(part.vertex_normals.astype(np.float32)))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex").Set(
        Vt.Vec2fArray.FromNumpy(part.visual.uv.astype(np.float32))
    )
    material, shader = surface(stage)
    maps = {
        "baseColorTexture": ({"diffuseColor": "rgb"}, {}),
        "metallicRoughnessTexture": ({"roughness": "g", "metallic": "b"}, {"space": "raw"}),
        "normalTexture": ({"normal": "rgb"}, {"space": "raw", "scale": (2, 2, 2, 1), "bias": (-1, -1, -1, 0)}),
        "occlusionTexture": ({"occlusion": "r"}, {"space": "raw"}),
        "emissiveTexture": ({"emissiveColor": "rgb"}, {"space": "sRGB"}),
    }
    for name, (inputs, more) in maps.items():
        getattr(part.visual.material, name).save(tmp_path / f"{name}.png")
        texture(stage, shader, inputs, f"{name}.png", name, **more)
    bind(mesh, material)
    stage.Save()
    assert len(fantex.Mesh.load(path).faces) == len(model.faces)
    same = fantex.compare(bottle, path, views=4, size=(320, 240))
    assert same["min_psnr_db"] > 50, same
    without = UsdShade.Shader.Get(stage, "/material/surface")
    without.GetInput("normal").ClearSources()
    assert fantex.compare(bottle, stage, views=1, size=(320, 240))["psnr_db"] < 45


def test_what_cannot_be_read(tmp_path, monkeypatch):
    bad = tmp_path / "bad.usda"
    bad.write_text("#usda 1.0\ndef Mesh {")
    with pytest.raises(fantex.Error, match=r"^\S*bad.usda cannot be read as USD: \S*bad.usda:2:1: parse error$"):
        fantex.Mesh.load(bad)
    binary = tmp_path / "whole.usdc"
    stage = new_stage(binary)
    quad(stage)
    stage.Save()
    cut = tmp_path / "cut.usdc"
    cut.write_bytes(binary.read_bytes()[:200])
    with pytest.raises(fantex.Error, match="cannot be read as USD: Sdf crate file corrupt, possibly truncated"):
        fantex.Mesh.load(cut)
    package = tmp_path / "cut.usdz"
    package.write_bytes(b"PK\x03\x04")
    with pytest.raises(fantex.Error, match="cannot be read as USD: it is damaged or cut off; write it anew"):
        fantex.Mesh.load(package)
    package.write_bytes(b"")
    with pytest.raises(fantex.Error, match="cut.usdz is empty; expected a USD file"):
        fantex.Mesh.load(package)
    with pytest.raises(FileNotFoundError):
        fantex.Mesh.load(tmp_path / "none.usdz")
    empty = tmp_path / "empty.usda"
    stage = new_stage(empty)
    UsdGeom.Sphere.Define(stage, "/ball")
    stage.Save()
    with pytest.raises(fantex.Error, match="holds no mesh that is shown .*left out of type Sphere"):
        fantex.Mesh.load(empty)
    # Faces beyond the points, values that are too few, an image that is not there, a surface of another kind.
    odd = tmp_path / "odd.usda"
    stage = new_stage(odd)
    quad(stage, "/torn").CreateFaceVertexIndicesAttr([0, 1, 2, 9])
    mesh = quad(stage, "/quad", st=[(0, 0)])
    mesh.CreateNormalsAttr([(0, 0, 1)])
    mesh.SetNormalsInterpolation("vertex")
    material, shader = surface(stage)
    texture(stage, shader, {"diffuseColor": "rgb"}, "none.png")
    bind(mesh, material)
    second = quad(stage, "/second", points=[(x + 3, y, z) for x, y, z in QUAD])
    bind(second, material)
    third = quad(stage, "/third", points=[(x + 6, y, z) for x, y, z in QUAD])
    strange = UsdShade.Material.Define(stage, "/strange")
    node = UsdShade.Shader.Define(stage, "/strange/node")
    node.CreateIdAttr("ND_standard_surface_surfaceshader")
    strange.CreateSurfaceOutput("mtlx").ConnectToSource(node.ConnectableAPI(), "out")
    bind(third, strange)
    stage.Save()
    mesh = fantex.Mesh.load(odd)
    assert len(mesh.faces) == 6
    notes = "\n".join(mesh.notes)
    for sentence in (
        "/torn is left out: its faces do not fit its points",
        "/quad.normals is left out: it does not fit its mesh",
        "/quad.primvars:st is left out: it does not fit its mesh",
        "none.png cannot be read; it is left out",
        "the material /strange has no UsdPreviewSurface",
    ):
        assert sentence in notes, notes
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(ImportError, match="pip install usd-core"):
        fantex.Mesh.load(odd)


def test_numbers_that_are_not_finite(tmp_path):
    """A point without a place takes its triangles along, and nothing else; so does a place, and a material's number stays as it was."""
    nan = float("nan")
    stage = new_stage(tmp_path / "nan.usda")
    mesh = UsdGeom.Mesh.Define(stage, "/mesh")
    mesh.CreatePointsAttr([*QUAD, (2, 0, 0), (2, nan, 0)])
    mesh.CreateFaceVertexCountsAttr([4, 3, 3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3, 1, 4, 2, 4, 5, 2])
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    material, _ = surface(stage, roughness=nan, diffuseColor=(0.1, float("inf"), 0.2), metallic=1.0)
    bind(mesh, material)
    quad(stage, "/lost").AddTranslateOp().Set((nan, 0, 0))
    quad(stage, "/all", points=[(nan, 0, 0)] * 4)
    loaded = fantex.Mesh.of(stage)
    assert len(loaded.faces) == 3
    np.testing.assert_allclose(loaded.bounds, [[0, 0, 0], [2, 1, 0]])
    notes = "\n".join(loaded.notes)
    for sentence in (
        "triangles with points that are no finite numbers, which are left out: 3",
        "meshes at places that are no finite numbers, which are left out: 1",
        "/material/surface.inputs:roughness is no finite number; it is left out",
        "/material/surface.inputs:diffuseColor is no finite number; it is left out",
    ):
        assert sentence in notes, notes


def test_inputs_that_are_left_out_are_noted(tmp_path):
    stage = new_stage(tmp_path / "coat.usda")
    material, _ = surface(stage, clearcoat=1.0, clearcoatRoughness=0.1, ior=1.3, displacement=0.5, sheen=0.5, roughness=0.2)
    bind(quad(stage), material)
    usual, shader = surface(stage, "/usual", clearcoat=0.0, clearcoatRoughness=0.01, ior=1.5, displacement=0.0)
    shader.CreateInput("opacityMode", Sdf.ValueTypeNames.Token).Set("transparent")
    shader.CreateInput("sheen", Sdf.ValueTypeNames.Float)
    bind(quad(stage, "/second"), usual)
    mapped, shader = surface(stage, "/mapped")
    texture(stage, shader, {"displacement": "r"}, "height.png")
    bind(quad(stage, "/third"), mapped)
    notes = [note for note in fantex.Mesh.of(stage).notes if note.startswith("of the material")]
    assert notes == [
        "of the material /material are left out: clearcoat, displacement, ior, sheen",
        "of the material /mapped are left out: displacement",
    ]


def test_files_made_meanwhile_stay(tmp_path, monkeypatch):
    path = tmp_path / "a.glb"
    stage = Usd.Stage.CreateInMemory()
    quad(stage)
    read = fantex.usd.glb_of

    def slow(*given, **more):
        path.write_bytes(b"of another")
        return read(*given, **more)

    monkeypatch.setattr(fantex.usd, "glb_of", slow)
    with pytest.raises(FileExistsError):
        fantex.usd.write_glb(stage, path)
    assert path.read_bytes() == b"of another" and os.listdir(tmp_path) == ["a.glb"]
    fantex.usd.write_glb(stage, path, overwrite=True)
    assert path.read_bytes().startswith(b"glTF") and os.listdir(tmp_path) == ["a.glb"]


def test_the_command_line_says_how(tmp_path):
    program = os.environ.get("FANTEX_PROGRAM")
    if not program:
        pytest.skip("no command line (FANTEX_PROGRAM)")
    path = tmp_path / "a.usda"
    path.write_text("#usda 1.0\n")
    said = subprocess.run([program, "info", path], capture_output=True, text=True)
    assert said.returncode == 1 and "python -m fantex.usd" in said.stderr
