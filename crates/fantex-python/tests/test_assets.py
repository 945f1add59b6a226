"""From meshes to assets and out again."""

import json
import os
import pickle
import re
import signal
import subprocess
import sys
import threading
import time
import warnings

import numpy as np
import pytest

import fantex
from conftest import grid_sphere, pattern


def test_samples_are_the_source(waves, sphere):
    positions, faces = sphere
    random = np.random.default_rng(7)
    face = random.integers(0, len(waves.faces), 4000)
    barycentric = random.dirichlet((1, 1, 1), 4000)
    points = (waves.positions[waves.faces[face]] * barycentric[:, :, None]).sum(1)
    sampled = waves.sample(face=face, barycentric=barycentric)
    assert sampled.shape == (4000, 4) and sampled.dtype == np.float32
    assert np.abs(sampled[:, :3] - pattern(points)).max() < 2e-3
    # Points beside the surface get the value of the nearest point.
    nearby = waves.sample(points * 1.01)
    assert np.abs(nearby - sampled).max() < 0.02
    found, weights, places = waves.nearest(points)
    np.testing.assert_allclose(places, points, atol=1e-6)
    again = (waves.positions[waves.faces[found]] * weights[:, :, None]).sum(1)
    np.testing.assert_allclose(again, points, atol=1e-6)


def test_one_point_and_no_point(waves):
    one = waves.sample([0, 0, 1])
    assert one.shape == (4,)
    np.testing.assert_allclose(one[:3], pattern([[0, 0, 1]])[0], atol=0.01)
    values = waves.sample([[0, 0, 1], [np.nan, 0, 0]])
    assert np.isnan(values[1]).all() and not np.isnan(values[0]).any()
    assert waves.sample([0, 0, 1], srgb=True).dtype == np.uint8


def test_footprints_average(waves):
    coarse = waves.sample([[0, 0, 1]], footprint=2.0)
    fine = waves.sample([[0, 0, 1]])
    assert np.abs(coarse - fine).max() > 0.02


def test_wrong_questions(waves):
    with pytest.raises(KeyError, match="no channel .*roughness.*it has base-color"):
        waves.sample([[0, 0, 1]], channel="roughness")
    with pytest.raises(IndexError, match="there is no face 99999999"):
        waves.sample(face=[99999999], barycentric=[[1, 0, 0]])
    with pytest.raises(TypeError, match="strokes is of type int; expected a path"):
        waves.paint(123)
    for length in (-1, float("nan"), float("inf"), [1, 2]):
        with pytest.raises(ValueError, match="footprint has"):
            waves.sample([0, 0, 1], footprint=length)
    with pytest.raises(ValueError, match="points, or face and barycentric"):
        waves.sample()
    with pytest.raises(FileNotFoundError):
        fantex.open("nowhere.fan")


def test_functions_in_python(tmp_path, sphere):
    # sRGB bytes, alone and with alpha.
    asset = fantex.bake(
        sphere,
        tmp_path / "a.fan",
        texels=20_000,
        source=lambda points, normals: (np.clip(normals * 0.5 + 0.5, 0, 1) * 255).astype(np.uint8),
    )
    assert np.abs(asset.sample([0, 1, 0], srgb=True)[:3].astype(int) - (128, 255, 128)).max() < 6

    def broken(points, normals):
        raise RuntimeError("no idea")

    with pytest.raises(RuntimeError, match="no idea"):
        fantex.bake(sphere, tmp_path / "b.fan", texels=20_000, source=broken)
    with pytest.raises(ValueError, match="the source's result has the shape"):
        fantex.bake(sphere, tmp_path / "b.fan", texels=20_000, source=lambda p, n: np.zeros((7, 3)))
    assert not (tmp_path / "b.fan").exists()
    with pytest.raises(FileExistsError, match="overwrite=True"):
        fantex.bake(sphere, tmp_path / "a.fan", texels=20_000, source=pattern)


def test_large_triangles_are_cut_for_functions_that_ask_for_it(tmp_path):
    bent = [[0, 0, 0], [1, 0, 0], [1, 1, 0.5], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]]
    settings = {"texels": 1e5, "source": lambda points, normals: points, "format": "float"}
    whole = fantex.bake(bent, tmp_path / "whole.fan", **settings)
    cut = fantex.bake(bent, tmp_path / "cut.fan", longest_edge=16, **settings)
    assert whole.baked["triangles"] == 2 and cut.baked["triangles"] > 100
    points = cut.positions[cut.faces].mean(1)
    assert np.abs(cut.sample(points)[:, :3] - points).max() < 0.02
    plan = fantex.plan(bent, tmp_path / "a.plan", longest_edge=16, **settings)
    fantex.bake_part(plan, (1, 1), tmp_path / "1.part", mesh=bent, source=settings["source"])
    fantex.merge(plan, [tmp_path / "1.part"], tmp_path / "merged.fan")
    assert (tmp_path / "merged.fan").read_bytes() == (tmp_path / "cut.fan").read_bytes()


