"""Arguments as users have them, and the sentences for what they are not."""

import errno
import os

import numpy as np
import pytest

import fantex
from conftest import pattern

STROKE_COLOR = [{"kind": "base_color", "color": {"srgb": [1, 0, 0]}}]


def test_whole_numbers(tmp_path, sphere, waves):
    mesh = fantex.Mesh(*sphere)
    assert len(mesh.simplified(3e2).faces) == len(mesh.simplified(np.int32(300)).faces) <= 300
    assert waves.atlas(64.0).images["base-color"].shape == (64, 64, 3)
    for call, sentence in [
        (lambda: mesh.simplified(float("nan")), "faces is nan; expected a whole number"),
        (lambda: mesh.simplified(2**70), "faces is 1180591620717411303424; expected at most"),
        (lambda: fantex.bake(mesh, tmp_path / "a.fan", texels=-1), "texels is -1; it cannot be negative"),
        (lambda: fantex.bake(mesh, tmp_path / "a.fan", texels=float("inf")), "texels is inf"),
        (lambda: fantex.bake(mesh, tmp_path / "a.fan", longest_edge=2.5), "longest_edge is 2.5; expected a whole"),
        (lambda: fantex.bake(mesh, tmp_path / "a.fan", texels=1e4, density=3), "texels and density both say"),
        (lambda: fantex.bake(mesh, tmp_path / "a.fan", density=-2), "density is -2; expected a number of texels above zero"),
        (lambda: fantex.bake(mesh, tmp_path / "a.fan", density=float("nan")), "density is nan; expected a number"),
        (lambda: fantex.Mesh(sphere[0], [[0, 1, 2], [3, 4]]), r"faces has rows of different lengths; expected \(n, 3\)"),
        (lambda: fantex.bake(mesh, tmp_path / "a.fan", density=3, match=True), "density and match both say"),
        (lambda: fantex.open(waves.place, memory=-1), "memory is -1; it cannot be negative"),
        (lambda: waves.atlas(-64), "resolution is -64; it cannot be negative"),
        (lambda: waves.render((64, -1)), "size is -1; it cannot be negative"),
        (lambda: waves.render((64,)), "size has 1 numbers; expected two, columns and rows"),
        (lambda: waves.render((6, 4), samples=2.5), "samples is 2.5; expected a whole number"),
        (lambda: waves.render((6, 4), light=(1, 2)), "light has 2 numbers; expected three"),
        (lambda: waves.render((6, 4), fantex.Camera((1, 2))), "the camera's eye has 2 numbers; expected three"),
        (lambda: waves.render((6, 4), light=(0, 0, 0)), "light is .0.0, 0.0, 0.0.; expected a direction"),
        (lambda: waves.sample(face=[0, 1], barycentric=[[1, 0, 0], [2, 2, 2]]), "barycentric has .2.0, 2.0, 2.0. in row 1; exp"),
        (lambda: waves.export_channels({}), "paths has no channel"),
        (lambda: waves.paint([{"samples": [float("nan")]}]), "strokes hold a number that is not finite"),
        (lambda: fantex.parametrize(*sphere, padding=-2), "padding is -2; it cannot be negative"),
    ]:
        with pytest.raises(ValueError, match=sentence):
            call()
    for call, sentence in [
        (lambda: mesh.simplified("300"), "faces is of type str; expected a whole number"),
        (lambda: waves.render(64), "size is 64; expected two whole numbers"),
        (lambda: waves.render((6, 4), "front"), "camera is of type str; expected a fantex.Camera"),
        (lambda: waves.render((6, 4), light="sun"), "light is 'sun'; expected three numbers"),
        (lambda: waves.render((6, 4), light=(0, 1, "up")), "light is .0, 1, 'up'.; expected three numbers"),
        (lambda: waves.render((6, 4), environment="sky", environment_strength=[1]), "environment_strength is of type list"),
        (lambda: waves.render((6, 4), filter=3), "filter is of type int; expected one of nearest, bilinear"),
        (lambda: fantex.Camera((1, 2, 3), fov="wide"), "the camera's fov is of type str; expected a number"),
        (lambda: fantex.bake(mesh, tmp_path / "a.fan", density=[3]), "density is of type list; expected a number"),
        (lambda: fantex.bake(mesh, tmp_path / "a.fan", source="marble"), r"not str; fantex.solid\('marble'\) is a solid"),
        (lambda: fantex.image(np.zeros((4, 4, 3), np.uint8)), "path is of type ndarray; expected that of a picture's file"),
        (lambda: fantex.image("bark.png", 5), "mapping is of type int; expected a text"),
        (lambda: waves.sample([0, 0, 1], channel=None), "channel is of type NoneType; expected a text"),
        (lambda: waves.paint(add_channels=5), "add_channels is of type int; expected a text or several"),
        (lambda: waves.atlas(64, progress=5), "progress is of type int; expected a function of done and total"),
    ]:
        with pytest.raises(TypeError, match=sentence):
            call()
    assert not os.listdir(tmp_path)


