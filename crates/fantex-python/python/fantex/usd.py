"""Models in USD, read by Pixar's own library: ``pip install usd-core``.

With it, everything that takes a model's path takes ``.usd``, ``.usda``, ``.usdc`` and ``.usdz``, and :meth:`Mesh.of` an open stage. Positions are metres
with y up, as everything that fantex exports says of them; ``Mesh.of(stage, keep_units=True)`` has those of the stage's world. For the command
line and other programs ``python -m fantex.usd scene.usdz scene.glb`` writes a model in glTF.

What is taken: meshes of any polygons, instanced or not, with normals, texture coordinates and ``displayColor``; of materials
``UsdPreviewSurface`` with its textures, also in a ``.usdz`` and in UDIM tiles. Subdivision surfaces are taken by their control meshes, skinned
meshes as they are at rest. What is left out is noted.
"""

from __future__ import annotations

import argparse
import errno
import os
import re
import sys
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from . import _native
from ._given import Path, failed, is_stage
from ._glb import Glb
from ._picture import _srgb8, _write

#: What of a stage is shown, unless somebody wants its helpers, too.
PURPOSES = ("default", "render")

# How the files of glTF's two formats of images begin.
_OF_GLTF = (b"\x89PNG", b"\xff\xd8")

# glTF's numbers.
_WRAPS = {"repeat": 10497, "mirror": 33648, "clamp": 33071, "black": 33071}


def write_glb(
    stage: Any,
    path: Path,
    *,
    time: Optional[float] = None,
    purposes: Sequence[str] = PURPOSES,
    overwrite: bool = False,
) -> List[str]:
    """Writes a stage as a model in glTF, metres with y up, with the images of its materials.

    Args:
        stage: a path, or an open ``Usd.Stage``.
        path: the ``.glb`` to write. It appears at the end, whole, or not at all.
        time: which time's values are taken; by default the earliest.
        purposes: which of ``"default"``, ``"render"``, ``"proxy"`` and ``"guide"`` are taken.
        overwrite: replace an existing file.

    Returns:
        What was left out or assumed, a sentence each.
    """
    path = os.fsdecode(path)
    if not path.lower().endswith(".glb"):
        raise ValueError(f"{path}: a .glb file is written; name it so")
    if not overwrite and os.path.exists(path):
        raise FileExistsError(f"{path} exists; give overwrite=True to replace it")
    # Reading takes long.
    folder = os.path.dirname(os.path.realpath(path))
    if not os.path.isdir(folder):
        raise FileNotFoundError(errno.ENOENT, f"there is no folder {folder}", path)
    glb, notes = glb_of(stage, time, purposes)
    _write(path, glb, overwrite)
    return notes


def glb_of(
    stage: Any, time: Optional[float] = None, purposes: Sequence[str] = PURPOSES, *, keep_units: bool = False
) -> Tuple[bytes, List[str]]:
    """A stage as the bytes of a ``.glb``, and what is to be known about it: in metres with y up, or in the stage's units and axes."""
    try:
        from pxr import Tf, Usd
    except ImportError as error:
        raise ImportError("USD is read by Pixar's library, which is not installed: pip install usd-core") from error
    if not is_stage(stage):
        name = os.fsdecode(stage)
        # What Python says of files that cannot be opened is plainer.
        with open(name, "rb") as file:
            if not file.read(1):
                raise failed(f"{name} is empty; expected a USD file")
        try:
            stage = Usd.Stage.Open(os.path.abspath(name))
        except Tf.ErrorException as error:
            raise failed(f"{name} cannot be read as USD: {_reason(str(error))}") from None
    code = Usd.TimeCode.EarliestTime() if time is None else Usd.TimeCode(time)
    return _Reader(stage, code, purposes).read(keep_units)


def _reason(said: str) -> str:
    """What the library says of a stage that it cannot open, without the places in its own source, which stand before each quoted sentence."""
    reasons = re.findall(r" at line \d+ in file \S+ : '(.*?)'\s*(?=Error in|$)", said, re.DOTALL)
    reasons = [reason.split(" matching ")[0].strip() for reason in reasons if not reason.startswith("Failed to open layer")]
    return reasons[0] if reasons else "it is damaged or cut off; write it anew"


class _Texture(NamedTuple):
    """One connection from a material's input to a channel of an image."""

    file: str
    #: ``r``, ``g``, ``b``, ``a`` or ``rgb``.
    channel: str
    wrap: Tuple[int, int]
    scale: Tuple[float, float, float, float]
    bias: Tuple[float, float, float, float]
    #: ``auto``, ``sRGB`` or ``raw``.
    space: str
    #: Name of the coordinates, and the affine map (six numbers, by rows) that they go through.
    uv: Tuple[str, Tuple[float, ...]]

    @property
    def lookup(self) -> Tuple[Any, ...]:
        """What two textures of one image have in common."""
        return self.wrap, self.uv

    @property
    def is_plain(self) -> bool:
        """Whether the numbers are those of the image."""
        return self.scale == (1, 1, 1, 1) and self.bias == (0, 0, 0, 0)


