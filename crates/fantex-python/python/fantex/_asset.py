"""Assets: files with a mesh and its texture."""

from __future__ import annotations

import io
import json
import os
import tempfile
from typing import Any, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np

from . import _native
from ._mesh import Mesh, Progress, _array
from ._picture import Camera, Picture, _taken, _view, _warn

MIB = 1 << 20


class Atlas(NamedTuple):
    """A mesh with ordinary texture coordinates and its pictures."""

    #: ``(k,)`` uint32: which vertex of the asset each vertex is.
    vmapping: np.ndarray
    #: ``(m, 3)`` uint32, rows as in the asset's faces.
    faces: np.ndarray
    #: ``(k, 2)`` float32, v upwards.
    uvs: np.ndarray
    #: By name: ``base-color``, ``orm`` (occlusion, roughness, metallic), ``normal`` (tangent space, +y up), ``emission``.
    images: Dict[str, Picture]


class Fans(NamedTuple):
    """The texture function for shaders that can read three places of a picture.

    With the barycentric coordinates ``l`` of a point of face ``f``, its three places are ``uv[f, i]`` interpolated by ``l``, for ``i``
    in 0, 1, 2; their weights are ``max(0, l_i - max(l_j, l_k) + delta)``, divided by their sum.
    """

    #: Width of the blend band.
    delta: float
    #: ``(m, 3, 3, 2)`` float32: face, slot, corner, and u and v (upwards) in the face's sheet.
    uv: np.ndarray
    #: ``(m,)`` uint32: the sheet of each face.
    sheet: np.ndarray
    #: Pictures of each sheet by name: ``base-color`` and the like as ``uint8``; ``normal`` as ``uint16``, in object space, each
    #: coordinate mapped from -1..1.
    sheets: List[Dict[str, np.ndarray]]
    #: What values of a picture were divided by to lie in 0..1.
    scales: Dict[str, float]


