"""Shaders that exports with fans carry, run by other programs and compared with the asset."""

import json
import os
import shlex
import subprocess
from pathlib import Path

import numpy as np
import pytest

import fantex
from conftest import pattern

SIZE = (320, 240)

VERTEX = """
#version 420
in vec3 position;
in vec2 place0, place1, place2, place3;
layout(location = 0) out vec2 uv0;
layout(location = 1) out vec2 uv1;
layout(location = 2) out vec2 uv2;
layout(location = 3) out vec2 corner;
uniform mat4 clip_from_world;
void main() {
    uv0 = place0; uv1 = place1; uv2 = place2; corner = place3;
    gl_Position = clip_from_world * vec4(position, 1.0);
}
"""

GLSL = """
layout(location = 0) in vec2 uv0;
layout(location = 1) in vec2 uv1;
layout(location = 2) in vec2 uv2;
layout(location = 3) in vec2 corner;
layout(location = 0) out vec4 value;
layout(location = 1) out vec4 place;
uniform sampler2D sheet;
uniform bool is_normal;
void main() {
    vec3 weights = fan_weights(corner);
    if (is_normal) value = vec4(fan_normal(sheet, uv0, uv1, uv2, weights), 1.0);
    else value = fan_sample(sheet, uv0, uv1, uv2, weights);
    place = vec4(float(gl_PrimitiveID) + 1.0, corner, 0.0);
}
"""

HLSL = """
#define FAN_SAMPLE(sheet, sheetSampler, uv) sheet.SampleLevel(sheetSampler, uv, 0)
%s
Texture2D<float4> sheet : register(t0);
Buffer<float2> places : register(t1);
SamplerState sheetSampler : register(s0);
RWBuffer<float4> values : register(u0);
[numthreads(1, 1, 1)]
void main(uint3 id : SV_DispatchThreadID)
{
    uint at = 4 * id.x;
    float3 weights = FanWeights(places[at + 3]);
    values[id.x] = %s(sheet, sheetSampler, places[at], places[at + 1], places[at + 2], weights).xyzz;
}
"""

PIXEL_HLSL = """
Texture2D sheet : register(t0);
SamplerState sheetSampler : register(s0);
float4 main(float2 uv0 : TEXCOORD0, float2 uv1 : TEXCOORD1, float2 uv2 : TEXCOORD2, float2 corner : TEXCOORD3) : SV_Target
{
    float3 weights = FanWeights(corner);
    return FanSample(sheet, sheetSampler, uv0, uv1, uv2, weights)
        + float4(FanNormal(sheet, sheetSampler, uv0, uv1, uv2, weights), 1.0);
}
"""


def read_gltf(path):
    """Positions, four coordinates and triangles of a model with one primitive."""
    document = json.loads(path.read_text())
    binary = path.with_suffix(".bin").read_bytes()
    (primitive,) = document["meshes"][0]["primitives"]

    def read(index, dtype, columns):
        accessor = document["accessors"][index]
        start = document["bufferViews"][accessor["bufferView"]]["byteOffset"] + accessor.get("byteOffset", 0)
        return np.frombuffer(binary, dtype, accessor["count"] * columns, start).reshape(-1, columns)

    attributes = primitive["attributes"]
    places = [read(attributes[f"TEXCOORD_{i}"], np.float32, 2) for i in range(4)]
    return read(attributes["POSITION"], np.float32, 3), places, read(primitive["indices"], np.uint32, 1)


