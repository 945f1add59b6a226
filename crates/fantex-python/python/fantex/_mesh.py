"""Meshes from files and from arrays of other packages."""

from __future__ import annotations

import io
import os
from typing import Any, Callable, Optional, Protocol, Sequence, Tuple, Union

import numpy as np

from . import _native, _open3d, _parts, _trimesh
from ._given import PATHS, Path, amount, is_stage, is_usd, length, plain, whole
from ._picture import Camera, Picture, _srgb8, _taken, _view


class StepProgress(Protocol):
    """Hears what is done, too: ``"covering"``, ``"baking"``, ``"uploading"``."""

    def __call__(self, done: int, total: int, /, *, step: str) -> Any: ...


Progress = Union[Callable[[int, int], Any], StepProgress]


def _array(values: Any, dtype: Any, name: str, columns: Optional[int] = None) -> np.ndarray:
    """A contiguous, aligned array, with rows where there are columns; copied only where type or layout ask for it. Takes lists, numpy,
    torch (CPU), Open3D's vectors."""
    if not isinstance(values, np.ndarray) and hasattr(values, "__dlpack__"):
        values = values.detach() if hasattr(values, "detach") else values
        try:
            values = np.from_dlpack(values)
        except (BufferError, RuntimeError, TypeError) as error:
            raise TypeError(f"{name} cannot be read from this device; move it to the CPU first") from error
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise ValueError(f"{name} has rows of different lengths; expected (n{'' if columns is None else f', {columns}'})") from error
    kind = np.dtype(dtype).kind
    if array.size == 0:
        return np.zeros((0,) if columns is None else (0, columns), dtype)
    if array.dtype.kind not in ("iub" if kind == "i" else "fiub"):
        wanted = "integers" if kind == "i" else "numbers"
        raise TypeError(f"{name} holds {array.dtype}, not {wanted}")
    if columns is not None and (array.ndim != 2 or array.shape[1] != columns):
        raise ValueError(f"{name} has the shape {array.shape}; expected (n, {columns})")
    if columns is None and array.ndim > 1:
        raise ValueError(f"{name} has the shape {array.shape}; expected (n,)")
    return np.require(array, dtype, ("C", "ALIGNED"))


def _linear_rgba(colors: Any, count: int, name: str) -> np.ndarray:
    """Colours as linear RGBA: ``uint8`` is sRGB, floats are linear; grey, RGB or RGBA, or one colour for all."""
    colors = np.asarray(colors)
    if colors.ndim == 1:
        # One grey per point, or one colour.
        colors = colors[:, None] if len(colors) == count and count not in (3, 4) else colors[None, :]
    if colors.ndim != 2 or colors.shape[1] not in (1, 3, 4) or len(colors) not in (1, count):
        raise ValueError(f"{name} has the shape {np.shape(colors)}; expected ({count}, 3) or ({count}, 4)")
    rgba = np.ones((count, 4), np.float32)
    if colors.dtype == np.uint8:
        table = np.asarray(_native.LINEAR_FROM_SRGB8, np.float32)
        rgba[:, :3] = table[colors[:, :3]]
        if colors.shape[1] == 4:
            rgba[:, 3] = colors[:, 3] / np.float32(255)
    elif colors.dtype.kind in "fb" or colors.size == 0:
        rgba[:, :3] = colors[:, :3]
        if colors.shape[1] == 4:
            rgba[:, 3] = colors[:, 3]
    else:
        raise TypeError(f"{name} holds {colors.dtype}; expected uint8 in sRGB or linear floats")
    return rgba


def _encoded(picture: Any) -> Tuple[bytes, bool]:
    """A picture as the bytes of a file: encoded already, a path, a PIL image, or an array (h, w, c), sRGB as uint8, linear as floats; and
    whether it was encoded here, so that nobody has to see whether it can be decoded."""
    if isinstance(picture, (bytes, bytearray)) or (isinstance(picture, memoryview) and picture.ndim == 1):
        return bytes(picture), False
    if isinstance(picture, (str, os.PathLike)):
        with io.open(picture, "rb") as file:
            return file.read(), False
    array = plain(picture.convert("RGBA") if hasattr(picture, "convert") else picture)
    if array.ndim not in (2, 3) or not (array.dtype == np.uint8 or array.dtype.kind == "f"):
        raise TypeError(f"a picture is (h, w) or (h, w, c), uint8 or float, not {array.shape} {array.dtype}")
    if array.ndim == 2:
        array = array[:, :, None]
    if array.dtype.kind == "f" and array.shape[2] in (1, 2, 3, 4):
        array = _srgb8(array)
    return _native.encode_png(np.ascontiguousarray(array, np.uint8)), True