class _Surface(NamedTuple):
    """A material: numbers and textures of the inputs of a ``UsdPreviewSurface``."""

    name: str
    values: Dict[str, Any]
    textures: Dict[str, _Texture]
    #: Colours of vertices that are the base colour.
    colors: Optional[str]

    @property
    def uvs(self) -> List[Tuple[str, Tuple[float, ...]]]:
        """The sets of texture coordinates that it needs, in glTF's order."""
        return list(dict.fromkeys(texture.uv for texture in self.textures.values()))


#: What an input is where nothing says so.
_DEFAULTS: Dict[str, Any] = {
    "diffuseColor": (0.18, 0.18, 0.18),
    "emissiveColor": (0.0, 0.0, 0.0),
    "metallic": 0.0,
    "roughness": 0.5,
    "opacity": 1.0,
    "opacityThreshold": 0.0,
    "occlusion": 1.0,
    "normal": (0.0, 0.0, 1.0),
    "useSpecularWorkflow": 0,
}

#: Inputs that are not read, where what they say is what is shown without them; None where others decide whether they count.
_LEFT_OUT: Dict[str, Any] = {
    "clearcoat": 0.0,
    "clearcoatRoughness": None,
    "displacement": 0.0,
    "ior": 1.5,
    "opacityMode": "transparent",
    "specularColor": None,
}

#: Of meshes that no material is bound to, but colours.
_BARE = _Surface("", {**_DEFAULTS, "diffuseColor": (1.0, 1.0, 1.0), "roughness": 0.9}, {}, "displayColor")


class _Corners(NamedTuple):
    """The triangles of a mesh."""

    #: ``(m, 3)``: corners in the order of the mesh.
    corners: np.ndarray
    #: ``(m,)``: the polygon of each.
    faces: np.ndarray
    #: The point of each corner of the mesh.
    points: np.ndarray


