"""What is in files, pictures of models and looks, tables, comparisons, and changes of assets."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import fantex
from conftest import ROOT, grid_sphere, pattern

SCENE = """
[picture]
size = [64, 48]
samples = 2

[camera]
eye = [0, 1.5, 3]
target = [0, 0, 0]

[textures.rings]
kind = "wood"

[textures.board]
kind = "checker"
cell = 0.5

[materials.oak]
base_color = "rings"

[[object]]
shape = { kind = "torus" }
material = "oak"
"""


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def test_info_of_anything(tmp_path, waves, sphere, scene, bottle):
    info = waves.info
    assert info == fantex.info(waves) == fantex.info(waves.place)
    assert info["kind"] == "asset" and info["triangles"] == len(waves.faces) and info["vertices"] == len(waves.positions)
    assert info["channels"] == dict.fromkeys(waves.channels, "float") and info["preview_bytes"] is None
    mesh = fantex.Mesh(*sphere)
    assert fantex.info(mesh) == mesh.info
    assert (mesh.info["kind"], mesh.info["components"], mesh.info["genus"]) == ("model", 1, 0)
    assert mesh.info["boundary_edges"] == mesh.info["nonmanifold_edges"] == 0 and not mesh.info["has_colors"]
    assert fantex.info(bottle)["uv_sets"] == 1
    open_edges = fantex.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).info
    assert open_edges["boundary_edges"] == 3
    look = fantex.info(scene)
    assert look["kind"] == "look" and look["textures"] == ["board", "rings"] and look["materials"] == ["oak"]
    assert (look["objects"], look["lights"], look["frames"], look["models"]) == (1, 0, 1, [])
    with pytest.raises(FileNotFoundError):
        fantex.info(tmp_path / "nowhere.glb")


def test_meshes_are_written(tmp_path, sphere):
    coarse = fantex.Mesh(*sphere).simplified(300)
    for name in ("a.ply", "a.obj", "a.glb"):
        coarse.save(tmp_path / name)
        again = fantex.Mesh.load(tmp_path / name)
        np.testing.assert_allclose(np.sort(again.positions, 0), np.sort(coarse.positions, 0), atol=1e-6)
        assert len(again.faces) == len(coarse.faces)
    with pytest.raises(FileExistsError, match="overwrite=True"):
        coarse.save(tmp_path / "a.ply")
    coarse.save(tmp_path / "a.ply", overwrite=True)
    with pytest.raises(fantex.Error, match="use .ply, .obj or .glb"):
        coarse.save(tmp_path / "a.stl")


def test_pictures_of_models_and_looks(tmp_path, bottle, waves, scene):
    mesh = fantex.Mesh.load(bottle)
    picture = mesh.render((160, 120), samples=2)
    assert picture.shape == (120, 160, 4) and picture.std() > 10
    np.testing.assert_array_equal(fantex.render(bottle, size=(160, 120), samples=2), picture)
    np.testing.assert_array_equal(
        fantex.render(waves.place, size=(80, 60), samples=1), waves.render((80, 60), samples=1)
    )
    assert fantex.render(waves).shape == (540, 960, 4)
    nearest = mesh.render((160, 120), samples=2, filter="nearest")
    assert fantex.compare_pictures(picture, nearest)["psnr_db"] < 60
    with pytest.raises(ValueError, match='filter "sharp" is none of nearest'):
        mesh.render(filter="sharp")

    # A computed sky lights and is seen.
    sky = mesh.render((80, 60), samples=1, environment="sky", light=(1, 2, 1), environment_rotation=30)
    assert sky[0, 0, 3] == 255 and np.abs(sky[0, 0].astype(int) - picture[0, 0]).max() > 5
    bright, dark = (
        mesh.render((80, 60), samples=1, environment="sky", environment_strength=strength) for strength in (1, 0.1)
    )
    assert dark[..., :3].mean() < bright[..., :3].mean()
    with pytest.raises(ValueError, match="environment_strength is -1"):
        mesh.render(environment="sky", environment_strength=-1)

    torus = fantex.render(scene)
    assert torus.shape == (48, 64, 4) and torus.std() > 5
    assert fantex.render(scene, size=(20, 10)).shape == (10, 20, 4)
    closer = fantex.render(scene, camera=fantex.Camera(eye=(0, 1, 2)), transparent=True)
    assert closer.shape == (48, 64, 4) and closer[0, 0, 3] == 0 and (closer[..., 3] > 0).any()
    with pytest.raises(ValueError, match="scene.toml is a look, .* leave light out"):
        fantex.render(scene, light=(1, 1, 1))
    with pytest.raises(ValueError, match="time is that of an animation"):
        fantex.render(bottle, time=1.0)

    # A model's own materials, as a look beside it.
    for file in bottle.parent.iterdir():
        if file.is_file():
            shutil.copy(file, tmp_path / file.name)
    own = tmp_path / "own.toml"
    own.write_text(mesh.look())
    assert own.read_text().startswith("# The materials of ") and fantex.info(own)["materials"]
    dressed = fantex.render(tmp_path / bottle.name, look=own, size=(160, 120), samples=2, filter="anisotropic")
    assert fantex.compare_pictures(picture, dressed)["psnr_db"] > 30


def test_tables(scene):
    board = fantex.table(scene, "board", size=(64, 32))
    assert board.shape == (32, 64, 4) and board.dtype == np.float32
    assert board[..., :3].min() < 0.1 and board[..., :3].max() > 0.7 and (board[..., 3] == 1).all()
    slices = fantex.table(scene, "board", size=(8, 8), slices=3, start=(-1, 1, -1), end=(1, -1, 1), samples=2)
    assert slices.shape == (3, 8, 8, 4)
    with pytest.raises(ValueError, match="has 2 textures; say which with texture="):
        fantex.table(scene)
    with pytest.raises(fantex.Error, match="there is no texture 'bord'"):
        fantex.table(scene, "bord")


def test_normal_maps(sphere):
    steps = np.linspace(0, 1, 9)
    x, y = (axis.ravel() for axis in np.meshgrid(steps, steps))
    faces = []
    for i in range(8):
        for j in range(8):
            a, b, c, d = 9 * i + j, 9 * i + j + 1, 9 * i + j + 9, 9 * i + j + 10
            faces += [(a, b, c), (b, d, c)]
    flat = np.stack([x, y, 0 * x], 1)
    plane = fantex.Mesh(flat, faces, uv=flat[:, :2])
    same = fantex.normal_map(plane, plane, size=(32, 16))
    assert same.image.shape == (16, 32, 3) and same.missed_share == 0 and same.cage >= 0
    np.testing.assert_allclose(same.image[8, 16], (0.5, 0.5, 1), atol=0.01)
    # A slope to the right bends the normals to the left.
    bent = fantex.normal_map(plane, (flat + 0.2 * np.stack([0 * x, 0 * x, x], 1), faces), size=(32, 32))
    assert bent.image[16, 16, 0] < 0.45
    repeated = fantex.Mesh(flat, faces, uv=2 * flat[:, :2])
    with pytest.warns(UserWarning, match="75.0 % of what its texture coordinates cover"):
        fantex.normal_map(repeated, plane, size=(32, 16))
    with pytest.raises(ValueError, match='space "world" is none of tangent, object'):
        fantex.normal_map(plane, plane, space="world")
    with pytest.raises((ValueError, fantex.Error), match="texture coordinates"):
        fantex.normal_map(sphere, plane)


def test_comparisons(tmp_path, waves, sphere):
    told = []
    same = fantex.compare(
        waves, waves.place, views=3, size=(120, 90), samples=2, progress=lambda *state: told.append(state)
    )
    assert same["psnr_db"] == np.inf and same["ssim"] > 0.9999 and same["flip"] == 0
    assert same["views"] == len(same["per_view"]) == 3 and same["empty_views"] == 0
    assert all(total == 3 for _, total in told)
    colored = (*sphere, pattern(sphere[0]))
    close = fantex.compare(fantex.Mesh.of(colored), waves, views=2, size=(120, 90), samples=2)
    assert 20 < close["min_psnr_db"] <= close["psnr_db"] < np.inf and 0.1 < close["model_share"] < 1
    with pytest.raises(ValueError, match="views is 0"):
        fantex.compare(waves, waves, views=0)

    picture = waves.render((60, 40), samples=1)
    linear = np.asarray(fantex._native.LINEAR_FROM_SRGB8, np.float32)[picture[..., :3]]
    equal = fantex.compare_pictures(picture, linear)
    assert equal["psnr_db"] > 100 and equal["flip"] < 1e-3
    other = picture.copy()
    other[:20] = 0
    worse = fantex.compare_pictures(picture, other)
    counts = np.zeros((40, 60), bool)
    counts[30:] = True
    assert worse["psnr_db"] < 30 < fantex.compare_pictures(picture, other, counts=counts)["psnr_db"]
    with pytest.raises(ValueError, match="pictures of one size are compared"):
        fantex.compare_pictures(picture, picture[:-1])
    with pytest.raises(TypeError, match="test holds int64"):
        fantex.compare_pictures(picture, picture.astype(np.int64))


def test_single_channels_and_other_coordinates(tmp_path, bottle):
    asset = fantex.bake(bottle, tmp_path / "bottle.fan", texels=60_000)
    paths = {"roughness": tmp_path / "r.png", "normal": tmp_path / "n.exr", "base-color": tmp_path / "c.ktx2"}
    files = asset.export_channels(paths, depth=16, resolution=256)
    assert sorted(files) == sorted(map(str, paths.values())) and all(path.stat().st_size for path in paths.values())
    with pytest.raises(FileExistsError):
        asset.export_channels(paths, resolution=256)
    with pytest.raises(ValueError, match='channel "shine" is none of base-color, opacity'):
        asset.export_channels({"shine": tmp_path / "s.png"})
    with pytest.raises(ValueError, match="depth is 12"):
        asset.export_channels({"normal": tmp_path / "s.png"}, depth=12)
    with pytest.raises(ValueError, match="uv is 'atlas', 'source' or a model"):
        asset.export(tmp_path / "a.glb", uv="other")
    assert asset.export(tmp_path / "a.glb", largest_side=256) == [str(tmp_path / "a.glb")]


def test_the_coordinates_of_a_model(tmp_path):
    """An asset that has kept none takes those of the model that it was baked from."""
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], float)
    faces = [[0, 1, 2], [1, 3, 2]]
    asset = fantex.bake((flat, faces), tmp_path / "a.fan", texels=4000, source=pattern)
    with pytest.raises((ValueError, fantex.Error), match='uv="source"'):
        asset.export(tmp_path / "a.glb", uv="source", resolution=64)
    asset.export(tmp_path / "a.glb", uv=fantex.Mesh(flat, faces, uv=flat[:, :2]), resolution=64)
    assert (tmp_path / "a.glb").stat().st_size > 500


def damaged_copy(asset, path):
    """An asset, several clusters of which are damaged; some hold the finest texels."""
    content = bytearray(Path(asset.place).read_bytes())
    for share in (0.3, 0.4, 0.55, 0.7):
        at = int(share * len(content))
        content[at : at + 64] = bytes([0x55]) * 64
    path.write_bytes(content)
    return fantex.open(path)


def test_damage_is_said(tmp_path, waves):
    damaged = damaged_copy(waves, tmp_path / "a.fan")
    found = damaged.verify()
    assert not found["ok"] and "a.fan did not pass: it has" in found["fault"] and found["damaged_tiles"] > 0
    with pytest.warns(UserWarning, match="a.fan: coarser texels stand in for"):
        for eye in ((3, 0, 0), (-3, 0, 0), (0, 3, 0), (0, -3, 0), (0, 0, 3), (0, 0, -3)):
            damaged.render((400, 400), fantex.Camera(eye), samples=1, filter="nearest")


@pytest.mark.parametrize("make", ["atlas", "fan_attributes", "to_trimesh"])
def test_damage_is_said_of_what_is_in_memory(tmp_path, waves, make):
    if make == "to_trimesh":
        pytest.importorskip("trimesh")
        pytest.importorskip("PIL")
    damaged = damaged_copy(waves, tmp_path / "a.fan")
    with pytest.warns(UserWarning, match="a.fan: coarser texels stand in for") as told:
        getattr(damaged, make)()
    # Of the line that asked for it.
    assert {warning.filename for warning in told if "stand in" in str(warning.message)} == {__file__}


def test_previews(tmp_path, sphere):
    asset = fantex.bake(sphere, tmp_path / "a.fan", texels=60_000, source=pattern)
    made = asset.make_preview(triangles=300, texels=4000, keep_borders=True)
    assert asset.info["preview_bytes"] == made["bytes"] and made["texels"] > 1000
    assert asset.verify()["ok"] and asset.verify()["fault"] is None
    assert asset.remove_preview() and asset.info["preview_bytes"] is None and not asset.remove_preview()


STROKE = {
    "brush": {"size": {"texels": 40}, "hardness": 0.5},
    "channels": [{"kind": "base_color", "color": {"srgb": [1, 0, 0]}}],
    "samples": [{"at": {"position": [0, 0, 1]}}, {"at": {"position": [0.3, 0, 0.95]}}],
}


def test_strokes_travel(tmp_path, sphere):
    white = lambda points, normals: np.ones_like(points)
    asset = fantex.bake(sphere, tmp_path / "a.fan", texels=60_000, source=white)
    asset.paint([STROKE])
    other = fantex.bake(sphere, tmp_path / "b.fan", texels=30_000, source=white)
    assert other.paint(asset)["strokes"] == 1 and other.sample([0, 0, 1])[1] < 0.2
    assert asset.save_strokes(tmp_path / "strokes.json") == {"strokes": 1, "unrecorded": 0}
    assert len(json.loads((tmp_path / "strokes.json").read_text())["strokes"]) == 1
    with pytest.raises(FileExistsError, match="overwrite=True"):
        asset.save_strokes(tmp_path / "strokes.json")
    third = fantex.bake(grid_sphere(12, 24), tmp_path / "c.fan", texels=30_000, source=white)
    assert third.paint(tmp_path / "strokes.json")["strokes"] == 1 and third.sample([0, 0, 1])[1] < 0.2


def test_channels_come_and_go(tmp_path, sphere):
    asset = fantex.bake(sphere, tmp_path / "a.fan", texels=30_000, source=pattern)
    assert asset.paint(add_channels=["orm", "emission"])["strokes"] == 0
    assert set(asset.channels) == {"base-color", "orm", "emission"}
    asset.paint(remove_channels=["orm"], alpha="blend")
    assert set(asset.channels) == {"base-color", "emission"}
    with pytest.raises(ValueError, match='channel "shine" is none of base-color'):
        asset.paint(add_channels=["shine"])
    with pytest.raises(ValueError, match='alpha "glass" is none of opaque'):
        asset.paint(alpha="glass")


def test_limits_for_files_of_others(tmp_path):
    inside = tmp_path / "in"
    inside.mkdir()
    (tmp_path / "outside.bin").write_bytes(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes())
    model = inside / "a.gltf"
    model.write_text(
        '{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],'
        '"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],'
        '"buffers":[{"uri":"../outside.bin","byteLength":36}],"bufferViews":[{"buffer":0,"byteLength":36}],'
        '"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}]}'
    )
    try:
        with pytest.raises(fantex.Error, match=r"outside its folder.*set_read_limits\(allow_outside=True\)"):
            fantex.Mesh.load(model)
        fantex.set_read_limits(allow_outside=True)
        assert len(fantex.Mesh.load(model).faces) == 1
        fantex.set_read_limits(memory=1000)
        with pytest.raises(fantex.Error, match=r"set_read_limits\(memory=...\)"):
            fantex.Mesh.load(ROOT / "assets" / "WaterBottle" / "WaterBottle.gltf")
    finally:
        fantex.set_read_limits()


def test_images_that_are_missing_are_left_out_with_a_warning(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl oak\nmap_Kd bark.png\n")
    model = tmp_path / "a.obj"
    model.write_text("mtllib a.mtl\nusemtl oak\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n")
    left_out = r'a texture was left out: the base colour of material "oak" \(line 2 of a.mtl\): cannot read .*bark.png'
    mesh = fantex.Mesh.load(model)
    with pytest.warns(UserWarning, match=left_out):
        mesh.render(size=(32, 32), samples=1)
    with pytest.warns(UserWarning, match=left_out):
        assert "notes" not in fantex.compare(mesh, mesh, views=1, size=(32, 32), samples=1)
    asset = fantex.bake(mesh, tmp_path / "a.fan", texels=1000)
    assert any("bark.png" in note for note in asset.baked["notes"])
    # What is given by hand has to be there.
    with pytest.raises(fantex.Error, match="the image of the mesh"):
        fantex.Mesh(mesh.positions, mesh.faces, uv=[[0, 0], [1, 0], [0, 1]], image=b"\x89PNG\r\n\x1a\nnonsense")
