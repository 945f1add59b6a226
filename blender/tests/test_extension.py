# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension in headless Blender (`bpy` from PyPI), its pictures beside the texture function itself."""

import math
import re

import numpy as np
import pytest
from conftest import ROOT

bpy = pytest.importorskip("bpy")
fantex = pytest.importorskip("fantex")


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
        "samples": [{"at": {"position": [0, 0.3, 0.8]}}],
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
    # In the object's own space, y upwards.
    above, beside = asset.sample([[0, 1, 0], [1, 0, 0]])
    np.testing.assert_allclose(above[:3], (0, 1, 0), atol=0.03)
    np.testing.assert_allclose(beside[:3], (1, 0, 0), atol=0.03)
    assert tuple(bpy.context.object.location) == (3, 4, 5)


def test_factors_come_along(tmp_path, extension):
    """Two materials that differ in colours alone: what they share is in no picture."""
    item = red_cube()
    item.data.materials.append(colored("gold", (1, 0.75, 0.25, 1)))
    for material in item.data.materials:
        inputs = material.node_tree.nodes["Principled BSDF"].inputs
        inputs["Metallic"].default_value, inputs["Roughness"].default_value = 1, 0.125
        inputs["Emission Color"].default_value, inputs["Emission Strength"].default_value = (0.25, 0.125, 0, 1), 4
    max(item.data.polygons, key=lambda face: face.center.z).material_index = 1
    shown = bake(tmp_path / "a.fan", source="MATERIALS")
    asset = fantex.open(tmp_path / "a.fan")
    assert asset.channels == ["base-color"] and len(asset.materials) == 2
    [material] = shown.data.materials
    inputs = material.node_tree.nodes["Principled BSDF"].inputs
    assert inputs["Metallic"].default_value == 1 and inputs["Roughness"].default_value == pytest.approx(0.125)
    light = np.array(inputs["Emission Color"].default_value)[:3] * inputs["Emission Strength"].default_value
    np.testing.assert_allclose(light, (1, 0.5, 0), atol=1e-5)
    assert inputs["Base Color"].is_linked
    assert bpy.ops.fantex.reload() == {"FINISHED"} and list(shown.data.materials) == [material]


def test_lit_and_unlit_materials_share_pictures(tmp_path, extension):
    look = tmp_path / "look.toml"
    look.write_text(
        "[materials.red]\nbase_color = [1, 0, 0]\n"
        "[materials.gold]\nbase_color = [1, 0.75, 0.25]\nlighting = \"unlit\"\n"
    )
    item = red_cube()
    item.data.materials[0].name = "red"
    item.data.materials.append(colored("gold", (1, 0.75, 0.25, 1)))
    max(item.data.polygons, key=lambda face: face.center.z).material_index = 1
    shown = bake(tmp_path / "a.fan", source="LOOK", look=str(look))
    asset = fantex.open(tmp_path / "a.fan")
    assert len(shown.data.materials) == 2
    for face, used in zip(shown.data.polygons, asset.face_materials):
        inputs = shown.data.materials[face.material_index].node_tree.nodes["Principled BSDF"].inputs
        assert inputs["Emission Color"].is_linked == asset.materials[used].unlit == (face.center.z > 0.99)
        assert inputs["Base Color"].is_linked != asset.materials[used].unlit
    assert len({group.name for material in shown.data.materials for group in extension.fans.made_groups(material)}) == 1
    before = list(shown.data.materials)
    assert bpy.ops.fantex.reload() == {"FINISHED"}
    assert list(shown.data.materials) == before


def test_unlit_materials_emit_their_color(tmp_path, extension):
    look = tmp_path / "look.toml"
    look.write_text("[materials.all]\nbase_color = [0.25, 0.5, 1]\nlighting = \"unlit\"\n")
    red_cube()
    shown = bake(tmp_path / "a.fan", source="LOOK", look=str(look))
    assert fantex.open(tmp_path / "a.fan").materials[0].unlit
    inputs = shown.data.materials[0].node_tree.nodes["Principled BSDF"].inputs
    assert inputs["Emission Color"].is_linked and not inputs["Base Color"].is_linked
    assert tuple(inputs["Base Color"].default_value) == (0, 0, 0, 1) and inputs["Emission Strength"].default_value == 1


