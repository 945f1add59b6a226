"""Functions as sources: their channels, what they are told, and what is wrong with them."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest

import fantex
from conftest import grid_sphere, pattern

SQUARE = ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])


def everything(points, normals):
    """All channels, smooth in the world."""
    x, y, z = points.T
    return {
        "metallic": 0.5 + 0.5 * np.sin(2 * x),
        "base-color": np.column_stack([pattern(points), 0.6 + 0.3 * y]),
        "roughness": (0.5 + 0.4 * z)[:, None],
        "normal": 7 * (normals + 0.3 * np.column_stack([np.sin(3 * y), np.zeros_like(y), np.cos(2 * x)])),
        "occlusion": 0.75,
        "emission": (0.2 + 0.1 * x).astype(np.float16),
        "displacement": 0.5 + 0.25 * y,
        "light": np.array([2.0, 0.5, 0.25]),
        "anisotropy": np.column_stack([np.cross([0, 1, 0], normals) + 1e-3, 0.5 + 0.2 * z]),
    }


def test_channels_are_what_the_function_says(tmp_path, sphere):
    asset = fantex.bake(sphere, tmp_path / "a.fan", texels=200_000, source=everything, format="float")
    assert asset.channels == ["base-color", "normal", "orm", "emission", "displacement", "light", "anisotropy"]
    assert asset.baked["channels"] == asset.channels
    assert not any("source" in note for note in asset.baked["notes"])
    random = np.random.default_rng(1)
    face = random.integers(0, len(asset.faces), 3000)
    weights = random.dirichlet((1, 1, 1), 3000)
    points = (asset.positions[asset.faces[face]] * weights[:, :, None]).sum(1)
    normals = asset.normals(face, weights)
    expected = everything(points, normals)

    def read(channel):
        return asset.sample(face=face, barycentric=weights, channel=channel)

    assert np.abs(read("base-color") - expected["base-color"]).max() < 3e-3
    orm = np.column_stack([np.full(3000, 0.75), expected["roughness"][:, 0], expected["metallic"]])
    assert np.abs(read("orm")[:, :3] - orm).max() < 3e-3
    assert np.abs(read("emission")[:, :3] - (0.2 + 0.1 * points[:, :1])).max() < 3e-3
    assert np.abs(read("displacement")[:, 0] - expected["displacement"]).max() < 3e-3
    np.testing.assert_allclose(read("light")[:, :3], np.tile([2, 0.5, 0.25], (3000, 1)), rtol=1e-5)
    unit = expected["normal"] / np.linalg.norm(expected["normal"], axis=1)[:, None]
    degrees = np.degrees(np.arccos(np.clip((read("normal")[:, :3] * unit).sum(1), -1, 1)))
    assert degrees.max() < 1, degrees.max()
    # Away from the poles, where the direction has none; of a direction either way is meant.
    away = np.abs(points[:, 1]) < 0.9
    along = expected["anisotropy"][away, :3] / np.linalg.norm(expected["anisotropy"][away, :3], axis=1)[:, None]
    found = read("anisotropy")[away]
    assert np.abs((found[:, :3] * along).sum(1)).min() > 0.99
    assert np.abs(found[:, 3] - expected["anisotropy"][away, 3]).max() < 0.01


def test_eight_bits_hold_channels_too(tmp_path, sphere):
    asset = fantex.bake(sphere, tmp_path / "a.fan", texels=100_000, source=everything)
    points = np.random.default_rng(2).normal(size=(500, 3))
    _, _, points = asset.nearest(points)
    expected = everything(points, points)
    assert np.abs(asset.sample(points)[:, :3] - expected["base-color"][:, :3]).mean() < 0.01
    assert np.abs(asset.sample(points, channel="orm")[:, 1] - expected["roughness"][:, 0]).max() < 0.05
    (note,) = [note for note in asset.baked["notes"] if "brighter" in note]
    assert note.startswith("The source's light is brighter than 1 at ") and 'format="float" keeps it' in note


def test_bytes_do_not_depend_on_threads(tmp_path):
    script = (
        "import sys\n"
        f"sys.path.insert(0, {os.path.dirname(__file__)!r})\n"
        "import fantex\n"
        "from test_functions import everything, grid_sphere\n"
        "fantex.bake(grid_sphere(), sys.argv[1], texels=60_000, source=everything, memory=1 << 22)\n"
    )
    files = []
    for threads in ("1", "3"):
        path = tmp_path / f"{threads}.fan"
        environment = {**os.environ, "RAYON_NUM_THREADS": threads}
        subprocess.run([sys.executable, "-c", script, str(path)], env=environment, check=True, timeout=300)
        files.append(path.read_bytes())
    assert files[0] == files[1]


def test_bytes_are_what_their_channels_say(tmp_path):
    """Colours in sRGB, shares in 255ths, masks; one value for all points."""

    def source(points, normals):
        return {
            "base-color": np.uint8([188, 0, 255]),
            "roughness": np.full(len(points), 51, np.uint8),
            "metallic": points[:, 0] > 0.5,
            "emission": np.array([[0.25, 0.5, 1.0]]),
        }

    asset = fantex.bake(SQUARE, tmp_path / "a.fan", texels=20_000, source=source, format="rgba8")
    assert asset.channels == ["base-color", "orm", "emission"]
    left, right = (asset.sample([x, 0.5, 0], channel="orm")[:3] for x in (0.25, 0.75))
    np.testing.assert_allclose([left, right], [[1, 0.2, 0], [1, 0.2, 1]], atol=0.003)
    assert asset.sample([0.5, 0.5, 0], srgb=True)[:3].tolist() == [188, 0, 255]
    np.testing.assert_allclose(asset.sample([0.5, 0.5, 0], channel="emission")[:3], [0.25, 0.5, 1], atol=0.005)
    # Without colours, too: the material's are seen then.
    rough = fantex.bake(SQUARE, tmp_path / "b.fan", texels=5_000, source=lambda points, _: {"occlusion": points[:, 1]})
    assert rough.channels == ["orm"]
    np.testing.assert_allclose(rough.sample([0.5, 0.25, 0], channel="orm")[:3], [0.25, 0.9, 0], atol=0.01)
    assert rough.materials[0].base_color == (1, 1, 1, 1) and rough.render((40, 30), samples=1).std() > 1


def test_a_model_has_the_channels(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("PIL")

    def source(points, normals):
        return {
            "base-color": np.full(3, 0.25),
            "orm": np.column_stack([np.full(len(points), 0.6), points[:, 0], points[:, 1]]),
            "normal": (0.6, 0, 0.8),
            "emission": (0.5, 0, 0),
        }

    made = fantex.bake_model(SQUARE, tmp_path / "a.glb", resolution=128, source=source)
    assert sorted(made["channels"]) == ["base-color", "emission", "normal", "orm"]
    (mesh,) = trimesh.load(tmp_path / "a.glb", process=False).geometry.values()
    material, uv = mesh.visual.material, mesh.visual.uv
    pixels = {name: np.asarray(getattr(material, name)) for name in ("metallicRoughnessTexture", "occlusionTexture", "normalTexture")}
    for corners in mesh.faces:
        at = uv[corners].mean(0) * (128, -128) + (0, 128)
        x, y = int(at[0]), int(at[1])
        place = mesh.vertices[corners].mean(0)
        np.testing.assert_allclose(pixels["metallicRoughnessTexture"][y, x, 1:3] / 255, place[:2], atol=0.02)
        assert abs(pixels["occlusionTexture"][y, x, 0] / 255 - 0.6) < 0.01
        assert abs(pixels["normalTexture"][y, x, 2] / 127.5 - 1 - 0.8) < 0.02


def test_parts_have_the_channels(tmp_path, sphere):
    settings = {"texels": 50_000, "source": everything}
    whole = fantex.bake(sphere, tmp_path / "whole.fan", **settings)
    plan = fantex.plan(sphere, tmp_path / "a.plan", **settings)
    assert list(plan.channels) == whole.channels
    parts = [tmp_path / f"{number}.part" for number in (1, 2)]
    with pytest.warns(UserWarning, match="light is brighter than 1 at ") as told:
        for number, part in enumerate(parts, 1):
            fantex.bake_part(plan, (number, 2), part, mesh=sphere, source=everything)
    assert {warning.filename for warning in told} == {__file__}
    fantex.merge(plan, parts, tmp_path / "merged.fan")
    assert (tmp_path / "merged.fan").read_bytes() == (tmp_path / "whole.fan").read_bytes()
    with pytest.raises(ValueError, match="its channels are not those that .*a.plan was made for"):
        fantex.bake_part(plan, (1, 2), tmp_path / "x.part", mesh=sphere, source=pattern)


def test_functions_are_told_what_they_have_parameters_for(tmp_path):
    mesh = fantex.Mesh(*SQUARE)
    seen = []

    def source(points, normals, *, barycentric, footprint, face=None):
        seen.append((points, footprint, face, barycentric))
        return points

    for fit, share in (("sharp", 1), ("box", 4), ("point", 64)):
        seen.clear()
        fantex.bake(mesh, tmp_path / "a.fan", texels=10_000, source=source, fit=fit, overwrite=True)
        # The first is asked for alone, as if the triangle were one texel.
        assert len(seen[0][0]) == 1 and 0.5 < seen[0][1][0] < 1.5
        points, footprint, face, barycentric = (np.concatenate(given) for given in zip(*seen[1:]))
        assert footprint.shape == face.shape == (len(points),) and barycentric.shape == points.shape
        there = (mesh.positions[mesh.faces[face]] * barycentric[:, :, None]).sum(1)
        np.testing.assert_allclose(there, points, atol=1e-6)
        # A unit square with so many texels.
        np.testing.assert_allclose(footprint, 0.01 / share, rtol=0.1)

    # Cut triangles are those of the asset.
    seen.clear()
    bent = fantex.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0.5], [0, 1, 0]], SQUARE[1])
    cut = fantex.bake(bent, tmp_path / "cut.fan", texels=10_000, source=source, longest_edge=16)
    points, _, face, barycentric = (np.concatenate(given) for given in zip(*seen[1:]))
    assert len(cut.faces) > len(bent.faces) and len(np.unique(face)) == len(cut.faces)
    np.testing.assert_allclose((cut.positions[cut.faces[face]] * barycentric[:, :, None]).sum(1), points, atol=1e-6)

    class Told:
        def __call__(self, points, normals, footprint):
            assert footprint.shape == (len(points),)
            return points

    fantex.bake(mesh, tmp_path / "b.fan", texels=5_000, source=Told())
    scaled = ([[100 * x, 100 * y, 0] for x, y, _ in SQUARE[0]], SQUARE[1])
    widths = []
    fantex.bake(scaled, tmp_path / "c.fan", texels=10_000, source=lambda points, normals, footprint: widths.append(footprint) or points / 100)
    np.testing.assert_allclose(np.concatenate(widths[1:]), 1, rtol=0.1)
    # A parameter with another name is the function's own.
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'width'"):
        fantex.bake(mesh, tmp_path / "d.fan", texels=5_000, source=lambda points, normals, width: points)


def later(first, then):
    """Gives the one at first, and then the other."""
    return lambda points, normals: (first if len(points) == 1 else then)(points)


WRONG = [
    (lambda p: {}, ValueError, "the source gave nothing; expected some of base-color, normal, orm, occlusion"),
    (lambda p: {"albedo": p, "base-color": p}, ValueError, "the source gave albedo; expected some of base-color"),
    (lambda p: {3: p}, ValueError, "the source gave 3; expected some of"),
    (lambda p: {"orm": p, "roughness": 1.0}, ValueError, "gave orm and roughness, which is in it; give one of them"),
    (lambda p: {"roughness": p}, ValueError, r"the source's roughness has the shape \(1, 3\); expected \(1,\)"),
    (lambda p: {"normal": p[:, 0]}, ValueError, r"the source's normal has the shape \(1,\); expected \(1, 3\)"),
    (lambda p: {"emission": np.ones((1, 4))}, ValueError, r"emission has the shape \(1, 4\); expected \(1, 3\)"),
    (lambda p: {"roughness": 1}, TypeError, "roughness holds int64; expected floats, or uint8 in 255ths"),
    (lambda p: {"normal": np.uint8([0, 0, 255])}, TypeError, "normal holds uint8; expected floats"),
    (lambda p: {"base-color": None}, (TypeError, ValueError), "the source's base-color h"),
    (lambda p: {"base-color": "red"}, (TypeError, ValueError), "the source's base-color h"),
    (lambda p: None, (TypeError, ValueError), "the source's result h"),
]


@pytest.mark.parametrize("first, error, sentence", WRONG)
def test_what_no_channel_can_be(tmp_path, first, error, sentence):
    with pytest.raises(error, match=sentence):
        fantex.bake(SQUARE, tmp_path / "a.fan", texels=5_000, source=lambda points, normals: first(points))
    with pytest.raises(error, match=sentence):
        fantex.plan(SQUARE, tmp_path / "a.plan", texels=5_000, source=lambda points, normals: first(points))
    assert not os.listdir(tmp_path)


LATER = [
    (lambda p: {"base-color": p, "roughness": 0.5}, lambda p: {"base-color": p}, "gave base-color and at first base-color, roughness; give the same"),
    (lambda p: p, lambda p: {"base-color": p, "metallic": 1.0}, "gave base-color, metallic and at first base-color"),
    (lambda p: {"base-color": p}, lambda p: {"base-color": np.ones((len(p), 4))}, "base-color has 4 numbers for each point and had 3 at first"),
    (lambda p: p[:, 0], lambda p: p, "the source's result has 3 numbers for each point and had 1 at first"),
    (lambda p: {"base-color": p}, lambda p: {"base-color": p[:-1]}, r"base-color has the shape \(\d+, 3\); expected \(\d+, 3\) or"),
    (lambda p: {"metallic": p[:, 0]}, lambda p: {"metallic": p[:, :2]}, r"metallic has the shape \(\d+, 2\); expected \(\d+,\)"),
    (lambda p: p, lambda p: p.astype(int), "the source's result holds int64; expected uint8 in sRGB or linear floats"),
]


@pytest.mark.parametrize("first, then, sentence", LATER)
def test_blocks_that_differ_from_the_first(tmp_path, first, then, sentence):
    source = later(first, then)
    with pytest.raises((TypeError, ValueError), match=sentence):
        fantex.bake(SQUARE, tmp_path / "a.fan", texels=5_000, source=source)
    with pytest.raises((TypeError, ValueError), match=sentence):
        fantex.bake_model(SQUARE, tmp_path / "a.glb", texels=5_000, source=source)
    assert not os.listdir(tmp_path)


@pytest.mark.parametrize("error", [KeyError("mine"), KeyboardInterrupt("mine"), SystemExit(3), MemoryError("mine"), StopIteration("mine")])
def test_what_a_function_raises_is_raised(tmp_path, error):
    def fail(points):
        raise error

    for source in (later(fail, fail), later(lambda points: points, fail)):
        with pytest.raises(type(error)) as raised:
            fantex.bake(SQUARE, tmp_path / "a.fan", texels=5_000, source=source)
        assert raised.value is error
    assert not os.listdir(tmp_path)


def test_what_is_no_number_is_told(tmp_path):
    def source(points, normals):
        left = points[:, 0] < 0.5
        return {
            "base-color": np.where(left[:, None], np.nan, 0.5) * np.ones(3),
            "normal": np.where(left[:, None], 0, (0.6, 0, 0.8)),
            "roughness": np.where(left, np.nan, 0.5),
            "metallic": np.where(left, np.inf, -np.inf),
            "displacement": np.where(left, 2.0, 0.5),
        }

    asset = fantex.bake(SQUARE, tmp_path / "a.fan", texels=10_000, source=source)
    left, right = (0.25, 0.5, 0), (0.75, 0.5, 0)
    np.testing.assert_allclose(asset.sample([left, right])[:, 0], [0, 0.5], atol=0.01)
    np.testing.assert_allclose(asset.sample([left, right], channel="normal")[:, :3], [(0, 0, 1), (0.6, 0, 0.8)], atol=0.02)
    np.testing.assert_allclose(asset.sample([left, right], channel="orm")[:, 1:3], [(0, 1), (0.5, 0)], atol=0.01)
    notes = "\n".join(asset.baked["notes"])
    for sentence in (
        "The source gave no number as base-color for ",
        "points, which became black.",
        "The source gave no direction as normal for ",
        "points, which have that of the surface.",
        "The source gave no number as roughness for ",
        "points, which became 0.",
        "The source's displacement is outside 0 to 1 at ",
    ):
        assert sentence in notes, notes
    assert "metallic" not in notes
    kept = fantex.bake(SQUARE, tmp_path / "b.fan", texels=10_000, format="float", source=source)
    assert "outside 0 to 1" not in "\n".join(kept.baked["notes"])
    assert abs(kept.sample(left, channel="displacement")[0] - 2) < 0.01


def test_few_points_are_no_colors():
    """Three greys are no colour, and a colour is no three greys, however many points are asked for at once."""
    from fantex._function import FunctionSource

    def rows(given, count):
        function = FunctionSource(lambda points, normals: given(points))
        function.first(np.ones((1, 3)) * 0.1, np.zeros((1, 3)))
        points = np.linspace(0.1, 0.9, count)[:, None] * np.ones(3)
        return points, function(points, points)

    for count in (1, 2, 3, 4, 5):
        points, greys = rows(lambda points: points[:, 0], count)
        np.testing.assert_allclose(greys, np.c_[points, np.ones(count)], rtol=1e-6)
        for color in ([0.1, 0.2, 0.3], [0.1, 0.2, 0.3, 0.4]):
            _, one = rows(lambda points: np.array(color), count)
            np.testing.assert_allclose(one[:, : len(color)], np.tile(color, (count, 1)), rtol=1e-6)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_ends_a_bake_of_channels(tmp_path):
    script = (
        "import os, signal, sys, time\n"
        f"sys.path.insert(0, {os.path.dirname(__file__)!r})\n"
        "import fantex\n"
        "from test_functions import everything, grid_sphere\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "def slow(points, normals):\n"
        "    os.write(1, b'go\\n')\n"
        "    time.sleep(0.01)\n"
        "    return everything(points, normals)\n"
        "try:\n"
        f"    fantex.bake(grid_sphere(), {str(tmp_path / 'a.fan')!r}, texels=1e9, source=slow)\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted', flush=True)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "go\n"
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=120)[0].splitlines()[-1] == "interrupted"
    assert not os.listdir(tmp_path)
