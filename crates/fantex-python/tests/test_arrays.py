"""Meshes and numbers as users have them."""

import errno

import numpy as np
import pytest

import fantex


def test_any_number_type_and_layout(sphere):
    positions, faces = sphere
    plain = fantex.Mesh(positions, faces)
    for p, f in [
        (positions.astype(np.float32), faces.astype(np.uint32)),
        (np.asfortranarray(positions), faces.astype(np.uint8, casting="unsafe").astype(np.int16) * 0 + faces),
        (positions.tolist(), faces.tolist()),
        (positions[::1][:, ::1], faces.astype(np.int32)),
    ]:
        mesh = fantex.Mesh(p, f)
        assert mesh.faces.shape == plain.faces.shape and mesh.faces.dtype == np.uint32
        np.testing.assert_allclose(mesh.positions, plain.positions, atol=1e-6)


def unaligned(array):
    """The array at an odd address, as arrays out of network messages are."""
    buffer = np.zeros(array.nbytes + 1, np.uint8)
    moved = buffer[1:].view(array.dtype).reshape(array.shape)
    moved[...] = array
    assert not moved.flags.aligned
    return moved


def test_unaligned_arrays(sphere):
    positions, faces = sphere
    mesh = fantex.Mesh(unaligned(positions), unaligned(faces.astype(np.int64)))
    np.testing.assert_array_equal(mesh.positions, fantex.Mesh(positions, faces).positions)
    _, _, uvs = fantex.parametrize(unaligned(positions), unaligned(faces.astype(np.int64)))
    assert np.isfinite(uvs).all()


def test_what_is_no_mesh_is_named(sphere):
    positions, faces = sphere
    with pytest.raises(ValueError, match=r"positions has the shape .*expected \(n, 3\)"):
        fantex.Mesh(positions[:, :2], faces)
    with pytest.raises(TypeError, match="faces holds float64, not integers"):
        fantex.Mesh(positions, faces.astype(float))
    with pytest.raises(ValueError, match="face 0 has the vertices .* but there are 10 positions"):
        fantex.Mesh(positions[:10], faces[50:])
    with pytest.raises(ValueError, match="face 1 has the vertices"):
        fantex.Mesh(positions, [[0, 48, 49], [0, -1, 49]])
    with pytest.raises(fantex.Error, match="nothing is left"):
        fantex.Mesh(positions, [[0, 0, 1]])
    with pytest.raises(TypeError, match="int is no mesh"):
        fantex.Mesh.of(3)
    with pytest.raises(FileNotFoundError):
        fantex.Mesh.load("nowhere.ply")