def test_assets_that_cannot_be_shown_stay(tmp_path, extension, monkeypatch):
    item = red_cube()
    path = tmp_path / "a.fan"
    asked = extension.fantex.Asset.fan_attributes
    # As an asset of a thousand times the texels.
    small = lambda asset, memory: asked(asset, memory=memory >> 20)
    monkeypatch.setattr(extension.fantex.Asset, "fan_attributes", small)
    with pytest.raises(RuntimeError, match="a.fan is baked, but cannot be shown: .* more than 8 GiB .*'s preferences"):
        bake(path, million_texels=0.1)
    assert fantex.open(path).verify()["ok"] and item[extension.BAKED_KEY] == str(path)
    assert bpy.context.object == item and not item.hide_get()
    with pytest.raises(RuntimeError, match="in the extension's preferences"):
        bpy.ops.fantex.import_fan(filepath=str(path))
    monkeypatch.undo()
    bake(path)


def test_mistakes_are_told(tmp_path, extension):
    with pytest.raises(RuntimeError, match="nowhere.fan"):
        bpy.ops.fantex.import_fan(filepath=str(tmp_path / "nowhere.fan"))
    bpy.ops.mesh.primitive_cube_add()
    with pytest.raises(RuntimeError, match="no vertex colours"):
        bpy.ops.fantex.bake("EXEC_DEFAULT", filepath=str(tmp_path / "a.fan"), source="COLORS")
    with pytest.raises(RuntimeError, match="^Error: Cube has no materials; give it one"):
        bpy.ops.fantex.bake("EXEC_DEFAULT", filepath=str(tmp_path / "a.fan"), source="MATERIALS")
    with pytest.raises(RuntimeError, match="no look is given; choose its file"):
        bpy.ops.fantex.bake("EXEC_DEFAULT", filepath=str(tmp_path / "a.fan"), source="LOOK")
    with pytest.raises(RuntimeError, match="Select an object that shows an asset"):
        bpy.ops.fantex.reload()
    bpy.context.object["fantex_asset"] = str(tmp_path / "nowhere.fan")
    for call in (bpy.ops.fantex.import_fan, bpy.ops.fantex.export_atlas):
        with pytest.raises(RuntimeError, match="nowhere.fan"):
            call(filepath=str(tmp_path / "nowhere.fan"))
        with pytest.raises(RuntimeError, match="//a.(fan|glb) lies beside the .blend file: save that first"):
            call(filepath="//a.glb")
    assert not (tmp_path / "a.fan").exists()


def colored(name, color):
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = color
    return material


def red_cube(**settings):
    bpy.ops.mesh.primitive_cube_add(**settings)
    item = bpy.context.object
    item.data.materials.append(colored("red", (1, 0, 0, 1)))
    return item


def bake(path, **settings):
    settings = {"source": "SOLID", "million_texels": 0.01, **settings}
    assert bpy.ops.fantex.bake("EXEC_DEFAULT", filepath=str(path), **settings) == {"FINISHED"}
    return bpy.context.object


def cut(item):
    """A cube with a hole, made by another object."""
    item.location = (10, 0, 0)
    bpy.ops.mesh.primitive_cube_add(location=(10, 0, 1), scale=(0.5, 0.5, 1))
    modifier = item.modifiers.new("cut", "BOOLEAN")
    modifier.object, modifier.operation, modifier.solver = bpy.context.object, "DIFFERENCE", "EXACT"


def mirrored(item):
    item.location = (12, 0, 0)
    bpy.ops.object.empty_add(location=(10, 0, 0))
    item.modifiers.new("mirror", "MIRROR").mirror_object = bpy.context.object


def keyed(item):
    item.location = (4, 0, 0)
    item.keyframe_insert("location", frame=1)


def constrained(item):
    bpy.ops.object.empty_add(location=(5, 0, 0), rotation=(0.5, 0.3, 0))
    item.constraints.new("COPY_TRANSFORMS").target = bpy.context.object


