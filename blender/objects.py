# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects of Blender as meshes and sources of fantex."""

import contextlib
import os
import tempfile

import bpy
import fantex
import numpy as np


#: Types of objects that have a surface.
TYPES = {"MESH", "CURVE", "SURFACE", "FONT", "META"}

#: Types of nodes that Blender's glTF exporter reads, or looks through.
TAKEN = set(
    "OUTPUT_MATERIAL BSDF_PRINCIPLED EMISSION BACKGROUND MIX_SHADER BSDF_TRANSPARENT LIGHT_PATH TEX_IMAGE MAPPING UVMAP TEX_COORD "
    "NORMAL_MAP SEPARATE_COLOR COMBINE_COLOR MATH RGB VALUE VERTEX_COLOR ATTRIBUTE AMBIENT_OCCLUSION NEW_GEOMETRY GROUP GROUP_INPUT "
    "GROUP_OUTPUT REROUTE".split()
)


def sockets_behind(output):
    """The sockets of nodes that a node depends on, also of those in groups."""
    nodes, seen = [output], set()
    while nodes:
        for link in (link for socket in nodes.pop().inputs for link in socket.links if not link.is_muted):
            socket, node = link.from_socket, link.from_node
            if socket in seen or node.mute:
                continue
            seen.add(socket)
            yield socket
            nodes.append(node)
            if node.type == "GROUP" and node.node_tree:
                nodes += [inner for inner in node.node_tree.nodes if inner.type == "GROUP_OUTPUT"]


def left_out_of(material):
    """What of a material does not go to glTF, a sentence each."""
    tree = material.node_tree
    output = tree.get_output_node("ALL") if tree else None
    names, images = {}, {}
    for socket in sockets_behind(output) if output else ():
        node = socket.node
        is_mix = node.type in ("MIX", "MIX_RGB") and node.blend_type == "MULTIPLY"
        if node.type not in TAKEN and not is_mix:
            names[node.bl_label] = None
        elif node.type == "TEX_COORD" and socket.name != "UV":
            names[f"{socket.name} coordinates"] = None
        elif node.type == "TEX_IMAGE" and node.image and node.image.size[0] == 0:
            images[node.image.name] = None
    if names:
        yield f"{material.name} is not baked as it is seen: glTF has no place for {', '.join(names)}; bake that to an image first"
    for image in images:
        yield f"{material.name} is baked without {image}: its file is missing or damaged"


def makes_instances(item, depsgraph):
    """Whether an object's modifiers, or its faces or vertices, show other objects. (Surfaces of curves are listed as instances, too.)"""
    return item.type == "MESH" and any(
        each.is_instance and each.parent is not None and each.parent.original == item for each in depsgraph.object_instances
    )


def left_out(item, depsgraph, by_materials):
    """What of an object a bake does not show, a sentence each."""
    if makes_instances(item, depsgraph):
        yield f"{item.name} shows instances, which are not baked; a Realize Instances node makes them faces"
    if by_materials:
        for material in {slot.material: None for slot in item.material_slots if slot.material}:
            yield from left_out_of(material)


def check_faces(count, item, depsgraph):
    """Raises ``ValueError`` where an object has no faces."""
    if count == 0:
        hint = ", only instances; a Realize Instances node makes them faces" if makes_instances(item, depsgraph) else ""
        raise ValueError(f"{item.name} has no faces{hint}")


def triangles(item, depsgraph):
    """Positions of the object's evaluated corners, triangles over them, and linear RGBA of its active colours or None."""
    evaluated = item.evaluated_get(depsgraph)
    mesh = evaluated.to_mesh()
    try:
        mesh.calc_loop_triangles()
        vertices = np.empty((len(mesh.vertices), 3), np.float32)
        mesh.vertices.foreach_get("co", vertices.ravel())
        of_loop = np.empty(len(mesh.loops), np.int32)
        mesh.loops.foreach_get("vertex_index", of_loop)
        faces = np.empty((len(mesh.loop_triangles), 3), np.int32)
        mesh.loop_triangles.foreach_get("loops", faces.ravel())
        colors = None
        attribute = mesh.color_attributes.active_color
        if attribute is not None:
            values = np.empty((len(attribute.data), 4), np.float32)
            attribute.data.foreach_get("color", values.ravel())
            colors = values[of_loop] if attribute.domain == "POINT" else values
        return vertices[of_loop], faces, colors
    finally:
        evaluated.to_mesh_clear()