def test_cleaning_says_which_faces_are_left(sphere):
    positions, faces = sphere
    dirty = np.concatenate([[[0, 0, 5]], faces, faces[:3]])
    mesh = fantex.Mesh(positions, dirty)
    # The poles' triangles have no area, either.
    corners = positions[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    assert mesh.source_faces.tolist() == (np.flatnonzero(area > 1e-12) + 1).tolist()
    assert any("without area" in note or "no area" in note for note in mesh.notes), mesh.notes


def test_meshes_of_trimesh(tmp_path, sphere):
    trimesh = pytest.importorskip("trimesh")
    positions, faces = sphere
    colors = np.random.default_rng(1).integers(0, 256, (len(positions), 4), np.uint8)
    colors[:, 3] = 255
    mesh = trimesh.Trimesh(positions, faces, vertex_colors=colors, process=False)
    asset = fantex.bake(mesh, tmp_path / "a.fan", texels=300_000)
    # At vertices that are no poles the colour is the vertex's.
    inner = slice(48, len(positions) - 48)
    sampled = asset.sample(positions[inner], srgb=True)
    assert np.abs(sampled[:, :3].astype(int) - colors[inner, :3]).mean() < 12
    scene = trimesh.Scene([mesh])
    assert len(fantex.Mesh.of(scene).faces) == len(fantex.Mesh.of(mesh).faces)


def test_textures_of_trimesh_come_along(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    image = pytest.importorskip("PIL.Image")
    positions = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    uv = positions[:, :2]
    pixels = np.zeros((64, 64, 3), np.uint8)
    pixels[:32, :32] = (255, 0, 0)  # top left
    pixels[32:, 32:] = (0, 255, 0)  # bottom right
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=image.fromarray(pixels))
    visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    square = trimesh.Trimesh(positions, [[0, 1, 2], [0, 2, 3]], visual=visual, process=False)
    asset = fantex.bake(square, tmp_path / "a.fan", texels=40_000)
    top_left, bottom_right, top_right = asset.sample([[0.25, 0.75, 0], [0.75, 0.25, 0], [0.75, 0.75, 0]])
    np.testing.assert_allclose(top_left[:3], (1, 0, 0), atol=0.02)
    np.testing.assert_allclose(bottom_right[:3], (0, 1, 0), atol=0.02)
    np.testing.assert_allclose(top_right[:3], 0, atol=0.02)


def test_torch_tensors_and_other_dlpack(sphere):
    class Tensor:
        """What has DLPack and nothing else."""

        def __init__(self, array):
            self.array = array

        def __dlpack__(self, **options):
            return self.array.__dlpack__(**options)

        def __dlpack_device__(self):
            return self.array.__dlpack_device__()

    positions, faces = sphere
    mesh = fantex.Mesh(Tensor(positions), Tensor(faces))
    assert len(mesh.positions) > 1000


def test_tensors_of_torch(sphere):
    torch = pytest.importorskip("torch", reason="no torch for Python")
    positions, faces = sphere
    plain = fantex.Mesh(positions, faces)
    for dtype in (torch.float32, torch.float64):
        tensor = torch.tensor(positions, dtype=dtype, requires_grad=True)
        mesh = fantex.Mesh(tensor, torch.tensor(faces), colors=torch.ones(len(positions), 3))
        np.testing.assert_allclose(mesh.positions, plain.positions, atol=1e-6)
    vmapping, _, uvs = fantex.parametrize(torch.tensor(positions), torch.tensor(faces, dtype=torch.int32))
    assert len(vmapping) == len(uvs)
    with pytest.raises(TypeError, match="faces holds float32, not integers"):
        fantex.Mesh(torch.tensor(positions), torch.tensor(faces, dtype=torch.float32))
    with pytest.raises((TypeError, ValueError)):
        fantex.Mesh(torch.tensor(positions, device="meta"), torch.tensor(faces))


def test_vectors_of_open3d(tmp_path, sphere):
    open3d = pytest.importorskip("open3d", reason="no open3d for Python", exc_type=ImportError)
    positions, faces = sphere
    vertices = open3d.utility.Vector3dVector(positions)
    triangles = open3d.utility.Vector3iVector(faces)
    plain = fantex.Mesh(positions, faces)
    np.testing.assert_allclose(fantex.Mesh(vertices, triangles).positions, plain.positions, atol=1e-12)
    mesh = open3d.geometry.TriangleMesh(vertices, triangles)
    mesh.vertex_colors = open3d.utility.Vector3dVector(np.full((len(positions), 3), 0.5))
    asset = fantex.bake(mesh, tmp_path / "a.fan", texels=20_000)
    # Open3D's colours are encoded: half is 128 of 255.
    assert np.abs(asset.sample([0, 0, 1], srgb=True)[:3].astype(int) - 128).max() <= 2


def test_fewer_faces_keep_the_shape(sphere):
    positions, faces = sphere
    fine = fantex.Mesh(positions, faces)
    coarse = fine.simplified(len(faces) // 3)
    assert len(faces) // 4 < len(coarse.faces) <= len(faces) // 3
    radii = np.linalg.norm(coarse.positions - positions.mean(axis=0), axis=1)
    np.testing.assert_allclose(radii, np.linalg.norm(positions - positions.mean(axis=0), axis=1).mean(), rtol=0.02)
    with pytest.raises(ValueError, match="faces is -1; it cannot be negative"):
        fine.simplified(-1)


def test_scenes_of_trimesh_are_what_their_files_are(tmp_path):
    """Factors of colours, opacity, shine and emission, places, and parts without textures, as the written file has them."""
    trimesh = pytest.importorskip("trimesh")
    image = pytest.importorskip("PIL.Image")
    from trimesh.visual.material import PBRMaterial

    pixels = np.full((8, 8, 4), 200, np.uint8)
    pixels[:, :4, 3] = 0
    cut = PBRMaterial(
        baseColorTexture=image.fromarray(pixels),
        baseColorFactor=[255, 128, 64, 255],
        alphaMode="MASK",
        emissiveFactor=[1, 0, 0],
        metallicFactor=1.0,
        roughnessFactor=0.25,
    )
    first = square_of_trimesh(cut)
    second = square_of_trimesh(PBRMaterial(baseColorTexture=image.fromarray(pixels[..., :3]), baseColorFactor=[64, 255, 255, 255]))
    colored = trimesh.Trimesh(first.vertices, first.faces, process=False, vertex_colors=np.tile([255, 188, 0, 255], (4, 1)))
    scene = trimesh.Scene()
    places = [(100.0, 0, 0), (200.0, 0, 0), (300.0, 0, 0)]
    for mesh, place in zip((first, second, colored), places):
        scene.add_geometry(mesh, transform=trimesh.transformations.translation_matrix(place))
    asset = fantex.bake(scene, tmp_path / "a.fan", texels=60_000, format="float")
    points = np.array([[100.75, 0.5, 0], [200.75, 0.5, 0], [300.5, 0.5, 0]])
    grey = ((200 / 255 + 0.055) / 1.055) ** 2.4
    factors = np.array([[255, 128, 64], [64, 255, 255]]) / 255
    np.testing.assert_allclose(asset.sample(points[:2])[:, :3], grey * factors, atol=0.01)
    np.testing.assert_allclose(asset.sample(points[2:])[0, :3], [1, ((188 / 255 + 0.055) / 1.055) ** 2.4, 0], atol=0.01)
    np.testing.assert_allclose(asset.sample(points, channel="orm")[:, 1:3], [[0.25, 1], [0.9, 0], [0.9, 0]], atol=0.02)
    np.testing.assert_allclose(asset.sample(points, channel="emission")[:, :3], [[1, 0, 0], [0] * 3, [0] * 3], atol=0.02)
    assert asset.sample([[100.25, 0.5, 0]])[0, 3] < 0.05
    assert "cut-out" in {material.alpha for material in asset.materials}
    # One mesh alone is no less.
    alone = fantex.bake(first, tmp_path / "b.fan", texels=10_000)
    assert alone.materials[0].alpha == "cut-out" and alone.sample([[0.25, 0.5, 0]])[0, 3] < 0.05
    with pytest.raises(ValueError, match="the scene holds no mesh with faces"):
        fantex.Mesh.of(trimesh.Scene())


def test_functions_give_alpha_and_no_numbers(tmp_path):
    square = ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    for format, most in (("float", 0.01), ("bc7", 0.02)):
        asset = fantex.bake(
            square,
            tmp_path / "a.fan",
            texels=10_000,
            format=format,
            overwrite=True,
            source=lambda points, _: np.column_stack([np.full((len(points), 3), 0.5), points[:, 0]]),
        )
        np.testing.assert_allclose(asset.sample([[0.25, 0.5, 0], [0.75, 0.5, 0]])[:, 3], [0.25, 0.75], atol=most)
        assert not any("no number" in note for note in asset.baked["notes"])

    def odd(points, _):
        values = np.full((len(points), 3), np.inf)
        values[points[:, 0] < 0.5] = np.nan
        return values

    asset = fantex.bake(square, tmp_path / "b.fan", texels=10_000, source=odd)
    np.testing.assert_allclose(asset.sample([[0.25, 0.5, 0], [0.75, 0.5, 0]])[:, :3], [[0] * 3, [1] * 3], atol=0.01)
    assert any(note.startswith("The source gave no number for ") for note in asset.baked["notes"])
    made = fantex.bake_model(square, tmp_path / "b.glb", texels=10_000, source=odd)
    assert any("no number" in note for note in made["notes"])
    with pytest.raises(ValueError, match="the mesh has no faces"):
        fantex.Mesh(square[0], np.zeros((0, 3), int))
    with pytest.raises(ValueError, match="no vertex colours"):
        fantex.bake(square, tmp_path / "c.fan", source=fantex.vertex_colors())
    with pytest.raises(FileNotFoundError) as raised:
        fantex.bake(square, tmp_path / "none" / "c.fan", texels=100, source=fantex.solid("wood"))
    assert raised.value.errno == errno.ENOENT


def test_functions_say_what_is_made_of_their_opacity(tmp_path):
    square = ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])

    def half(points, _):
        return np.column_stack([np.full((len(points), 3), 0.5), points[:, 0] > 0.5])

    settings = {"texels": 10_000, "source": half}
    for alpha in ("opaque", "cut-out", "blend"):
        asset = fantex.bake(square, tmp_path / f"{alpha}.fan", alpha=alpha, **settings)
        assert [material.alpha for material in asset.materials] == [alpha]
    assert fantex.bake(square, tmp_path / "a.fan", **settings).materials[0].alpha == "opaque"
    # As painting would have it, and in parts the same.
    assert fantex.open(tmp_path / "cut-out.fan").materials[0].threshold == 0.5
    plan = fantex.plan(square, tmp_path / "a.plan", alpha="cut-out", **settings)
    fantex.bake_part(plan, (1, 1), tmp_path / "1.part", mesh=square, source=half)
    fantex.merge(plan, [tmp_path / "1.part"], tmp_path / "merged.fan")
    assert (tmp_path / "merged.fan").read_bytes() == (tmp_path / "cut-out.fan").read_bytes()
    fantex.bake_model(square, tmp_path / "a.glb", alpha="blend", **settings)
    assert b'"alphaMode":"BLEND"' in (tmp_path / "a.glb").read_bytes()
    with pytest.raises(ValueError, match="none of opaque, cut-out, blend"):
        fantex.bake(square, tmp_path / "b.fan", alpha="cut", **settings)
    with pytest.raises(ValueError, match="alpha= is for functions"):
        fantex.bake(square, tmp_path / "b.fan", alpha="blend")