def turned(item):
    item.scale, item.rotation_euler = (-1, 2, 1), (7, 0, 0)


def reshaped(item):
    item.shape_key_add(name="Basis")
    key = item.shape_key_add(name="Twice")
    for point in key.data:
        point.co *= 2
    key.value = 1


def edited(item):
    bpy.context.view_layer.objects.active = item
    bpy.ops.object.mode_set(mode="EDIT")
    import bmesh

    mesh = bmesh.from_edit_mesh(item.data)
    mesh.verts.ensure_lookup_table()
    mesh.verts[0].co.x = -7
    bmesh.update_edit_mesh(item.data)


def hidden(item):
    item.hide_set(True)


CHANGES = [cut, mirrored, keyed, constrained, turned, reshaped, edited, hidden]


@pytest.mark.parametrize("change", CHANGES, ids=[change.__name__ for change in CHANGES])
def test_materials_come_along_with_the_shape(extension, change):
    """By way of glTF an object has the same shape as without, and stays as it is."""
    item = red_cube()
    change(item)
    context = bpy.context
    context.view_layer.objects.active = item
    context.view_layer.update()

    def state():
        context.view_layer.update()
        values = [item.matrix_world, item.matrix_basis, item.scale, item.location]
        selected = [other.name for other in context.view_layer.objects.selected]
        counts = len(bpy.data.objects), len(bpy.data.meshes)
        angles = tuple(item.rotation_euler)
        return repr((values, angles, selected, context.view_layer.objects.active.name, item.mode, counts))

    before = state()
    full = extension.objects.full_mesh(context, item)
    assert state() == before
    plain = extension.objects.plain_mesh(item, context.evaluated_depsgraph_get())
    assert full.info["triangles"] == plain.info["triangles"]
    assert full.info["materials"] == 1
    np.testing.assert_allclose(full.bounds, plain.bounds, atol=1e-5)


def test_materials_of_the_object_itself_come_along(tmp_path, extension):
    bpy.ops.mesh.primitive_cube_add()
    item = bpy.context.object
    item.data.materials.append(colored("red", (1, 0, 0, 1)))
    item.material_slots[0].link = "OBJECT"
    item.material_slots[0].material = colored("blue", (0, 0, 1, 1))
    bake(tmp_path / "a.fan", source="MATERIALS")
    sampled = fantex.open(tmp_path / "a.fan").sample([1, 0, 0])
    np.testing.assert_allclose(sampled[:3], (0, 0, 1), atol=0.03)


def test_the_exporter_may_be_off(tmp_path, extension):
    import addon_utils

    red_cube()
    addon_utils.disable("io_scene_gltf2")
    try:
        with pytest.raises(RuntimeError, match="^Error: Blender's add-on glTF 2.0 is off"):
            bpy.ops.fantex.bake("EXEC_DEFAULT", filepath=str(tmp_path / "a.fan"), source="MATERIALS")
    finally:
        addon_utils.enable("io_scene_gltf2")


def test_looks_see_names_and_coordinates(tmp_path, extension):
    from PIL import Image

    halves = np.zeros((64, 64, 3), np.uint8)
    halves[:32] = 255
    Image.fromarray(halves).save(tmp_path / "halves.png")
    look = tmp_path / "look.toml"
    look.write_text(
        """
[textures.halves]
kind = "image"
image = "halves.png"
[materials.picture]
base_color = "halves"
[materials.blue]
base_color = [0.0, 0.0, 1.0]
"""
    )
    bpy.ops.mesh.primitive_cube_add()
    item = bpy.context.object
    item.data.materials.append(colored("blue", (1, 1, 1, 1)))
    item.data.materials.append(colored("picture", (1, 1, 1, 1)))
    top = max(item.data.polygons, key=lambda face: face.center.z)
    top.material_index = 1
    for loop in top.loop_indices:
        x, y, _ = item.data.vertices[item.data.loops[loop].vertex_index].co
        item.data.uv_layers[0].uv[loop].vector = (x + 1) / 2, (y + 1) / 2
    bake(tmp_path / "a.fan", source="LOOK", look=str(look))
    # v goes with Blender's y, which is -z in the file.
    upper, lower, beside = fantex.open(tmp_path / "a.fan").sample([[0, 1, -0.5], [0, 1, 0.5], [1, 0, 0]])
    np.testing.assert_allclose([upper[:3], lower[:3], beside[:3]], [(1, 1, 1), (0, 0, 0), (0, 0, 1)], atol=0.03)


