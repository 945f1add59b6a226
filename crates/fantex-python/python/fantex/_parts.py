"""Meshes of other packages with materials, as glTF in memory."""

from __future__ import annotations

from typing import Any, Callable, Dict, List, NamedTuple, Optional, Tuple

import numpy as np

from ._glb import Glb

#: What takes colours to linear RGBA, and a picture to a file's bytes.
Linear = Callable[[np.ndarray, int, str], np.ndarray]
Encoded = Callable[[Any], bytes]


class Part(NamedTuple):
    """Triangles of one material."""

    #: ``(n, 3)`` float64.
    positions: np.ndarray
    #: ``(m, 3)`` int64.
    faces: np.ndarray
    #: ``(n, 4)``, linear.
    colors: Optional[np.ndarray] = None
    #: ``(n, 2)``, v upwards.
    uv: Optional[np.ndarray] = None
    #: Has attributes as a PBRMaterial or a SimpleMaterial of trimesh has them, those that it says something by.
    material: Any = None


def corners(values: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Values of vertices at the corners of faces, a row for each."""
    wrong = np.flatnonzero(((faces < 0) | (faces >= len(values))).any(1))
    if len(wrong):
        raise ValueError(f"face {wrong[0]} has the vertices {faces[wrong[0]].tolist()}, but there are {len(values)} positions")
    return values[faces].reshape(-1, values.shape[1])


class Writer:
    """Collects meshes. Positions keep what single precision leaves of their distance from the middle of their mesh."""

    def __init__(self, linear: Linear, encoded: Encoded) -> None:
        self.glb = Glb()
        self.linear, self.encoded = linear, encoded
        self.pictures: Dict[int, int] = {}

    def mesh(self, name: str, parts: List[Part]) -> Tuple[int, np.ndarray]:
        """Writes a mesh around its middle; gives its number and where that is."""
        known = np.concatenate([part.positions for part in parts])
        known = known[np.isfinite(known).all(1)]
        middle = (known.min(0) + known.max(0)) / 2 if len(known) else np.zeros(3)
        return self.glb.add("meshes", {"name": name, "primitives": [self._primitive(part, middle) for part in parts]}), middle

    def place(self, mesh: Tuple[int, np.ndarray], matrix: np.ndarray) -> None:
        """Puts a mesh where a matrix says."""
        number, middle = mesh
        moved = np.eye(4)
        moved[:3, 3] = middle
        self.glb.add("nodes", {"mesh": number, "matrix": (matrix @ moved).T.ravel().tolist()})

    def finished(self) -> bytes:
        """The bytes of a ``.glb`` with all that was placed."""
        nodes = self.glb.json.get("nodes", [])
        bare = [primitive for mesh in self.glb.json["meshes"] for primitive in mesh["primitives"] if "material" not in primitive]
        if bare and "materials" in self.glb.json:
            # Beside others, too, they are no metal.
            plain = self.glb.add("materials", {"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.9}})
            for primitive in bare:
                primitive["material"] = plain
        self.glb.json.update(scene=0, scenes=[{"nodes": list(range(len(nodes)))}])
        return self.glb.finished()

    def _primitive(self, part: Part, middle: np.ndarray) -> Dict[str, Any]:
        with np.errstate(invalid="ignore"):
            attributes = {"POSITION": part.positions - middle}
        if part.colors is not None:
            attributes["COLOR_0"] = part.colors
        if part.uv is not None:
            # glTF counts v from above.
            attributes["TEXCOORD_0"] = part.uv[:, :2] * (1, -1) + (0, 1)
        material = self._material(part.material, part.uv is not None)
        accessors = {key: self.glb.accessor(values, False) for key, values in attributes.items()}
        indices = self.glb.accessor(part.faces.ravel().astype(np.uint32))
        primitive: Dict[str, Any] = {"attributes": accessors, "indices": indices}
        if material is not None:
            primitive["material"] = self.glb.add("materials", material)
        return primitive

    def _material(self, given: Any, has_uv: bool) -> Optional[Dict[str, Any]]:
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
        factor = self._factor(given)
        if factor is not None:
            pbr["baseColorFactor"] = np.clip(factor, 0, 1).tolist()
        picture = said("baseColorTexture")
        picture = said("image") if picture is None else picture
        if has_uv and picture is not None:
            pbr["baseColorTexture"] = self._texture(picture)
        if shine is not None:
            pbr["metallicRoughnessTexture"] = self._texture(shine)
        for name in ("normalTexture", "occlusionTexture", "emissiveTexture"):
            if has_uv and said(name) is not None:
                material[name] = self._texture(said(name))
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

    def _texture(self, picture: Any) -> Dict[str, int]:
        if id(picture) not in self.pictures:
            image = self.glb.image(self.encoded(picture), "")
            self.pictures[id(picture)] = self.glb.add("textures", {"source": image})
        return {"index": self.pictures[id(picture)]}

    def _factor(self, given: Any) -> Optional[np.ndarray]:
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