class Mesh:
    """A triangle mesh, loaded and cleaned: welded, without repeated triangles and without such that have no area.

    Args:
        positions: ``(n, 3)``, world units.
        faces: ``(m, 3)`` vertex indices, counter-clockwise seen from outside.
        colors: ``(n, 3)`` or ``(n, 4)`` per vertex: linear floats or sRGB ``uint8``.
        normals: ``(n, 3)`` per vertex.
        uv: ``(n, 2)`` per vertex, v upwards.
        image: the base colour that ``uv`` refers to: ``(h, w, c)`` linear floats or sRGB ``uint8``, a PIL image, a path, or a
            file's bytes.
        weld: join vertices that lie up to this far apart, world units; by default only those at the same place.

    Arrays may be numpy's, lists, torch tensors on the CPU or anything with DLPack or the buffer protocol. A mesh does not change.
    """

    # Which face of the input each of those was that cleaning was given, where their order is another one.
    _order: Optional[np.ndarray] = None

    def __init__(
        self,
        positions: Any,
        faces: Any,
        *,
        colors: Any = None,
        normals: Any = None,
        uv: Any = None,
        image: Any = None,
        weld: Optional[float] = None,
    ) -> None:
        positions = _array(positions, np.float64, "positions", 3)
        faces = _array(faces, np.int64, "faces", 3)
        if not len(faces):
            raise ValueError("the mesh has no faces; a textured surface needs at least one")
        if colors is not None:
            colors = _linear_rgba(plain(colors), len(positions), "colors")
        if normals is not None:
            normals = _array(normals, np.float32, "normals", 3)
        if uv is not None:
            uv = _array(uv, np.float32, "uv", 2)
        if image is not None and uv is None:
            raise ValueError("image needs uv, the coordinates that lay it over the mesh")
        encoded, is_sound = (None, True) if image is None else _encoded(image)
        weld = length(weld, "weld")
        self._native = _native.Mesh.of_arrays(positions, faces, colors, normals, uv, encoded, is_sound, weld)

    @classmethod
    def load(cls, path: Path, *, weld: Optional[float] = None, keep_units: bool = False) -> "Mesh":
        """Reads a model (``.glb .gltf .obj .ply .stl``, and USD as :mod:`fantex.usd` says), or the mesh of an asset (``.fan``), without what is
        baked. ``weld`` joins vertices of a model that lie up to this far apart, world units; by default only those at the same place.
        USD becomes metres with y up; with ``keep_units``, here and in :meth:`of`, it stays in its stage's units and axes."""
        if is_usd(path):
            return cls._of_stage(path, os.fsdecode(path), weld, keep_units)
        _check_is_stage(path, keep_units)
        return cls._of(_native.Mesh.load(os.fsdecode(path), length(weld, "weld")))

    @classmethod
    def _of(cls, native: Any) -> "Mesh":
        mesh = cls.__new__(cls)
        mesh._native = native
        return mesh

    @classmethod
    def _of_part(cls, part: _parts.Part, weld: Optional[float]) -> "Mesh":
        return cls(part.positions, part.faces, colors=part.colors, weld=weld)

    @classmethod
    def _of_stage(cls, stage: Any, name: str, weld: Optional[float], keep_units: bool) -> "Mesh":
        # Few need it.
        from . import usd

        glb, notes = usd.glb_of(stage, keep_units=keep_units)
        return cls._of(_native.Mesh.of_glb(glb, name, notes, length(weld, "weld")))

    @classmethod
    def of(cls, mesh: Any, *, weld: Optional[float] = None, keep_units: bool = False) -> "Mesh":
        """A mesh from what users have: a path, a pair of arrays, a mesh of trimesh or Open3D, anything with ``vertices`` and
        ``faces``, an open stage of USD, or an :class:`Asset`. Of trimesh, also of scenes, come colours of vertices or faces, or coordinates and
        materials with all their maps and what they make of opacity; of Open3D, old meshes and those of tensors, textures and materials or colours of vertices. ``weld`` is as for :meth:`load`, and not for what is cleaned already."""
        is_asset = isinstance(getattr(mesh, "_native", None), _native.Asset)
        if weld is not None and (is_asset or isinstance(mesh, Mesh)):
            raise ValueError(f"weld= is for models and arrays; {mesh!r} is cleaned already, so give weld= where it is made")
        if isinstance(mesh, PATHS):
            return cls.load(mesh, weld=weld, keep_units=keep_units)
        if is_stage(mesh):
            return cls._of_stage(mesh, mesh.GetRootLayer().identifier, weld, keep_units)
        _check_is_stage(mesh, keep_units)
        if isinstance(mesh, Mesh):
            return mesh
        if is_asset:
            return cls._of(_native.Mesh.of_asset(mesh._native))
        if isinstance(mesh, tuple):
            if len(mesh) not in (2, 3):
                raise TypeError("a mesh in a tuple is (positions, faces) or (positions, faces, colors)")
            return cls(mesh[0], mesh[1], colors=mesh[2] if len(mesh) == 3 else None, weld=weld)
        if _trimesh.is_scene(mesh) or _trimesh.has_texture(mesh):
            glb = _trimesh.glb_of(mesh, _linear_rgba, lambda picture: _encoded(picture)[0])
            return cls._of(_native.Mesh.of_glb(glb, "the mesh", [], length(weld, "weld")))
        if _open3d.is_mesh(mesh) or _open3d.is_tensor_mesh(mesh):
            parts, order = _open3d.parts_of(mesh, _linear_rgba)
            if parts[0].uv is None and parts[0].material is None:
                return cls._of_part(parts[0], weld)
            glb = _open3d.glb_of(parts, _linear_rgba, lambda picture: _encoded(picture)[0])
            made = cls._of(_native.Mesh.of_glb(glb, "the mesh", [], length(weld, "weld")))
            made._order = order
            return made
        if hasattr(mesh, "vertices") and hasattr(mesh, "faces"):
            if _trimesh.has_colors(mesh):
                return cls._of_part(_trimesh.part_of(mesh, _linear_rgba), weld)
            return cls(mesh.vertices, mesh.faces, weld=weld)
        raise TypeError(
            f"{type(mesh).__name__} is no mesh: give a path, a fantex.Mesh, (positions, faces), or an object with vertices and faces"
        )

    def simplified(self, faces: float) -> "Mesh":
        """The same shape with about so many faces, without colours, normals and texture coordinates: bake this mesh onto it with
        ``source=fantex.mesh(this)``."""
        return Mesh._of(self._native.simplified(amount(faces, "faces")))

    def save(self, path: Path, *, overwrite: bool = False) -> None:
        """Writes positions and faces, without colours, textures and coordinates: ``.ply``, ``.obj`` or ``.glb``."""
        self._native.save(os.fsdecode(path), overwrite)

    def look(self) -> str:
        """The mesh's own materials as a look: text for a ``.toml`` file beside the model, to change and to give to :func:`look` or
        :func:`render`."""
        return self._native.look()

    def render(
        self,
        size: Sequence[int] = (960, 540),
        camera: Optional[Camera] = None,
        *,
        samples: int = 8,
        filter: str = "anisotropic",
        light: Optional[Sequence[float]] = None,
        environment: Optional[Path] = None,
        environment_strength: float = 1.0,
        environment_rotation: float = 0.0,
        transparent: bool = False,
    ) -> Picture:
        """A picture of the mesh with its own materials and colours, made on the CPU: what a bake of these shows. Takes the arguments of
        :meth:`Asset.render`, and gives ``(rows, columns, 4)`` uint8, sRGB. It warns where images of its file are missing or broken, which are
        left out."""
        view = _view(
            size=size,
            camera=camera,
            samples=samples,
            filter=filter,
            light=light,
            environment=environment,
            environment_strength=environment_strength,
            environment_rotation=environment_rotation,
            transparent=transparent,
        )
        return _taken(self._native.render(view))

    @property
    def info(self) -> dict:
        """``kind`` (``"model"``), ``triangles``, ``vertices``, ``components``, ``boundary_edges``, ``nonmanifold_edges``,
        ``nonmanifold_vertices``, ``genus`` (None where it has none), ``materials``, ``uv_sets``, ``has_colors``, ``notes``."""
        return {**self._native.figures(), "notes": self.notes}

    @property
    def positions(self) -> np.ndarray:
        """``(n, 3)`` float64, world units."""
        return self._native.positions

    @property
    def faces(self) -> np.ndarray:
        """``(m, 3)`` uint32."""
        return self._native.faces

    @property
    def colors(self) -> Optional[np.ndarray]:
        """``(m, 3, 4)`` float32: linear RGBA at the three corners of each face; None where there are none."""
        return self._native.colors

    @property
    def normals(self) -> Optional[np.ndarray]:
        """``(m, 3, 3)`` float32: unit normals at the three corners of each face; None where there are none, and shading finds them."""
        return self._native.normals

    @property
    def uv(self) -> Optional[np.ndarray]:
        """``(m, 3, 2)`` float32: texture coordinates at the three corners of each face, v upwards; None where there are none. Of several sets the first."""
        return self._native.uv

    @property
    def bounds(self) -> np.ndarray:
        """``(2, 3)`` float64: the corners of its box, world units."""
        return _bounds(self.positions)

    @property
    def source_faces(self) -> np.ndarray:
        """``(m,)`` uint32: which face of the input each face was. Cleaning leaves out some."""
        faces = self._native.source_faces
        return faces if self._order is None else self._order[faces]

    @property
    def notes(self) -> list:
        """What loading noticed and what cleaning did, a sentence each."""
        return self._native.notes

    def __copy__(self) -> "Mesh":
        return self

    def __deepcopy__(self, memo: Any) -> "Mesh":
        return self

    def __reduce__(self) -> Any:
        raise TypeError("a fantex.Mesh cannot be sent to other processes; send the path or the arrays that it was made of")

    def __repr__(self) -> str:
        return f"fantex.Mesh({len(self.positions)} positions, {len(self.faces)} faces)"


