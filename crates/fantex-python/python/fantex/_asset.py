"""Assets: files with a mesh and its texture."""

from __future__ import annotations

import contextlib
import io
import json
import os
import threading
from typing import Any, Dict, Iterable, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np

from . import _native
from ._given import PATHS, Path, absolute, amount, failed, is_address, names, plain, text, whole
from ._mesh import Mesh, Progress, _array, _bounds
from ._picture import Camera, Picture, _srgb8, _taken, _view, _warn

MIB = 1 << 20


class _AtlasParts(NamedTuple):
    #: ``(k,)`` uint32: which vertex of the asset each vertex is.
    vmapping: np.ndarray
    #: ``(m, 3)`` uint32, rows as in the asset's faces.
    faces: np.ndarray
    #: ``(k, 2)`` float32, v upwards.
    uvs: np.ndarray
    #: By name: ``base-color``, ``orm`` (occlusion, roughness, metallic), ``normal`` (tangent space, +y up), ``emission``.
    images: Dict[str, Picture]


class Atlas(_AtlasParts):
    """A mesh with ordinary texture coordinates and its pictures: ``vmapping, faces, uvs, images``, and beside these the scales."""

    #: What values of a picture were divided by to lie in 0..1: more than 1 for bright emission.
    scales: Dict[str, float]

    def __new__(cls, vmapping, faces, uvs, images, scales):
        parts = super().__new__(cls, vmapping, faces, uvs, images)
        parts.scales = scales
        return parts

    def __getnewargs__(self):
        return (*self, self.scales)


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


class Material(NamedTuple):
    """What an asset says of a material beside its texels. Colour, metalness, roughness and emission are those where the asset has no channel of
    them: what is the same all over a material is in no texels."""

    #: Its name in the model, or empty.
    name: str
    #: What it makes of the opacity of the base colour: ``"opaque"``, nothing; ``"cut-out"``, what has less than the threshold is not there;
    #: ``"blend"``, what lies behind is seen through it.
    alpha: str
    #: Of cut-outs, usually 0..1; None for others.
    threshold: Optional[float]
    #: Linear RGBA, 0..1, without ``base-color``.
    base_color: Tuple[float, float, float, float]
    #: 0..1, without ``orm``.
    metallic: float
    #: 0..1, without ``orm``.
    roughness: float
    #: Linear RGB, which may exceed 1, without ``emission``.
    emission: Tuple[float, float, float]
    #: Its colour is what is seen, whatever light there is.
    unlit: bool
    #: It is seen from behind, too.
    double_sided: bool