def test_textures_are_cut_at_hard_edges_where_that_is_asked_for(tmp_path):
    corners = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    cube = corners, [face for a, b, c, d in sides for face in ([a, b, c], [a, c, d])]
    settings = {"texels": 2e4, "source": fantex.solid("marble"), "longest_edge": 0}
    whole = fantex.bake(cube, tmp_path / "whole.fan", **settings)
    assert whole.info["hard_edges"] is None and whole.verify()["hard_edges"] == 0
    cut = fantex.bake(cube, tmp_path / "cut.fan", hard_edges=60, **settings)
    report = cut.verify()
    assert cut.info["hard_edges"] == 60 and report["ok"] and report["hard_edges"] == 12
    assert 0 < report["largest_hard_jump"] < 0.5 and report["largest_jump"] < 1e-6
    plan = fantex.plan(cube, tmp_path / "a.plan", hard_edges=60, **settings)
    fantex.bake_part(plan, (1, 1), tmp_path / "1.part", mesh=cube)
    fantex.merge(plan, [tmp_path / "1.part"], tmp_path / "merged.fan")
    assert (tmp_path / "merged.fan").read_bytes() == (tmp_path / "cut.fan").read_bytes()
    with pytest.raises(ValueError, match="an angle of 0 to 180 degrees between the normals"):
        fantex.bake(cube, tmp_path / "b.fan", hard_edges=200, **settings)


def test_the_light_of_a_model_does_not_cover_a_function(tmp_path, bottle):
    """A factor that scales a texture of emission says nothing without it."""
    black = lambda points, normals: np.zeros_like(points)
    asset = fantex.bake(bottle, tmp_path / "a.fan", texels=20_000, source=black)
    picture = asset.render((60, 40), samples=1, transparent=True)
    assert picture[picture[..., 3] == 255][:, :3].mean() < 60


def test_progress_may_end_a_bake(tmp_path, sphere):
    seen = []

    def progress(done, total):
        seen.append((done, total))
        if len(seen) == 2:
            raise StopIteration("enough")

    slow = lambda points, normals: (time.sleep(0.002), pattern(points))[1]
    with pytest.raises(StopIteration, match="enough"):
        fantex.bake(sphere, tmp_path / "a.fan", texels=30_000_000, source=slow, progress=progress)
    assert not os.listdir(tmp_path)
    assert seen[0][1] > 0


