# SPDX-License-Identifier: GPL-3.0-or-later
"""Assets as meshes of Blender: three texture coordinates per corner, sheets of tiles, and the node group that blends them."""

from typing import NamedTuple, Optional, Tuple

import bpy
import numpy as np

#: UV layers: the corner's places in the tiles of the fans at its triangle's corners, and its first two barycentric coordinates.
PLACES = ("fan_0", "fan_1", "fan_2")
CORNER = "fan_corner"

#: Where an object's asset is, and whether its y axis pointed upwards.
ASSET_KEY = "fantex_asset"
Y_UP_KEY = "fantex_y_up"

#: Marks materials, node groups and images that are made here: a text that says how they are laid out. Others are the user's.
MADE_KEY = "fantex_made"
#: The number of a mesh's materials that are made here. They come first; further ones are the user's.
SHEETS_KEY = "fantex_sheets"
#: Which channel an image has.
CHANNEL_KEY = "fantex_channel"

#: How far apart the two sides of a leaf lie, as a share of the model's diagonal: what renderers tell apart and nobody sees.
SIDE_DISTANCE = 1e-4


def z_up(vectors):
    """Vectors of a file whose y axis points upwards as Blender has them."""
    return np.stack([vectors[..., 0], -vectors[..., 2], vectors[..., 1]], -1)


def build_object(asset, fans, name, y_up, in_light=False):
    """A new object with the asset's mesh, its fans and their materials, one for each sheet and each material of the asset that looks otherwise.

    Pictures of colours are sRGB bytes, which Cycles interpolates as such; ``in_light`` makes them floats in linear light, as fantex
    interpolates, of four times the size.
    """
    mesh = build_mesh(asset, fans, name, y_up, in_light)
    item = bpy.data.objects.new(name, mesh)
    mark(item, asset, y_up)
    return item


def rebuild(item, asset, fans, y_up):
    """Gives an object, and all others with its mesh, another asset. Names, places, modifiers and what the user has made of the
    materials stay; materials whose sheets are laid out otherwise are made anew."""
    old = item.data
    name = old.name
    old_materials = list(old.materials)
    count = old.get(SHEETS_KEY, len(fans.sheets))
    in_light = any(
        image.is_float
        for material in old_materials
        for image in made_images(material)
        if image[CHANNEL_KEY] == "base-color"
    )
    mesh = build_mesh(asset, fans, name, y_up, in_light, old_materials[:count])
    for material in old_materials[count:]:
        mesh.materials.append(material)
    old.user_remap(mesh)
    mark(item, asset, y_up)
    if old.users == 0:
        bpy.data.meshes.remove(old)
    for material in old_materials:
        remove_unused(material)
    mesh.name = name


def mark(item, asset, y_up):
    item[ASSET_KEY] = asset.place
    item[Y_UP_KEY] = bool(y_up)


def made_groups(material):
    """The node groups of a material that are made here."""
    tree = material.node_tree if material else None
    groups = {node.node_tree for node in tree.nodes if node.type == "GROUP"} if tree else set()
    return [group for group in groups if group and MADE_KEY in group]


def made_images(material):
    """The images of a material that are made here."""
    nodes = [node for group in made_groups(material) for node in group.nodes if node.type == "TEX_IMAGE"]
    return [image for image in {node.image for node in nodes} if image and MADE_KEY in image]


def remove_unused(material):
    """Removes a material that is made here and that nothing uses, with its node group and pictures."""
    if material is None or MADE_KEY not in material or material.users > 0:
        return
    groups, images = made_groups(material), made_images(material)
    bpy.data.materials.remove(material)
    for group in groups:
        if group.users == 0:
            bpy.data.node_groups.remove(group)
    for image in images:
        if image.users == 0:
            bpy.data.images.remove(image)


