"""Fans for other programs: sheets, coordinates, and the files that carry them."""

import json
import struct

import numpy as np
import pytest

import fantex
from conftest import pattern


def function_of(fans, picture, face, barycentric, level=0):
    """The texture function as a shader would write it, of bilinear look-ups in a sheet's level."""
    picture = picture.astype(np.float64) / np.iinfo(picture.dtype).max
    for _ in range(level):
        picture = picture.reshape(picture.shape[0] // 2, 2, picture.shape[1] // 2, 2, -1).mean((1, 3))
    others = np.stack([np.delete(barycentric, i, 1).max(1) for i in range(3)], 1)
    weights = np.maximum(0, barycentric - others + fans.delta)
    weights /= weights.sum(1, keepdims=True)
    places = (fans.uv[face] * barycentric[:, None, :, None]).sum(2)
    height, width, _ = picture.shape
    result = 0
    for i in range(3):
        x, y = places[:, i, 0] * width - 0.5, (1 - places[:, i, 1]) * height - 0.5
        left, top = np.floor(x).astype(int), np.floor(y).astype(int)
        fx, fy = (x - left)[:, None], (y - top)[:, None]

        def texel(dx, dy):
            return picture[np.clip(top + dy, 0, height - 1), np.clip(left + dx, 0, width - 1)]

        value = (texel(0, 0) * (1 - fx) + texel(1, 0) * fx) * (1 - fy)
        value += (texel(0, 1) * (1 - fx) + texel(1, 1) * fx) * fy
        result = result + value * weights[:, i, None]
    return result


def linear(encoded):
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


@pytest.fixture(scope="module")
def bottle_asset(tmp_path_factory, bottle):
    # In tiles of which several fit into a small sheet.
    path = tmp_path_factory.mktemp("fans") / "bottle.fan"
    return fantex.bake(bottle, path, texels=200_000, tile=128)


def surface(asset, count=20_000, seed=5):
    """Points spread evenly over the surface."""
    random = np.random.default_rng(seed)
    a, b, c = asset.positions[asset.faces].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return random.choice(len(area), count, p=area / area.sum()), random.dirichlet((1, 1, 1), count)


@pytest.mark.parametrize("side", [8192, 320])
def test_three_look_ups_are_the_texture_function(bottle_asset, side):
    """In one sheet, and in several."""
    fans = bottle_asset.fan_attributes(largest_side=side)
    assert (len(fans.sheets) > 1) == (side == 320)
    face, barycentric = surface(bottle_asset)
    for channel in ("orm", "normal"):
        truth = bottle_asset.sample(face=face, barycentric=barycentric, channel=channel)[:, :3]
        value = np.zeros_like(truth, np.float64)
        for index, sheet in enumerate(fans.sheets):
            at = fans.sheet[face] == index
            value[at] = function_of(fans, sheet[channel], face[at], barycentric[at])
        if channel == "normal":
            # In object space the vertex normals of triangles smaller than a texel are lost.
            value = value * 2 - 1
            cosine = (value * truth).sum(1) / np.linalg.norm(value, axis=1)
            assert np.median(cosine) > 0.9999 and cosine.mean() > 0.999, cosine.mean()
        else:
            assert np.abs(value - truth).max() < 0.003


def test_colors_of_a_sheet(waves):
    fans = waves.fan_attributes()
    face, barycentric = surface(waves)
    (sheet,) = fans.sheets
    truth = waves.sample(face=face, barycentric=barycentric)[:, :3]
    # Interpolated as sRGB numbers instead of light, which differs little in a smooth picture.
    assert np.abs(linear(function_of(fans, sheet["base-color"], face, barycentric)) - truth).max() < 0.01


@pytest.mark.parametrize("gutter,levels", [(4, 2), (16, 4)])
def test_coarse_levels_stay_inside_tiles(tmp_path, sphere, gutter, levels):
    """Every tile is white, what lies between them black after the gutters are: no black is read down to the stated level."""
    asset = fantex.bake(sphere, tmp_path / "a.fan", texels=60_000, source=lambda p, n: np.ones_like(p))
    fans = asset.fan_attributes(gutter=gutter)
    picture = fans.sheets[0]["base-color"].copy()
    height, width, _ = picture.shape
    # What no gutter reaches: texels farther than the gutter from any place that is read.
    read = np.zeros((height, width), bool)
    low = np.floor(fans.uv.min(2) * (width, height)).astype(int)
    high = np.ceil(fans.uv.max(2) * (width, height)).astype(int)
    for (x0, y0), (x1, y1) in zip(low.reshape(-1, 2), high.reshape(-1, 2)):
        rows = slice(max(height - y1 - gutter, 0), max(height - y0 + gutter, 0))
        read[rows, max(x0 - gutter, 0) : max(x1 + gutter, 0)] = True
    picture[~read] = 0
    assert (picture == 0).any()
    face, barycentric = surface(asset)
    for level in range(levels + 1):
        value = function_of(fans, picture, face, barycentric, level)
        if level < levels:
            assert value.min() > 0.99, level


def test_no_jump_at_edges(bottle_asset):
    """Both faces of an edge give the same value there."""
    fans = bottle_asset.fan_attributes()
    (sheet,) = fans.sheets
    edges = {}
    pairs = []
    for face, corners in enumerate(bottle_asset.faces):
        for k in range(3):
            a, b = corners[k], corners[(k + 1) % 3]
            if (b, a) in edges:
                pairs.append((*edges.pop((b, a)), face, k))
            else:
                edges[(a, b)] = (face, k)
    pairs = np.array(pairs)
    for share in (0.0, 0.3, 0.5, 0.62, 1.0):

        def on_edge(face, k, t):
            barycentric = np.zeros((len(face), 3))
            barycentric[np.arange(len(face)), k] = 1 - t
            barycentric[np.arange(len(face)), (k + 1) % 3] = t
            return function_of(fans, sheet["orm"], face, barycentric)

        first = on_edge(pairs[:, 0], pairs[:, 1], share)
        second = on_edge(pairs[:, 2], pairs[:, 3], 1 - share)
        # A part in two hundred million of a sheet's width is what single precision leaves.
        assert np.abs(first - second).max() < 2e-4


def read_glb(path):
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def test_glb_with_fans(tmp_path, bottle_asset):
    path = tmp_path / "fans.glb"
    assert bottle_asset.export_fans(path) == [str(path)]
    document, binary = read_glb(path)
    accessors, views = document["accessors"], document["bufferViews"]

    def read(index, dtype, columns):
        accessor = accessors[index]
        start = views[accessor["bufferView"]]["byteOffset"] + accessor.get("byteOffset", 0)
        return np.frombuffer(binary, dtype, accessor["count"] * columns, start).reshape(-1, columns)

    (primitive,) = document["meshes"][0]["primitives"]
    attributes = primitive["attributes"]
    indices = read(primitive["indices"], np.uint32, 1).reshape(-1, 3)
    uv = np.stack([read(attributes[f"TEXCOORD_{i}"], np.float32, 2) for i in range(3)], 1)
    lambdas = read(attributes["TEXCOORD_3"], np.float32, 2)
    np.testing.assert_array_equal(lambdas[indices], np.tile([[[1, 0], [0, 1], [0, 0]]], (len(indices), 1, 1)))
    fans = bottle_asset.fan_attributes()
    expected = fans.uv.transpose(0, 2, 1, 3).copy()
    expected[..., 1] = 1 - expected[..., 1]
    np.testing.assert_allclose(uv[indices], expected, atol=1e-6)
    positions = read(attributes["POSITION"], np.float32, 3)
    np.testing.assert_allclose(positions[indices], bottle_asset.positions[bottle_asset.faces], atol=1e-6)
    assert document["meshes"][0]["extras"]["fantexDelta"] == pytest.approx(fans.delta)
    # Programs that know no fans still load it.
    trimesh = pytest.importorskip("trimesh")
    assert len(trimesh.load(path, force="mesh").faces) == len(bottle_asset.faces)


def test_usd_and_materialx(tmp_path, bottle_asset):
    files = bottle_asset.export_fans(tmp_path / "bottle.usda")
    names = sorted(file.rsplit("/", 1)[-1] for file in files)
    assert names == ["bottle-fans-base-color.png", "bottle-fans-normal.png", "bottle-fans-orm.png"] + [
        "bottle.mtlx",
        "bottle.usda",
    ] or "bottle-fans-emission.png" in names
    with pytest.raises(FileExistsError):
        bottle_asset.export_fans(tmp_path / "bottle.usda")
    text = (tmp_path / "bottle.usda").read_text()
    assert text.startswith("#usda 1.0") and text.count("texCoord2f[] primvars:st") == 4


def test_usd_is_valid(tmp_path, bottle_asset):
    usd = pytest.importorskip("pxr.Usd", reason="no usd-core")
    from pxr import UsdGeom, UsdShade

    bottle_asset.export_fans(tmp_path / "bottle.usda")
    stage = usd.Stage.Open(str(tmp_path / "bottle.usda"))
    (mesh,) = (UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
    assert len(mesh.GetFaceVertexCountsAttr().Get()) == len(bottle_asset.faces)
    api = UsdGeom.PrimvarsAPI(mesh)
    points = len(mesh.GetPointsAttr().Get())
    for name in ("st", "st1", "st2", "st3"):
        primvar = api.GetPrimvar(name)
        assert primvar.GetInterpolation() == "vertex" and len(primvar.Get()) == points
    extent = UsdGeom.Mesh.ComputeExtent(mesh.GetPointsAttr().Get())
    np.testing.assert_allclose(mesh.GetExtentAttr().Get(), extent, rtol=1e-6)
    subset = UsdGeom.Subset.GetAllGeomSubsets(mesh)[0]
    material = UsdShade.MaterialBindingAPI(subset.GetPrim()).ComputeBoundMaterial()[0]
    assert material.GetPrim().GetDisplayName() == bottle_asset.materials[0].name != ""
    surface_shader = material.ComputeSurfaceSource("mtlx")[0]
    assert surface_shader.GetIdAttr().Get() == "ND_standard_surface_surfaceshader"
    # Every connection leads somewhere.
    for prim in stage.Traverse():
        for attribute in prim.GetAttributes():
            for source in attribute.GetConnections():
                assert stage.GetAttributeAtPath(source), source


def test_usd_passes_pixars_validators(tmp_path, bottle_asset):
    usd = pytest.importorskip("pxr.Usd", reason="no usd-core")
    validation = pytest.importorskip("pxr.UsdValidation", reason="usd-core has no validators")
    bottle_asset.export_fans(tmp_path / "bottle.usda")
    stage = usd.Stage.Open(str(tmp_path / "bottle.usda"))
    context = validation.ValidationContext(validation.ValidationRegistry().GetOrLoadAllValidators())
    errors = {error.GetName(): error.GetMessage() for error in context.Validate(stage)}
    # usd-core comes without MaterialX's library.
    errors.pop("MissingShaderIdInRegistry", None)
    assert errors == {}


@pytest.fixture(scope="module")
def leaf_asset(tmp_path_factory, sphere):
    """With opacity in its colours."""
    trimesh = pytest.importorskip("trimesh", reason="no trimesh")
    folder = tmp_path_factory.mktemp("leaf")
    material = trimesh.visual.material.PBRMaterial(alphaMode="MASK", baseColorFactor=(0.2, 0.8, 0.3, 0.7))
    visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(sphere[0]), 2)), material=material)
    trimesh.Trimesh(*sphere, visual=visual, process=False).export(folder / "leaf.glb")
    return fantex.bake(folder / "leaf.glb", folder / "leaf.fan", texels=20_000)