class _Reader:
    """Turns a stage into glTF."""

    def __init__(self, stage: Any, time: Any, purposes: Sequence[str]) -> None:
        from pxr import UsdGeom

        self.stage, self.time, self.purposes = stage, time, set(purposes)
        self.xforms = UsdGeom.XformCache(time)
        self.glb = Glb()
        self.meshes: Dict[Any, Optional[int]] = {}
        self.surfaces: Dict[str, Optional[_Surface]] = {}
        self.materials: Dict[Any, int] = {}
        self.images: Dict[Any, Optional[int]] = {}
        self.counted: Dict[str, int] = {}
        self.notes: Dict[str, None] = {}

    def note(self, sentence: str) -> None:
        self.notes[sentence] = None

    def count(self, sentence: str, number: int = 1) -> None:
        """Notes a sentence that is true of several prims or triangles; ``{}`` stands for their number."""
        self.counted[sentence] = self.counted.get(sentence, 0) + number

    def read(self, keep_units: bool) -> Tuple[bytes, List[str]]:
        from pxr import Gf

        gltf_from_stage = None if keep_units else self.gltf_from_stage()
        nodes = [
            self.glb.add("nodes", {"mesh": mesh, "matrix": np.asarray(matrix).ravel().tolist()})
            for mesh, matrix in self.placed(self.stage.GetPseudoRoot(), Gf.Matrix4d(1), None)
        ]
        notes = [sentence.format(number) for sentence, number in self.counted.items()] + list(self.notes)
        if not nodes:
            name = self.stage.GetRootLayer().identifier
            raise failed(f"{name} holds no mesh that is shown" + (f" ({'; '.join(notes)})" if notes else ""))
        if gltf_from_stage is not None:
            nodes = [self.glb.add("nodes", {"children": nodes, "matrix": gltf_from_stage.T.ravel().tolist()})]
        self.glb.json.update(scene=0, scenes=[{"nodes": nodes}])
        return self.glb.finished(), notes

    def gltf_from_stage(self) -> np.ndarray:
        """The map to metres with y up."""
        from pxr import UsdGeom

        unit = UsdGeom.GetStageMetersPerUnit(self.stage)
        if not (np.isfinite(unit) and unit > 0):
            name = self.stage.GetRootLayer().identifier
            raise failed(f"{name} has metersPerUnit = {unit}; expected a number above 0")
        if not UsdGeom.StageHasAuthoredMetersPerUnit(self.stage):
            self.note(f"the stage has no metersPerUnit; its unit is taken for {unit:g} m, as USD says")
        is_z_up = UsdGeom.GetStageUpAxis(self.stage) == UsdGeom.Tokens.z
        matrix = np.eye(4)
        matrix[:3, :3] = np.asarray([[1, 0, 0], [0, 0, 1], [0, -1, 0]] if is_z_up else np.eye(3)) * unit
        return matrix

    def placed(self, root: Any, world_from_root: Any, root_world: Any) -> Iterator[Tuple[int, Any]]:
        """The meshes below a prim, and where they are. Below a prototype ``root_world`` is its own place, which its instances replace."""
        from pxr import Usd, UsdGeom, UsdSkel

        prims = iter(Usd.PrimRange(root, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)))
        for prim in prims:
            imageable = UsdGeom.Imageable(prim)
            if not imageable:
                continue
            if imageable.ComputeVisibility(self.time) == UsdGeom.Tokens.invisible:
                prims.PruneChildren()
                continue
            if imageable.ComputePurpose() not in self.purposes:
                continue
            world = self.xforms.GetLocalToWorldTransform(prim)
            if root_world is not None:
                world = world * root_world.GetInverse() * world_from_root
            if prim.IsA(UsdGeom.PointInstancer):
                prims.PruneChildren()
                yield from self.instances(UsdGeom.PointInstancer(prim), world)
            elif prim.IsA(UsdGeom.Mesh):
                mesh = self.mesh(prim)
                if mesh is not None and not np.isfinite(np.asarray(world)).all():
                    self.count("meshes at places that are no finite numbers, which are left out: {}")
                elif mesh is not None:
                    if prim.HasAPI(UsdSkel.BindingAPI):
                        self.count("meshes with a skeleton, which are taken as they are at rest: {}")
                    yield mesh, world
            elif prim.IsA(UsdGeom.Gprim):
                self.count(f"left out of type {prim.GetTypeName()}, which are no meshes: {{}}")

    def instances(self, instancer: Any, world: Any) -> Iterator[Tuple[int, Any]]:
        """What an instancer of points puts where."""
        prototypes = [self.stage.GetPrimAtPath(path) for path in instancer.GetPrototypesRel().GetForwardedTargets()]
        indices = self.integers(instancer.GetProtoIndicesAttr())
        if not all(prototypes) or (indices < 0).any() or (indices >= len(prototypes)).any():
            self.note(f"{instancer.GetPath()} is left out: some of its instances name no prototype")
            return
        # Masked, as the places are, which come without those that are hidden.
        mask = instancer.ComputeMaskAtTime(self.time)
        places = instancer.ComputeInstanceTransformsAtTime(self.time, self.time)
        for index, place in zip(indices[np.asarray(mask, bool)] if mask else indices, places):
            prototype = prototypes[index]
            # A place begins with the prototype's own transform.
            own = self.xforms.GetLocalToWorldTransform(prototype)
            yield from self.placed(prototype, place * world, own)

    def mesh(self, prim: Any) -> Optional[int]:
        """A mesh, with the materials that are bound where it stands."""
        source = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        bound = self.bound(prim)
        key = (source.GetPath(), tuple((name, material and material.GetPath()) for name, material, _ in bound))
        if key not in self.meshes:
            self.meshes[key] = self.read_mesh(prim, bound)
        return self.meshes[key]

    def bound(self, prim: Any) -> List[Tuple[str, Any, Optional[np.ndarray]]]:
        """Materials of subsets with their faces, and at last the one of all others."""
        from pxr import UsdShade

        def material(of: Any) -> Any:
            found = UsdShade.MaterialBindingAPI(of).ComputeBoundMaterial()[0]
            return found.GetPrim() if found else None

        subsets = UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets()
        parts = [
            (subset.GetPrim().GetName(), material(subset.GetPrim()), self.integers(subset.GetIndicesAttr()))
            for subset in subsets
        ]
        return [*parts, ("", material(prim), None)]

    def integers(self, attribute: Any) -> np.ndarray:
        return np.asarray(attribute.Get(self.time) or [], np.int64)

    def read_mesh(self, prim: Any, bound: List[Tuple[str, Any, Optional[np.ndarray]]]) -> Optional[int]:
        from pxr import UsdGeom

        mesh = UsdGeom.Mesh(prim)
        positions = mesh.GetPointsAttr().Get(self.time)
        counts, points = self.integers(mesh.GetFaceVertexCountsAttr()), self.integers(mesh.GetFaceVertexIndicesAttr())
        if positions is None or not len(positions) or not len(counts):
            self.count("meshes without faces, which are left out: {}")
            return None
        positions = np.asarray(positions, np.float64)
        if counts.min() < 0 or counts.sum() != len(points) or points.min() < 0 or points.max() >= len(positions):
            self.note(f"{prim.GetPath()} is left out: its faces do not fit its points")
            return None
        if mesh.GetSubdivisionSchemeAttr().Get() != UsdGeom.Tokens.none:
            self.count("subdivision surfaces, which are taken by their control meshes: {}")
        triangles = _native.cut_polygons(positions, counts, points)
        faces = np.repeat(np.arange(len(counts)), np.maximum(counts - 2, 0))
        holes = self.integers(mesh.GetHoleIndicesAttr())
        if len(holes):
            is_shown = ~np.isin(faces, holes)
            triangles, faces = triangles[is_shown], faces[is_shown]
        is_finite = np.isfinite(positions).all(1)[points[triangles]].all(1)
        if not is_finite.all():
            self.count("triangles with points that are no finite numbers, which are left out: {}", int((~is_finite).sum()))
            triangles, faces = triangles[is_finite], faces[is_finite]
        if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded:
            triangles = triangles[:, ::-1]
        primitives = []
        is_free = np.ones(len(faces), bool)
        for _, material, subset in bound:
            taken = is_free if subset is None else is_free & np.isin(faces, subset)
            if taken.any():
                is_free = is_free & ~taken
                corners = _Corners(triangles[taken], faces[taken], points)
                primitives += self.primitives(mesh, positions, corners, material)
        if not primitives:
            self.count("meshes without faces, which are left out: {}")
            return None
        return self.glb.add("meshes", {"name": str(prim.GetPath()), "primitives": primitives})

    def primitives(self, mesh: Any, positions: np.ndarray, corners: _Corners, material: Any) -> List[Dict[str, Any]]:
        """The triangles of one material; of one in UDIM tiles, those of each tile."""
        from pxr import UsdGeom

        surface = self.surface(material) or _BARE
        primvars = UsdGeom.PrimvarsAPI(mesh.GetPrim())
        normals = self.normals(mesh, primvars, corners)
        uvs = [self.coordinates(mesh, primvars, corners, *uv) for uv in surface.uvs]
        colors = None if surface.colors is None else self.colors(primvars, corners, surface.colors)
        tiles = self.tiles(surface, uvs)
        is_two_sided = bool(mesh.GetDoubleSidedAttr().Get())
        made = []
        for tile in [None] if tiles is None else np.unique(tiles):
            chosen = slice(None) if tile is None else tiles == tile
            part = [None if values is None else values[chosen] for values in uvs]
            if tile is not None:
                part = [values if values is None else values - _tile_corner(tile) for values in part]
            missing = [uv for uv, values in zip(surface.uvs, part) if values is None]
            number = self.material(surface, missing, tile, is_two_sided, colors is not None and colors[..., 3].min() < 1)
            attributes = {"NORMAL": normals, "COLOR_0": colors}
            attributes = {name: None if values is None else values[chosen] for name, values in attributes.items()}
            kept = [values for values in part if values is not None]
            # glTF counts v from above.
            attributes.update({f"TEXCOORD_{i}": values * (1, -1) + (0, 1) for i, values in enumerate(kept)})
            made.append(self.primitive(positions, corners.points[corners.corners[chosen]], attributes, number))
        return made

    def primitive(
        self, positions: np.ndarray, triangles: np.ndarray, attributes: Dict[str, Optional[np.ndarray]], material: int
    ) -> Dict[str, Any]:
        """Triangles of points, with what their corners have, which comes by corners: vertices are joined where nothing tells them apart."""
        given = {name: values for name, values in attributes.items() if values is not None}
        if not given:
            used, indices = np.unique(triangles, return_inverse=True)
            values = {"POSITION": positions[used]}
        else:
            rows = [values.reshape(-1, values.shape[-1]).astype(np.float32) for values in given.values()]
            point = triangles.reshape(-1, 1).astype(np.uint32).view(np.float32)
            table = np.ascontiguousarray(np.concatenate([point, *rows], 1))
            keys = table.view(np.dtype((np.void, table.dtype.itemsize * table.shape[1]))).ravel()
            _, first, indices = np.unique(keys, return_index=True, return_inverse=True)
            values = {"POSITION": positions[triangles.ravel()[first]]}
            values.update({name: row[first] for name, row in zip(given, rows)})
        accessors = {name: self.glb.accessor(rows, name == "POSITION") for name, rows in values.items()}
        indices = self.glb.accessor(indices.ravel().astype(np.uint32))
        return {"attributes": accessors, "indices": indices, "material": material}

    def spread(self, primvar: Any, corners: _Corners, columns: int) -> Optional[np.ndarray]:
        """A primvar's values at the corners of triangles: ``(m, 3, columns)``. None without it, and where its number is wrong."""
        values = primvar.ComputeFlattened(self.time) if primvar.HasAuthoredValue() else None
        if values is None:
            return None
        return self.at_corners(values, primvar.GetInterpolation(), corners, columns, primvar.GetAttr().GetPath())

    def at_corners(
        self, values: Any, interpolation: str, corners: _Corners, columns: int, place: Any
    ) -> Optional[np.ndarray]:
        values = np.asarray(values, np.float64)
        values = values.reshape(len(values), -1)
        where = {
            "constant": np.zeros_like(corners.corners),
            "uniform": np.broadcast_to(corners.faces[:, None], corners.corners.shape),
            "vertex": corners.points[corners.corners],
            "varying": corners.points[corners.corners],
            "faceVarying": corners.corners,
        }.get(interpolation)
        if where is None or values.shape[1] != columns or where.max() >= len(values):
            self.note(f"{place} is left out: it does not fit its mesh")
            return None
        return values[where]

    def normals(self, mesh: Any, primvars: Any, corners: _Corners) -> Optional[np.ndarray]:
        primvar = primvars.GetPrimvar("normals")
        if primvar and primvar.HasAuthoredValue():
            return self.spread(primvar, corners, 3)
        values = mesh.GetNormalsAttr().Get(self.time)
        if values is None or not len(values):
            return None
        return self.at_corners(values, mesh.GetNormalsInterpolation(), corners, 3, mesh.GetNormalsAttr().GetPath())

    def coordinates(
        self, mesh: Any, primvars: Any, corners: _Corners, name: str, affine: Tuple[float, ...]
    ) -> Optional[np.ndarray]:
        primvar = primvars.FindPrimvarWithInheritance(name)
        values = self.spread(primvar, corners, 2) if primvar else None
        if values is None:
            self.count(f"meshes without the texture coordinates {name!r}, whose textures are left out: {{}}")
            return None
        matrix = np.reshape(affine, (2, 3))
        return values @ matrix[:, :2].T + matrix[:, 2]

    def colors(self, primvars: Any, corners: _Corners, name: str) -> Optional[np.ndarray]:
        primvar = primvars.FindPrimvarWithInheritance(name)
        values = self.spread(primvar, corners, 3) if primvar else None
        if values is None:
            return None
        primvar = primvars.FindPrimvarWithInheritance("displayOpacity")
        opacity = self.spread(primvar, corners, 1) if primvar else None
        opacity = np.ones((*values.shape[:2], 1)) if opacity is None else opacity
        return np.clip(np.concatenate([values, opacity], 2), 0, 1)

    def tiles(self, surface: _Surface, uvs: List[Optional[np.ndarray]]) -> Optional[np.ndarray]:
        """The UDIM tile of each triangle, where the material has such images."""
        for texture in surface.textures.values():
            values = uvs[surface.uvs.index(texture.uv)]
            if "<UDIM>" in texture.file and values is not None:
                column, row = np.floor(values.mean(1)).astype(np.int64).T
                return 1001 + np.clip(column, 0, 9) + 10 * np.maximum(row, 0)
        return None

    def surface(self, material: Any) -> Optional[_Surface]:
        """What a material says; None without one that is understood."""
        from pxr import UsdShade

        if not material:
            return None
        path = str(material.GetPath())
        if path not in self.surfaces:
            shader = UsdShade.Material(material).ComputeSurfaceSource()[0]
            is_known = shader and shader.GetIdAttr().Get() == "UsdPreviewSurface"
            if not is_known:
                self.note(f"the material {path} has no UsdPreviewSurface; its meshes have their displayColor")
            self.surfaces[path] = self.inputs(shader, path) if is_known else None
        return self.surfaces[path]

    def inputs(self, shader: Any, name: str) -> _Surface:
        from pxr import UsdShade

        values, textures, colors = dict(_DEFAULTS), {}, None
        for key in _DEFAULTS:
            source = _producer(shader.GetInput(key))
            if source is None:
                continue
            if not UsdShade.Output.IsOutput(source):
                values[key] = self.value(shader, key, _DEFAULTS[key])
                continue
            node = UsdShade.Shader(source.GetPrim())
            kind = str(node.GetIdAttr().Get())
            if kind == "UsdUVTexture":
                texture = self.texture(node, source.GetBaseName(), name)
                if texture is not None:
                    textures[key] = texture
            elif kind.startswith("UsdPrimvarReader") and key == "diffuseColor":
                colors, values[key] = str(self.value(node, "varname", "displayColor")), (1.0, 1.0, 1.0)
            else:
                self.note(f"{key} of the material {name} comes from {kind}, which is not read")
        left_out = [given.GetBaseName() for given in shader.GetInputs() if self.is_left_out(given)]
        if left_out:
            self.note(f"of the material {name} are left out: {', '.join(sorted(left_out))}")
        if values["useSpecularWorkflow"]:
            self.note(f"the material {name} says its specular colour, which is taken for that of no metal")
            values["metallic"] = 0.0
            textures.pop("metallic", None)
        return _Surface(name, values, textures, colors)

    def value(self, node: Any, name: str, default: Any) -> Any:
        """What an input is, itself or by the interface of its material."""
        source = _producer(node.GetInput(name))
        found = None if source is None else source.Get(self.time)
        if not _is_finite(found):
            self.note(f"{source.GetPath()} is no finite number; it is left out")
            return default
        return default if found is None else found

    def is_left_out(self, given: Any) -> bool:
        """Whether an input of a material says what is not shown."""
        from pxr import UsdShade

        name, source = given.GetBaseName(), _producer(given)
        if name in _DEFAULTS or source is None or (name in _LEFT_OUT and _LEFT_OUT[name] is None):
            return False
        found = None if UsdShade.Output.IsOutput(source) else source.Get(self.time)
        if found is None:
            return UsdShade.Output.IsOutput(source)
        usual = _LEFT_OUT.get(name)
        return not (np.isclose(found, usual) if isinstance(usual, float) else found == usual)

    def texture(self, node: Any, channel: str, material: str) -> Optional[_Texture]:
        from pxr import UsdShade

        source = _producer(node.GetInput("file"))
        asset = None if source is None else source.Get(self.time)
        if asset is None or not asset.path:
            self.note(f"a texture of the material {material} names no image")
            return None
        if "<UDIM>" in asset.path:
            # The tiles are found by the name as the layer has it.
            layer = source.GetPropertyStack(self.time)[0].layer
            file = UsdShade.UdimUtils.ResolveUdimPath(asset.path, layer) or asset.path
        else:
            file = asset.resolvedPath or asset.path
        name, affine = "st", np.eye(3)[:2]
        source = _producer(node.GetInput("st"))
        while source is not None and UsdShade.Output.IsOutput(source):
            reader = UsdShade.Shader(source.GetPrim())
            if reader.GetIdAttr().Get() != "UsdTransform2d":
                name = str(self.value(reader, "varname", "st"))
                break
            angle = np.radians(float(self.value(reader, "rotation", 0.0)))
            scale = np.diag(np.asarray(self.value(reader, "scale", (1.0, 1.0)), float))
            move = np.asarray(self.value(reader, "translation", (0.0, 0.0)), float)
            turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ scale
            inner = np.column_stack([turn, move])
            affine = affine @ np.vstack([inner, [0, 0, 1]])
            source = _producer(reader.GetInput("in"))
        wraps = [str(self.value(node, key, "useMetadata")) for key in ("wrapS", "wrapT")]
        if "black" in wraps:
            self.note(f"the image {file} is black beyond its borders, where its border texels are repeated")
        return _Texture(
            file=str(file),
            channel=channel,
            wrap=tuple(_WRAPS.get(wrap, _WRAPS["repeat"]) for wrap in wraps),
            scale=tuple(map(float, self.value(node, "scale", (1, 1, 1, 1)))),
            bias=tuple(map(float, self.value(node, "bias", (0, 0, 0, 0)))),
            space=str(self.value(node, "sourceColorSpace", "auto")),
            uv=(name, tuple(affine.ravel().tolist())),
        )

    def material(
        self,
        surface: _Surface,
        missing: List[Tuple[str, Tuple[float, ...]]],
        tile: Optional[int],
        is_two_sided: bool,
        is_seen_through: bool,
    ) -> int:
        """The material's number, without the textures whose coordinates are missing."""
        key = (surface.name, surface.colors, tuple(missing), tile, is_two_sided, is_seen_through)
        if key not in self.materials:
            textures = {name: texture for name, texture in surface.textures.items() if texture.uv not in missing}
            described = self.described(surface._replace(textures=textures), tile, is_seen_through)
            described["doubleSided"] = is_two_sided
            self.materials[key] = self.glb.add("materials", described)
        return self.materials[key]

    def described(self, surface: _Surface, tile: Optional[int], is_seen_through: bool) -> Dict[str, Any]:
        values, textures = surface.values, surface.textures
        threshold = float(values["opacityThreshold"])
        opacity = textures.get("opacity")
        is_blended = is_seen_through or opacity is not None or float(values["opacity"]) < 1
        base = textures.get("diffuseColor")
        factor = [*_rgb(values["diffuseColor"]), float(values["opacity"])]
        pbr: Dict[str, Any] = {"metallicFactor": float(values["metallic"]), "roughnessFactor": float(values["roughness"])}
        described: Dict[str, Any] = {"name": surface.name.rsplit("/", 1)[-1], "pbrMetallicRoughness": pbr}
        if is_blended:
            described.update({"alphaMode": "MASK", "alphaCutoff": threshold} if threshold > 0 else {"alphaMode": "BLEND"})
        found = self.base_color(surface, base, opacity, is_blended, tile)
        if found is not None:
            pbr["baseColorTexture"], scale = found
            factor = [scale if base is not None else value for value, scale in zip(factor[:3], scale)] + [
                1.0 if opacity is not None else factor[3]
            ]
        pbr["baseColorFactor"] = np.clip(factor, 0, 1).tolist()
        shine = {name: textures[name] for name in ("roughness", "metallic") if name in textures}
        found = self.packed(surface, {"roughness": 1, "metallic": 2}, shine, tile)
        if found is not None:
            pbr["metallicRoughnessTexture"] = found
            pbr.update({f"{name}Factor": 1.0 for name in shine})
        if "normal" in textures:
            found, strength = self.normal(surface, textures["normal"], tile)
            if found is not None:
                described["normalTexture"] = {**found, "scale": strength}
        if "occlusion" in textures:
            found = self.packed(surface, {"occlusion": 0}, {"occlusion": textures["occlusion"]}, tile)
            if found is not None:
                described["occlusionTexture"] = found
        self.emission(surface, described, tile)
        return described

    def base_color(
        self, surface: _Surface, base: Optional[_Texture], opacity: Optional[_Texture], is_blended: bool, tile: Optional[int]
    ) -> Optional[Tuple[Dict[str, Any], Sequence[float]]]:
        """Colour and opacity in one image, and the factors of the colour."""
        first = base or opacity
        if first is None:
            return None
        has_both = opacity is not None and opacity.channel == "a" and opacity._replace(channel="rgb") == base
        is_direct = (
            base is not None
            and base.channel == "rgb"
            and base.space != "raw"
            and base.bias == (0, 0, 0, 0)
            and (not is_blended or (has_both and base.scale[3] == 1))
        )
        if is_direct and base is not None:
            found = self.whole(surface, base, tile, is_color=True)
            return None if found is None else (found, base.scale[:3])
        if base is not None and opacity is not None and base.lookup != opacity.lookup:
            self.note(f"opacity and colour of the material {surface.name} are laid differently; opacity is left out")
            opacity = None
        colors = None if base is None else self.texels(surface, base, tile, is_color=True)
        alphas = None if opacity is None else self.texels(surface, opacity, tile, is_color=False)
        if colors is None and alphas is None:
            return None
        colors, alphas = _same_size(colors, alphas)
        shape = (alphas if colors is None else colors).shape[:2]
        picture = np.ones((*shape, 4), np.float32)
        if colors is not None:
            picture[..., :3] = colors
        if alphas is not None:
            picture[..., 3] = alphas[..., 0]
        return self.encoded(surface, first, ("base", base, opacity, tile), _srgb8(picture)), (1.0, 1.0, 1.0)

    def packed(
        self, surface: _Surface, places: Dict[str, int], textures: Dict[str, _Texture], tile: Optional[int]
    ) -> Optional[Dict[str, Any]]:
        """Numbers in the channels of one image: where they lie so already, that image, else one put together."""
        if not textures:
            return None
        first = next(iter(textures.values()))
        if any(texture.lookup != first.lookup for texture in textures.values()):
            self.note(f"{' and '.join(textures)} of the material {surface.name} are laid differently; the first is taken")
            textures = {name: texture for name, texture in textures.items() if texture.lookup == first.lookup}
        is_direct = len(textures) == len(places) and all(
            texture.is_plain and texture.file == first.file and texture.channel == "rgba"[places[name]]
            and texture.space != "sRGB"
            for name, texture in textures.items()
        )
        if is_direct:
            return self.whole(surface, first, tile, is_color=False)
        layers = {name: self.texels(surface, texture, tile, is_color=False) for name, texture in textures.items()}
        layers = {name: texels for name, texels in layers.items() if texels is not None}
        if not layers:
            return None
        size = max((texels.shape[:2] for texels in layers.values()), key=np.prod)
        picture = np.ones((*size, 3), np.float32)
        for name, texels in layers.items():
            picture[..., places[name]] = _resized(texels, size)[..., 0]
        key = ("packed", tuple(sorted(textures.items())), tile)
        return self.encoded(surface, first, key, _bytes(picture))

    def normal(self, surface: _Surface, texture: _Texture, tile: Optional[int]) -> Tuple[Optional[Dict[str, Any]], float]:
        """A normal map, and the factor of its slopes. Numbers of 0..1 stand for -1..1, also where nothing says so."""
        scale, bias = np.asarray(texture.scale[:3]), np.asarray(texture.bias[:3])
        if texture.is_plain:
            scale, bias = np.full(3, 2.0), np.full(3, -1.0)
        strength = float(scale[0] / 2)
        if np.allclose(scale[:2], 2 * strength) and np.allclose(bias[:2], -strength) and strength > 0:
            return self.whole(surface, texture, tile, is_color=False), strength
        texels = self.texels(surface, texture._replace(scale=(1,) * 4, bias=(0,) * 4), tile, is_color=False)
        if texels is None:
            return None, 1.0
        picture = (texels * scale.astype(np.float32) + bias.astype(np.float32)) * np.float32(0.5) + np.float32(0.5)
        return self.encoded(surface, texture, ("normal", texture, tile), _bytes(picture)), 1.0

    def emission(self, surface: _Surface, described: Dict[str, Any], tile: Optional[int]) -> None:
        texture = surface.textures.get("emissiveColor")
        factor = np.asarray(_rgb(surface.values["emissiveColor"]), float)
        if texture is not None:
            is_plain = texture.channel == "rgb" and texture.space != "raw" and texture.bias == (0, 0, 0, 0)
            if is_plain and not self.is_bright(texture, tile):
                found = self.whole(surface, texture, tile, is_color=True)
                factor = np.asarray(texture.scale[:3], float)
            else:
                texels = self.texels(surface, texture, tile, is_color=True)
                peak = 1.0 if texels is None else max(1.0, float(texels.max()))
                factor = np.full(3, peak)
                key = ("emission", texture, tile)
                found = None if texels is None else self.encoded(surface, texture, key, _srgb8(texels / np.float32(peak)))
            if found is None:
                return
            described["emissiveTexture"] = found
        strength = max(1.0, float(factor.max()))
        described["emissiveFactor"] = np.maximum(factor / strength, 0).tolist()
        if strength > 1:
            strengths = self.glb.extension("KHR_materials_emissive_strength", {"emissiveStrength": strength})
            described["extensions"] = strengths

    def bytes_of(self, texture: _Texture, tile: Optional[int]) -> Optional[bytes]:
        """The image's file, which may lie in a package."""
        from pxr import Ar

        file = texture.file if tile is None else texture.file.replace("<UDIM>", str(tile))
        asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(file))
        if not asset:
            self.note(f"the image {file} cannot be read; it is left out")
            return None
        return bytes(asset.GetBuffer())

    def whole(self, surface: _Surface, texture: _Texture, tile: Optional[int], is_color: bool) -> Optional[Dict[str, Any]]:
        """An image as it is: colours in sRGB, or numbers."""
        file = (texture.file, tile)
        key = file if file in self.images else (*file, is_color)
        if key not in self.images:
            data = self.bytes_of(texture, tile)
            if data is None or data.startswith(_OF_GLTF):
                key = file
            else:
                texels = self.decoded(texture, data, is_color)
                encode = _srgb8 if is_color else _bytes
                if texels is not None and not is_color:
                    self.note_rounding(texture, texels)
                elif texels is not None and texels[..., :3].max() > 1:
                    self.note(f"colours of the image {texture.file} are cut off at 1")
                data = None if texels is None else _native.encode_png(encode(texels))
            self.images[key] = None if data is None else self.glb.image(data, os.path.basename(texture.file))
        return self.looked_up(surface, texture, self.images[key])

    def is_bright(self, texture: _Texture, tile: Optional[int]) -> bool:
        """Whether an image has light above 1, for which glTF has no format."""
        data = self.bytes_of(texture, tile)
        if data is None or data.startswith(_OF_GLTF):
            return False
        texels = self.decoded(texture, data, True)
        return texels is not None and bool(texels[..., :3].max() > 1)

    def note_rounding(self, texture: _Texture, texels: np.ndarray) -> None:
        """Says it of numbers that 8 bits do not hold."""
        if np.abs(texels - _bytes(texels) / np.float32(255)).max() > 1e-4:
            self.note(f"the numbers of the image {texture.file} are rounded to 8 bits")

    def encoded(self, surface: _Surface, texture: _Texture, key: Any, picture: np.ndarray) -> Optional[Dict[str, Any]]:
        """An image that was put together, once."""
        if key not in self.images:
            data = _native.encode_png(np.ascontiguousarray(picture))
            self.images[key] = self.glb.image(data, os.path.basename(texture.file))
        return self.looked_up(surface, texture, self.images[key])

    def looked_up(self, surface: _Surface, texture: _Texture, image: Optional[int]) -> Optional[Dict[str, Any]]:
        if image is None:
            return None
        wrap_s, wrap_t = texture.wrap
        key = ("texture", image, texture.wrap)
        if key not in self.images:
            sampler = self.glb.add("samplers", {"wrapS": wrap_s, "wrapT": wrap_t})
            self.images[key] = self.glb.add("textures", {"source": image, "sampler": sampler})
        return {"index": self.images[key], "texCoord": surface.uvs.index(texture.uv)}

    def decoded(self, texture: _Texture, data: bytes, is_srgb: bool) -> Optional[np.ndarray]:
        try:
            return _native.decode_image(data, texture.file, is_srgb)
        except (_native.Error, OSError, ValueError) as error:
            self.note(f"{error}; it is left out")
            return None

    def texels(self, surface: _Surface, texture: _Texture, tile: Optional[int], is_color: bool) -> Optional[np.ndarray]:
        """Numbers of an image's channels, ``(rows, columns, 1 or 3)``; colours as linear light."""
        data = self.bytes_of(texture, tile)
        is_srgb = texture.space == "sRGB" or (is_color and texture.space != "raw")
        texels = None if data is None else self.decoded(texture, data, is_srgb)
        if texels is None:
            return None
        if texture.channel == "rgb":
            scale, bias, texels = texture.scale[:3], texture.bias[:3], texels[..., :3]
        else:
            channel = "rgba".index(texture.channel)
            scale, bias, texels = texture.scale[channel], texture.bias[channel], texels[..., channel : channel + 1]
        if not is_color:
            self.note_rounding(texture, texels)
        return texels * np.asarray(scale, np.float32) + np.asarray(bias, np.float32)