def cut_out_threshold(asset):
    """The least alpha that is seen where the asset's materials are cut-outs; None where one of them blends, or all are opaque."""
    if any(material.alpha == "blend" for material in asset.materials):
        return None
    return min((material.threshold for material in asset.materials if material.alpha == "cut-out"), default=None)


class Factors(NamedTuple):
    """What a material shows beside pictures; None where these show it."""

    #: Linear RGB, and how much is seen.
    color: Optional[Tuple[float, ...]]
    metallic: Optional[float]
    roughness: Optional[float]
    #: Linear RGB, which may exceed 1.
    emission: Optional[Tuple[float, ...]]
    unlit: bool


def factors_of(material, channels):
    """The factors of an asset's material whose sheets have these channels."""
    *color, alpha = material.base_color
    if material.alpha != "blend":
        alpha = 1.0 if material.alpha == "opaque" or alpha >= material.threshold else 0.0
    is_shiny = "orm" not in channels and not material.unlit
    return Factors(
        color=None if "base-color" in channels else (*color, alpha),
        metallic=material.metallic if is_shiny else None,
        roughness=material.roughness if is_shiny else None,
        emission=None if "emission" in channels or material.unlit else material.emission,
        unlit=material.unlit,
    )


def slots_of(asset, fans):
    """The slots of materials, each with the number of its sheet and its factors, and the slot of each face."""
    factors = [factors_of(material, fans.sheets[0]) for material in asset.materials]
    kinds = list(dict.fromkeys(factors))
    number_of = {kind: number for number, kind in enumerate(kinds)}
    kind = np.array([number_of[each] for each in factors])[asset.face_materials]
    used, slots = np.unique(fans.sheet.astype(np.int64) * len(kinds) + kind, return_inverse=True)
    return [(number // len(kinds), kinds[number % len(kinds)]) for number in used.tolist()], slots


def with_sides_apart(positions, faces):
    """A mesh for Blender, whose faces may not have the same vertices: where two have, as on both sides of a leaf, the second one
    gets vertices of its own, a little in front."""
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    second = np.setdiff1d(np.arange(len(faces)), first)
    if len(second) == 0:
        return positions, faces
    used, corners = np.unique(faces[second], return_inverse=True)
    corners = corners.reshape(-1, 3)
    a, b, c = positions[faces[second]].transpose(1, 0, 2)
    normals = np.zeros((len(used), 3))
    np.add.at(normals, corners, np.cross(b - a, c - a)[:, None])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    distance = SIDE_DISTANCE * np.linalg.norm(np.ptp(positions, axis=0))
    faces = faces.astype(np.int64)
    faces[second] = len(positions) + corners
    return np.concatenate([positions, positions[used] + distance * normals]), faces


def build_mesh(asset, fans, name, y_up, in_light=False, materials=()):
    """A new mesh. Given materials are taken again: the user's as they are, others with new pictures where these fit."""
    slots, slot_of_face = slots_of(asset, fans)
    positions, faces = with_sides_apart(asset.positions, asset.faces)
    if y_up:
        positions = z_up(positions)
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(positions))
    mesh.vertices.foreach_set("co", positions.astype(np.float32).ravel())
    mesh.loops.add(3 * len(faces))
    mesh.loops.foreach_set("vertex_index", faces.astype(np.int32).ravel())
    mesh.polygons.add(len(faces))
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * len(faces), 3, dtype=np.int32))
    mesh.polygons.foreach_set("material_index", slot_of_face.astype(np.int32))
    mesh.update(calc_edges=True)
    for slot, layer in enumerate(PLACES):
        coordinates = mesh.uv_layers.new(name=layer, do_init=False)
        coordinates.uv.foreach_set("vector", np.ascontiguousarray(fans.uv[:, slot]).ravel())
    corners = np.tile(np.array([1, 0, 0, 1, 0, 0], np.float32), len(faces))
    mesh.uv_layers.new(name=CORNER, do_init=False).uv.foreach_set("vector", corners)
    set_normals(mesh, asset, faces, y_up)
    shows_through = any("base-color" in sheet and sheet["base-color"].shape[2] == 4 for sheet in fans.sheets)
    threshold = cut_out_threshold(asset) if shows_through else None
    # Materials of one sheet share its node group, and its pictures.
    groups, filled = {}, set()
    for index, (number, factors) in enumerate(slots):
        title = name if len(slots) == 1 else f"{name} {index + 1}"
        material = materials[index] if index < len(materials) else None
        is_users = material is not None and MADE_KEY not in material
        shown = (fans.sheets[number], fans, y_up, in_light, threshold)
        if not is_users and not refill(material, factors, filled, *shown):
            if number not in groups:
                groups[number] = build_group(title, *shown)
            material = build_material(title, groups[number], factors, *shown)
        mesh.materials.append(material)
    mesh[SHEETS_KEY] = len(slots)
    mesh.validate(clean_customdata=False)
    return mesh