@pytest.mark.parametrize("textures", ["png", "exr"])
@pytest.mark.parametrize("name", ["bottle_asset", "leaf_asset"])
def test_materialx_is_valid_and_generates_code(tmp_path, name, textures, request):
    mx = pytest.importorskip("MaterialX", reason="no MaterialX")
    import MaterialX.PyMaterialXGenShader as generate  # isort: skip (the others need its types)
    import MaterialX.PyMaterialXGenGlsl as glsl
    import MaterialX.PyMaterialXGenMdl as mdl
    import MaterialX.PyMaterialXGenMsl as msl
    import MaterialX.PyMaterialXGenOsl as osl

    request.getfixturevalue(name).export_fans(tmp_path / "bottle.usda", textures=textures)
    library = mx.createDocument()
    path = mx.getDefaultDataSearchPath()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), path, library)
    document = mx.createDocument()
    mx.readFromXmlFile(document, str(tmp_path / "bottle.mtlx"))
    document.setDataLibrary(library)
    is_valid, why = document.validate()
    assert is_valid, why
    for node in document.getNodeGraph("fans_0").getNodes():
        assert node.getNodeDef() is not None, f"{node.getCategory()} {node.getType()} {node.getName()}"
    # USD names the same definitions.
    usda = (tmp_path / "bottle.usda").read_text()
    for node in document.getNodeGraph("fans_0").getNodes():
        assert f'"{node.getNodeDef().getName()}"' in usda, node.getNodeDef().getName()
    for kind in (glsl.GlslShaderGenerator, osl.OslShaderGenerator, mdl.MdlShaderGenerator, msl.MslShaderGenerator):
        generator = kind.create()
        context = generate.GenContext(generator)
        context.registerSourceCodeSearchPath(path)
        for material in document.getMaterialNodes():
            shader = generator.generate(material.getName(), material, context)
            code = shader.getSourceCode("pixel")
            assert all(f"color{i}" in code or f"color_opacity{i}" in code for i in range(3)) and len(code) > 2000


