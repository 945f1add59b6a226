"""Meshes of Open3D with textures: its own where it is installed, and objects that have what its documentation says."""

from types import SimpleNamespace

import numpy as np
import pytest

import fantex

POSITIONS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
#: Of the corners of each face, v upwards.
UVS = POSITIONS[FACES.ravel(), :2]


class Image:
    """An image of either kind."""

    def __init__(self, texels=None):
        self.texels = texels

    def is_empty(self):
        return self.texels is None

    def __array__(self, dtype=None, copy=None):
        return np.asarray(self.texels)

    def as_tensor(self):
        return Tensor(self.texels)


class Tensor:
    def __init__(self, values):
        self.values = values

    def numpy(self):
        return self.values


class OldMesh:
    """What a ``geometry.TriangleMesh`` has."""

    def __init__(self):
        self.vertices, self.triangles, self.vertex_colors = POSITIONS, FACES, np.zeros((0, 3))
        self.triangle_uvs, self.textures, self.triangle_material_ids = np.zeros((0, 2)), [], np.zeros(0, np.int32)

    def has_vertex_colors(self):
        return len(self.vertex_colors) > 0

    def has_triangle_uvs(self):
        return len(self.triangle_uvs) > 0

    def has_triangle_material_ids(self):
        return len(self.triangle_material_ids) > 0


class TensorMesh:
    """What a ``t.geometry.TriangleMesh`` has."""

    def __init__(self):
        self.vertex = {"positions": Tensor(POSITIONS.astype(np.float32))}
        self.triangle = {"indices": Tensor(FACES)}
        self.material = SimpleNamespace(
            material_name="", texture_maps={}, scalar_properties={}, vector_properties={}, is_valid=lambda: bool(self.material.material_name)
        )

    def cpu(self):
        return self


class Documented:
    """Makes such objects."""

    name = "documented"

    def old(self, **values):
        mesh = OldMesh()
        for name, value in values.items():
            setattr(mesh, name, [Image(texels) for texels in value] if name == "textures" else value)
        return mesh

    def of_tensors(self, vertex=None, triangle=None, material="", maps=None, numbers=None, colors=None):
        mesh = TensorMesh()
        mesh.vertex.update({name: Tensor(values) for name, values in (vertex or {}).items()})
        mesh.triangle.update({name: Tensor(values) for name, values in (triangle or {}).items()})
        mesh.material.material_name = material
        mesh.material.texture_maps.update({name: Image(texels) for name, texels in (maps or {}).items()})
        mesh.material.scalar_properties.update(numbers or {})
        mesh.material.vector_properties.update(colors or {})
        return mesh


class Installed:
    """Makes Open3D's own."""

    name = "installed"

    def __init__(self, open3d):
        self.open3d = open3d

    def old(self, **values):
        utility, geometry = self.open3d.utility, self.open3d.geometry
        mesh = geometry.TriangleMesh(utility.Vector3dVector(POSITIONS), utility.Vector3iVector(FACES))
        kinds = {
            "vertex_colors": utility.Vector3dVector,
            "triangle_uvs": utility.Vector2dVector,
            "triangle_material_ids": utility.IntVector,
            "textures": lambda images: [geometry.Image() if texels is None else geometry.Image(texels) for texels in images],
        }
        for name, value in values.items():
            setattr(mesh, name, kinds[name](value))
        return mesh

    def of_tensors(self, vertex=None, triangle=None, material="", maps=None, numbers=None, colors=None):
        core, geometry = self.open3d.core, self.open3d.t.geometry
        mesh = geometry.TriangleMesh()
        for of, values in (
            (mesh.vertex, {"positions": POSITIONS.astype(np.float32), **(vertex or {})}),
            (mesh.triangle, {"indices": FACES, **(triangle or {})}),
        ):
            for name, value in values.items():
                of[name] = core.Tensor(np.ascontiguousarray(value))
        if material:
            mesh.material = self.open3d.visualization.Material(material)
        for name, texels in (maps or {}).items():
            mesh.material.texture_maps[name] = geometry.Image(core.Tensor(np.ascontiguousarray(texels)))
        for name, value in (numbers or {}).items():
            mesh.material.scalar_properties[name] = value
        for name, value in (colors or {}).items():
            mesh.material.vector_properties[name] = np.float32(value)
        return mesh


@pytest.fixture(params=["documented", "installed"])
def open3d(request):
    if request.param == "documented":
        return Documented()
    return Installed(pytest.importorskip("open3d", reason="no open3d for Python", exc_type=ImportError))


def quarters(*colors):
    """A picture of four colours: top left, top right, bottom left, bottom right."""
    corner = np.uint8(colors).reshape(2, 2, -1)
    return np.ascontiguousarray(corner.repeat(32, 0).repeat(32, 1))


RED, GREEN, BLUE, WHITE = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)
#: Top left, top right, bottom left, bottom right, y upwards.
PLACES = [(0.25, 0.75, 0), (0.75, 0.75, 0), (0.25, 0.25, 0), (0.75, 0.25, 0)]