def set_normals(mesh, asset, faces, y_up):
    """The asset's shading normals."""
    face = np.repeat(np.arange(len(faces)), 3)
    corners = np.tile(np.eye(3, dtype=np.float32), (len(faces), 1))
    normals = asset.normals(face, corners)
    mesh.polygons.foreach_set("use_smooth", np.ones(len(faces), bool))
    mesh.normals_split_custom_set(z_up(normals) if y_up else normals)


def pixels_of(samples, is_color, in_light=False):
    """RGBA of a picture as Blender has it, from the bottom row upwards. Colours are sRGB unless ``in_light``."""
    height, width, components = samples.shape
    rgba = np.ones((height, width, 4), np.float32)
    scale = np.float32(255 if samples.dtype == np.uint8 else 65535)
    rgba[..., :components] = samples[::-1] / scale
    if components == 1:
        rgba[..., 1:3] = rgba[..., :1]
    if is_color and in_light:
        encoded = rgba[..., :3]
        rgba[..., :3] = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return rgba


def fill(image, pixels):
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    image.pack()


def build_image(name, samples, is_color, in_light=False):
    """A packed picture; row 0 of the array is on top. Bytes of colours are sRGB, 16 bits are numbers."""
    is_float = samples.dtype == np.uint16 or (is_color and in_light)
    height, width, components = samples.shape
    image = bpy.data.images.new(name, width, height, alpha=components == 4, float_buffer=is_float)
    image.colorspace_settings.name = "sRGB" if is_color and not in_light else "Non-Color"
    image.alpha_mode = "CHANNEL_PACKED" if components == 4 else "NONE"
    fill(image, pixels_of(samples, is_color, in_light))
    return image


#: Channels that materials show, and those whose pictures are colours.
SHOWN = ("base-color", "orm", "normal", "emission")
COLORS = ("base-color", "emission")


def samples_of(sheet, channel, y_up):
    """The picture of a channel, with normals in Blender's axes."""
    samples = sheet[channel]
    if channel == "normal" and y_up:
        top = np.iinfo(samples.dtype).max
        samples = np.stack([samples[..., 0], top - samples[..., 2], samples[..., 1]], -1)
    return samples


def layout_of(sheet, fans, y_up, in_light, threshold, factors=None):
    """Everything that a material, or without factors its node group, depends on but the pixels of its pictures, as a text."""
    pictures = sorted((channel, samples.shape, samples.dtype.name) for channel, samples in sheet.items())
    scales = sorted(fans.scales.items())
    return repr((pictures, scales, float(fans.delta), bool(y_up), bool(in_light), threshold, factors))


def refill(material, factors, filled, sheet, fans, y_up, in_light, threshold):
    """Gives the pictures of a material new pixels, but those that are filled already. False, and nothing is done, where it is to be another
    material."""
    if material is None or material.get(MADE_KEY) != layout_of(sheet, fans, y_up, in_light, threshold, factors):
        return False
    images = {image[CHANNEL_KEY]: image for image in made_images(material)}
    shown = [channel for channel in SHOWN if channel in sheet]
    # Nodes and images may be changed by the user.
    if any(channel not in images or tuple(images[channel].size) != sheet[channel].shape[1::-1] for channel in shown):
        return False
    for channel in shown:
        image = images[channel]
        if image not in filled:
            fill(image, pixels_of(samples_of(sheet, channel, y_up), channel in COLORS, in_light))
            filled.add(image)
    return True