def test_what_is_at_corners_is_read(sphere):
    positions, faces = sphere
    bare = fantex.Mesh(positions, faces)
    assert bare.colors is None and bare.normals is None and bare.uv is None
    given = {
        "colors": np.column_stack([(positions + 1) / 2, np.full(len(positions), 0.5)]).astype(np.float32),
        "normals": (positions / np.linalg.norm(positions, axis=1)[:, None]).astype(np.float32),
        "uv": positions[:, :2].astype(np.float32),
    }
    mesh = fantex.Mesh(positions, faces, **given)
    for name, values in given.items():
        found = getattr(mesh, name)
        assert found.dtype == np.float32
        np.testing.assert_allclose(found, values[faces[mesh.source_faces]], atol=1e-6, err_msg=name)
        with pytest.raises(AttributeError):
            setattr(mesh, name, None)


def test_slips_in_strokes(tmp_path, waves):
    """A number where a choice belongs is JSON."""
    for brush in ({"size": 60}, {"size": {}}, {"size": [1]}):
        with pytest.raises(fantex.Error, match="something else belongs here: a word in quotation marks, or one key"):
            waves.paint([{"brush": brush, "channels": [], "samples": []}])


def square_of_trimesh(material):
    trimesh = pytest.importorskip("trimesh")
    positions = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    visual = trimesh.visual.TextureVisuals(uv=positions[:, :2], material=material)
    return trimesh.Trimesh(positions, [[0, 1, 2], [0, 2, 3]], visual=visual, process=False)


