# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects of Blender as meshes and sources of fantex."""

import os
import tempfile

import bpy
import fantex
import numpy as np


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


def plain_mesh(item, depsgraph):
    """The object's triangles with its active colours, in its own space."""
    positions, faces, colors = triangles(item, depsgraph)
    if len(faces) == 0:
        raise ValueError(f"{item.name} has no faces")
    return fantex.Mesh(positions, faces, colors=colors)


def mesh_with_materials(context, item):
    """The object with its materials, by way of glTF: textures, factors, normal maps."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "object.glb")
        selected, active = list(context.selected_objects), context.view_layer.objects.active
        matrix = item.matrix_world.copy()
        try:
            for other in selected:
                other.select_set(False)
            item.select_set(True)
            context.view_layer.objects.active = item
            # In its own space.
            item.matrix_world.identity()
            bpy.ops.export_scene.gltf(
                filepath=path,
                use_selection=True,
                export_yup=False,
                export_apply=True,
                export_animations=False,
                export_skins=False,
                export_morph=False,
            )
        finally:
            item.matrix_world = matrix
            item.select_set(False)
            for other in selected:
                other.select_set(True)
            context.view_layer.objects.active = active
        return fantex.Mesh.load(path)