# ---- More than one sheet: one material each, of which each reader has to find the pictures.


def blended(picture, places, corners, delta):
    """The texture function at points: ``places`` ``(n, 3, 2)`` with v downwards, ``corners`` ``(n, 2)``; linear numbers in and out."""
    l = np.concatenate([corners, 1 - corners.sum(1, keepdims=True)], 1)
    others = np.stack([np.delete(l, i, 1).max(1) for i in range(3)], 1)
    weights = np.maximum(0, l - others + delta)
    weights /= weights.sum(1, keepdims=True)
    height, width, _ = picture.shape
    x, y = places[..., 0] * width - 0.5, places[..., 1] * height - 0.5
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - left)[..., None], (y - top)[..., None]
    texel = lambda dx, dy: picture[np.clip(top + dy, 0, height - 1), np.clip(left + dx, 0, width - 1)]
    value = (texel(0, 0) * (1 - fx) + texel(1, 0) * fx) * (1 - fy) + (texel(0, 1) * (1 - fx) + texel(1, 1) * fx) * fy
    return (value * weights[..., None]).sum(1)


def decibels(a, b):
    return -10 * np.log10(np.mean((np.asarray(a, np.float64) - b) ** 2))


def agrees(asset, faces, positions, places, corners, delta, picture_of_face, seed=3):
    """PSNR of a reader's texture function and the asset's, in linear light, at one point of each face."""
    barycentric = np.random.default_rng(seed).dirichlet((1, 1, 1), len(faces))
    at = lambda values: (values[faces] * barycentric[:, :, None]).sum(1)
    points, corners = at(positions), at(corners)
    places = np.stack([at(place) for place in places], 1)
    value = np.zeros((len(faces), 3))
    for picture, of_picture in picture_of_face:
        value[of_picture] = blended(picture, places[of_picture], corners[of_picture], delta)[:, :3]
    face, found, _ = asset.nearest(points)
    return decibels(value, asset.sample(face=face, barycentric=found)[:, :3])