def y_up(vectors):
    """Vectors of Blender as files have them whose y axis points upwards."""
    return np.stack([vectors[..., 0], vectors[..., 2], -vectors[..., 1]], -1)


def plain_mesh(item, depsgraph):
    """The object's triangles with its active colours, in its own space, y upwards."""
    positions, faces, colors = triangles(item, depsgraph)
    check_faces(len(faces), item, depsgraph)
    return fantex.Mesh(y_up(positions), faces, colors=colors)


def evaluated_mesh(item, depsgraph):
    """A new mesh: the object's with modifiers and shape keys applied, with all layers and the materials that the object shows."""
    mesh = bpy.data.meshes.new_from_object(
        item.evaluated_get(depsgraph), preserve_all_data_layers=True, depsgraph=depsgraph
    )
    own = item.data.materials
    for index, slot in enumerate(item.material_slots):
        # Modifiers may give the mesh other materials.
        if slot.link == "OBJECT" and index < len(mesh.materials) and mesh.materials[index] == own[index]:
            mesh.materials[index] = slot.material
    return mesh


@contextlib.contextmanager
def evaluated_copy(context, item):
    """An object without transforms, the only selected one, that has the item's evaluated mesh."""
    item.update_from_editmode()
    mesh = evaluated_mesh(item, context.evaluated_depsgraph_get())
    objects = context.view_layer.objects
    selected, active = list(objects.selected), objects.active
    copy = bpy.data.objects.new(item.name, mesh)
    try:
        check_faces(len(mesh.polygons), item, context.evaluated_depsgraph_get())
        # Hidden collections do not hide the scene's own.
        context.scene.collection.objects.link(copy)
        for other in selected:
            other.select_set(False)
        copy.select_set(True)
        objects.active = copy
        yield copy
    finally:
        bpy.data.objects.remove(copy)
        bpy.data.meshes.remove(mesh)
        for other in selected:
            other.select_set(True)
        objects.active = active


def write_gltf(path, **options):
    """Writes what is selected. Raises ``ValueError``."""
    if "gltf" not in dir(bpy.ops.export_scene):
        raise ValueError("Blender's add-on glTF 2.0 is off; switch it on in the preferences, or take another source")
    # Versions of the exporter differ in their options.
    known = bpy.ops.export_scene.gltf.get_rna_type().properties.keys()
    options = {name: value for name, value in options.items() if name in known}
    try:
        bpy.ops.export_scene.gltf(
            filepath=path,
            use_selection=True,
            export_yup=True,
            export_animations=False,
            export_skins=False,
            export_morph=False,
            **options,
        )
    except (AttributeError, RuntimeError) as error:
        raise ValueError(f"Blender's glTF exporter has failed: {error}") from error


def full_mesh(context, item, with_colors=False):
    """The object with its materials and texture coordinates, by way of glTF: textures, factors, normal maps; y upwards.

    Colours multiply those of the material in glTF. They come along where the material uses them, or ``with_colors``.
    """
    with tempfile.TemporaryDirectory() as folder, evaluated_copy(context, item) as copy:
        if not (with_colors or any(copy.data.materials)):
            raise ValueError(f"{item.name} has no materials; give it one, or take another source")
        path = os.path.join(folder, "object.glb")
        write_gltf(
            path,
            export_vertex_color="ACTIVE" if with_colors else "MATERIAL",
            export_active_vertex_color_when_no_material=with_colors,
        )
        return fantex.Mesh.load(path)