def bytes_at(asset, places):
    return asset.sample(places, srgb=True)[:, :3].astype(int)


def test_textures_of_old_meshes(tmp_path, open3d):
    """Their first row lies below."""
    picture = quarters(RED, GREEN, BLUE, WHITE)
    mesh = open3d.old(triangle_uvs=UVS, textures=[np.ascontiguousarray(picture[::-1])])
    asset = fantex.bake(mesh, tmp_path / "a.fan", texels=20_000)
    assert np.abs(bytes_at(asset, PLACES) - [RED, GREEN, BLUE, WHITE]).max() < 4
    assert asset.channels == ["base-color"]
    # The source that is the default.
    again = fantex.bake(mesh, tmp_path / "b.fan", texels=20_000, source=fantex.own_materials())
    assert (tmp_path / "a.fan").read_bytes() == (tmp_path / "b.fan").read_bytes() and again.channels == asset.channels


def test_materials_of_old_meshes(tmp_path, open3d):
    """Each triangle has its own texture; one has none, as readers of Open3D leave it; faces are counted as they were."""
    lower, upper = (np.full((8, 8, 3), color, np.uint8) for color in (RED, GREEN))
    below, above = (0.75, 0.25, 0), (0.25, 0.75, 0)
    mesh = open3d.old(triangle_uvs=UVS, textures=[None, lower, upper], triangle_material_ids=[2, 1])
    made = fantex.Mesh.of(mesh)
    assert made.source_faces.tolist() == [1, 0]
    middles = made.positions[made.faces].mean(1)
    np.testing.assert_allclose(middles, POSITIONS[FACES[[1, 0]]].mean(1), atol=1e-6)
    asset = fantex.bake(mesh, tmp_path / "a.fan", texels=20_000)
    assert np.abs(bytes_at(asset, [below, above]) - [GREEN, RED]).max() < 4
    # What has no texture shows its vertices' colours.
    colored = open3d.old(
        triangle_uvs=UVS, textures=[None, lower], triangle_material_ids=[0, 1], vertex_colors=np.tile([0, 0, 1.0], (4, 1))
    )
    asset = fantex.bake(colored, tmp_path / "b.fan", texels=20_000)
    assert np.abs(bytes_at(asset, [below, above]) - [BLUE, RED]).max() < 4
    # Coordinates without a picture are there all the same.
    np.testing.assert_allclose(fantex.Mesh.of(open3d.old(triangle_uvs=UVS)).uv, UVS.reshape(-1, 3, 2), atol=1e-6)
    with pytest.raises(ValueError, match="the mesh has 5 texture coordinates and 2 triangles; expected three for each"):
        fantex.Mesh.of(open3d.old(triangle_uvs=UVS[:5])) if open3d.name == "documented" else fantex.Mesh.of(few(UVS))


def few(uvs):
    """Open3D itself takes them away."""
    return Documented().old(triangle_uvs=uvs[:5])


def test_maps_of_tensor_meshes(tmp_path, open3d):
    """All maps, and numbers that scale them; roughness and metallic of different sizes."""
    mesh = open3d.of_tensors(
        triangle={"texture_uvs": UVS.reshape(-1, 3, 2).astype(np.float32)},
        material="defaultLit",
        maps={
            "albedo": quarters(RED, GREEN, BLUE, WHITE),
            "normal": np.full((4, 4, 3), (204, 128, 230), np.uint8),
            "roughness": quarters(255, 204, 153, 51),
            "metallic": np.uint8([[[255], [0]]]).repeat(16, 0).repeat(8, 1),
            "ambient_occlusion": np.full((4, 4, 1), 0.6, np.float32),
        },
        numbers={"roughness": 0.5, "metallic": 1.0},
        colors={"base_color": (1, 0.5, 1, 1), "emissive_color": (0.25, 0, 0, 1)},
    )
    asset = fantex.bake(mesh, tmp_path / "a.fan", texels=40_000, source=fantex.own_materials(), format="rgba8")
    assert asset.channels == ["base-color", "normal", "orm"]
    factors = np.array([[255, 0, 0], [0, 188, 0], [0, 0, 255], [255, 188, 255]])
    assert np.abs(bytes_at(asset, PLACES) - factors).max() <= 2
    orm = asset.sample(PLACES, channel="orm")[:, :3]
    np.testing.assert_allclose(orm, [(0.6, 0.5, 1), (0.6, 0.4, 0), (0.6, 0.3, 1), (0.6, 0.1, 0)], atol=0.01)
    # Along u, which is x here, and upwards.
    np.testing.assert_allclose(asset.sample(PLACES, channel="normal")[:, :3], np.tile([0.6, 0, 0.8], (4, 1)), atol=0.02)
    np.testing.assert_allclose(asset.materials[0].emission, (0.25, 0, 0), atol=1e-6)


