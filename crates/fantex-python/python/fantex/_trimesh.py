"""Meshes and scenes of trimesh, with their materials and places, as glTF."""

from __future__ import annotations

from typing import Any, Callable, Dict, Optional

import numpy as np

from ._glb import Glb

#: What takes the colours of vertices or faces to linear RGBA, and a picture to a file's bytes.
Linear = Callable[[np.ndarray, int, str], np.ndarray]
Encoded = Callable[[Any], bytes]


def is_scene(thing: Any) -> bool:
    return hasattr(thing, "dump") and hasattr(thing, "geometry")


def has_texture(mesh: Any) -> bool:
    """Whether a mesh has a material instead of colours."""
    return getattr(getattr(mesh, "visual", None), "kind", None) == "texture"


def glb_of(thing: Any, linear: Linear, encoded: Encoded) -> bytes:
    """A mesh or a scene as the bytes of a ``.glb``. Positions keep what single precision leaves of their distance from the middle of their mesh."""
    writer = _Writer(linear, encoded)
    if is_scene(thing):
        for node in thing.graph.nodes_geometry:
            matrix, name = thing.graph[node]
            if hasattr(thing.geometry[name], "faces"):
                writer.place(name, thing.geometry[name], np.asarray(matrix, float))
    else:
        writer.place("mesh", thing, np.eye(4))
    nodes = writer.glb.json.get("nodes", [])
    if not nodes:
        raise ValueError("the scene holds no mesh with faces")
    bare = [primitive for mesh in writer.glb.json["meshes"] for primitive in mesh["primitives"] if "material" not in primitive]
    if bare and "materials" in writer.glb.json:
        # Beside others, too, they are no metal.
        plain = writer.glb.add("materials", {"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.9}})
        for primitive in bare:
            primitive["material"] = plain
    writer.glb.json.update(scene=0, scenes=[{"nodes": list(range(len(nodes)))}])
    return writer.glb.finished()


class _Writer:
    def __init__(self, linear: Linear, encoded: Encoded) -> None:
        self.glb = Glb()
        self.linear, self.encoded = linear, encoded
        self.meshes: Dict[str, Any] = {}
        self.pictures: Dict[int, int] = {}

    def place(self, name: str, mesh: Any, matrix: np.ndarray) -> None:
        if not len(mesh.faces):
            return
        if name not in self.meshes:
            self.meshes[name] = self.mesh(name, mesh)
        number, middle = self.meshes[name]
        moved = np.eye(4)
        moved[:3, 3] = middle
        self.glb.add("nodes", {"mesh": number, "matrix": (matrix @ moved).T.ravel().tolist()})

    def mesh(self, name: str, mesh: Any) -> Any:
        """A mesh around its middle, and where that is."""
        positions, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
        known = positions[np.isfinite(positions).all(1)]
        middle = (known.min(0) + known.max(0)) / 2 if len(known) else np.zeros(3)
        visual = getattr(mesh, "visual", None)
        kind = getattr(visual, "kind", None)
        attributes: Dict[str, np.ndarray] = {}
        material: Optional[Dict[str, Any]] = None
        if kind == "face":
            # A vertex each for the corners of a face, so that they have its colour.
            positions, faces = positions[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)
            colors = np.repeat(np.asarray(visual.face_colors), 3, axis=0)
            attributes["COLOR_0"] = self.linear(colors, len(positions), "the colours of the faces")
        elif kind == "vertex":
            colors = np.asarray(visual.vertex_colors)
            attributes["COLOR_0"] = self.linear(colors, len(positions), "the colours of the vertices")
        elif kind == "texture":
            uv = getattr(visual, "uv", None)
            uv = None if uv is None else np.asarray(uv, np.float64)
            material = self.material(visual.material, uv is not None)
            if uv is not None:
                # glTF counts v from above.
                attributes["TEXCOORD_0"] = uv[:, :2] * (1, -1) + (0, 1)
        with np.errstate(invalid="ignore"):
            attributes = {"POSITION": positions - middle, **attributes}
        accessors = {key: self.glb.accessor(values, False) for key, values in attributes.items()}
        indices = self.glb.accessor(faces.ravel().astype(np.uint32))
        primitive: Dict[str, Any] = {"attributes": accessors, "indices": indices}
        if material is not None:
            primitive["material"] = self.glb.add("materials", material)
        return self.glb.add("meshes", {"name": name, "primitives": [primitive]}), middle

    def material(self, given: Any, has_uv: bool) -> Optional[Dict[str, Any]]:
        """None where it says nothing."""

        def said(name: str, default: Any = None) -> Any:
            value = getattr(given, name, None)
            return default if value is None else value

        shine = said("metallicRoughnessTexture") if has_uv else None
        # glTF's own where a texture says the rest.
        unsaid = (0.0, 0.9) if shine is None else (1.0, 1.0)
        pbr: Dict[str, Any] = {
            "metallicFactor": float(said("metallicFactor", unsaid[0])),
            "roughnessFactor": float(said("roughnessFactor", unsaid[1])),
        }
        material: Dict[str, Any] = {"name": str(said("name", "")), "pbrMetallicRoughness": pbr}
        factor = self.factor(given)
        if factor is not None:
            pbr["baseColorFactor"] = np.clip(factor, 0, 1).tolist()
        picture = said("baseColorTexture")
        picture = said("image") if picture is None else picture
        if has_uv and picture is not None:
            pbr["baseColorTexture"] = self.texture(picture)
        if shine is not None:
            pbr["metallicRoughnessTexture"] = self.texture(shine)
        for name in ("normalTexture", "occlusionTexture", "emissiveTexture"):
            if has_uv and said(name) is not None:
                material[name] = self.texture(said(name))
        emission = said("emissiveFactor", (1.0, 1.0, 1.0) if "emissiveTexture" in material else None)
        if emission is not None:
            material["emissiveFactor"] = np.clip(np.asarray(emission, float), 0, 1).tolist()
        if said("alphaMode") in ("MASK", "BLEND"):
            material["alphaMode"] = given.alphaMode
            if said("alphaCutoff") is not None:
                material["alphaCutoff"] = float(given.alphaCutoff)
        says_shine = said("metallicFactor") is not None or said("roughnessFactor") is not None
        if material.keys() == {"name", "pbrMetallicRoughness"} and len(pbr) == 2 and not says_shine:
            return None
        material["doubleSided"] = bool(said("doubleSided", False))
        return material

    def texture(self, picture: Any) -> Dict[str, int]:
        if id(picture) not in self.pictures:
            image = self.glb.image(self.encoded(picture), "")
            self.pictures[id(picture)] = self.glb.add("textures", {"source": image})
        return {"index": self.pictures[id(picture)]}

    def factor(self, given: Any) -> Optional[np.ndarray]:
        """The colour of a material, linear RGBA; None where it has none."""
        factor = getattr(given, "baseColorFactor", None)
        if factor is not None:
            # glTF's numbers, in 255ths.
            return np.asarray(factor, np.float32) / np.float32(255)
        diffuse = getattr(given, "diffuse", None)
        # trimesh's own grey stands for none.
        if diffuse is None or np.array_equal(diffuse, (102, 102, 102, 255)):
            return None
        return self.linear(np.asarray(diffuse, np.uint8), 1, "the material's colour")[0]