def _producer(given: Any) -> Any:
    """The attribute that gives an input its value; None without one."""
    from pxr import UsdShade

    found = UsdShade.Utils.GetValueProducingAttributes(given) if given else []
    return found[0] if found else None


def _is_finite(value: Any) -> bool:
    """Whether a value has no number that is not finite."""
    return value is None or isinstance(value, (str, bool)) or bool(np.isfinite(np.asarray(value, float)).all())


def _rgb(value: Any) -> Tuple[float, float, float]:
    r, g, b = map(float, value)
    return r, g, b


def _tile_corner(tile: int) -> Tuple[int, int]:
    """Where a UDIM tile begins."""
    return (tile - 1001) % 10, (tile - 1001) // 10


def _bytes(picture: np.ndarray) -> np.ndarray:
    return (np.clip(picture, 0, 1) * 255 + 0.5).astype(np.uint8)


def _resized(texels: np.ndarray, size: Tuple[int, int]) -> np.ndarray:
    """The nearest texels in another size."""
    rows, columns = ((np.arange(n) + 0.5) * old / n for n, old in zip(size, texels.shape))
    return texels[rows.astype(int)][:, columns.astype(int)]


def _same_size(a: Optional[np.ndarray], b: Optional[np.ndarray]) -> Tuple[Any, Any]:
    if a is None or b is None or a.shape[:2] == b.shape[:2]:
        return a, b
    size = max(a.shape[:2], b.shape[:2], key=np.prod)
    return _resized(a, size), _resized(b, size)


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """``python -m fantex.usd``."""
    parser = argparse.ArgumentParser(prog="python -m fantex.usd", description="Writes a USD stage as a model in glTF.")
    parser.add_argument("stage", help="a .usd, .usda, .usdc or .usdz file")
    parser.add_argument("output", help="the .glb to write: metres, y up")
    parser.add_argument("--time", type=float, help="which time's values are taken; by default the earliest")
    parser.add_argument("--force", action="store_true", help="replace an existing file")
    given = parser.parse_args(arguments)
    try:
        notes = write_glb(given.stage, given.output, time=given.time, overwrite=given.force)
    except FileExistsError:
        print(f"fantex.usd: {given.output} exists; give --force to replace it", file=sys.stderr)
        return 1
    except (OSError, ValueError, ImportError, _native.Error) as error:
        print(f"fantex.usd: {error}", file=sys.stderr)
        return 2 if isinstance(error, ValueError) else 1
    for note in notes:
        print(f"note: {note}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