def build_material(name, group, factors, sheet, fans, y_up, in_light=False, threshold=None):
    """A new material for a sheet with that node group. With a threshold, its alpha is that of cut-outs."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    material[MADE_KEY] = layout_of(sheet, fans, y_up, in_light, threshold, factors)
    tree = material.node_tree
    inputs = tree.nodes["Principled BSDF"].inputs
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    node.location = (-300, 300)
    # An unlit colour is emitted, and nothing is reflected.
    places = {"Base Color": "Emission Color", "Alpha": "Alpha"} if factors.unlit else {key: key for key in inputs.keys()}
    for output in node.outputs:
        if output.name in places:
            tree.links.new(output, inputs[places[output.name]])

    def put(title, value):
        inputs[title].default_value = value

    if factors.unlit:
        put("Base Color", (0, 0, 0, 1))
        put("Specular IOR Level", 0)
        put("Emission Strength", 1)
    elif "emission" in sheet:
        put("Emission Strength", fans.scales["emission"])
    elif any(factors.emission):
        strength = max(1, *factors.emission)
        put("Emission Color", (*(light / strength for light in factors.emission), 1))
        put("Emission Strength", strength)
    if factors.color is not None:
        *color, alpha = factors.color
        put(places["Base Color"], (*color, 1))
        put("Alpha", alpha)
    if factors.roughness is not None:
        put("Metallic", factors.metallic)
        put("Roughness", factors.roughness)
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


def build_group(name, sheet, fans, y_up, in_light=False, threshold=None):
    """The node group: the texture function of all channels of a sheet."""
    tree = bpy.data.node_groups.new(f"Fan Texture {name}", "ShaderNodeTree")
    tree[MADE_KEY] = layout_of(sheet, fans, y_up, in_light, threshold)
    build = _Builder(tree)
    shares = weights(build, float(fans.delta))
    places = [build.node("ShaderNodeUVMap", uv_map=layer).outputs[0] for layer in PLACES]
    result = build.node("NodeGroupOutput")

    def output(title, kind, socket):
        tree.interface.new_socket(title, in_out="OUTPUT", socket_type=kind)
        tree.links.new(socket, result.inputs[title])

    def blended(channel):
        samples = samples_of(sheet, channel, y_up)
        image = build_image(f"{name} {channel}", samples, channel in COLORS, in_light)
        image[MADE_KEY], image[CHANNEL_KEY] = tree[MADE_KEY], channel
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
        color, alpha = blended("base-color")
        output("Base Color", "NodeSocketColor", color)
        if alpha is not None and threshold is not None:
            # Seen from the threshold on, itself included.
            alpha = build.math("SUBTRACT", 1.0, build.math("LESS_THAN", alpha, threshold))
        if alpha is not None:
            output("Alpha", "NodeSocketFloat", alpha)
    if "orm" in sheet:
        parts = build.node("ShaderNodeSeparateXYZ")
        build.connect(parts, [(0, blended("orm")[0])])
        output("Occlusion", "NodeSocketFloat", parts.outputs[0])
        output("Roughness", "NodeSocketFloat", parts.outputs[1])
        output("Metallic", "NodeSocketFloat", parts.outputs[2])
    if "normal" in sheet:
        turned = build.node("ShaderNodeNormalMap", space="OBJECT")
        build.connect(turned, [("Color", blended("normal")[0])])
        output("Normal", "NodeSocketVector", turned.outputs[0])
    if "emission" in sheet:
        output("Emission Color", "NodeSocketColor", blended("emission")[0])
    return tree