def test_numbers_that_are_no_colors(tmp_path, sphere):
    positions, faces = sphere
    for colors in (np.full((len(positions), 3), 255), np.full((len(positions), 3), 65535, np.uint16)):
        with pytest.raises(TypeError, match=f"colors holds {colors.dtype}; expected uint8 in sRGB or linear floats"):
            fantex.Mesh(positions, faces, colors=colors)
    with pytest.raises(TypeError, match="the source's result holds int64; expected uint8"):
        fantex.bake(sphere, tmp_path / "a.fan", texels=5000, source=lambda points, _: np.ones((len(points), 3), int))


def test_float_pictures_are_linear(tmp_path):
    positions = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    for image in (np.full((8, 8, 3), 0.5, np.float32), np.full((8, 8), 0.5), np.full((8, 8, 4), 0.5)):
        mesh = fantex.Mesh(positions, [[0, 1, 2], [0, 2, 3]], uv=positions[:, :2], image=image)
        asset = fantex.bake(mesh, tmp_path / "a.fan", texels=5000, overwrite=True)
        np.testing.assert_allclose(asset.sample([0.5, 0.5, 0])[:3], 0.5, atol=0.01)
    with pytest.raises(TypeError, match=r"not \(1, 8, 8, 3\) float64"):
        fantex.Mesh(positions, [[0, 1, 2]], uv=positions[:, :2], image=np.zeros((1, 8, 8, 3)))