def test_textures_are_cut_at_hard_edges_where_that_is_asked_for(tmp_path, extension):
    angles = {}
    for name, settings in {"whole": {}, "cut": {"cuts_hard_edges": True}, "all": {"hard_angle": math.pi}}.items():
        bpy.ops.mesh.primitive_cube_add()
        bake(tmp_path / f"{name}.fan", **{"cuts_hard_edges": name != "whole", **settings})
        angles[name] = fantex.open(tmp_path / f"{name}.fan").info["hard_edges"]
    assert angles == {"whole": None, "cut": 60, "all": 180}


def test_notes_of_bakes_are_told(tmp_path, extension, capfd):
    bpy.ops.mesh.primitive_plane_add()
    bake(tmp_path / "a.fan")
    assert "Info: 4 edges on the boundary" in capfd.readouterr().out


def test_looks_see_colors(tmp_path, extension):
    look = tmp_path / "look.toml"
    look.write_text('[textures.own]\nkind = "vertex_color"\n[materials.all]\nbase_color = "own"\n')
    item = red_cube()
    colors = item.data.color_attributes.new("Color", "FLOAT_COLOR", "CORNER")
    colors.data.foreach_set("color", np.tile(np.array([0.8, 0.2, 0.1, 1], np.float32), len(colors.data)))
    bake(tmp_path / "a.fan", source="LOOK", look=str(look))
    sampled = fantex.open(tmp_path / "a.fan").sample([1, 0, 0])
    np.testing.assert_allclose(sampled[:3], (0.8, 0.2, 0.1), atol=0.02)


#: Another extent along each axis.
CORNERS = [(0, 0, -1), (1, 0, -1), (0, 2, -1), (0, 0, 5)]


def box(item):
    bpy.context.view_layer.update()
    corners = np.array([item.matrix_world @ vertex.co for vertex in item.data.vertices])
    return np.stack([corners.min(0), corners.max(0)])


@pytest.mark.parametrize("source", ["SOLID", "MATERIALS"])
def test_models_stand_everywhere(tmp_path, extension, source):
    """What was baked, shown, exported and read by others stands as the object does."""
    mesh = bpy.data.meshes.new("model")
    mesh.from_pydata(CORNERS, [], [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)])
    item = bpy.data.objects.new("model", mesh)
    bpy.context.scene.collection.objects.link(item)
    bpy.context.view_layer.objects.active = item
    item.data.materials.append(colored("red", (1, 0, 0, 1)))
    expected = box(item)
    shown = bake(tmp_path / "a.fan", source=source)
    np.testing.assert_allclose(box(shown), expected, atol=1e-5)
    assert bpy.ops.fantex.export_atlas(filepath=str(tmp_path / "a.glb"), resolution=50) == {"FINISHED"}
    before = set(bpy.data.images)
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "a.glb"))
    assert {tuple(image.size) for image in set(bpy.data.images) - before} == {(64, 64)}
    np.testing.assert_allclose(box(bpy.context.object), expected, atol=1e-5)
    bpy.ops.fantex.import_fan(filepath=str(tmp_path / "a.fan"))
    np.testing.assert_allclose(box(bpy.context.object), expected, atol=1e-5)


