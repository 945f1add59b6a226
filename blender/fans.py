# SPDX-License-Identifier: GPL-3.0-or-later
"""Assets as meshes of Blender: three texture coordinates per corner, sheets of tiles, and the node group that blends them."""

import bpy
import numpy as np

#: UV layers: the corner's places in the tiles of the fans at its triangle's corners, and its first two barycentric coordinates.
PLACES = ("fan_0", "fan_1", "fan_2")
CORNER = "fan_corner"

#: Where an object's asset is, and whether its y axis pointed upwards.
ASSET_KEY = "fantex_asset"
Y_UP_KEY = "fantex_y_up"


def z_up(vectors):
    """Vectors of a file whose y axis points upwards as Blender has them."""
    return np.stack([vectors[..., 0], -vectors[..., 2], vectors[..., 1]], -1)


def build_object(asset, fans, name, y_up, in_light=False):
    """A new object with the asset's mesh, its fans and their materials, one for each sheet.

    Pictures of colours are sRGB bytes, which Cycles interpolates as such; ``in_light`` makes them floats in linear light, as fantex
    interpolates, of four times the size.
    """
    mesh = build_mesh(asset, fans, name, y_up, in_light)
    item = bpy.data.objects.new(name, mesh)
    mark(item, asset, y_up)
    return item


def rebuild(item, asset, fans, y_up):
    """Gives an object another asset; its own name, place and modifiers stay."""
    old = item.data
    name = old.name
    old_materials = list(old.materials)
    item.data = build_mesh(asset, fans, name, y_up)
    mark(item, asset, y_up)
    if old.users == 0:
        bpy.data.meshes.remove(old)
    for material in old_materials:
        remove_unused(material)
    item.data.name = name


def mark(item, asset, y_up):
    item[ASSET_KEY] = asset.place
    item[Y_UP_KEY] = bool(y_up)


def remove_unused(material):
    """Removes a material that nothing uses, with its node group and pictures."""
    if material is None or material.users > 0:
        return
    groups = [node.node_tree for node in material.node_tree.nodes if node.type == "GROUP"]
    bpy.data.materials.remove(material)
    for group in groups:
        images = {node.image for node in group.nodes if node.type == "TEX_IMAGE" and node.image}
        if group.users == 0:
            bpy.data.node_groups.remove(group)
        for image in images:
            if image.users == 0:
                bpy.data.images.remove(image)


def build_mesh(asset, fans, name, y_up, in_light=False):
    positions, faces = asset.positions, asset.faces
    if y_up:
        positions = z_up(positions)
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(positions))
    mesh.vertices.foreach_set("co", positions.astype(np.float32).ravel())
    mesh.loops.add(3 * len(faces))
    mesh.loops.foreach_set("vertex_index", faces.astype(np.int32).ravel())
    mesh.polygons.add(len(faces))
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * len(faces), 3, dtype=np.int32))
    mesh.polygons.foreach_set("material_index", fans.sheet.astype(np.int32))
    mesh.update(calc_edges=True)
    for slot, layer in enumerate(PLACES):
        coordinates = mesh.uv_layers.new(name=layer, do_init=False)
        coordinates.uv.foreach_set("vector", np.ascontiguousarray(fans.uv[:, slot]).ravel())
    corners = np.tile(np.array([1, 0, 0, 1, 0, 0], np.float32), len(faces))
    mesh.uv_layers.new(name=CORNER, do_init=False).uv.foreach_set("vector", corners)
    set_normals(mesh, asset, faces, y_up)
    for index, sheet in enumerate(fans.sheets):
        title = name if len(fans.sheets) == 1 else f"{name} {index + 1}"
        mesh.materials.append(build_material(title, sheet, fans, y_up, in_light))
    mesh.validate(clean_customdata=False)
    return mesh


def set_normals(mesh, asset, faces, y_up):
    """The asset's shading normals."""
    face = np.repeat(np.arange(len(faces)), 3)
    corners = np.tile(np.eye(3, dtype=np.float32), (len(faces), 1))
    normals = asset.normals(face, corners)
    mesh.polygons.foreach_set("use_smooth", np.ones(len(faces), bool))
    mesh.normals_split_custom_set(z_up(normals) if y_up else normals)


def build_image(name, samples, is_color, in_light=False):
    """A packed picture; row 0 of the array is on top. Bytes of colours are sRGB, 16 bits are numbers."""
    is_float = samples.dtype == np.uint16 or (is_color and in_light)
    height, width, components = samples.shape
    rgba = np.ones((height, width, 4), np.float32)
    scale = np.float32(255 if samples.dtype == np.uint8 else 65535)
    rgba[..., :components] = samples[::-1] / scale
    if components == 1:
        rgba[..., 1:3] = rgba[..., :1]
    if is_color and in_light:
        encoded = rgba[..., :3]
        rgba[..., :3] = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    image = bpy.data.images.new(name, width, height, alpha=components == 4, float_buffer=is_float)
    image.colorspace_settings.name = "sRGB" if is_color and not in_light else "Non-Color"
    image.alpha_mode = "CHANNEL_PACKED" if components == 4 else "NONE"
    image.pixels.foreach_set(rgba.ravel())
    image.pack()
    return image


