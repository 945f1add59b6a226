"""Meshes and scenes of trimesh, with their materials and places, as glTF."""

from __future__ import annotations

from typing import Any, Dict, Tuple

import numpy as np

from ._parts import Encoded, Linear, Part, Writer, corners


def is_scene(thing: Any) -> bool:
    return hasattr(thing, "dump") and hasattr(thing, "geometry")


def has_texture(mesh: Any) -> bool:
    """Whether a mesh has a material instead of colours."""
    return getattr(getattr(mesh, "visual", None), "kind", None) == "texture"


def has_colors(mesh: Any) -> bool:
    """Whether its vertices or faces have colours."""
    return getattr(getattr(mesh, "visual", None), "kind", None) in ("vertex", "face")


def glb_of(thing: Any, linear: Linear, encoded: Encoded) -> bytes:
    """A mesh or a scene as the bytes of a ``.glb``."""
    writer = Writer(linear, encoded)
    if is_scene(thing):
        placed = [(name, thing.geometry[name], matrix) for matrix, name in map(thing.graph.get, thing.graph.nodes_geometry)]
    else:
        placed = [("mesh", thing, np.eye(4))]
    meshes: Dict[str, Tuple[int, np.ndarray]] = {}
    for name, mesh, matrix in placed:
        if not len(getattr(mesh, "faces", ())):
            continue
        if name not in meshes:
            meshes[name] = writer.mesh(name, [part_of(mesh, linear)])
        writer.place(meshes[name], np.asarray(matrix, float))
    if not meshes:
        raise ValueError("the scene holds no mesh with faces")
    return writer.finished()


def part_of(mesh: Any, linear: Linear) -> Part:
    """A mesh with colours of vertices or faces, or with coordinates and a material."""
    positions, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
    visual = getattr(mesh, "visual", None)
    kind = getattr(visual, "kind", None)
    if kind == "face":
        # A vertex each for the corners of a face, so that they have its colour; cleaning joins them again.
        positions, faces = corners(positions, faces), np.arange(3 * len(faces)).reshape(-1, 3)
        colors = np.repeat(np.asarray(visual.face_colors), 3, axis=0)
        return Part(positions, faces, linear(colors, len(positions), "the colours of the faces"))
    if kind == "vertex":
        return Part(positions, faces, linear(np.asarray(visual.vertex_colors), len(positions), "the colours of the vertices"))
    if kind == "texture":
        uv = getattr(visual, "uv", None)
        return Part(positions, faces, None, None if uv is None else np.asarray(uv, np.float64), visual.material)
    return Part(positions, faces)