class Asset:
    """A baked asset, open for reading. Any number of threads may use it."""

    def __init__(self, place: Union[str, os.PathLike], *, memory: float = 256 * MIB) -> None:
        self._place = os.fspath(place)
        self._memory = int(memory)
        self._native = _native.Asset(self._place, self._memory)
        #: What the bake said, where it was baked right here: texels, tiles, bytes, seconds, notes.
        self.baked: Optional[dict] = None

    @property
    def place(self) -> str:
        """Path or URL."""
        return self._place

    @property
    def positions(self) -> np.ndarray:
        """``(n, 3)`` float64, world units, of the cleaned mesh."""
        return self._native.positions

    @property
    def faces(self) -> np.ndarray:
        """``(m, 3)`` uint32 of the cleaned mesh."""
        return self._native.faces

    @property
    def channels(self) -> List[str]:
        """Names of the channels, such as ``base-color``."""
        return self._native.channels

    @property
    def info(self) -> dict:
        """``kind`` (``"asset"``), ``triangles``, ``vertices``, ``texels`` per channel, ``tiles``, detail ``levels``, ``bytes`` of the
        file, ``preview_bytes`` (None without a preview), and ``channels``, formats by name."""
        return self._native.figures()

    def nearest(self, points: Any) -> tuple:
        """The nearest points of the surface to points ``(n, 3)`` of the world.

        Returns:
            ``face`` ``(n,)`` uint32, ``barycentric`` ``(n, 3)`` float32, ``position`` ``(n, 3)`` float64. Points that are not
            finite get NaN, and the face 2**32 - 1.
        """
        return self._native.nearest(_array(points, np.float64, "points", 3))

    def sample(
        self,
        points: Any = None,
        *,
        channel: str = "base-color",
        face: Any = None,
        barycentric: Any = None,
        footprint: Any = None,
        srgb: bool = False,
    ) -> np.ndarray:
        """Values of the texture function.

        Args:
            points: ``(n, 3)`` or ``(3,)`` positions; the value at the nearest point of the surface is taken.
            channel: one of :attr:`channels`.
            face: ``(n,)`` faces, with ``barycentric`` ``(n, 3)``, instead of points.
            footprint: width of the square that a sample stands for, world units: a number or ``(n,)``. Without it the finest
                texels are interpolated.
            srgb: give colours as ``uint8`` in sRGB.

        Returns:
            ``(n, 4)`` float32 linear RGBA; for normals unit vectors in x, y and z; for anisotropy the
            highlight's direction in x, y and z and its strength. NaN for points that are not finite. One row
            alone, without the first axis, for one point.
        """
        is_single = False
        if points is not None:
            if face is not None or barycentric is not None:
                raise ValueError("give points, or face and barycentric, not both")
            points = np.asarray(points, np.float64)
            is_single = points.ndim == 1
            face, barycentric, _ = self.nearest(points[None] if is_single else points)
        elif face is None or barycentric is None:
            raise ValueError("give points, or face and barycentric")
        else:
            is_single = np.ndim(face) == 0
            face, barycentric = np.atleast_1d(np.asarray(face)), np.atleast_2d(np.asarray(barycentric))
        face = _array(face, np.int64, "face")
        barycentric = _array(barycentric, np.float32, "barycentric", 3)
        if footprint is not None:
            footprint = np.atleast_1d(_array(footprint, np.float64, "footprint"))
        nowhere = face == 0xFFFF_FFFF
        if nowhere.any():
            face, barycentric = face.copy(), barycentric.copy()
            face[nowhere], barycentric[nowhere] = 0, (1, 0, 0)
        values = self._native.sample(channel, face, barycentric, footprint)
        values[nowhere] = np.nan
        if srgb:
            values = _srgb8(values)
        return values[0] if is_single else values

    def normals(self, face: Any, barycentric: Any) -> np.ndarray:
        """Unit vertex normals ``(n, 3)`` float32 at points of the surface."""
        face = _array(face, np.int64, "face")
        return self._native.normals(face, _array(barycentric, np.float32, "barycentric", 3))

    def render(
        self,
        size: Sequence[int] = (960, 540),
        camera: Optional[Camera] = None,
        *,
        samples: int = 8,
        filter: str = "anisotropic",
        light: Optional[Sequence[float]] = None,
        environment: Union[str, os.PathLike, None] = None,
        environment_strength: float = 1.0,
        environment_rotation: float = 0.0,
        transparent: bool = False,
    ) -> Picture:
        """A picture of the asset, made on the CPU. Where coarser texels stand in for damaged ones, it warns.

        Args:
            size: columns and rows.
            camera: from where; all of it from the front, the right and above by default.
            samples: per pixel, 1 to 64.
            filter: of textures: ``nearest``, ``bilinear``, ``bicubic``, ``bicubic-mipmaps``, ``trilinear``, ``anisotropic``, ``ewa``.
            light: direction to the sun, world axes; over the camera's left shoulder by default, none beside an environment.
            environment: picture of the surroundings (``.hdr``, ``.exr``) that lights the scene, or ``"sky"`` for a computed one.
            environment_strength: factor of its light.
            environment_rotation: degrees by which it is turned to the left.
            transparent: nothing behind the model, alpha 0.

        Returns:
            ``(rows, columns, 4)`` uint8, sRGB.
        """
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

    def _repr_png_(self) -> Optional[bytes]:
        return self.render(size=(640, 480)).to_png()

    def atlas(
        self,
        resolution: Optional[int] = None,
        *,
        padding: Optional[int] = None,
        memory: float = 1 << 30,
        progress: Optional[Progress] = None,
    ) -> Atlas:
        """The asset for programs with ordinary texture coordinates, in memory.

        Args:
            resolution: side of the pictures, a power of two; by default as many texels as the asset has, up to 8192.
            padding: texels around each piece that are its own, a power of two.
            memory: bytes that texels may take.
            progress: called with ``(done, total)`` texels.
        """
        vmapping, faces, uvs, images = self._native.atlas(resolution, padding, int(memory), progress)
        return Atlas(vmapping, faces, uvs, {name: image.view(Picture) for name, image in images})

    def export(
        self,
        path: Union[str, os.PathLike],
        *,
        resolution: Optional[int] = None,
        largest_side: int = 8192,
        padding: Optional[int] = None,
        uv: Any = "atlas",
        ktx2: bool = False,
        overwrite: bool = False,
        memory: float = 1 << 30,
        progress: Optional[Progress] = None,
    ) -> List[str]:
        """Writes a model with texture coordinates: ``.glb`` with its pictures inside, or ``.gltf`` with files beside it.

        Args:
            resolution: side of the pictures, a power of two; by default as many texels as the asset has.
            largest_side: the largest side that is taken by default.
            padding: texels around each piece of an atlas that are its own, a power of two.
            uv: ``"atlas"``, a packing of its own; ``"source"``, the coordinates of the model that was baked; or that model, a
                :class:`Mesh` with the asset's triangles, where the asset has not kept them.
            ktx2: write the pictures as KTX2 files, too.
            overwrite: replace existing files.

        Returns:
            The paths of all files.
        """
        options = _atlas_options(resolution, largest_side, padding, uv, overwrite, memory)
        return _written(self._native.export(os.fspath(path), {**options, "ktx2": ktx2}, progress))

    def export_channels(
        self,
        paths: Mapping[str, Union[str, os.PathLike]],
        *,
        depth: int = 8,
        resolution: Optional[int] = None,
        largest_side: int = 8192,
        padding: Optional[int] = None,
        uv: Any = "atlas",
        overwrite: bool = False,
        memory: float = 1 << 30,
        progress: Optional[Progress] = None,
    ) -> List[str]:
        """Writes single channels, laid out as :meth:`export` does with the same arguments.

        Args:
            paths: by name a file each, ``.png``, ``.exr`` (linear floats) or ``.ktx2``. Names are those of :attr:`channels`, and
                ``opacity``, ``occlusion``, ``roughness`` and ``metallic`` alone.
            depth: bits per sample of PNG files, 8 or 16.

        Returns:
            The paths of all files.
        """
        options = _atlas_options(resolution, largest_side, padding, uv, overwrite, memory)
        channels = [(name, os.fspath(path)) for name, path in paths.items()]
        return _written(self._native.export_channels(channels, depth, options, progress))

    def fan_attributes(
        self,
        *,
        gutter: int = 4,
        largest_side: int = 8192,
        memory: float = 1 << 30,
        progress: Optional[Progress] = None,
    ) -> Fans:
        """The asset for shaders that blend fans: three texture coordinates per corner, and sheets of tiles.

        Args:
            gutter: texels around each tile that continue it, a power of two.
            largest_side: the most columns and rows of a sheet.
            memory: bytes that sheets may take.
        """
        return Fans(**self._native.fans(gutter, largest_side, int(memory), progress))

    def export_fans(
        self,
        path: Union[str, os.PathLike],
        *,
        gutter: int = 4,
        largest_side: int = 8192,
        textures: str = "png",
        shaders: Sequence[str] = (),
        overwrite: bool = False,
        memory: float = 1 << 30,
        progress: Optional[Progress] = None,
    ) -> List[str]:
        """Writes what :meth:`fan_attributes` gives: ``.glb``, ``.gltf`` with sheets beside it, or ``.usda`` with a MaterialX file
        and sheets beside it.

        Args:
            largest_side: the most columns and rows of a sheet. Where one does not suffice there are several, one material each.
            textures: ``"png"``; ``"png+ktx2"`` or ``"png+exr"``, which writes the sheets as KTX2 or OpenEXR beside the model, too; or
                ``"exr"``, to which a ``.usda`` refers instead.
            shaders: languages in which the shader is written beside the model: ``"glsl"``, ``"wgsl"``, ``"hlsl"``, ``"godot"``.

        Returns:
            The paths of all files.
        """
        options = _fan_options(gutter, largest_side, textures, shaders, overwrite, memory)
        return _written(self._native.export_fans(os.fspath(path), options, progress))

    def to_trimesh(self, resolution: Optional[int] = None) -> Any:
        """A ``trimesh.Trimesh`` with an atlas; needs trimesh and Pillow."""
        import trimesh
        from PIL import Image

        vmapping, faces, uvs, images = self.atlas(resolution)
        maps = {"base-color": "baseColorTexture", "orm": "metallicRoughnessTexture", "normal": "normalTexture"}
        textures = {maps[name]: Image.fromarray(np.asarray(image)) for name, image in images.items() if name in maps}
        material = trimesh.visual.material.PBRMaterial(**textures)
        if "metallicRoughnessTexture" not in textures:
            material.metallicFactor, material.roughnessFactor = 0.0, 1.0
        visual = trimesh.visual.TextureVisuals(uv=uvs, material=material)
        return trimesh.Trimesh(self.positions[vmapping], faces, visual=visual, process=False)

    def verify(self, *, texels: bool = False) -> dict:
        """Checks structure, checksums, and that the texture is continuous across every edge: ``ok``, ``largest_jump``, ...;
        ``fault`` is a sentence on the first thing that is wrong, or None.

        Args:
            texels: compare detail levels, too: ``contradictions``, ``texel_faults``, ...
        """
        return self._native.verify(texels, self._memory)

    def make_preview(
        self,
        *,
        triangles: float = 5000,
        texels: float = 100_000,
        keep_borders: bool = False,
        memory: float = 1 << 30,
        progress: Optional[Progress] = None,
    ) -> dict:
        """Puts a preview into the file: a small asset that viewers far away show until the rest is there. It takes the place of one that
        is there, and shows what is in the asset now. An asset in a store is fetched, changed here, and put back whole.

        Args:
            triangles: of its mesh, about.
            texels: of its finest level, per channel.
            keep_borders: leave open borders as they are, so that previews of assets that meet there fit together; there may be more
                triangles for it.
            progress: called with ``(done, total)`` bytes of what lies in a store.

        Returns:
            ``triangles``, ``texels`` and ``bytes`` of the preview.
        """
        made = _native.make_preview(self._place, int(triangles), int(texels), keep_borders, int(memory), progress)
        self._reopen()
        return dict(zip(("triangles", "texels", "bytes"), made))

    def remove_preview(self) -> bool:
        """Takes the preview out of the file; False where there is none."""
        was_there = _native.remove_preview(self._place)
        self._reopen()
        return was_there

    def paint(
        self,
        strokes: Any = None,
        *,
        history: bool = True,
        add_channels: Iterable[str] = (),
        remove_channels: Iterable[str] = (),
        alpha: Optional[str] = None,
    ) -> dict:
        """Paints on the file: all strokes or none, and opens it anew. A file in a store is fetched, changed here, and put back whole.

        Args:
            strokes: what a stroke file holds: its path, its dictionary, or the list of its strokes; or another :class:`Asset`, whose
                strokes are painted on this one, too. None where only channels or ``alpha`` change.
            history: keep what undoes them.
            add_channels: channels that it is to have; they show what was seen without them.
            remove_channels: channels to take out before, with all that was baked and painted in them. That cannot be undone.
            alpha: what its materials make of the opacity of the base colour: ``"opaque"``, ``"cut-out"``, ``"blend"``; as it is by
                default.

        Returns:
            Numbers of ``strokes``, ``dabs`` and changed ``pages``, and of strokes of another asset that were ``unrecorded`` and are missing.
        """
        options = {
            "history": history,
            "add_channels": list(add_channels),
            "remove_channels": list(remove_channels),
            "alpha": alpha,
            "memory": self._memory,
        }
        if strokes is None:
            painted = _native.paint(self._place, None, None, options)
        elif isinstance(strokes, Asset):
            painted = _native.paint(self._place, None, strokes._native, options)
        elif isinstance(strokes, (str, os.PathLike)):
            path = os.fspath(strokes)
            painted = _native.paint(self._place, (path, os.path.dirname(path) or "."), None, options)
        else:
            if not isinstance(strokes, dict):
                strokes = {"version": 1, "strokes": list(strokes)}
            with tempfile.TemporaryDirectory() as folder:
                path = os.path.join(folder, "strokes.json")
                with io.open(path, "w", encoding="utf-8") as file:
                    json.dump(strokes, file)
                painted = _native.paint(self._place, (path, os.getcwd()), None, options)
        self._reopen()
        return dict(zip(("strokes", "dabs", "pages", "unrecorded"), painted))

    def save_strokes(self, path: Union[str, os.PathLike], *, overwrite: bool = False) -> dict:
        """Writes the strokes that were painted on the asset as a stroke file (``.json``), which :meth:`paint` takes, with the pictures
        that it mentions in the folder ``files`` beside it.

        Returns:
            Numbers of ``strokes``, and of those that were ``unrecorded`` and are missing.
        """
        path = os.fspath(path)
        if os.path.lexists(path) and not overwrite:
            raise FileExistsError(f"{path} exists already; give overwrite=True to overwrite it")
        return dict(zip(("strokes", "unrecorded"), _native.save_strokes(self._native, path)))

    def _reopen(self) -> None:
        """Reads the file again after it was changed."""
        self._native = _native.Asset(self._place, self._memory)

    def __repr__(self) -> str:
        figures = self.info
        return (
            f"fantex.Asset({self._place!r}: {figures['texels']} texels in {figures['tiles']} tiles, "
            f"{', '.join(self.channels)})"
        )