@pytest.fixture(scope="module", params=["bottle_asset", "scan_asset"])
def large_asset(request):
    """An asset that needs several sheets of 512 texels."""
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="module")
def scan_asset(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("scan") / "bunny.fan"
    source = lambda points, normals: pattern(points / 0.1)
    return fantex.bake(data / "meshes/bunny/stanford_bunny.ply", path, texels=200_000, source=source)


def test_sheets_of_a_glb_are_found_by_material(tmp_path, large_asset):
    image = pytest.importorskip("PIL.Image", reason="no Pillow")
    import io

    large_asset.export_fans(tmp_path / "a.glb", largest_side=512)
    document, binary = read_glb(tmp_path / "a.glb")
    views, accessors = document["bufferViews"], document["accessors"]
    assert len(document["materials"]) > 1

    def read(index, dtype, columns):
        accessor = accessors[index]
        start = views[accessor["bufferView"]]["byteOffset"] + accessor.get("byteOffset", 0)
        return np.frombuffer(binary, dtype, accessor["count"] * columns, start).reshape(-1, columns)

    worst = []
    for primitive in document["meshes"][0]["primitives"]:
        material = document["materials"][primitive["material"]]
        texture = document["textures"][material["pbrMetallicRoughness"]["baseColorTexture"]["index"]]
        view = views[document["images"][texture["source"]]["bufferView"]]
        data = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        picture = linear(np.asarray(image.open(io.BytesIO(data)).convert("RGB")) / 255)
        assert max(picture.shape) <= 512
        attributes = primitive["attributes"]
        places = [read(attributes[f"TEXCOORD_{i}"], np.float32, 2) for i in range(3)]
        faces = read(primitive["indices"], np.uint32, 1).reshape(-1, 3)
        positions = read(attributes["POSITION"], np.float32, 3) + np.array(document["nodes"][0].get("translation", (0, 0, 0)))
        corners = read(attributes["TEXCOORD_3"], np.float32, 2)
        everywhere = [(picture, np.ones(len(faces), bool))]
        delta = material["extras"]["fantexDelta"]
        worst.append(agrees(large_asset, faces, positions, places, corners, delta, everywhere))
    assert min(worst) > 50, worst


@pytest.mark.parametrize("textures", ["png", "exr"])
def test_sheets_of_a_usd_are_found_by_material(tmp_path, large_asset, textures):
    """Read by Pixar's library, pictures by OpenImageIO, which reads OpenEXR with its own."""
    usd = pytest.importorskip("pxr.Usd", reason="no usd-core")
    oiio = pytest.importorskip("OpenImageIO", reason="no OpenImageIO")
    from pxr import UsdGeom, UsdShade

    files = large_asset.export_fans(tmp_path / "a.usda", largest_side=512, textures=textures)
    assert all(file.rsplit(".", 1)[1] in (textures, "usda", "mtlx") for file in files)
    stage = usd.Stage.Open(str(tmp_path / "a.usda"))
    (mesh,) = (UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
    faces = np.asarray(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
    world = UsdGeom.XformCache().GetLocalToWorldTransform(mesh.GetPrim()).ExtractTranslation()
    positions = np.asarray(mesh.GetPointsAttr().Get()) + np.array(world)
    api = UsdGeom.PrimvarsAPI(mesh)
    *places, corners = (np.asarray(api.GetPrimvar(name).Get()) for name in ("st", "st1", "st2", "st3"))
    places = [place * (1, -1) + (0, 1) for place in places]
    pictures = []
    subsets = UsdGeom.Subset.GetAllGeomSubsets(mesh)
    assert len(subsets) > 1
    for subset in subsets:
        material = UsdShade.MaterialBindingAPI(subset.GetPrim()).ComputeBoundMaterial()[0]
        source = material.ComputeSurfaceSource("mtlx")[0].GetInput("base_color")
        # Down the graph to the pictures.
        while not source.GetPrim().GetAttribute("inputs:file"):
            shader = UsdShade.Shader(source.GetConnectedSources()[0][0].source.GetPrim())
            inputs = {name.GetBaseName(): name for name in shader.GetInputs()}
            source = inputs.get("in1", inputs.get("in", inputs.get("file")))
        file = source.GetPrim().GetAttribute("inputs:file")
        picture = np.asarray(oiio.ImageBuf(file.Get().resolvedPath).get_pixels(oiio.FLOAT))[..., :3]
        assert file.GetColorSpace() == {"png": "srgb_texture", "exr": "lin_rec709"}[textures]
        of_picture = np.zeros(len(faces), bool)
        of_picture[np.asarray(subset.GetIndicesAttr().Get())] = True
        pictures.append((linear(picture) if textures == "png" else picture, of_picture))
    assert (sum(of_picture for _, of_picture in pictures) == 1).all()
    delta = large_asset.fan_attributes().delta
    quality = agrees(large_asset, faces, positions, places, corners, delta, pictures)
    assert quality > 50, quality


def test_each_sheet_has_a_valid_graph(tmp_path, bottle_asset):
    mx = pytest.importorskip("MaterialX", reason="no MaterialX")
    bottle_asset.export_fans(tmp_path / "a.usda", largest_side=512, textures="exr")
    library = mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
    document = mx.createDocument()
    mx.readFromXmlFile(document, str(tmp_path / "a.mtlx"))
    document.setDataLibrary(library)
    is_valid, why = document.validate()
    assert is_valid, why
    # The library's own are in the data library, whose graphs come along.
    graphs = [graph for graph in document.getNodeGraphs() if graph.getName().startswith("fans_")]
    assert len(graphs) == len(document.getMaterialNodes()) > 1
    read = {
        node.getInput("file").getValueString() for graph in graphs for node in graph.getNodes("image")
    }
    assert read == {file.name for file in tmp_path.glob("*.exr")}