def test_colors_of_faces_stay_sharp(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box()
    colors = np.array([[255, 0, 0, 255], [0, 0, 255, 255]], np.uint8)[(box.face_normals[:, 0] > 0.5).astype(int)]
    box.visual = trimesh.visual.ColorVisuals(box, face_colors=colors)
    mesh = fantex.Mesh.of(box)
    assert len(mesh.positions) == 8 and mesh.source_faces.tolist() == list(range(12))
    asset = fantex.bake(mesh, tmp_path / "a.fan", texels=20_000)
    # Near an edge of the blue side.
    blue, red = asset.sample([[0.5, 0.3, 0.3], [0.2, 0.5, 0.3]], srgb=True)
    assert np.abs(blue[:3].astype(int) - (0, 0, 255)).max() < 8 and np.abs(red[:3].astype(int) - (255, 0, 0)).max() < 8


def test_paths_of_all_kinds(tmp_path, sphere):
    places = tmp_path / "ü ☃.fan", str(tmp_path / "b.fan"), os.fsencode(tmp_path / "c.fan")
    for place in places:
        fantex.bake(sphere, place, texels=5000, source=fantex.solid("marble"))
        asset = fantex.open(place)
        assert asset.place == os.fsdecode(place) and fantex.info(place)["kind"] == "asset"
        assert fantex.Mesh.of(place).info["triangles"] == len(asset.faces)
    glb = os.fsencode(tmp_path / "c.glb")
    assert asset.export(glb, resolution=64) == [os.fsdecode(glb)]
    with pytest.raises(TypeError, match="not int"):
        fantex.open(5)


def test_a_folder_may_change_under_relative_paths(tmp_path, sphere, monkeypatch):
    monkeypatch.chdir(tmp_path)
    asset = fantex.bake(sphere, "a.fan", texels=20_000, source=pattern)
    world = fantex.split(asset, "land", triangles=1000, previews=False)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert asset.place == "a.fan" and asset.paint(add_channels="emission")["strokes"] == 0
    assert asset.channels == ["base-color", "emission"]
    assert world.verify()["ok"] and world.objects[0].open().channels == ["base-color"]
    assert world.render((20, 10), samples=1).std() > 1


def test_strokes_with_numbers_of_numpy(tmp_path, sphere):
    white = lambda points, normals: np.ones_like(points)
    asset = fantex.bake(sphere, tmp_path / "a.fan", texels=60_000, source=white)
    _, _, places = asset.nearest([[0, 0, 2], [0.3, 0, 1]])
    samples = [{"at": {"position": place}} for place in places]
    asset.paint([{"brush": {"size": {"texels": np.float32(40)}}, "channels": STROKE_COLOR, "samples": samples}])
    assert asset.sample([0, 0, 1])[1] < 0.2
    with pytest.raises(fantex.Error, match="what was given to paint is not a stroke file: line 1") as wrong:
        asset.paint({"strokes": []})
    assert wrong.value.path is None
    with pytest.raises(TypeError, match="strokes hold a set"):
        asset.paint([{"samples": {1, 2}}])


def test_one_point_alone(waves):
    face, barycentric, place = waves.nearest([0, 0, 1])
    assert np.ndim(face) == 0 and barycentric.shape == place.shape == (3,)
    many = waves.nearest([[0, 0, 1]])
    assert face == many[0][0] and (place == many[2][0]).all()
    np.testing.assert_allclose(waves.normals(face, barycentric), (0, 0, 1), atol=0.05)
    np.testing.assert_array_equal(waves.sample(face=face, barycentric=barycentric), waves.sample([0, 0, 1]))


def test_points_of_the_surface_that_are_none(waves):
    nowhere = waves.nearest([[np.nan, 0, 0], [0, 0, 1]])[:2]
    assert np.isnan(waves.normals(*nowhere)[0]).all() and np.isfinite(waves.normals(*nowhere)[1]).all()
    assert np.isnan(waves.sample(face=[0], barycentric=[[np.nan, 0, 1]])).all()
    with pytest.raises(ValueError, match="there are 2 faces and 1 barycentric coordinates"):
        waves.normals([0, 1], [[1, 0, 0]])
    with pytest.raises(ValueError, match=r"face has the shape \(1, 1\); expected \(n,\)"):
        waves.normals([[0]], [[1, 0, 0]])
    with pytest.raises(ValueError, match=r"footprint has the shape \(1, 2\)"):
        waves.sample([[0, 0, 1]], footprint=[[0.1, 0.2]])
    with pytest.raises(TypeError, match="points holds <U1, not numbers"):
        waves.sample([["0", "0", "1"]])


def test_boxes(waves, sphere):
    for shape in (waves, fantex.Mesh(*sphere)):
        np.testing.assert_allclose(shape.bounds, [[-1, -1, -1], [1, 1, 1]], atol=1e-6)


def test_files_of_channels_differ(tmp_path, waves):
    same = {"base-color": tmp_path / "a.png", "opacity": str(tmp_path / "a.png")}
    with pytest.raises(ValueError, match="two channels have the same file"):
        waves.export_channels(same, resolution=64)
    with pytest.raises(TypeError, match="paths is of type list; expected a dictionary"):
        waves.export_channels(["base-color"])
    with pytest.raises((ValueError, OSError), match="files are written here"):
        waves.save_strokes("s3://scans/strokes.json")
    assert not os.listdir(tmp_path)


def test_pictures_are_saved_whole(tmp_path, waves):
    picture = waves.render((20, 10), samples=1)
    picture.save(tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes() == picture.to_png()
    with pytest.raises(ValueError, match="a.jpg names no PNG file"):
        picture.save(tmp_path / "a.jpg")
    with pytest.raises(FileNotFoundError, match="none/a.png"):
        picture.save(tmp_path / "none" / "a.png")
    with pytest.raises(TypeError, match=r"uint8, not \(10, 20, 4\) float64"):
        (picture / 255).to_png()
    assert os.listdir(tmp_path) == ["a.png"]


@pytest.mark.skipif(os.name != "posix", reason="links and pipes")
def test_pictures_are_written_as_everything_is(tmp_path):
    """What a killed process has left goes away, links stay links, pipes stay pipes."""
    picture = np.zeros((2, 2, 3), np.uint8).view(fantex.Picture)
    left = tmp_path / ".fantex-left"
    left.write_bytes(b"half")
    os.utime(left, (0, 0))
    (tmp_path / "there").mkdir()
    os.symlink(tmp_path / "there" / "a.png", tmp_path / "link.png")
    picture.save(tmp_path / "link.png")
    assert (tmp_path / "link.png").is_symlink() and (tmp_path / "there" / "a.png").read_bytes() == picture.to_png()
    picture.save(tmp_path / "a.png")
    assert not left.exists()
    os.mkfifo(tmp_path / "pipe.png")
    reader = os.open(tmp_path / "pipe.png", os.O_RDONLY | os.O_NONBLOCK)
    try:
        picture.save(tmp_path / "pipe.png")
        assert os.read(reader, 1 << 16) == picture.to_png()
    finally:
        os.close(reader)
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(IsADirectoryError, match="folder.png"):
        picture.save(tmp_path / "folder.png")


def test_cameras_of_arrays():
    camera = fantex.Camera(np.array([0, 1, 2]), fov=np.float32(40))
    assert camera == fantex.Camera((0, 1, 2), fov=40) and camera.eye == (0.0, 1.0, 2.0)
    assert hash(camera) == hash(fantex.Camera([0, 1, 2], fov=40))


def test_closed_assets(tmp_path, sphere):
    with fantex.bake(sphere, tmp_path / "a.fan", texels=5000, source=pattern) as asset:
        assert asset.sample([0, 0, 1]).shape == (4,)
    for call in (lambda: asset.faces, lambda: asset.paint(alpha="blend"), lambda: fantex.Mesh.of(asset)):
        with pytest.raises(ValueError, match="a.fan is closed"):
            call()
    assert "closed" in repr(asset)
    asset.close()


@pytest.mark.skipif(os.name != "posix", reason="numbers of errors")
def test_numbers_of_errors(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError) as error:
        fantex.open(tmp_path / "file" / "a.fan")
    assert error.value.errno == errno.ENOTDIR and "file/a.fan" in str(error.value)
    with pytest.raises(FileNotFoundError) as error:
        fantex.open(tmp_path / "a.fan")
    assert error.value.errno == errno.ENOENT and str(error.value).startswith("cannot read ")


def test_files_that_are_changed_again_and_again_stay_small(tmp_path, sphere):
    """What a change replaced is overwritten, although the asset is open."""
    asset = fantex.bake(sphere, tmp_path / "a.fan", texels=60_000, source=pattern)
    sizes = []
    for _ in range(8):
        asset.make_preview(triangles=500, texels=20_000)
        sizes.append((tmp_path / "a.fan").stat().st_size)
    assert sizes[7] == sizes[6] == sizes[5], sizes
    assert asset.sample([0, 0, 1]).shape == (4,) and asset.verify()["ok"]
    with pytest.raises(fantex.Error):
        asset.paint({"strokes": []})
    assert asset.sample([0, 0, 1]).shape == (4,)
    if os.name == "posix":
        (tmp_path / "a.fan").unlink()
        with pytest.raises(FileNotFoundError):
            asset.remove_preview()
        assert asset.sample([0, 0, 1]).shape == (4,)


def test_pictures_that_cannot_be_compared():
    picture = np.zeros((16, 16, 3), np.float32)
    with pytest.raises(ValueError, match="test holds NaN"):
        fantex.compare_pictures(picture, picture * np.nan)
    with pytest.raises(TypeError, match="reference is a path; expected the picture"):
        fantex.compare_pictures("a.png", picture)


def test_tables_of_nothing(tmp_path):
    look = tmp_path / "a.toml"
    look.write_text('[textures.board]\nkind = "checker"\n')
    for given in ({"slices": 0}, {"size": (0, 4)}):
        with pytest.raises(ValueError, match="has nothing in it; all must be at least 1"):
            fantex.table(look, **{"size": (4, 4), **given})
    with pytest.raises(ValueError, match="all must be finite"):
        fantex.table(look, size=(4, 4), start=(np.nan, 0, 0))


def test_masks_that_do_not_fit_pictures():
    black, slope = np.zeros((4, 8, 3)), np.ones((4, 8, 3)) * np.arange(8)[None, :, None] / 8
    counts = np.ones((4, 8), bool)
    assert fantex.compare_pictures(black, slope, counts=counts.tolist()) == fantex.compare_pictures(black, slope, counts=counts)
    with pytest.raises(ValueError, match=r"counts has the shape \(8, 4\); expected that of the pictures, \(4, 8\)"):
        fantex.compare_pictures(black, slope, counts=counts.T)
    with pytest.raises(ValueError, match="counts leaves no pixel to compare"):
        fantex.compare_pictures(black, slope, counts=counts & False)
    with pytest.raises(TypeError, match="counts holds float64; expected bool"):
        fantex.compare_pictures(black, slope, counts=counts * 0.3)


def test_an_error_that_a_user_makes_has_a_path():
    assert fantex.Error("mine").path is None


@pytest.mark.skipif(os.name != "posix", reason="names of folders")
def test_names_of_files_stay_as_they_are(tmp_path):
    for name in ("a --look b", "--size"):
        with pytest.raises(FileNotFoundError) as error:
            fantex.open(tmp_path / name / "x.fan")
        assert f"{tmp_path}/{name}/x.fan" in str(error.value)


def test_numbers_of_an_environment_need_one(waves):
    for given in ({"environment_strength": 5}, {"environment_rotation": 90.0}):
        for render in (waves.render, fantex.Mesh.of(waves).render):
            with pytest.raises(ValueError, match="are those of an environment; give environment="):
                render((6, 4), **given)
    assert waves.render((6, 4), environment_strength=np.float32(1), samples=1).shape == (4, 6, 4)


def test_paths_of_bytes_are_uploaded(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere.fan"):
        fantex.upload(os.fsencode(tmp_path / "nowhere.fan"), b"s3://scans/a.fan")