def _srgb8(values: np.ndarray) -> np.ndarray:
    """Linear RGBA as sRGB bytes."""
    table = np.asarray(_native.LINEAR_FROM_SRGB8, np.float32)
    between = (table[1:] + table[:-1]) / 2
    values = np.nan_to_num(values)
    result = np.empty(values.shape, np.uint8)
    result[:, :3] = np.searchsorted(between, values[:, :3])
    result[:, 3] = np.clip(values[:, 3], 0, 1) * 255 + 0.5
    return result


def _atlas_options(
    resolution: Optional[int], largest_side: int, padding: Optional[int], uv: Any, overwrite: bool, memory: float
) -> Dict[str, Any]:
    """How models with an atlas are written, as the compiled part takes it."""
    if isinstance(uv, str) and uv not in ("atlas", "source"):
        raise ValueError(f"uv is 'atlas', 'source' or a model, not {uv!r}")
    return {
        "resolution": resolution,
        "largest_side": largest_side,
        "padding": padding,
        "source_uv": isinstance(uv, str) and uv == "source",
        "model": None if isinstance(uv, str) else Mesh.of(uv)._native,
        "overwrite": overwrite,
        "memory": int(memory),
    }


def _fan_options(
    gutter: int, largest_side: int, textures: str, shaders: Sequence[str], overwrite: bool, memory: float
) -> Dict[str, Any]:
    """How fans are written, as the compiled part takes it."""
    return {
        "gutter": gutter,
        "largest_side": largest_side,
        "textures": textures,
        "shaders": list(shaders),
        "overwrite": overwrite,
        "memory": int(memory),
    }


def _written(exported: Tuple[List[Any], List[str]]) -> List[str]:
    """The files that the compiled part wrote; what is to be known of them becomes warnings of the caller's caller."""
    files, notes = exported
    _warn(notes, 4)
    return [os.fspath(file) for file in files]