def _check_is_stage(mesh: Any, keep_units: bool) -> None:
    """Refuses ``keep_units`` for what is no USD."""
    if keep_units:
        raise ValueError(f"keep_units= is for USD, which says its units and axes; {mesh!r} is taken as it is")


def _bounds(positions: np.ndarray) -> np.ndarray:
    """The corners of the box around points."""
    return np.stack([positions.min(0), positions.max(0)])


class Unwrapping(tuple):
    """``(vmapping, faces, uvs)``; ``charts``, the number of pieces; ``size``, columns and rows of the picture in texels, and ``side``, the
    larger of these."""

    charts: int
    size: Tuple[int, int]
    side: int


def parametrize(
    positions: Any,
    faces: Any,
    normals: Any = None,
    uvs: Any = None,
    *,
    resolution: int = 2048,
    padding: Optional[int] = 2,
    square: bool = True,
    weld: Optional[float] = None,
    progress: Optional[Progress] = None,
) -> Unwrapping:
    """Texture coordinates for any mesh, in the place of ``xatlas.parametrize``.

    Args:
        positions: ``(n, 3)`` floats.
        faces: ``(m, 3)`` vertex indices.
        normals, uvs: taken for compatibility; charts do not depend on them.
        resolution: side of the square picture in texels, a power of two; larger where the pieces need it.
        padding: texels around each piece that are its own, a power of two; None for a 128th of the side, so that pictures may have
            coarser levels.
        square: False for a picture of any shape, with about as many texels as the square at most: few pieces fill it better. ``uvs`` are
            shares of its columns and of its rows, as xatlas' are; ``size`` says how many these are.
        weld: the surface goes on between vertices that lie up to this far apart; by default only at the same place.
        progress: called with ``(done, total)`` texels of the surface, from 0 again where the square grows; what it raises ends the work.

    Returns:
        ``vmapping`` ``(k,)`` uint32, the vertex of ``positions`` that each new vertex was; ``faces`` ``(m, 3)`` uint32 of new
        vertices, in the order of the input; ``uvs`` ``(k, 2)`` float32 in 0..1. Use ``positions[vmapping]``. No face is left
        out: repeated ones share coordinates; those without area, or at positions that are no finite numbers, lie in a point.
    """
    positions = _array(positions, np.float64, "positions", 3)
    faces = _array(faces, np.int64, "faces", 3)
    resolution, padding = whole(resolution, "resolution"), None if padding is None else whole(padding, "padding")
    weld = length(weld, "weld")
    vmapping, faces, uvs, charts, size = _native.parametrize(
        positions, faces, resolution, padding, bool(square), weld, progress
    )
    result = Unwrapping((vmapping, faces, uvs))
    result.charts, result.size, result.side = charts, size, max(size)
    return result