def drawn(path, channel):
    """Values, faces and barycentric coordinates of the pixels that see the model, by OpenGL."""
    moderngl = pytest.importorskip("moderngl", reason="no moderngl")
    try:
        context = moderngl.create_standalone_context(backend="egl")
    except Exception as error:
        pytest.skip(f"no OpenGL ({error})")
    from PIL import Image

    positions, places, triangles = read_gltf(path)
    functions = path.with_suffix(".glsl").read_text()
    program = context.program(vertex_shader=VERTEX, fragment_shader="#version 420\n" + functions + GLSL)
    center = (positions.max(0) + positions.min(0)) / 2
    radius = np.linalg.norm(positions - center, axis=1).max()
    turn = np.array([[0.8, 0, -0.6], [0.36, 0.8, 0.48], [0.48, -0.6, 0.64]])
    clip = np.eye(4)
    clip[:3, :3] = turn / radius * np.array([[SIZE[1] / SIZE[0]], [1], [-0.5]])
    clip[:3, 3] = -clip[:3, :3] @ center
    program["is_normal"] = channel == "normal"
    program["clip_from_world"].write(clip.T.astype("f4").tobytes())
    interleaved = np.concatenate([positions, *places], 1).astype("f4")
    vertices = context.buffer(interleaved.tobytes())
    names = ["position", *(f"place{i}" for i in range(4))]
    layout = [(vertices, "3f 2f 2f 2f 2f", *names)]
    array = context.vertex_array(program, layout, context.buffer(triangles.tobytes()))
    picture = np.asarray(Image.open(path.with_name(f"{path.stem}-fans-{channel}.png")))
    height, width, components = picture.shape
    # GL_SRGB8 and GL_SRGB8_ALPHA8.
    encoded = {3: 0x8C41, 4: 0x8C43}[components] if channel in ("base-color", "emission") else None
    if channel == "normal":
        picture = normals_of(path)
    kind = "f4" if channel == "normal" else "f1"
    sheet = context.texture((width, height), components, picture.tobytes(), 0, alignment=1, dtype=kind, internal_format=encoded)
    sheet.filter = (moderngl.LINEAR, moderngl.LINEAR)
    sheet.use(0)
    targets = [context.texture(SIZE, 4, dtype="f4") for _ in range(2)]
    frame = context.framebuffer(targets, context.depth_renderbuffer(SIZE))
    frame.use()
    context.clear()
    context.enable(moderngl.DEPTH_TEST)
    array.render()
    value, place = (np.frombuffer(target.read(), np.float32).reshape(-1, 4) for target in targets)
    context.release()
    seen = place[:, 0] > 0
    place = place[seen]
    barycentric = np.stack([place[:, 1], place[:, 2], 1 - place[:, 1] - place[:, 2]], 1)
    return value[seen], place[:, 0].astype(np.int64) - 1, barycentric


def normals_of(path):
    """The sheet of normals, whose 16 bits Pillow does not read: 0..1."""
    oiio = pytest.importorskip("OpenImageIO", reason="no OpenImageIO")
    buffer = oiio.ImageBuf(str(path.with_name(f"{path.stem}-fans-normal.png")))
    return np.ascontiguousarray(buffer.get_pixels(oiio.FLOAT)[..., :3])


def computed(path, channel, face, barycentric):
    """Values at points, by functions in HLSL that Microsoft's compiler has translated."""
    compushady = pytest.importorskip("compushady", reason="no compushady (a compiler for HLSL)")
    hlsl = pytest.importorskip("compushady.shaders.hlsl", reason="no compushady (a compiler for HLSL)")
    from compushady import formats
    from PIL import Image

    functions = path.with_suffix(".hlsl").read_text()
    # With derivatives, as pixel shaders have them.
    assert hlsl.dxc.compile(functions + PIXEL_HLSL, "main", compushady.SHADER_BINARY_TYPE_SPIRV, "ps_6_0")
    if not any(device.is_hardware or "llvmpipe" in device.name for device in compushady.get_discovered_devices()):
        pytest.skip("no Vulkan")
    _, places, triangles = read_gltf(path)
    corners = np.stack([place[triangles.reshape(-1, 3)[face]] for place in places], 1)
    queries = (corners * barycentric[:, None, :, None]).sum(2).astype(np.float32)
    if channel == "normal":
        picture = normals_of(path)
        picture = np.concatenate([picture, np.ones_like(picture[..., :1])], 2).astype(np.float32)
    else:
        picture = np.asarray(Image.open(path.with_name(f"{path.stem}-fans-{channel}.png")).convert("RGBA"))
    height, width, _ = picture.shape
    kind = {"normal": formats.R32G32B32A32_FLOAT, "base-color": formats.R8G8B8A8_UNORM_SRGB}
    sheet = compushady.Texture2D(width, height, kind.get(channel, formats.R8G8B8A8_UNORM))
    upload = compushady.Buffer(sheet.size, compushady.HEAP_UPLOAD)
    texel = picture.itemsize * 4
    upload.upload2d(picture.tobytes(), sheet.row_pitch, width, height, texel)
    upload.copy_to(sheet)
    points = compushady.Buffer(queries.nbytes, format=formats.R32G32_FLOAT)
    upload = compushady.Buffer(queries.nbytes, compushady.HEAP_UPLOAD)
    upload.upload(queries.tobytes())
    upload.copy_to(points)
    values = compushady.Buffer(16 * len(face), format=formats.R32G32B32A32_FLOAT)
    clamp, linear = compushady.SAMPLER_ADDRESS_MODE_CLAMP, compushady.SAMPLER_FILTER_LINEAR
    sampler = compushady.Sampler(clamp, clamp, clamp, linear, linear)
    function = "FanNormal" if channel == "normal" else "FanSample"
    compute = compushady.Compute(hlsl.compile(HLSL % (functions, function)), srv=[sheet, points], uav=[values], samplers=[sampler])
    compute.dispatch(len(face), 1, 1)
    result = compushady.Buffer(values.size, compushady.HEAP_READBACK)
    values.copy_to(result)
    return np.frombuffer(result.readback(), np.float32).reshape(-1, 4)