class Asset:
    """A baked asset, open for reading: until :meth:`close`, the end of a ``with`` block, or as long as there is a reference. Any
    number of threads may use it. Sent to another process, it is opened there again, under the same path.

    Args:
        place: path or URL.
        memory: bytes that decoded tiles may take.
    """

    def __init__(self, place: Path, *, memory: float = 256 * MIB) -> None:
        self._place = os.fsdecode(place)
        # The folder that the process is in may change.
        self._path = absolute(place)
        self._memory = amount(memory, "memory")
        # Held while the file is changed.
        self._lock = threading.RLock()
        self._opened: Optional[_native.Asset] = _native.Asset(self._place, self._memory)
        #: What the bake said, where it was baked right here: texels, tiles, bytes, seconds, notes.
        self.baked: Optional[dict] = None

    @property
    def _native(self) -> _native.Asset:
        with self._lock:
            return self._check_open()

    def _check_open(self) -> _native.Asset:
        if self._opened is None:
            raise ValueError(f"{self._place} is closed; open it again with fantex.open")
        return self._opened

    @contextlib.contextmanager
    def _changing(self) -> Iterator[str]:
        """Where the file is, to be changed. It is let go of meanwhile, as writers use the room of what they replaced only when nobody reads
        the file; other threads wait."""
        with self._lock:
            self._check_open()
            if not is_address(self._path):
                # What is gone stays open.
                os.stat(self._path)
                self._opened = None
            try:
                yield self._path
            finally:
                self._opened = _native.Asset(self._path, self._memory)

    def close(self) -> None:
        """Lets go of the file and of what was decoded. Everything but another ``close`` then raises ``ValueError``."""
        with self._lock:
            self._opened = None

    def __enter__(self) -> "Asset":
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def __reduce__(self) -> Any:
        return _again, (self._path, self._memory, self.baked)

    def __copy__(self) -> "Asset":
        return _again(self._path, self._memory, self.baked)

    def __deepcopy__(self, memo: Any) -> "Asset":
        return self.__copy__()

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
    def bounds(self) -> np.ndarray:
        """``(2, 3)`` float64: the corners of its box, world units."""
        return _bounds(self.positions)

    @property
    def channels(self) -> List[str]:
        """Names of the channels, such as ``base-color``."""
        return self._native.channels

    @property
    def materials(self) -> List[Material]:
        """The materials, at least one; :attr:`face_materials` counts in them."""
        return [Material(*parts) for parts in self._native.materials]

    @property
    def face_materials(self) -> np.ndarray:
        """``(m,)`` uint32: which of :attr:`materials` each face has."""
        return self._native.face_materials

    @property
    def info(self) -> dict:
        """``kind`` (``"asset"``), ``triangles``, ``vertices``, ``texels`` per channel, ``tiles``, detail ``levels``, ``bytes`` of the
        file, ``preview_bytes`` (None without a preview), ``hard_edges`` (the angle from which on edges were cut for the texture, or None), and
        ``channels``, formats (``bc7``, ``bc1``, ``bc5``, ``bc4``, ``rgba8``, ``rg8``, ``r8`` or ``float``) by name."""
        return self._native.figures()

    def nearest(self, points: Any) -> tuple:
        """The nearest points of the surface to points ``(n, 3)`` of the world, or to one.

        Returns:
            ``face`` ``(n,)`` uint32, ``barycentric`` ``(n, 3)`` float32, ``position`` ``(n, 3)`` float64. Points that are not
            finite get NaN, and the face 2**32 - 1. Without the first axis for one point.
        """
        points, is_single = _rows(points, "points")
        found = self._native.nearest(_array(points, np.float64, "points", 3))
        return tuple(values[0] for values in found) if is_single else found

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
            face: ``(n,)`` faces, with ``barycentric`` ``(n, 3)``, each of sum one, instead of points.
            footprint: width of the square that a sample stands for, world units: a number or ``(n,)``. Without it the finest
                texels are interpolated.
            srgb: give colours as ``uint8`` in sRGB.

        Returns:
            ``(n, 4)`` float32 linear RGBA; for normals unit vectors in x, y and z; for anisotropy the
            highlight's direction in x, y and z and its strength. NaN for points that are not finite, all 0
            with ``srgb``. One row alone, without the first axis, for one point.

        Raises:
            KeyError: the asset has no such channel.
            IndexError: it has no such face.
        """
        is_single, channel = False, text(channel, "channel")
        if points is not None:
            if face is not None or barycentric is not None:
                raise ValueError("give points, or face and barycentric, not both")
            points, is_single = _rows(points, "points")
            face, barycentric, _ = self.nearest(points)
        elif face is None or barycentric is None:
            raise ValueError("give points, or face and barycentric")
        face, barycentric, is_nowhere, is_one = _on_surface(face, barycentric)
        if footprint is not None:
            footprint = np.atleast_1d(_array(footprint, np.float64, "footprint"))
            if not (np.isfinite(footprint) & (footprint >= 0)).all():
                raise ValueError("footprint has lengths below zero, or such that are not finite")
        values = self._native.sample(channel, face, barycentric, footprint)
        values[is_nowhere] = np.nan
        if srgb:
            values = _srgb8(values)
        return values[0] if is_single or is_one else values

    def normals(self, face: Any, barycentric: Any) -> np.ndarray:
        """Unit vertex normals ``(n, 3)`` float32 at points of the surface, or at one; NaN where :meth:`nearest` gave NaN."""
        face, barycentric, is_nowhere, is_one = _on_surface(face, barycentric)
        values = self._native.normals(face, barycentric)
        values[is_nowhere] = np.nan
        return values[0] if is_one else values

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
        """The asset for programs with ordinary texture coordinates, in memory. Where coarser texels stand in for damaged ones, it warns.

        Args:
            resolution: side of the pictures, a power of two; by default as many texels as the asset has, up to 8192.
            padding: texels around each piece that are its own, a power of two.
            memory: bytes that texels may take.
            progress: called with ``(done, total)`` texels.
        """
        atlas, notes = self._atlas(resolution, padding, memory, progress)
        _warn(notes, 3)
        return atlas

    def _atlas(
        self, resolution: Optional[int], padding: Optional[int], memory: float, progress: Optional[Progress]
    ) -> Tuple[Atlas, List[str]]:
        """An atlas, and what is to be known of it."""
        resolution, padding = _whole_or_none(resolution, "resolution"), _whole_or_none(padding, "padding")
        vmapping, faces, uvs, pictures, notes = self._native.atlas(
            resolution, padding, amount(memory, "memory"), progress
        )
        images = {name: image.view(Picture) for name, image, _ in pictures}
        return Atlas(vmapping, faces, uvs, images, {name: scale for name, _, scale in pictures}), notes

    def export(
        self,
        path: Path,
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
            The paths of all files. What these lack, such as texels or channels, are warnings.
        """
        options = _atlas_options(resolution, largest_side, padding, uv, overwrite, memory)
        return _written(self._native.export(os.fsdecode(path), {**options, "ktx2": ktx2}, progress))

    def export_channels(
        self,
        paths: Mapping[str, Path],
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
            The paths of all files. What these lack, such as light brighter than 1, are warnings.
        """
        options = _atlas_options(resolution, largest_side, padding, uv, overwrite, memory)
        if not isinstance(paths, Mapping):
            raise TypeError(f"paths is of type {type(paths).__name__}; expected a dictionary with a file for each channel")
        if not paths:
            raise ValueError("paths has no channel; give a file for each that is to be written")
        channels = [(name, os.fsdecode(path)) for name, path in paths.items()]
        if len({absolute(path) for _, path in channels}) < len(channels):
            raise ValueError("two channels have the same file; give each its own")
        return _written(self._native.export_channels(channels, whole(depth, "depth"), options, progress))

    def fan_attributes(
        self,
        *,
        gutter: int = 4,
        largest_side: int = 8192,
        memory: float = 1 << 30,
        progress: Optional[Progress] = None,
    ) -> Fans:
        """The asset for shaders that blend fans: three texture coordinates per corner, and sheets of tiles. Where coarser texels
        stand in for damaged ones, it warns.

        Args:
            gutter: texels around each tile that continue it, a power of two.
            largest_side: the most columns and rows of a sheet.
            memory: bytes that sheets may take.
        """
        gutter, largest_side = whole(gutter, "gutter"), whole(largest_side, "largest_side")
        fans = self._native.fans(gutter, largest_side, amount(memory, "memory"), progress)
        _warn(fans.pop("notes"), 3)
        return Fans(**fans)

    def export_fans(
        self,
        path: Path,
        *,
        gutter: int = 4,
        largest_side: int = 8192,
        textures: str = "png",
        shaders: Union[str, Sequence[str]] = (),
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
        return _written(self._native.export_fans(os.fsdecode(path), options, progress))

    def to_trimesh(self, resolution: Optional[int] = None) -> Any:
        """A ``trimesh.Trimesh`` with an atlas and one material; needs trimesh and Pillow.

        Where some of the asset's :attr:`materials` blend, that one does, else it is cut out where some are. What is in no channel is
        that of the material with the largest area. It warns where coarser texels stand in for damaged ones, and where emission is
        brighter than 1, which trimesh has no place for: the brightest is 1 then, the rest in proportion.
        """
        import trimesh
        from PIL import Image

        atlas, notes = self._atlas(resolution, None, 1 << 30, None)
        vmapping, faces, uvs, images = atlas
        _warn(notes, 3)
        maps = {
            "base-color": "baseColorTexture",
            "orm": "metallicRoughnessTexture",
            "normal": "normalTexture",
            "emission": "emissiveTexture",
        }
        textures = {maps[name]: Image.fromarray(np.asarray(image)) for name, image in images.items() if name in maps}
        material = trimesh.visual.material.PBRMaterial(**textures)
        used = self._largest_material()
        if "baseColorTexture" not in textures:
            material.baseColorFactor = np.round(255 * np.clip(used.base_color, 0, 1)).astype(np.uint8)
        if "metallicRoughnessTexture" not in textures:
            material.metallicFactor, material.roughnessFactor = used.metallic, used.roughness
        if "emissiveTexture" in textures:
            material.emissiveFactor = (1.0, 1.0, 1.0)
            _warn_of_light(atlas.scales["emission"])
        elif max(used.emission) > 0:
            strength = max(1.0, *used.emission)
            material.emissiveFactor = np.maximum(used.emission, 0) / strength
            _warn_of_light(strength)
        material.doubleSided = any(each.double_sided for each in self.materials)
        cut_outs = [each.threshold for each in self.materials if each.alpha == "cut-out"]
        if any(each.alpha == "blend" for each in self.materials):
            material.alphaMode = "BLEND"
        elif cut_outs:
            material.alphaMode, material.alphaCutoff = "MASK", cut_outs[0]
        visual = trimesh.visual.TextureVisuals(uv=uvs, material=material)
        return trimesh.Trimesh(self.positions[vmapping], faces, visual=visual, process=False)

    def _largest_material(self) -> Material:
        """The material with the largest area."""
        a, b, c = self.positions[self.faces].transpose(1, 0, 2)
        areas = np.bincount(self.face_materials, np.linalg.norm(np.cross(b - a, c - a), axis=1))
        return self.materials[int(areas.argmax())]

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
        texels: Optional[float] = None,
        keep_borders: bool = False,
        memory: float = 1 << 30,
        progress: Optional[Progress] = None,
    ) -> dict:
        """Puts a preview into the file: a small asset that viewers far away show until the rest is there. It takes the place of one that
        is there, and shows what is in the asset now. An asset in a store is fetched, changed here, and put back whole.

        Args:
            triangles: of its mesh, about.
            texels: of its finest level, per channel; 100 000, or a quarter of the asset's where that is less, if None.
            keep_borders: leave open borders as they are, so that previews of assets that meet there fit together; there may be more
                triangles for it.
            progress: called with ``(done, total)`` bytes of what lies in a store.

        Returns:
            ``triangles``, ``texels`` and ``bytes`` of the preview.
        """
        numbers = amount(triangles, "triangles"), None if texels is None else amount(texels, "texels")
        memory = amount(memory, "memory")
        with self._changing() as place:
            made = _native.make_preview(place, *numbers, keep_borders, memory, progress)
        return dict(zip(("triangles", "texels", "bytes"), made))

    def remove_preview(self) -> bool:
        """Takes the preview out of the file; False where there is none."""
        with self._changing() as place:
            return _native.remove_preview(place)

    def paint(
        self,
        strokes: Any = None,
        *,
        history: bool = True,
        add_channels: Union[str, Iterable[str]] = (),
        remove_channels: Union[str, Iterable[str]] = (),
        alpha: Optional[str] = None,
    ) -> dict:
        """Paints on the file: all strokes or none, and opens it anew. A file in a store is fetched, changed here, and put back whole.

        Args:
            strokes: what a stroke file holds: its path, its dictionary, or the list of its strokes; or another :class:`Asset`, whose
                strokes are painted on this one, too. None where only channels or ``alpha`` change.
            history: keep what undoes them; without it what undoes earlier ones goes, too, and a file of which more than half is free then is
                written anew.
            add_channels: channels that it is to have; they show what was seen without them.
            remove_channels: channels to take out before, with all that was baked and painted in them. That cannot be undone.
            alpha: what its materials make of the opacity of the base colour: ``"opaque"``, ``"cut-out"``, ``"blend"``; as it is by
                default.

        Returns:
            Numbers of ``strokes``, ``dabs`` and changed ``pages``, and of strokes of another asset that were ``unrecorded`` and are missing.

        Raises:
            TypeError: ``strokes`` is nothing of that.
            KeyboardInterrupt: Ctrl-C, when all strokes are painted; none of them is kept.
        """
        options = {
            "history": history,
            "add_channels": names(add_channels, "add_channels"),
            "remove_channels": names(remove_channels, "remove_channels"),
            "alpha": alpha,
            "memory": self._memory,
        }
        if isinstance(strokes, Asset):
            log = strokes._native
            with self._changing() as place:
                painted = _native.paint(place, None, log, options)
        elif strokes is None or isinstance(strokes, PATHS):
            path = None if strokes is None else os.fsdecode(strokes)
            given = None if path is None else (path, os.path.dirname(path) or ".")
            with self._changing() as place:
                painted = _native.paint(place, given, None, options)
        else:
            if not isinstance(strokes, Mapping):
                if not isinstance(strokes, Iterable):
                    kind = type(strokes).__name__
                    raise TypeError(f"strokes is of type {kind}; expected a path, a dictionary, a list of strokes or an Asset")
                strokes = {"version": 1, "strokes": list(strokes)}
            # It takes as long to import as all of the package's own modules together.
            import tempfile

            with tempfile.TemporaryDirectory() as folder:
                path = os.path.join(folder, "strokes.json")
                try:
                    written = json.dumps(strokes, default=_json, allow_nan=False)
                except ValueError as error:
                    raise ValueError(f"strokes hold a number that is not finite, or themselves: {error}") from None
                with io.open(path, "w", encoding="utf-8") as file:
                    file.write(written)
                try:
                    with self._changing() as place:
                        painted = _native.paint(place, (path, os.getcwd()), None, options)
                except _native.Error as error:
                    if path not in str(error):
                        raise
                    # Nobody knows that file.
                    raise failed(str(error).replace(path, "what was given to paint")) from None
        return dict(zip(("strokes", "dabs", "pages", "unrecorded"), painted))

    def save_strokes(self, path: Path, *, overwrite: bool = False) -> dict:
        """Writes the strokes that were painted on the asset as a stroke file (``.json``), which :meth:`paint` takes, with the pictures
        that it mentions in the folder ``files`` beside it.

        Returns:
            Numbers of ``strokes``, and of those that were ``unrecorded`` and are missing.
        """
        path = os.fsdecode(path)
        if os.path.lexists(path) and not overwrite:
            raise FileExistsError(f"{path} exists already; give overwrite=True to overwrite it")
        return dict(zip(("strokes", "unrecorded"), _native.save_strokes(self._native, path)))

    def __repr__(self) -> str:
        if self._opened is None:
            return f"fantex.Asset({self._place!r}: closed)"
        figures = self.info
        return (
            f"fantex.Asset({self._place!r}: {figures['texels']} texels in {figures['tiles']} tiles, "
            f"{', '.join(self.channels)})"
        )


def _again(place: str, memory: int, baked: Optional[dict]) -> Asset:
    """An asset as another process or a copy has it."""
    asset = Asset(place, memory=memory)
    asset.baked = baked
    return asset


def _warn_of_light(largest: float) -> None:
    """Warns the caller's caller of emission that trimesh's materials do not hold."""
    if largest > 1:
        _warn([f"emission of up to {largest:.3f} was divided by that, as trimesh holds no more than 1; export keeps it"], 4)


def _rows(points: Any, name: str) -> Tuple[np.ndarray, bool]:
    """Points as rows, and whether there was one alone."""
    points = plain(points)
    is_single = points.ndim == 1 and points.size > 0
    return _array(points[None] if is_single else points, np.float64, name, 3), is_single


def _on_surface(face: Any, barycentric: Any) -> Tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
    """Points of the surface as rows, which of them are nowhere (there the first face is given), and whether there was one alone."""
    face, barycentric = plain(face), plain(barycentric)
    is_single = face.ndim == 0
    face = _array(np.atleast_1d(face), np.int64, "face")
    barycentric = _array(np.atleast_2d(barycentric), np.float32, "barycentric", 3)
    is_nowhere = face == 0xFFFF_FFFF
    if len(face) == len(barycentric):
        is_nowhere |= ~np.isfinite(barycentric).all(axis=1)
        if is_nowhere.any():
            face, barycentric = face.copy(), barycentric.copy()
            face[is_nowhere], barycentric[is_nowhere] = 0, (1, 0, 0)
        # Half precision is close enough.
        wrong = np.flatnonzero(np.abs(barycentric.sum(axis=1) - 1) > 0.01)
        if len(wrong):
            raise ValueError(f"barycentric has {barycentric[wrong[0]].tolist()} in row {wrong[0]}; expected three numbers of sum one")
    return face, barycentric, is_nowhere, is_single


def _json(value: Any) -> Any:
    """Numbers and arrays of numpy, in strokes."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise TypeError(f"strokes hold a {type(value).__name__}; expected numbers, texts, lists and dictionaries")


def _whole_or_none(value: Any, name: str) -> Optional[int]:
    return None if value is None else whole(value, name)


def _atlas_options(
    resolution: Optional[int], largest_side: int, padding: Optional[int], uv: Any, overwrite: bool, memory: float
) -> Dict[str, Any]:
    """How models with an atlas are written, as the compiled part takes it."""
    if isinstance(uv, str) and uv not in ("atlas", "source"):
        raise ValueError(f"uv is 'atlas', 'source' or a model, not {uv!r}")
    return {
        "resolution": _whole_or_none(resolution, "resolution"),
        "largest_side": whole(largest_side, "largest_side"),
        "padding": _whole_or_none(padding, "padding"),
        "source_uv": isinstance(uv, str) and uv == "source",
        "model": None if isinstance(uv, str) else Mesh.of(uv)._native,
        "overwrite": overwrite,
        "memory": amount(memory, "memory"),
    }


def _fan_options(
    gutter: int, largest_side: int, textures: str, shaders: Union[str, Sequence[str]], overwrite: bool, memory: float
) -> Dict[str, Any]:
    """How fans are written, as the compiled part takes it."""
    return {
        "gutter": whole(gutter, "gutter"),
        "largest_side": whole(largest_side, "largest_side"),
        "textures": textures,
        "shaders": names(shaders, "shaders"),
        "overwrite": overwrite,
        "memory": amount(memory, "memory"),
    }


def _written(exported: Tuple[List[Any], List[str]]) -> List[str]:
    """The files that the compiled part wrote; what is to be known of them becomes warnings of the caller's caller."""
    files, notes = exported
    _warn(notes, 4)
    return [os.fspath(file) for file in files]