def build_material(name, sheet, fans, y_up, in_light=False):
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    surface = tree.nodes["Principled BSDF"]
    group = tree.nodes.new("ShaderNodeGroup")
    group.node_tree = build_group(name, sheet, fans, y_up, in_light)
    group.location = (-300, 300)
    for output in group.outputs:
        if output.name in surface.inputs:
            tree.links.new(output, surface.inputs[output.name])
    if "base-color" in sheet and sheet["base-color"].shape[2] < 4:
        # Opaque: no need to ask for transparency.
        for link in list(surface.inputs["Alpha"].links):
            tree.links.remove(link)
    if "emission" in sheet:
        surface.inputs["Emission Strength"].default_value = fans.scales["emission"]
    if "orm" not in sheet:
        surface.inputs["Roughness"].default_value = 1.0
    return material


class _Builder:
    """Nodes that compute, from left to right."""

    def __init__(self, tree):
        self.tree = tree
        self.column = 0

    def node(self, kind, **settings):
        node = self.tree.nodes.new(kind)
        for key, value in settings.items():
            setattr(node, key, value)
        node.location = (self.column * 40 - 1600, -(len(self.tree.nodes) % 12) * 120)
        self.column += 1
        return node

    def connect(self, node, inputs):
        for socket, value in inputs:
            if isinstance(value, (int, float)):
                node.inputs[socket].default_value = value
            else:
                self.tree.links.new(value, node.inputs[socket])

    def math(self, operation, *values):
        node = self.node("ShaderNodeMath", operation=operation)
        self.connect(node, enumerate(values))
        return node.outputs[0]

    def scaled(self, vector, factor):
        node = self.node("ShaderNodeVectorMath", operation="SCALE")
        self.connect(node, [("Vector", vector), ("Scale", factor)])
        return node.outputs[0]

    def sum(self, first, second):
        node = self.node("ShaderNodeVectorMath", operation="ADD")
        self.connect(node, enumerate((first, second)))
        return node.outputs[0]


def weights(build, delta):
    """``a_i = max(0, l_i - max(l_j, l_k) + delta)``, divided by their sum."""
    corner = build.node("ShaderNodeUVMap", uv_map=CORNER)
    parts = build.node("ShaderNodeSeparateXYZ")
    build.connect(parts, [(0, corner.outputs[0])])
    first, second = parts.outputs[0], parts.outputs[1]
    third = build.math("SUBTRACT", build.math("SUBTRACT", 1.0, first), second)
    place = (first, second, third)
    raised = []
    for i in range(3):
        others = build.math("MAXIMUM", place[(i + 1) % 3], place[(i + 2) % 3])
        over = build.math("ADD", build.math("SUBTRACT", place[i], others), delta)
        raised.append(build.math("MAXIMUM", over, 0.0))
    total = build.math("ADD", build.math("ADD", raised[0], raised[1]), raised[2])
    return [build.math("DIVIDE", a, total) for a in raised]


def build_group(name, sheet, fans, y_up, in_light=False):
    """The node group: the texture function of all channels of a sheet."""
    tree = bpy.data.node_groups.new(f"Fan Texture {name}", "ShaderNodeTree")
    build = _Builder(tree)
    shares = weights(build, float(fans.delta))
    places = [build.node("ShaderNodeUVMap", uv_map=layer).outputs[0] for layer in PLACES]
    result = build.node("NodeGroupOutput")

    def output(title, kind, socket):
        tree.interface.new_socket(title, in_out="OUTPUT", socket_type=kind)
        tree.links.new(socket, result.inputs[title])

    def blended(channel, is_color):
        samples = sheet[channel]
        if channel == "normal" and y_up:
            top = np.iinfo(samples.dtype).max
            samples = np.stack([samples[..., 0], top - samples[..., 2], samples[..., 1]], -1)
        image = build_image(f"{name} {channel}", samples, is_color, in_light)
        color = alpha = None
        for place, share in zip(places, shares):
            texture = build.node("ShaderNodeTexImage", image=image, interpolation="Linear", extension="EXTEND")
            build.connect(texture, [("Vector", place)])
            part = build.scaled(texture.outputs["Color"], share)
            color = part if color is None else build.sum(color, part)
            if samples.shape[2] == 4:
                part = build.math("MULTIPLY", texture.outputs["Alpha"], share)
                alpha = part if alpha is None else build.math("ADD", alpha, part)
        return color, alpha

    if "base-color" in sheet:
        color, alpha = blended("base-color", True)
        output("Base Color", "NodeSocketColor", color)
        if alpha is not None:
            output("Alpha", "NodeSocketFloat", alpha)
    if "orm" in sheet:
        parts = build.node("ShaderNodeSeparateXYZ")
        build.connect(parts, [(0, blended("orm", False)[0])])
        output("Occlusion", "NodeSocketFloat", parts.outputs[0])
        output("Roughness", "NodeSocketFloat", parts.outputs[1])
        output("Metallic", "NodeSocketFloat", parts.outputs[2])
    if "normal" in sheet:
        turned = build.node("ShaderNodeNormalMap", space="OBJECT")
        build.connect(turned, [("Color", blended("normal", False)[0])])
        output("Normal", "NodeSocketVector", turned.outputs[0])
    if "emission" in sheet:
        output("Emission Color", "NodeSocketColor", blended("emission", True)[0])
    return tree