def test_both_sides_of_a_leaf_are_seen(tmp_path, extension):
    positions, faces = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]]

    def sides(points, normals):
        return np.where(normals[:, 2:] > 0, [[1.0, 0, 0]], [[0, 0, 1.0]])

    asset = fantex.bake((positions, faces), tmp_path / "leaf.fan", texels=5000, source=sides)
    item = extension.fans.build_object(asset, asset.fan_attributes(), "leaf", False)
    assert len(item.data.polygons) == len(asset.faces) == 4
    bpy.context.scene.collection.objects.link(item)
    bpy.context.view_layer.update()
    for height in (1, -1):
        hit, _, normal, face = item.ray_cast((0.6, 0.3, height), (0, 0, -height))
        assert hit and normal.z * height > 0
        color = asset.sample(face=[face], barycentric=[[1 / 3] * 3])[0, :3]
        np.testing.assert_allclose(color, (1, 0, 0) if height > 0 else (0, 0, 1), atol=0.03)


def test_files_of_others_are_not_replaced(tmp_path, extension):
    path = tmp_path / "a.fan"
    properties = bpy.ops.fantex.bake.get_rna_type().properties
    assert properties["filepath"].is_skip_save and properties["overwrite"].is_skip_save
    item = red_cube()
    bake(path)
    before = path.read_bytes()
    item.hide_set(False)
    bpy.ops.mesh.primitive_cone_add()
    other = bpy.context.object
    copy = item.copy()
    bpy.context.scene.collection.objects.link(copy)
    for active in (other, copy, item):
        # The copy says that the file is its own, too.
        bpy.context.view_layer.objects.active = active
        with pytest.raises(RuntimeError, match="exists and is not"):
            bake(path)
    assert path.read_bytes() == before
    bpy.data.objects.remove(copy)
    bpy.context.view_layer.objects.active = item
    bake(path, million_texels=0.02)
    assert path.read_bytes() != before
    bpy.context.view_layer.objects.active = other
    bake(path, overwrite=True)