def test_colors_of_materials_of_trimesh(tmp_path):
    """Factors of glTF are linear, colours of OBJ sRGB; both scale the picture where there is one."""
    pytest.importorskip("trimesh")
    image = pytest.importorskip("PIL.Image")
    from trimesh.visual.material import PBRMaterial, SimpleMaterial

    grey = image.fromarray(np.full((8, 8, 3), 128, np.uint8))
    half = fantex._native.LINEAR_FROM_SRGB8[128]
    for material, expected in [
        (PBRMaterial(baseColorTexture=grey, baseColorFactor=[255, 128, 0, 255]), (half, half * 128 / 255, 0)),
        (PBRMaterial(baseColorTexture=grey.convert("L"), baseColorFactor=[255, 0, 0, 255]), (half, 0, 0)),
        (PBRMaterial(baseColorTexture=grey), (half, half, half)),
        (PBRMaterial(baseColorFactor=[255, 128, 0, 255]), (1, 128 / 255, 0)),
        (SimpleMaterial(diffuse=[255, 128, 0, 255]), (1, half, 0)),
        (SimpleMaterial(image=grey, diffuse=[255, 0, 128, 255]), (half, 0, half * half)),
        (SimpleMaterial(image=grey), (half, half, half)),
    ]:
        asset = fantex.bake(square_of_trimesh(material), tmp_path / "a.fan", texels=4000, format="float", overwrite=True)
        np.testing.assert_allclose(asset.sample([0.5, 0.5, 0])[:3], expected, atol=0.01)
    # What says how it shines is a material, and what says nothing is none.
    asset = fantex.bake(square_of_trimesh(PBRMaterial(roughnessFactor=0.5)), tmp_path / "b.fan", texels=4000)
    assert [material.roughness for material in asset.materials] == [0.5]
    for material in (PBRMaterial(), SimpleMaterial(), SimpleMaterial(diffuse=[102, 102, 102, 255])):
        with pytest.raises(ValueError, match="neither textures nor colours"):
            fantex.bake(square_of_trimesh(material), tmp_path / "c.fan")
