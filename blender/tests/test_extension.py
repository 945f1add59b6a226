# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension in headless Blender (`bpy` from PyPI), its pictures beside the texture function itself."""

import importlib.util
import math
import sys
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
fantex = pytest.importorskip("fantex")

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def extension():
    """The folder as a package, as Blender loads it."""
    folder = ROOT / "blender"
    spec = importlib.util.spec_from_file_location(
        "fantex_extension", folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    module = importlib.util.module_from_spec(spec)
    sys.modules["fantex_extension"] = module
    spec.loader.exec_module(module)
    module.register()
    yield module
    module.unregister()


@pytest.fixture(autouse=True)
def empty_scene():
    bpy.ops.wm.read_factory_settings(use_empty=True)


def emission_only(item, output="Base Color"):
    """Shows an output of the node group as it is."""
    for material in item.data.materials:
        tree = material.node_tree
        group = next(node for node in tree.nodes if node.type == "GROUP")
        target = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
        emission = tree.nodes.new("ShaderNodeEmission")
        tree.links.new(group.outputs[output], emission.inputs["Color"])
        tree.links.new(emission.outputs[0], target.inputs["Surface"])


def cycles_picture(tmp_path, item, size=256):
    """Linear RGBA of one ray through the middle of each pixel, and where these rays hit: mask, faces, barycentric coordinates."""
    scene = bpy.context.scene
    corners = np.array([item.matrix_world @ v.co for v in item.data.vertices])
    center, radius = corners.mean(0), np.ptp(corners, axis=0).max() * 0.6
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    camera.data.type, camera.data.ortho_scale = "ORTHO", 2 * radius
    camera.data.clip_end = 100 * radius
    direction = np.array([0.5, -0.75, 0.43])
    direction /= np.linalg.norm(direction)
    camera.location = center + direction * 8 * radius
    import mathutils

    camera.rotation_euler = mathutils.Vector(direction).to_track_quat("Z", "Y").to_euler()
    scene.camera = camera
    render = scene.render
    render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    scene.cycles.pixel_filter_type = "BOX"
    scene.cycles.use_adaptive_sampling = False
    render.filter_size = 0.01
    scene.cycles.filter_width = 0.01
    render.resolution_x = render.resolution_y = size
    render.film_transparent = True
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_mode = "RGBA"
    render.image_settings.color_depth = "32"
    scene.view_settings.view_transform = "Raw"
    render.filepath = str(tmp_path / "picture.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(render.filepath)
    image.colorspace_settings.name = "Non-Color"
    pixels = np.empty(size * size * 4, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(size, size, 4)

    bpy.context.view_layer.update()
    axes = np.array(camera.matrix_world.to_3x3())
    faces = np.full((size, size), -1)
    places = np.zeros((size, size, 3), np.float32)
    inverse = item.matrix_world.inverted()
    for y in range(size):
        for x in range(size):
            u, v = ((x + 0.5) / size - 0.5) * 2 * radius, ((y + 0.5) / size - 0.5) * 2 * radius
            start = np.array(camera.location) + axes[:, 0] * u + axes[:, 1] * v
            hit, place, _, face = item.ray_cast(
                inverse @ mathutils.Vector(start), inverse.to_3x3() @ mathutils.Vector(-direction)
            )
            if hit:
                faces[y, x], places[y, x] = face, place
    return pixels, faces, places


def barycentric(asset_positions, faces, at, places):
    a, b, c = asset_positions[faces[at]].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    square = (normal**2).sum(1)

    def share(p, q):
        return (np.cross(q - p, places - p) * normal).sum(1) / square

    result = np.stack([share(b, c), share(c, a), share(a, b)], 1)
    return result / result.sum(1, keepdims=True)


def decibels(a, b):
    return -10 * math.log10(max(float(((a - b) ** 2).mean()), 1e-20))


def compare(tmp_path, extension, asset, y_up=False, in_light=False, largest_side=8192):
    """PSNR between Cycles' picture of the nodes and the texture function at the same points."""
    attributes = asset.fan_attributes(largest_side=largest_side)
    item = extension.fans.build_object(asset, attributes, "model", y_up, in_light)
    assert len(item.data.materials) == len(attributes.sheets)
    bpy.context.scene.collection.objects.link(item)
    emission_only(item)
    pixels, faces, places = cycles_picture(tmp_path, item)
    positions = asset.positions
    if y_up:
        positions = extension.fans.z_up(positions)
    at = (faces >= 0) & (pixels[..., 3] == 1)
    assert at.sum() > 5000
    weights = barycentric(positions, asset.faces, faces[at], places[at].astype(np.float64))
    # Where a ray passes an edge within rounding, it may hit another face.
    inner = (weights > 1e-3).all(1)
    truth = asset.sample(face=faces[at][inner], barycentric=weights[inner])[:, :3]
    return decibels(pixels[at][inner][:, :3], truth)


def waves(points, normals):
    x, y, z = points.T * 9
    return np.stack([0.5 + 0.4 * np.sin(x), 0.5 + 0.4 * np.sin(y + 1), 0.5 + 0.4 * np.sin(z + x)], -1)


def shapes():
    """Meshes of several kinds: smooth, with creases, dirty."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=24, ring_count=12)
    bpy.ops.mesh.primitive_torus_add(major_segments=24, minor_segments=8)
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.mesh.primitive_monkey_add()
    bpy.ops.mesh.primitive_cone_add(vertices=40)
    return [item for item in bpy.context.scene.objects if item.type == "MESH"]


def test_nodes_are_the_texture_function(tmp_path, extension):
    """At least 50 dB on five models."""
    assets = []
    for item in shapes():
        mesh = extension.objects.plain_mesh(item, bpy.context.evaluated_depsgraph_get())
        path = tmp_path / f"{item.name}.fan"
        assets.append(fantex.bake(mesh, path, texels=100_000, source=waves))
    for asset in assets:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        quality = compare(tmp_path, extension, asset)
        print(asset.place, f"{quality:.1f} dB")
        assert quality > 50, (asset.place, quality)


def test_sheets_beyond_a_limit_are_materials(tmp_path, extension):
    bpy.ops.mesh.primitive_monkey_add()
    mesh = extension.objects.plain_mesh(bpy.context.object, bpy.context.evaluated_depsgraph_get())
    asset = fantex.bake(mesh, tmp_path / "a.fan", texels=100_000, source=waves)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert compare(tmp_path, extension, asset, largest_side=400) > 50
    assert len(bpy.data.objects["model"].data.materials) > 1


def test_y_up_models_stand(tmp_path, extension):
    bottle = ROOT / "assets" / "WaterBottle" / "WaterBottle.gltf"
    asset = fantex.bake(bottle, tmp_path / "bottle.fan", texels=200_000)
    # Sharp lettering: interpolated as bytes of sRGB it differs a little, in linear light not.
    assert compare(tmp_path, extension, asset, y_up=True) > 45
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert compare(tmp_path, extension, asset, y_up=True, in_light=True) > 60
    item = bpy.data.objects["model"]
    assert item.dimensions.z > 1.5 * item.dimensions.x
    surface = item.data.materials[0].node_tree.nodes["Principled BSDF"]
    for name in ("Base Color", "Roughness", "Metallic", "Normal"):
        assert surface.inputs[name].is_linked, name


def test_normals_are_in_object_space(tmp_path, extension):
    """A smooth sphere's normals on a coarse one: the nodes give the fine one's."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=48)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    fine = extension.objects.plain_mesh(bpy.context.object, depsgraph)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=16, ring_count=8)
    coarse = extension.objects.plain_mesh(bpy.context.object, bpy.context.evaluated_depsgraph_get())
    colored = fantex.Mesh(fine.positions, fine.faces, colors=np.full((len(fine.positions), 3), 0.5))
    asset = fantex.bake(coarse, tmp_path / "a.fan", texels=150_000, source=fantex.mesh(colored))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    item = extension.fans.build_object(asset, asset.fan_attributes(), "model", False)
    bpy.context.scene.collection.objects.link(item)
    # Normals as colours: the output of the normal map is in world space, which is the object's here.
    emission_only(item, "Normal")
    pixels, faces, places = cycles_picture(tmp_path, item)
    at = (faces >= 0) & (pixels[..., 3] == 1)
    weights = barycentric(asset.positions, asset.faces, faces[at], places[at].astype(np.float64))
    truth = asset.sample(face=faces[at], barycentric=weights, channel="normal")[:, :3]
    seen = pixels[at][:, :3]
    # Emission cannot be negative.
    positive = (truth > 0.1).all(1)
    assert positive.sum() > 500
    assert np.abs(seen[positive] - truth[positive]).mean() < 0.01


def test_baking_the_active_object(tmp_path, extension):
    bpy.ops.mesh.primitive_monkey_add()
    item = bpy.context.object
    colors = item.data.color_attributes.new("Color", "FLOAT_COLOR", "CORNER")
    values = np.tile(np.array([0.8, 0.2, 0.1, 1], np.float32), len(colors.data))
    colors.data.foreach_set("color", values)
    path = tmp_path / "monkey.fan"
    result = bpy.ops.fantex.bake("EXEC_DEFAULT", filepath=str(path), source="COLORS", million_texels=0.05)
    assert result == {"FINISHED"}
    shown = bpy.context.object
    assert shown.name == "Suzanne fans" and shown["fantex_asset"] == str(path)
    assert item.hide_get()
    sampled = fantex.open(path).sample([[0, 0, 5]])[0]
    np.testing.assert_allclose(sampled[:3], (0.8, 0.2, 0.1), atol=0.02)
    # Painted on elsewhere, reloaded here.
    asset = fantex.open(path)
    asset.paint([{
        "brush": {"size": {"texels": 200}},
        "channels": [{"kind": "base_color", "color": {"srgb": [0, 0, 1]}}],
        "samples": [{"at": {"position": [0, -0.8, 0.3]}}],
    }])
    before = shown.data
    assert bpy.ops.fantex.reload() == {"FINISHED"}
    assert bpy.context.object.data != before
    assert len([material for material in bpy.data.materials if material.users]) == 1
    # And out again.
    out = tmp_path / "monkey.glb"
    assert bpy.ops.fantex.export_atlas(filepath=str(out), resolution=256) == {"FINISHED"}
    assert out.stat().st_size > 10_000


def test_materials_come_along(tmp_path, extension):
    bpy.ops.mesh.primitive_cube_add()
    item = bpy.context.object
    for color in ((1, 0, 0, 1), (0, 1, 0, 1)):
        material = bpy.data.materials.new("plain")
        material.use_nodes = True
        material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = color
        item.data.materials.append(material)
    top = max(item.data.polygons, key=lambda face: face.center.z)
    top.material_index = 1
    item.location = (3, 4, 5)
    path = tmp_path / "cube.fan"
    result = bpy.ops.fantex.bake("EXEC_DEFAULT", filepath=str(path), source="MATERIALS", million_texels=0.02)
    assert result == {"FINISHED"}
    asset = fantex.open(path)
    # In the object's own space, z upwards.
    above, beside = asset.sample([[0, 0, 1], [1, 0, 0]])
    np.testing.assert_allclose(above[:3], (0, 1, 0), atol=0.03)
    np.testing.assert_allclose(beside[:3], (1, 0, 0), atol=0.03)
    assert tuple(bpy.context.object.location) == (3, 4, 5)


def test_mistakes_are_told(tmp_path, extension):
    with pytest.raises(RuntimeError, match="nowhere.fan"):
        bpy.ops.fantex.import_fan(filepath=str(tmp_path / "nowhere.fan"))
    bpy.ops.mesh.primitive_cube_add()
    with pytest.raises(RuntimeError, match="no vertex colours"):
        bpy.ops.fantex.bake("EXEC_DEFAULT", filepath=str(tmp_path / "a.fan"), source="COLORS")
    assert not (tmp_path / "a.fan").exists()