def test_what_tensor_meshes_leave_out(tmp_path, open3d):
    uvs = {"texture_uvs": UVS.reshape(-1, 3, 2).astype(np.float32)}
    # Packed, with older names of numbers; a map that nothing is said of counts whole, and no map is no metal.
    packed = quarters((255, 128, 0), (51, 255, 255), (102, 51, 51), (0, 0, 0))
    mesh = open3d.of_tensors(triangle=uvs, material="defaultLit", maps={"ao_rough_metal": packed})
    orm = fantex.bake(mesh, tmp_path / "a.fan", texels=40_000).sample(PLACES, channel="orm")[:, :3]
    np.testing.assert_allclose(orm, packed[::32, ::32].reshape(4, 3) / 255, atol=0.02)
    mesh = open3d.of_tensors(triangle=uvs, material="defaultLit", maps={"roughness": quarters(255, 0, 255, 0)}, numbers={"base_roughness": 0.5})
    orm = fantex.bake(mesh, tmp_path / "b.fan", texels=40_000).sample(PLACES, channel="orm")[:, 1:3]
    np.testing.assert_allclose(orm, [(0.5, 0), (0, 0), (0.5, 0), (0, 0)], atol=0.02)
    # Coordinates of vertices; colours, which floats encode; a material without a picture; nothing at all.
    mesh = open3d.of_tensors(vertex={"texture_uvs": POSITIONS[:, :2].astype(np.float32)}, material="defaultLit", maps={"albedo": quarters(RED, GREEN, BLUE, WHITE)})
    assert np.abs(bytes_at(fantex.bake(mesh, tmp_path / "c.fan", texels=20_000), PLACES) - [RED, GREEN, BLUE, WHITE]).max() < 4
    for colors in (np.full((4, 3), 0.5, np.float32), np.full((4, 3), 128, np.uint8)):
        mesh = open3d.of_tensors(vertex={"colors": colors})
        assert np.abs(bytes_at(fantex.bake(mesh, tmp_path / "d.fan", texels=5_000, overwrite=True), PLACES) - 128).max() <= 2
    mesh = open3d.of_tensors(material="defaultLitTransparency", colors={"base_color": (0.5, 0.25, 1, 0.5)}, numbers={"metallic": 1.0})
    asset = fantex.bake(mesh, tmp_path / "e.fan", texels=5_000)
    np.testing.assert_allclose(asset.sample(PLACES[0]), (0.5, 0.25, 1, 0.5), atol=0.01)
    assert (asset.materials[0].alpha, asset.materials[0].metallic) == ("blend", 1)
    bare = open3d.of_tensors()
    assert fantex.Mesh.of(bare).faces.tolist() == FACES.tolist()
    with pytest.raises(ValueError, match="has neither textures nor colours to bake; choose a source"):
        fantex.bake(bare, tmp_path / "f.fan")
    assert fantex.bake(bare, tmp_path / "f.fan", texels=5_000, source=fantex.solid("marble")).channels == ["base-color"]


def test_files_that_open3d_reads_show_what_their_files_do(tmp_path):
    """Both kinds of meshes of an OBJ file look like the file."""
    open3d = pytest.importorskip("open3d", reason="no open3d for Python", exc_type=ImportError)
    picture = quarters(RED, GREEN, BLUE, WHITE)
    (tmp_path / "a.png").write_bytes(fantex._native.encode_png(picture))
    (tmp_path / "a.mtl").write_text("newmtl a\nKd 1 1 1\nmap_Kd a.png\n")
    corners = "".join(f"v {x} {y} 0\nvt {x} {y}\n" for x, y, _ in POSITIONS)
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{corners}usemtl a\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n")
    read = [fantex.Mesh.load(tmp_path / "a.obj")]
    for whole in (False, True):
        read.append(open3d.io.read_triangle_mesh(str(tmp_path / "a.obj"), whole))
    read.append(open3d.t.io.read_triangle_mesh(str(tmp_path / "a.obj"), True))
    read.append(open3d.t.geometry.TriangleMesh.from_legacy(read[2]))
    for number, mesh in enumerate(read):
        asset = fantex.bake(mesh, tmp_path / f"{number}.fan", texels=20_000)
        assert np.abs(bytes_at(asset, PLACES) - [RED, GREEN, BLUE, WHITE]).max() < 4, number


def test_empty_meshes(open3d):
    empty = open3d.old()
    empty.triangles = np.zeros((0, 3), np.int32) if open3d.name == "documented" else open3d.open3d.utility.Vector3iVector()
    tensors = TensorMesh() if open3d.name == "documented" else open3d.open3d.t.geometry.TriangleMesh()
    if open3d.name == "documented":
        tensors.vertex, tensors.triangle = {}, {}
    for mesh in (empty, tensors):
        with pytest.raises(ValueError, match="the mesh has no faces"):
            fantex.Mesh.of(mesh)
