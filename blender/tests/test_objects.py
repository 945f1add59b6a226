# SPDX-License-Identifier: GPL-3.0-or-later
"""What of objects is baked, and what is told of the rest."""

import pytest

bpy = pytest.importorskip("bpy")
fantex = pytest.importorskip("fantex")

from test_extension import bake, colored, red_cube  # noqa: E402


def told(extension, item, by_materials=True):
    bpy.context.view_layer.update()
    return list(extension.objects.left_out(item, bpy.context.evaluated_depsgraph_get(), by_materials))


def test_what_gltf_does_not_hold_is_told(extension):
    item = red_cube()
    tree = item.data.materials[0].node_tree
    color = tree.nodes["Principled BSDF"].inputs["Base Color"]

    def node(kind, **settings):
        made = tree.nodes.new(f"ShaderNode{kind}")
        for name, value in settings.items():
            setattr(made, name, value)
        return made

    picture, place, coordinates = node("TexImage"), node("Mapping"), node("TexCoord")
    picture.image = bpy.data.images.new("checks", 4, 4)
    tree.links.new(coordinates.outputs["UV"], place.inputs["Vector"])
    tree.links.new(place.outputs[0], picture.inputs["Vector"])
    tint = node("Mix", data_type="RGBA", blend_type="MULTIPLY")
    tree.links.new(picture.outputs[0], tint.inputs["A"])
    tree.links.new(tint.outputs["Result"], color)
    assert told(extension, item) == []
    tree.links.new(coordinates.outputs["Object"], place.inputs["Vector"])
    tint.blend_type = "SCREEN"
    [note] = told(extension, item)
    assert "red is not baked as it is seen: glTF has no place for Mix, Object coordinates; bake that" in note
    assert told(extension, item, by_materials=False) == []
    # Within a group; what leads nowhere does not count.
    group = bpy.data.node_groups.new("inner", "ShaderNodeTree")
    group.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    group.links.new(group.nodes.new("ShaderNodeTexNoise").outputs["Color"], group.nodes.new("NodeGroupOutput").inputs[0])
    tree.links.new(node("Group", node_tree=group).outputs[0], color)
    [note] = told(extension, item)
    assert "glTF has no place for Noise Texture; bake" in note
    tree.links.new(picture.outputs[0], color)
    tree.links.new(coordinates.outputs["UV"], picture.inputs["Vector"])
    picture.image.source, picture.image.filepath = "FILE", "/nowhere/checks.png"
    assert told(extension, item) == ["red is baked without checks: its file is missing or damaged"]


def test_warnings_come_with_the_bake(tmp_path, extension, capfd):
    item = red_cube()
    tree = item.data.materials[0].node_tree
    tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs[0], tree.nodes["Principled BSDF"].inputs["Base Color"])
    bake(tmp_path / "a.fan", source="MATERIALS")
    assert "Warning: red is not baked as it is seen: glTF has no place for Noise Texture" in capfd.readouterr().out


def test_instances_are_told(tmp_path, extension):
    item = red_cube()
    tree = bpy.data.node_groups.new("copies", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    given, made = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    points, copies = tree.nodes.new("GeometryNodeMeshLine"), tree.nodes.new("GeometryNodeInstanceOnPoints")
    tree.links.new(points.outputs[0], copies.inputs["Points"])
    tree.links.new(given.outputs[0], copies.inputs["Instance"])
    tree.links.new(copies.outputs[0], made.inputs[0])
    item.modifiers.new("copies", "NODES").node_group = tree
    [note] = told(extension, item)
    assert "Cube shows instances, which are not baked; a Realize Instances node" in note
    with pytest.raises(RuntimeError, match="Cube has no faces, only instances; a Realize Instances node makes them faces"):
        bake(tmp_path / "a.fan")


def test_whatever_has_a_surface_is_baked(tmp_path, extension):
    bpy.ops.object.camera_add()
    with pytest.raises(RuntimeError, match="Select an object with a surface: a mesh, a curve, a text or a metaball"):
        bpy.ops.fantex.bake("EXEC_DEFAULT", filepath=str(tmp_path / "a.fan"))
    for add in (bpy.ops.curve.primitive_bezier_circle_add, bpy.ops.object.metaball_add, bpy.ops.object.text_add):
        add()
        assert bpy.ops.fantex.bake.poll()
    item = bpy.context.object
    item.data.materials.append(colored("red", (1, 0, 0, 1)))
    assert told(extension, item) == []
    # A name gets its ending.
    shown = bake(tmp_path / "text", source="MATERIALS")
    assert shown.name == "Text fans" and shown.type == "MESH"
    asset = fantex.open(tmp_path / "text.fan")
    assert asset.sample([0, 0, 0])[0] > 0.9 and len(asset.faces) > 50


def test_projects_may_be_moved(tmp_path, extension):
    item = red_cube()
    (tmp_path / "project" / "assets").mkdir(parents=True)
    for place in ("assets/a.fan", "b.fan"):
        (tmp_path / "project" / place).touch()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "project" / "a.blend"))
    below, beside = (str(tmp_path / "project" / place) for place in ("assets/a.fan", "b.fan"))
    assert extension.found("/gone/assets/a.fan", item) == extension.found(r"C:\gone\assets\a.fan", item) == below
    assert extension.found("/gone/deep/b.fan", item) == beside
    for place in ("/gone/c.fan", "s3://scans/b.fan", below, ""):
        assert extension.found(place, item) == place
    item[extension.BAKED_KEY] = "/gone/b.fan"
    assert extension.owns(item, beside) and not extension.owns(item, below)