def test_assets_outlive_blender(tmp_path, extension, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert extension.default_folder() == str(tmp_path)
    (tmp_path / "Documents").mkdir()
    assert extension.default_folder() == str(tmp_path / "Documents")
    red_cube()
    with pytest.raises(RuntimeError, match="save that first"):
        bake("//x.fan")
    (tmp_path / "scene").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene" / "a.blend"))
    assert extension.default_folder() == str(tmp_path / "scene")
    item = bake("//x.fan")
    assert item["fantex_asset"] == str(tmp_path / "scene" / "x.fan")


def paint_blue(path, size=200):
    fantex.open(path).paint([{
        "brush": {"size": {"texels": size}},
        "channels": [{"kind": "base_color", "color": {"srgb": [0, 0, 1]}}],
        "samples": [{"at": {"position": [0, 1, 0]}}],
    }])


def pixels(image):
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    return values


def test_reload_leaves_what_is_the_users(tmp_path, extension):
    red_cube()
    item = bake(tmp_path / "a.fan")
    material = item.data.materials[0]
    surface = material.node_tree.nodes["Principled BSDF"]
    surface.inputs["Roughness"].default_value = 0.123
    gold, empty, plain = colored("gold", (1, 0.8, 0, 1)), bpy.data.materials.new("empty"), bpy.data.materials.new("plain")
    empty.use_nodes = True
    empty.node_tree.nodes.new("ShaderNodeGroup")
    for further in (gold, empty, plain):
        item.data.materials.append(further)
    twin = item.copy()
    bpy.context.scene.collection.objects.link(twin)
    image = extension.fans.made_images(material)[0]
    before, old_mesh = pixels(image), item.data.name
    paint_blue(tmp_path / "a.fan")
    assert bpy.ops.fantex.reload() == {"FINISHED"}
    assert list(item.data.materials) == [material, gold, empty, plain]
    assert surface.inputs["Roughness"].default_value == pytest.approx(0.123)
    assert twin.data == item.data and item.data.name == old_mesh
    assert len([mesh for mesh in bpy.data.meshes if "fantex_sheets" in mesh]) == 1
    image, = extension.fans.made_images(material)
    assert (pixels(image) != before).any()
    # In the place of the material made here.
    item.data.materials[0] = gold
    assert bpy.ops.fantex.reload() == {"FINISHED"}
    assert list(item.data.materials) == [gold, gold, empty, plain]
    # Out of all slots.
    item.data.materials.clear()
    extension.fans.remove_unused(gold)
    extension.fans.remove_unused(material)
    assert set(bpy.data.materials.keys()) == {"red", "gold", "empty", "plain"}


def test_files_have_what_was_reloaded(tmp_path, extension):
    red_cube()
    item = bake(tmp_path / "a.fan")
    name = extension.fans.made_images(item.data.materials[0])[0].name
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    before = pixels(bpy.data.images[name])
    paint_blue(tmp_path / "a.fan")
    assert bpy.ops.fantex.reload() == {"FINISHED"}
    painted = pixels(bpy.data.images[name])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    assert (painted != before).any()
    np.testing.assert_array_equal(pixels(bpy.data.images[name]), painted)


def test_reload_of_another_layout_makes_materials_anew(tmp_path, extension):
    item = red_cube()
    shown = bake(tmp_path / "a.fan")
    old = shown.data.materials[0].name
    gold = colored("gold", (1, 0.8, 0, 1))
    shown.data.materials.append(gold)
    counts = [len(data) for data in (bpy.data.materials, bpy.data.node_groups, bpy.data.images)]
    mesh = extension.objects.plain_mesh(item, bpy.context.evaluated_depsgraph_get())
    fantex.bake(mesh, tmp_path / "a.fan", texels=100_000, source=fantex.solid("wood"), overwrite=True)
    assert bpy.ops.fantex.reload() == {"FINISHED"}
    assert shown.data.materials[1] == gold and shown.data.materials[0].name.startswith(old)
    assert [len(data) for data in (bpy.data.materials, bpy.data.node_groups, bpy.data.images)] == counts


def test_cut_outs_have_an_edge(tmp_path, extension):
    positions, faces = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), [[0, 1, 2], [0, 2, 3]]
    # Alpha is x.
    colors = np.stack([np.ones(4), np.zeros(4), np.zeros(4), positions[:, 0]], 1)
    mesh = fantex.Mesh(positions, faces, colors=colors)
    look = tmp_path / "look.toml"
    look.write_text('[textures.own]\nkind = "vertex_color"\n[materials.all]\nbase_color = "own"\nopacity = "blend"\n')
    asset = fantex.bake(mesh, tmp_path / "a.fan", texels=20000, source=fantex.look(look))
    for alpha, expected in (("cut-out", [0.0, 1.0]), ("blend", [0.25, 0.75])):
        asset.paint(alpha=alpha)
        bpy.ops.wm.read_factory_settings(use_empty=True)
        item = extension.fans.build_object(asset, asset.fan_attributes(), "model", False)
        bpy.context.scene.collection.objects.link(item)
        surface = item.data.materials[0].node_tree.nodes["Principled BSDF"]
        assert surface.inputs["Alpha"].is_linked
        emission_only(item, "Alpha")
        picture, faces_hit, places = cycles_picture(tmp_path, item, 64)
        for x, value in zip((0.25, 0.75), expected):
            at = (faces_hit >= 0) & (np.abs(places[..., 0] - x) < 0.05)
            assert at.sum() > 20
            np.testing.assert_allclose(picture[at][:, 0], value, atol=0.07)
    # As cut-outs again, in the place of blends.
    asset.paint(alpha="cut-out")
    extension.fans.rebuild(item, asset, asset.fan_attributes(), False)
    group, = extension.fans.made_groups(item.data.materials[0])
    assert any(node.type == "MATH" and node.operation == "LESS_THAN" for node in group.nodes)
    asset.paint(alpha="opaque")
    item = extension.fans.build_object(asset, asset.fan_attributes(), "model", False)
    assert not item.data.materials[0].node_tree.nodes["Principled BSDF"].inputs["Alpha"].is_linked


def test_the_manifest_names_the_wheel_of_the_recipe():
    import tomllib

    manifest = tomllib.loads((ROOT / "blender" / "blender_manifest.toml").read_text())
    wheel, = manifest["wheels"]
    tag = re.search(r"--compatibility (\w+)", (ROOT / "blender" / "README.md").read_text())[1]
    assert wheel == f"./wheels/fantex-{manifest['version']}-cp310-abi3-{tag}_x86_64.whl"
    assert manifest["platforms"] == ["linux-x64"]