def test_what_the_last_call_raises_comes_after_the_file(tmp_path, sphere):
    def progress(done, total, step):
        if step == "baking" and done == total:
            raise RuntimeError("too late")

    with pytest.raises(RuntimeError, match="too late"):
        fantex.bake(sphere, tmp_path / "a.fan", texels=20_000, source=fantex.solid("marble"), progress=progress)
    assert fantex.open(tmp_path / "a.fan").verify()["ok"]


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize("tool", ["paint", "blur"])
def test_ctrl_c_leaves_an_asset_as_it_was(tmp_path, tool):
    """Tools that read the surface make what was painted before them durable."""
    asset = fantex.bake(grid_sphere(), tmp_path / "a.fan", texels=2_000_000, source=pattern, tile=256)
    asset.close()
    content = (tmp_path / "a.fan").read_bytes()
    script = (
        "import fantex, math, os, signal, sys, threading\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "samples = [{'at': {'position': [math.cos(t / 10), math.sin(t / 10), 0]}} for t in range(60)]\n"
        "stroke = {'brush': {'size': {'texels': 600}, 'hardness': 0.5}, 'samples': samples,\n"
        "    'channels': [{'kind': 'base_color', 'color': {'srgb': [1, 0, 0]}}]}\n"
        "blur = {**stroke, 'tool': {'blur': {'radius': {'texels': 4}}}}\n"
        "strokes = [stroke, blur if sys.argv[2] == 'blur' else stroke, stroke]\n"
        "asset = fantex.open(sys.argv[1])\n"
        "timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))\n"
        "timer.start()\n"
        "try:\n"
        "    asset.paint(strokes)\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted', flush=True)\n"
    )
    command = [sys.executable, "-c", script, str(tmp_path / "a.fan"), tool]
    assert subprocess.run(command, stdout=subprocess.PIPE, text=True, timeout=300).stdout == "interrupted\n"
    assert os.listdir(tmp_path) == ["a.fan"]
    points = np.random.default_rng(8).normal(size=(2000, 3))
    after = fantex.open(tmp_path / "a.fan").sample(points)
    (tmp_path / "a.fan").write_bytes(content)
    np.testing.assert_array_equal(after, fantex.open(tmp_path / "a.fan").sample(points))


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_ends_a_bake(tmp_path):
    script = (
        "import fantex, os, signal, sys, time\n"
        "import numpy as np\n"
        f"sys.path.insert(0, {os.path.dirname(__file__)!r})\n"
        "from conftest import grid_sphere\n"
        # Processes in the background may inherit that it is ignored.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "def slow(points, normals):\n"
        # In one piece: several threads ask.
        "    os.write(1, b'go\\n')\n"
        "    time.sleep(0.01)\n"
        "    return np.zeros((len(points), 3))\n"
        "try:\n"
        f"    fantex.bake(grid_sphere(), {str(tmp_path / 'a.fan')!r}, texels=1e9, source=slow)\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted', flush=True)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "go\n"
    process.send_signal(signal.SIGINT)
    rest = process.communicate(timeout=120)[0]
    assert rest.splitlines()[-1] == "interrupted"
    assert not os.listdir(tmp_path)


def test_the_lock_is_released(tmp_path, sphere):
    """Another thread goes on while a bake runs."""
    ticks, done = [0], threading.Event()

    def tick():
        while not done.is_set():
            ticks[0] += 1
            time.sleep(0.001)

    thread = threading.Thread(target=tick)
    thread.start()
    try:
        before = ticks[0]
        fantex.bake(sphere, tmp_path / "a.fan", texels=2_000_000, source=fantex.solid("marble"))
        assert ticks[0] - before > 5
    finally:
        done.set()
        thread.join()


def test_own_materials_pictures_and_exports(tmp_path, bottle):
    asset = fantex.bake(bottle, tmp_path / "bottle.fan", texels=150_000)
    assert asset.channels[0] == "base-color" and "normal" in asset.channels
    assert asset.baked["texels"] > 100_000 and asset.baked["channels"] == asset.channels
    picture = asset.render(size=(160, 120), samples=2)
    assert picture.shape == (120, 160, 4) and picture.dtype == np.uint8
    assert picture.std() > 10
    assert picture._repr_png_()[:8] == b"\x89PNG\r\n\x1a\n"
    center = asset.positions.mean(0)
    size = np.ptp(asset.positions, axis=0).max()
    front = fantex.Camera(center + (0, 0, 2 * size), center)
    clear = asset.render(size=(80, 80), camera=front, samples=2, transparent=True)
    assert clear[0, 0, 3] == 0 and clear[40, 40, 3] == 255

    atlas = asset.atlas(resolution=256)
    np.testing.assert_array_equal(atlas.vmapping[atlas.faces], asset.faces)
    assert atlas.images["base-color"].shape[:2] == (256, 256)
    # Texels of the atlas are those of the asset.
    random = np.random.default_rng(1)
    face = random.integers(0, len(asset.faces), 3000)
    barycentric = random.dirichlet((4, 4, 4), 3000)
    uv = (atlas.uvs[atlas.faces[face]] * barycentric[:, :, None]).sum(1)
    x, y = (uv[:, 0] * 256).astype(int).clip(0, 255), ((1 - uv[:, 1]) * 256).astype(int).clip(0, 255)
    looked_up = atlas.images["base-color"][y, x, :3].astype(int)
    sampled = asset.sample(face=face, barycentric=barycentric, srgb=True)[:, :3].astype(int)
    assert np.median(np.abs(looked_up - sampled)) <= 4

    files = asset.export(tmp_path / "bottle.glb", resolution=256)
    assert files == [str(tmp_path / "bottle.glb")]
    with pytest.raises(FileExistsError):
        asset.export(tmp_path / "bottle.glb", resolution=256)
    report = asset.verify()
    assert report["ok"] and report["largest_jump"] <= report["bound"] and "contradictions" not in report
    report = asset.verify(texels=True)
    assert report["ok"] and report["contradictions"] == 0 and report["texels_compared"] > 1_000


def test_a_model_in_one_step(tmp_path, sphere):
    """A function becomes a GLB whose texture is the function."""
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("PIL")
    path = tmp_path / "ball.glb"
    reports = []
    made = fantex.bake_model(sphere, path, source=pattern, resolution=512, progress=lambda *at: reports.append(at))
    assert made["files"] == [str(path)] and made["resolution"] == 512 and made["channels"] == ["base-color"]
    assert made["charts"] > 1 and 0.4 < made["used_share"] < 1 and reports[-1] == (512 * 512, 512 * 512)
    assert made["bytes"] == path.stat().st_size
    scene = trimesh.load(path, process=False)
    (mesh,) = scene.geometry.values()
    image = np.asarray(mesh.visual.material.baseColorTexture)[..., :3] / 255.0
    linear = np.where(image <= 0.04045, image / 12.92, ((image + 0.055) / 1.055) ** 2.4)
    random = np.random.default_rng(3)
    face = random.integers(0, len(mesh.faces), 5000)
    weights = random.dirichlet((1, 1, 1), 5000)[:, :, None]
    points = (mesh.vertices[mesh.faces[face]] * weights).sum(1)
    # trimesh has v upwards.
    uv = (mesh.visual.uv[mesh.faces[face]] * weights).sum(1) * [1, -1] + [0, 1]
    at = uv * 512 - 0.5
    x, y = np.floor(at).astype(int).T
    fx, fy = (at - np.floor(at)).T[:, :, None]
    read = (linear[y, x] * (1 - fx) + linear[y, x + 1] * fx) * (1 - fy) + (
        linear[y + 1, x] * (1 - fx) + linear[y + 1, x + 1] * fx
    ) * fy
    assert np.abs(read - pattern(points)).max() < 0.02
    with pytest.raises(FileExistsError):
        fantex.bake_model(sphere, path, source=pattern, resolution=512)
    with pytest.raises(ValueError, match="texels and resolution"):
        fantex.bake_model(sphere, tmp_path / "x.glb", source=pattern, texels=1e5, resolution=512)
    with pytest.raises(ValueError, match="give a path"):
        fantex.bake_model(sphere, "s3://a/x.glb", source=pattern)
    with pytest.raises(ValueError, match=".glb or .gltf"):
        fantex.bake_model(sphere, tmp_path / "x.fan", source=pattern)

    def broken(points, normals):
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        fantex.bake_model(sphere, tmp_path / "x.glb", source=broken)
    assert [file.name for file in tmp_path.iterdir()] == ["ball.glb"]


def test_to_trimesh(tmp_path, bottle):
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("PIL")
    asset = fantex.bake(bottle, tmp_path / "bottle.fan", texels=60_000)
    mesh = asset.to_trimesh(256)
    mesh.export(tmp_path / "out.glb")
    back = trimesh.load(tmp_path / "out.glb", force="mesh")
    assert len(back.faces) == len(asset.faces)
    # The picture lies as trimesh thinks it does: a bake of the result shows the same colours.
    again = fantex.bake(tmp_path / "out.glb", tmp_path / "again.fan", texels=60_000)
    points = asset.positions[asset.faces[::7]].mean(1)
    difference = again.sample(points)[:, :3] - asset.sample(points)[:, :3]
    assert np.median(np.abs(difference)) < 0.03


def test_light_and_opacity_go_to_trimesh(tmp_path, bottle, sphere):
    pytest.importorskip("trimesh")
    pytest.importorskip("PIL")
    glowing = fantex.bake(bottle, tmp_path / "bottle.fan", texels=60_000)
    material = glowing.to_trimesh(128).visual.material
    assert material.emissiveTexture.size == (128, 128) and material.emissiveFactor.tolist() == [1, 1, 1]
    assert material.alphaMode is None and glowing.materials[0].alpha == "opaque"
    asset = fantex.bake(sphere, tmp_path / "a.fan", texels=20_000, source=lambda p, n: np.ones((len(p), 4)) / 2)
    for alpha, mode, threshold in (("blend", "BLEND", None), ("cut-out", "MASK", 0.5), ("opaque", None, None)):
        asset.paint(alpha=alpha)
        assert [used[:3] for used in asset.materials] == [("", alpha, threshold)]
        material = asset.to_trimesh(64).visual.material
        assert (material.alphaMode, material.alphaCutoff) == (mode, threshold)


def two_triangles(folder, materials, **more):
    """A glTF file with a triangle for each of two materials, the second above the first and smaller."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0, 1], [0, 0.5, 1]], "<f4")
    (folder / "a.bin").write_bytes(points.tobytes() + np.ascontiguousarray(points[:3, :2]).tobytes())
    views = [{"buffer": 0, "byteOffset": start, "byteLength": size} for start, size in ((0, 36), (36, 36), (72, 24))]
    accessors = [
        {"bufferView": number, "componentType": 5126, "count": 3, "type": kind}
        for number, kind in enumerate(("VEC3", "VEC3", "VEC2"))
    ]
    parts = [{"attributes": {"POSITION": number, "TEXCOORD_0": 2}, "material": number} for number in (0, 1)]
    gltf = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": parts}],
        "materials": materials,
        "buffers": [{"uri": "a.bin", "byteLength": 96}],
        "bufferViews": views,
        "accessors": accessors,
        **more,
    }
    (folder / "a.gltf").write_text(json.dumps(gltf))
    return folder / "a.gltf"


@pytest.fixture
def lamp(tmp_path):
    """An asset that emits 8, 4, 2 everywhere."""
    light = np.tile(np.array([255, 188, 137], np.uint8), (4, 4, 1)).view(fantex.Picture)
    light.save(tmp_path / "light.png")
    material = {
        "emissiveTexture": {"index": 0},
        "emissiveFactor": [1, 1, 1],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 8}},
    }
    pictures = {"images": [{"uri": "light.png"}], "textures": [{"source": 0}]}
    model = two_triangles(tmp_path, [material, material], extensionsUsed=["KHR_materials_emissive_strength"], **pictures)
    return fantex.bake(model, tmp_path / "lamp.fan", texels=4000)


def test_bright_light_keeps_its_scale(lamp):
    light = lamp.sample(face=[0], barycentric=[[1 / 3] * 3], channel="emission")[0, :3]
    np.testing.assert_allclose(light, [8, 4, 2], rtol=0.05)
    atlas = lamp.atlas(64)
    assert atlas.scales.keys() == atlas.images.keys() and atlas.scales["emission"] == pytest.approx(8, rel=0.05)
    _, _, _, images = atlas
    assert images is atlas.images and pickle.loads(pickle.dumps(atlas)).scales == atlas.scales
    at = (atlas.uvs[atlas.faces[0]].mean(0) * [64, -64] + [0, 64]).astype(int)
    encoded = atlas.images["emission"][at[1], at[0]] / 255.0
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(linear * atlas.scales["emission"], light, rtol=0.05)


def test_bright_light_goes_to_trimesh(lamp):
    pytest.importorskip("trimesh")
    pytest.importorskip("PIL")
    with pytest.warns(UserWarning, match="emission of up to [78][.].* trimesh holds no more than 1"):
        material = lamp.to_trimesh(64).visual.material
    assert material.emissiveFactor.tolist() == [1, 1, 1]


def test_exports_say_what_they_lack(tmp_path, lamp):
    with pytest.warns(UserWarning) as told:
        lamp.export_channels({"emission": tmp_path / "e.png"}, resolution=16)
    said = [str(warning.message) for warning in told]
    assert {warning.filename for warning in told} == {__file__}
    assert any(re.search("e.png: 16 texels a side hold .* of the asset's density; give a larger resolution=", note) for note in said)
    assert any(re.search("e.png: emission of up to [78][.].* is cut off at 1 in PNG", note) for note in said)
    with pytest.warns(UserWarning, match="a padding of .* instead of the 64 asked for: .* give a larger resolution="):
        lamp.export(tmp_path / "a.glb", resolution=128, padding=64)


def test_models_say_what_they_lack(tmp_path, sphere):
    settings = {"source": pattern, "largest_side": 64}
    made = fantex.bake_model(sphere, tmp_path / "a.glb", texels=1e6, **settings)
    assert any("64 texels a side hold" in note for note in made["notes"]), made["notes"]
    # Who asks for a side does not ask for a density.
    made = fantex.bake_model(sphere, tmp_path / "b.glb", source=pattern, resolution=64)
    assert not any("texels a side" in note for note in made["notes"]), made["notes"]


def test_materials_of_faces(tmp_path):
    """One of the two is cut out."""
    materials = [{"name": "wall"}, {"name": "leaf", "alphaMode": "MASK", "alphaCutoff": 0.25}]
    model = two_triangles(tmp_path, materials)
    asset = fantex.bake(model, tmp_path / "a.fan", texels=4000, source=fantex.solid("marble"), longest_edge=0)
    assert [used[:3] for used in asset.materials] == [("wall", "opaque", None), ("leaf", "cut-out", 0.25)]
    assert [used.double_sided for used in asset.materials] == [False, False]
    heights = asset.positions[asset.faces].mean(1)[:, 2]
    assert asset.face_materials.dtype == np.uint32 and asset.face_materials.tolist() == heights.round().tolist()


def gold_and_sign(folder):
    """An asset of two materials that differ in colours alone, and so have no other channel: gold that glows, and an unlit sign."""
    shine = {"metallicFactor": 1, "roughnessFactor": 0.125}
    gold = {"name": "gold", "pbrMetallicRoughness": {**shine, "baseColorFactor": [1, 0.75, 0.25, 1]}}
    sign = {"name": "sign", "pbrMetallicRoughness": shine, "extensions": {"KHR_materials_unlit": {}}, "doubleSided": True}
    gold["emissiveFactor"] = sign["emissiveFactor"] = [0.25, 0.125, 0]
    model = two_triangles(folder, [gold, sign], extensionsUsed=["KHR_materials_unlit"])
    return fantex.bake(model, folder / "gold.fan", texels=4000)


def test_factors_of_materials(tmp_path):
    asset = gold_and_sign(tmp_path)
    assert asset.channels == ["base-color"]
    gold, sign = asset.materials
    assert gold[:6] == ("gold", "opaque", None, (1, 0.75, 0.25, 1), 1, 0.125) and gold.emission == (0.25, 0.125, 0)
    assert (gold.unlit, gold.double_sided, sign.unlit, sign.double_sided) == (False, False, True, True)


def test_factors_go_to_trimesh(tmp_path):
    pytest.importorskip("trimesh")
    pytest.importorskip("PIL")
    asset = gold_and_sign(tmp_path)
    material = asset.to_trimesh(64).visual.material
    # Gold has more of the surface.
    assert (material.metallicFactor, material.roughnessFactor) == (1, 0.125)
    assert material.emissiveFactor.tolist() == [0.25, 0.125, 0] and material.doubleSided


def test_a_mesh_onto_another(tmp_path, sphere):
    fine = grid_sphere(80, 160)
    colors = pattern(fine[0])
    coarse = fantex.bake(
        sphere, tmp_path / "a.fan", texels=200_000, source=fantex.mesh((*fine, colors)), format="float"
    )
    assert "normal" in coarse.channels
    points = fine[0][2000:9000:13]
    assert np.abs(coarse.sample(points)[:, :3] - pattern(points)).max() < 0.03
    face, barycentric, _ = coarse.nearest(points)
    bent = coarse.sample(face=face, barycentric=barycentric, channel="normal")[:, :3]
    assert (bent * points).sum(1).min() > 0.995
    smooth = coarse.normals(face, barycentric)
    assert (smooth * points).sum(1).min() > 0.98


def test_strokes(tmp_path, sphere):
    asset = fantex.bake(sphere, tmp_path / "a.fan", texels=100_000, source=lambda p, n: np.ones_like(p))
    stroke = {
        "brush": {"size": {"texels": 40}, "hardness": 0.5},
        "channels": [{"kind": "base_color", "color": {"srgb": [1, 0, 0]}}],
        "samples": [{"at": {"position": [0, 0, 1]}}, {"at": {"position": [0.3, 0, 0.95]}}],
    }
    painted = asset.paint([stroke])
    assert painted["strokes"] == 1 and painted["dabs"] > 1
    assert asset.sample([0, 0, 1])[1] < 0.2
    assert asset.sample([0, 0, -1])[1] > 0.95
    path = tmp_path / "strokes.json"
    path.write_text(json.dumps({"version": 1, "strokes": [stroke]}))
    assert asset.paint(path)["strokes"] == 1
    with pytest.raises((ValueError, fantex.Error), match="sampels"):
        asset.paint([{**stroke, "sampels": []}])


def test_strokes_that_fail_leave_no_channels(tmp_path, sphere):
    asset = fantex.bake(sphere, tmp_path / "a.fan", texels=30_000, source=pattern)
    stroke = {"tool": {"blur": {"radius": {"texels": -1}}}, "channels": [{"kind": "base_color"}]}
    stroke["samples"] = [{"at": {"position": [0, 0, 1]}}]
    with pytest.raises(fantex.Error, match="radius"):
        asset.paint([stroke], add_channels="emission", alpha="blend")
    assert asset.channels == ["base-color"] and asset.materials[0].alpha == "opaque"
    assert os.listdir(tmp_path) == ["a.fan"]


def test_wrong_words(tmp_path, sphere):
    with pytest.raises(ValueError, match='format "bc9" is none of bc7, bc1, rgba8, float'):
        fantex.bake(sphere, tmp_path / "a.fan", format="bc9", source=fantex.solid("wood"))
    with pytest.raises(ValueError, match="cheese"):
        fantex.bake(sphere, tmp_path / "a.fan", source=fantex.solid("cheese"))
    with pytest.raises(ValueError, match="neither textures nor colours"):
        fantex.bake(sphere, tmp_path / "a.fan")
    with pytest.raises(TypeError, match="not str"):
        fantex.bake(sphere, tmp_path / "a.fan", source="vertex")


def test_real_scan(tmp_path, data):
    mesh = fantex.Mesh.load(next((data / "meshes" / "bunny").glob("*.ply")))
    asset = fantex.bake(mesh, tmp_path / "bunny.fan", texels=500_000, source=fantex.solid("marble"))
    assert asset.verify()["ok"]
    vmapping, faces, uvs = fantex.parametrize(mesh.positions, mesh.faces)
    np.testing.assert_array_equal(vmapping[faces], mesh.faces)


def test_functions_are_never_asked_for_no_points(tmp_path, data):
    def source(points, normals):
        assert len(points)
        return np.ones_like(points)

    fantex.bake(data / "meshes/bunny/stanford_bunny.ply", tmp_path / "a.fan", texels=50_000, source=source)


def test_obj_with_a_map_per_number(tmp_path):
    """Roughness, metalness and opacity in files of their own, as the numbers in them say."""
    image_module = pytest.importorskip("PIL.Image", reason="no Pillow")
    random = np.random.default_rng(3)
    smooth = {}
    for name in ("c", "d", "r", "m"):
        coarse = random.integers(40, 220, (4, 4, 3 if name == "c" else 1), np.uint8)
        size = (64, 64) if name == "r" else (128, 128)
        picture = image_module.fromarray(coarse.squeeze()).resize(size, image_module.BICUBIC)
        picture.save(tmp_path / f"{name}.png")
        smooth[name] = np.asarray(picture).reshape(*size, -1) / 255.0
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd c.png\nmap_d d.png\nmap_Pr r.png\nmap_Pm -imfchan l m.png\n")
    (tmp_path / "a.obj").write_text(
        "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3 4/4\n"
    )
    asset = fantex.bake(tmp_path / "a.obj", tmp_path / "a.fan", texels=100_000, format="float")
    points = np.concatenate([random.uniform(0.05, 0.95, (2000, 2)), np.zeros((2000, 1))], 1)
    color = asset.sample(points)
    orm = asset.sample(points, channel="orm")

    def expected(name):
        picture = smooth[name]
        side = len(picture)
        x, y = points[:, 0] * side - 0.5, (1 - points[:, 1]) * side - 0.5
        left, top = np.floor(x).astype(int), np.floor(y).astype(int)
        fx, fy = (x - left)[:, None], (y - top)[:, None]
        upper = picture[top, left] * (1 - fx) + picture[top, left + 1] * fx
        return upper * (1 - fy) + (picture[top + 1, left] * (1 - fx) + picture[top + 1, left + 1] * fx) * fy

    encoded = np.where(color <= 0.0031308, color * 12.92, 1.055 * color.clip(1e-9) ** (1 / 2.4) - 0.055)
    assert np.abs(encoded[:, :3] - expected("c")).max() < 0.02
    assert np.abs(color[:, 3] - expected("d")[:, 0]).max() < 0.02
    assert np.abs(orm[:, 1] - expected("r")[:, 0]).max() < 0.02
    assert np.abs(orm[:, 2] - expected("m")[:, 0]).max() < 0.02


@pytest.mark.parametrize("kind", ["path", "asset", "pickled"])
def test_an_asset_is_a_source(tmp_path, waves, kind):
    """All its channels come along, onto a coarser mesh."""
    given = {"path": waves.place, "asset": waves, "pickled": waves}[kind]
    source = fantex.mesh(given)
    if kind == "pickled":
        source = pickle.loads(pickle.dumps(source))
    coarse = grid_sphere(12, 24)
    asset = fantex.bake(coarse, tmp_path / "coarse.fan", texels=60_000, source=source)
    assert sorted(asset.channels) == ["base-color", "normal"]
    points = np.random.default_rng(2).normal(size=(2000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    seen, truth = asset.sample(points)[:, :3], waves.sample(points)[:, :3]
    assert np.abs(seen - truth).max() < 0.03
    # The coarse mesh is shaded as the fine one.
    normals = asset.sample(points, channel="normal")[:, :3]
    assert (normals * points).sum(1).mean() > 0.999


def test_the_mesh_of_an_asset(tmp_path, waves):
    for mesh in (fantex.Mesh.load(waves.place), fantex.Mesh.of(waves), fantex.Mesh.of(waves.place)):
        np.testing.assert_array_equal(mesh.faces, waves.faces)
        np.testing.assert_array_equal(mesh.positions, waves.positions)
        with pytest.raises(ValueError, match="vertex colours"):
            fantex.bake(mesh, tmp_path / "no.fan", source=fantex.vertex_colors())
    coarse = fantex.Mesh.of(waves).simplified(300)
    assert 100 < len(coarse.faces) <= 300
    # Something else on the same mesh, and the same at another density.
    marble = fantex.bake(waves, tmp_path / "marble.fan", texels=20_000, source=fantex.solid("marble"))
    np.testing.assert_array_equal(marble.positions[: len(waves.positions)], waves.positions)
    small = fantex.bake(waves, tmp_path / "small.fan", texels=20_000, source=fantex.mesh(waves))
    assert small.info["texels"] < waves.info["texels"] / 5
    assert np.abs(small.sample([[0, 0, 1]])[:, :3] - waves.sample([[0, 0, 1]])[:, :3]).max() < 0.02
    with pytest.raises(ValueError, match="source"):
        fantex.bake(waves, tmp_path / "nothing.fan")
    with pytest.raises(FileNotFoundError, match="nowhere.fan"):
        fantex.mesh(tmp_path / "nowhere.fan")


def test_a_bake_says_what_cleaning_did(tmp_path, sphere):
    """Also where the mesh is no object of its own that could be asked."""
    positions, faces = sphere
    soup, own = positions[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)
    asset = fantex.bake((soup, own), tmp_path / "soup.fan", texels=20_000, source=pattern)
    assert any("welded" in note for note in asset.baked["notes"]), asset.baked


def test_copies_of_vertices_that_were_rounded_are_joined(tmp_path, sphere):
    """A soup whose corners differ by less than a millionth of its size."""
    positions, faces = sphere
    noise = np.random.default_rng(5).uniform(-1e-7, 1e-7, (3 * len(faces), 3))
    soup = positions[faces].reshape(-1, 3) + noise, np.arange(3 * len(faces)).reshape(-1, 3)
    torn = fantex.Mesh(*soup)
    assert torn.info["components"] == len(faces)
    (note,) = (note for note in torn.notes if "within a millionth" in note)
    assert "weld= joins" in note and "--" not in note
    joined = fantex.Mesh(*soup, weld=1e-6)
    assert joined.info["components"] == 1 and len(joined.positions) == len(fantex.Mesh(*sphere).positions)
    joined.save(tmp_path / "joined.ply")
    torn.save(tmp_path / "torn.ply")
    settings = {"texels": 20_000, "source": fantex.solid("marble"), "longest_edge": 0}
    asset = fantex.bake(tmp_path / "torn.ply", tmp_path / "a.fan", weld=1e-6, **settings)
    assert asset.baked["tiles"] < len(faces) / 8
    # Parts are baked of the same mesh.
    with pytest.warns(UserWarning) as told:
        plan = fantex.plan(tmp_path / "torn.ply", tmp_path / "a.plan", weld=1e-6, **settings)
    assert [str(warning.message) for warning in told] == asset.baked["notes"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fantex.bake_part(plan, (1, 1), tmp_path / "a.part")
    fantex.merge(plan, [tmp_path / "a.part"], tmp_path / "b.fan")
    assert (tmp_path / "a.fan").read_bytes() == (tmp_path / "b.fan").read_bytes()
    charts = [fantex.parametrize(*soup, weld=weld, resolution=256).charts for weld in (None, 1e-6)]
    assert charts[1] < charts[0] / 8
    for wrong in (0, -1, float("nan")):
        with pytest.raises(ValueError, match="expected a length above zero"):
            fantex.Mesh(*soup, weld=wrong)
    with pytest.raises(ValueError, match="cleaned already"):
        fantex.bake(torn, tmp_path / "c.fan", weld=1e-6)
    with pytest.raises(ValueError, match="weld= is for models"):
        fantex.Mesh.load(tmp_path / "a.fan", weld=1e-6)


def test_parts_of_a_bake_from_an_asset(tmp_path, waves):
    coarse = grid_sphere(12, 24)
    settings = {"texels": 30_000, "source": fantex.mesh(waves)}
    plan = fantex.plan(coarse, tmp_path / "a.plan", **settings)
    for number in (1, 2):
        fantex.bake_part(plan, (number, 2), tmp_path / f"{number}.part", mesh=coarse)
    parts = [tmp_path / "1.part", tmp_path / "2.part"]
    fantex.merge(plan, parts, tmp_path / "merged.fan")
    fantex.bake(coarse, tmp_path / "whole.fan", **settings)
    assert (tmp_path / "merged.fan").read_bytes() == (tmp_path / "whole.fan").read_bytes()