def psnr(a, b):
    return -10 * np.log10(np.mean((np.asarray(a, np.float64) - b) ** 2))


MODELS = ["bottle", "sphere", "spot", "bunny", "teapot"]


@pytest.fixture(scope="module", params=MODELS)
def exported(request, tmp_path_factory):
    """An asset, and its model with sheets and shaders."""
    folder = tmp_path_factory.mktemp(request.param)
    mesh, source = request.getfixturevalue("bottle" if request.param == "bottle" else "sphere"), None
    if request.param not in ("bottle", "sphere"):
        files = {"spot": "spot/spot_triangulated.obj", "bunny": "bunny/stanford_bunny.ply", "teapot": "teapot.stl"}
        mesh = request.getfixturevalue("data") / "meshes" / files[request.param]
    size = {"sphere": 1.0, "spot": 1.0, "bunny": 0.1, "teapot": 10.0}.get(request.param)
    if size:
        source = lambda points, normals: pattern(points / size)
    asset = fantex.bake(mesh, folder / "a.fan", texels=200_000, source=source)
    asset.export_fans(folder / "a.gltf", shaders=["glsl", "hlsl", "wgsl", "godot"])
    return asset, folder / "a.gltf"


def check(asset, channel, value, face, barycentric):
    truth = asset.sample(face=face, barycentric=barycentric, channel=channel)[:, :3]
    if channel == "normal":
        # Triangles smaller than a texel lose their own vertex normals.
        assert np.median((value[:, :3] * truth).sum(1)) > 0.9999
    else:
        assert psnr(value[:, :3], truth) > 50, channel


def channels_of(asset):
    return [channel for channel in ("base-color", "orm", "normal") if channel in asset.channels]


def test_glsl_gives_the_texture_function(exported):
    """In pictures of the model."""
    asset, path = exported
    for channel in channels_of(asset):
        value, face, barycentric = drawn(path, channel)
        assert len(value) > 5000
        check(asset, channel, value, face, barycentric)


def test_hlsl_gives_the_texture_function(exported):
    """On points all over the surface."""
    asset, path = exported
    random = np.random.default_rng(9)
    face, barycentric = random.integers(len(asset.faces), size=20_000), random.dirichlet((1, 1, 1), 20_000)
    for channel in channels_of(asset):
        check(asset, channel, computed(path, channel, face, barycentric), face, barycentric)


def test_godot_shows_what_the_renderer_does(tmp_path, bottle):
    """An unlit model, from near."""
    program = os.environ.get("FANTEX_GODOT")
    if not program:
        pytest.skip("no Godot 4 (FANTEX_GODOT, with a display)")
    from PIL import Image

    for file in bottle.parent.iterdir():
        if file.suffix in (".bin", ".png"):
            (tmp_path / file.name).write_bytes(file.read_bytes())
    document = json.loads(bottle.read_text())
    for material in document["materials"]:
        material.setdefault("extensions", {})["KHR_materials_unlit"] = {}
        material.pop("emissiveTexture", None), material.pop("emissiveFactor", None)
    document["extensionsUsed"] = ["KHR_materials_unlit"]
    (tmp_path / "unlit.gltf").write_text(json.dumps(document))
    asset = fantex.bake(tmp_path / "unlit.gltf", tmp_path / "a.fan", texels=20_000)
    project = tmp_path / "project"
    project.mkdir()
    asset.export_fans(project / "model.gltf", shaders=["godot"])
    view = {"eye": (0.12, 0.1, 0.4), "target": (0, 0, 0), "fov": 30, "size": SIZE}
    view["sheets"] = {"base_color": "base-color"}
    for uniform, channel in (("orm", "orm"), ("object_normal", "normal")):
        if channel in asset.channels:
            view["sheets"][uniform] = channel
    (project / "view.json").write_text(json.dumps(view))
    (project / "draw.gd").write_text((Path(__file__).parent / "godot_picture.gd").read_text())
    (project / "project.godot").write_text("config_version=5\n")
    command = [*shlex.split(program), "--path", str(project), "--rendering-method", "forward_plus", "--audio-driver", "Dummy"]
    done = subprocess.run([*command, "--script", "res://draw.gd"], capture_output=True, text=True, timeout=120)
    assert "SHADER ERROR" not in done.stderr + done.stdout and (project / "picture.png").exists(), done.stderr
    seen = np.asarray(Image.open(project / "picture.png").convert("RGB")).astype(float) / 255
    camera = fantex.Camera(eye=view["eye"], target=view["target"], fov=view["fov"])
    truth = np.asarray(asset.render(SIZE, camera, samples=1, transparent=True)).astype(float) / 255
    inside = truth[..., 3] == 1
    for shift in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        inside &= np.roll(truth[..., 3], shift, (0, 1)) == 1
    assert inside.sum() > 8000
    assert psnr(seen[inside], truth[inside][:, :3]) > 50
