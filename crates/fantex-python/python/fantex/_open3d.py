"""Meshes of Open3D: its older ``TriangleMesh`` and the one of tensors, with their textures."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, Dict, List, Optional, Tuple

import numpy as np

from ._parts import Encoded, Linear, Part, Writer, corners


def is_mesh(thing: Any) -> bool:
    return hasattr(thing, "vertices") and hasattr(thing, "has_vertex_colors")


def is_tensor_mesh(thing: Any) -> bool:
    return hasattr(thing, "vertex") and hasattr(thing, "triangle") and hasattr(thing, "material")


def parts_of(mesh: Any, linear: Linear) -> Tuple[List[Part], Optional[np.ndarray]]:
    """The parts of a mesh, which all have texture coordinates or none; and the face of the mesh that each face of these is, where
    that is another one."""
    return _of_tensors(mesh.cpu(), linear) if is_tensor_mesh(mesh) else _of_vectors(mesh, linear)


def glb_of(parts: List[Part], linear: Linear, encoded: Encoded) -> bytes:
    """The parts of a mesh as the bytes of a ``.glb``."""
    writer = Writer(linear, encoded)
    writer.place(writer.mesh("mesh", parts), np.eye(4))
    return writer.finished()


def _of_vectors(mesh: Any, linear: Linear) -> Tuple[List[Part], Optional[np.ndarray]]:
    positions, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.triangles, np.int64)
    colors = _linear(np.asarray(mesh.vertex_colors), linear) if mesh.has_vertex_colors() else None
    if not mesh.has_triangle_uvs() or not len(faces):
        return [Part(positions, faces, colors)], None
    # Row 0 of a texture lies at v = 0, and some have no rows: those of materials without one.
    textures = [None if texture.is_empty() else _picture(np.asarray(texture)[::-1]) for texture in mesh.textures]
    materials = [None if texture is None else SimpleNamespace(baseColorTexture=texture) for texture in textures]
    has_numbers = mesh.has_triangle_material_ids()
    numbers = np.asarray(mesh.triangle_material_ids) if has_numbers else np.zeros(len(faces), int)
    # What has no material is white, as it is there.
    numbers = np.where((numbers >= 0) & (numbers < len(materials)), numbers, -1)
    whole = _whole(positions, faces, colors, np.asarray(mesh.triangle_uvs))
    order = np.argsort(numbers, kind="stable")
    parts = []
    for number in np.unique(numbers):
        rows = (3 * np.flatnonzero(numbers == number)[:, None] + np.arange(3)).ravel()
        material = materials[number] if number >= 0 else None
        # A texture stands in the place of colours.
        shown = None if material is not None or whole.colors is None else whole.colors[rows]
        parts.append(Part(whole.positions[rows], np.arange(len(rows)).reshape(-1, 3), shown, whole.uv[rows], material))
    return parts, order


def _of_tensors(mesh: Any, linear: Linear) -> Tuple[List[Part], Optional[np.ndarray]]:
    def attribute(of: Any, name: str) -> Optional[np.ndarray]:
        return of[name].numpy() if name in of else None

    positions, faces = attribute(mesh.vertex, "positions"), attribute(mesh.triangle, "indices")
    if positions is None or faces is None or not len(faces):
        return [Part(np.zeros((0, 3)), np.zeros((0, 3), np.int64))], None
    positions, faces = positions.astype(np.float64), faces.astype(np.int64)
    colors = attribute(mesh.vertex, "colors")
    colors = None if colors is None else _linear(colors, linear)
    uv, of_vertices = attribute(mesh.triangle, "texture_uvs"), attribute(mesh.vertex, "texture_uvs")
    if uv is None and of_vertices is not None:
        uv = corners(of_vertices, faces)
    material = _material(mesh.material) if mesh.material.is_valid() else None
    if uv is None:
        return [Part(positions, faces, colors, None, material)], None
    whole = _whole(positions, faces, colors, uv.reshape(-1, 2))
    if material is not None and hasattr(material, "baseColorTexture"):
        whole = whole._replace(colors=None)
    return [whole._replace(material=material)], None


def _whole(positions: np.ndarray, faces: np.ndarray, colors: Optional[np.ndarray], uv: np.ndarray) -> Part:
    """A vertex each for the corners of the faces; cleaning joins them again."""
    if len(uv) != 3 * len(faces):
        raise ValueError(f"the mesh has {len(uv)} texture coordinates and {len(faces)} triangles; expected three for each")
    at = corners(positions, faces)
    return Part(at, np.arange(len(at)).reshape(-1, 3), None if colors is None else corners(colors, faces), uv.astype(np.float64))


def _linear(colors: np.ndarray, linear: Linear) -> np.ndarray:
    """Its floats are sRGB-encoded."""
    return linear(_bytes(colors), len(colors), "the colours of the vertices")


def _bytes(numbers: np.ndarray) -> np.ndarray:
    """Numbers of 0 to 1, or whole ones, in 255ths."""
    if numbers.dtype == np.uint16:
        return ((numbers.astype(np.uint32) + 128) // 257).astype(np.uint8)
    return numbers if numbers.dtype == np.uint8 else (np.clip(numbers, 0, 1) * 255 + 0.5).astype(np.uint8)


def _picture(texels: np.ndarray) -> np.ndarray:
    """A picture of colours, whose floats are linear."""
    return texels if texels.dtype.kind == "f" else _bytes(texels)


def _material(given: Any) -> SimpleNamespace:
    """A material as one of glTF. Numbers scale their maps, as they do there."""
    maps = {name: image.as_tensor().numpy() for name, image in given.texture_maps.items()}
    maps = {name: image for name, image in maps.items() if image.size}
    numbers, colors = given.scalar_properties, given.vector_properties
    material = SimpleNamespace()
    if "base_color" in colors:
        material.baseColorFactor = 255 * np.asarray(colors["base_color"], np.float64)
    if "emissive_color" in colors and np.any(colors["emissive_color"][:3]):
        material.emissiveFactor = np.asarray(colors["emissive_color"], np.float64)[:3]
    if "albedo" in maps:
        material.baseColorTexture = _picture(maps["albedo"])
    if "normal" in maps:
        material.normalTexture = _bytes(maps["normal"])
    shares: Dict[str, np.ndarray] = {}
    for channel, names in enumerate((("ambient_occlusion", "ao"), ("roughness",), ("metallic",))):
        for name in names:
            if name in maps:
                shares[names[0]] = _bytes(maps[name])[..., :1]
        if names[0] not in shares and "ao_rough_metal" in maps:
            shares[names[0]] = _bytes(maps["ao_rough_metal"])[..., channel : channel + 1]
    if "ambient_occlusion" in shares:
        material.occlusionTexture = np.repeat(shares["ambient_occlusion"], 3, axis=2)
    if "roughness" in shares or "metallic" in shares:
        material.metallicRoughnessTexture = _shine(shares.get("roughness"), shares.get("metallic"))
        material.metallicFactor = 1.0 if "metallic" in shares else 0.0
    for name, attribute in (("metallic", "metallicFactor"), ("roughness", "roughnessFactor")):
        # Older versions say base_metallic and base_roughness.
        for key in ("base_" + name, name):
            if key in numbers:
                setattr(material, attribute, float(numbers[key]))
    if "Transparency" in given.material_name:
        material.alphaMode = "BLEND"
    return material


def _shine(roughness: Optional[np.ndarray], metallic: Optional[np.ndarray]) -> np.ndarray:
    """A picture of roughness (green) and metallic (blue), as large as the larger of the two; what is not given is 1."""
    given = [image for image in (roughness, metallic) if image is not None]
    height, width = (max(image.shape[axis] for image in given) for axis in range(2))
    picture = np.full((height, width, 3), 255, np.uint8)
    for channel, image in ((1, roughness), (2, metallic)):
        if image is not None:
            rows, columns = (np.arange(side) * image.shape[axis] // side for axis, side in enumerate((height, width)))
            picture[..., channel] = image[rows][:, columns, 0]
    return picture
