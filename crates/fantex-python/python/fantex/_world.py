"""Worlds: indexes of assets that are shown together."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any, Iterable, List, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np

from . import _native
from ._asset import MIB, Asset, _atlas_options, _fan_options, _written
from ._mesh import Progress
from ._picture import Camera, Picture, _taken, _view

Path = Union[str, os.PathLike]
Point = Tuple[float, float, float]


class WorldPreview(NamedTuple):
    """What an index says of a preview."""

    #: Of its mesh.
    triangles: int
    #: Of its finest level, per channel.
    texels: int
    #: Length of the finest detail that it shows, world units.
    detail: float


@dataclass(frozen=True)
class WorldObject:
    """An asset in a world, as the index describes it; ``open()`` reads it."""

    #: Its name in the index: a path below the index's folder, or an address.
    name: str
    #: Where it is: a path or an address.
    place: str
    #: Length of the file.
    bytes: int
    #: Of its mesh.
    triangles: int
    #: Of its finest level, per channel.
    texels: int
    #: Corners of its box, world units.
    low: Point
    high: Point
    #: None for an asset without one: it is shown whole or not at all.
    preview: Optional[WorldPreview]

    def open(self, *, memory: float = 256 * MIB) -> Asset:
        """Opens the asset. Decoded tiles take at most ``memory`` bytes."""
        return Asset(self.place, memory=memory)


@dataclass(frozen=True)
class WorldCoarse:
    """A coarse asset, which stands for several assets of a world from afar, as the index describes it; ``open()`` reads it."""

    #: As of a :class:`WorldObject`.
    name: str
    place: str
    bytes: int
    triangles: int
    texels: int
    low: Point
    high: Point
    #: Length of the finest detail that it shows, world units.
    detail: float
    #: Names of the assets, and of finer coarse ones, that it stands for.
    parts: Tuple[str, ...]

    def open(self, *, memory: float = 256 * MIB) -> Asset:
        """Opens the asset. Decoded tiles take at most ``memory`` bytes."""
        return Asset(self.place, memory=memory)


class World:
    """A world: an index of assets that are shown together, near the eye whole, far away by their previews and by coarse assets.

    Args:
        place: the index (``.fanworld``), a path or an ``https://``, ``s3://``, ``gs://`` or ``az://`` address. Only the index is read; assets are
            opened by what needs them.
        memory: bytes that what is open may take in :meth:`render` and :meth:`verify`.
    """

    def __init__(self, place: Path, *, memory: float = 1 << 30) -> None:
        self._place = os.fspath(place)
        self._memory = int(memory)
        self._native = _native.World(self._place)
        #: The assets, in the order of the index.
        self.objects: List[WorldObject] = [_object(parts) for parts in self._native.objects]
        #: Coarse assets, each of which stands for several of these or of its own kind.
        self.coarse: List[WorldCoarse] = [_coarse(parts) for parts in self._native.coarse]
        #: What :func:`split` or :func:`make_world` said, where it was made right here.
        self.made: Optional[dict] = None

    @property
    def place(self) -> str:
        """Path or URL of the index."""
        return self._place

    @property
    def bounds(self) -> Optional[np.ndarray]:
        """``(2, 3)`` float64: the corners of the box around all assets, world units; None without assets."""
        if not self.objects:
            return None
        corners = np.array([(entry.low, entry.high) for entry in self.objects], np.float64)
        return np.stack([corners[:, 0].min(0), corners[:, 1].max(0)])

    @property
    def info(self) -> dict:
        """``kind`` (``"world"``); ``objects``, their ``triangles``, ``texels`` and ``bytes``; the box, ``low`` and ``high``; ``previews``,
        ``preview_triangles``, ``preview_texels`` and the longest ``preview_detail``; ``coarse``, ``coarse_triangles``,
        ``coarse_texels``, ``coarse_bytes``; the names of all ``assets``."""
        bounds = self.bounds
        previews = [entry.preview for entry in self.objects if entry.preview is not None]
        return {
            "kind": "world",
            "objects": len(self.objects),
            "triangles": sum(entry.triangles for entry in self.objects),
            "texels": sum(entry.texels for entry in self.objects),
            "bytes": sum(entry.bytes for entry in self.objects),
            "low": None if bounds is None else bounds[0].tolist(),
            "high": None if bounds is None else bounds[1].tolist(),
            "previews": len(previews),
            "preview_triangles": sum(preview.triangles for preview in previews),
            "preview_texels": sum(preview.texels for preview in previews),
            "preview_detail": max((preview.detail for preview in previews), default=None),
            "coarse": len(self.coarse),
            "coarse_triangles": sum(entry.triangles for entry in self.coarse),
            "coarse_texels": sum(entry.texels for entry in self.coarse),
            "coarse_bytes": sum(entry.bytes for entry in self.coarse),
            "assets": [entry.name for entry in self.objects],
        }

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
        memory: Optional[float] = None,
    ) -> Picture:
        """A picture of the world, made on the CPU: what is near by whole assets, what is far by previews and coarse assets. It warns
        where something is coarser than the picture could show, and where coarser texels stand in for damaged ones.

        Args:
            memory: bytes that what is open may take, half of them for meshes; those of the world by default.

        The other arguments, and the picture, are those of :meth:`Asset.render`.
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
        return _taken(self._native.render(view, self._memory if memory is None else int(memory)))

    def export(
        self,
        path: Path,
        *,
        resolution: Optional[int] = None,
        largest_side: int = 8192,
        padding: Optional[int] = None,
        ktx2: bool = False,
        overwrite: bool = False,
        memory: float = 1 << 30,
        progress: Optional[Progress] = None,
    ) -> List[str]:
        """Writes one model with texture coordinates: a node for each asset, whole, with pictures of its own. Takes the arguments of
        :meth:`Asset.export`, ``resolution`` for the pictures of each asset; one asset is open at a time.

        Returns:
            The paths of all files.
        """
        options = _atlas_options(resolution, largest_side, padding, "atlas", overwrite, memory)
        return _written(self._native.export(os.fspath(path), {**options, "ktx2": ktx2}, progress))

    def export_fans(
        self,
        path: Path,
        *,
        gutter: int = 4,
        largest_side: int = 8192,
        textures: str = "png",
        overwrite: bool = False,
        memory: float = 1 << 30,
        progress: Optional[Progress] = None,
    ) -> List[str]:
        """Writes one model with the fans themselves, a node for each asset. Takes the arguments of :meth:`Asset.export_fans`.

        Returns:
            The paths of all files.
        """
        options = _fan_options(gutter, largest_side, textures, (), overwrite, memory)
        return _written(self._native.export_fans(os.fspath(path), options, progress))

    def verify(self, *, texels: bool = False, progress: Optional[Progress] = None) -> dict:
        """Checks every asset, preview and coarse asset as :meth:`Asset.verify` does, that the index says what is there, and that sectors
        of one asset agree where they meet.

        Args:
            texels: compare detail levels, too.
            progress: called with ``(done, total)`` texels.

        Returns:
            ``ok``; numbers of ``objects``, ``coarse`` and ``faulty`` ones; ``seam_edges`` that were compared, and the ``largest_jump`` there
            with its ``bound``; ``faults``, a sentence each.
        """
        return _native.verify_index(self._place, texels, self._memory, progress)

    def __len__(self) -> int:
        return len(self.objects)

    def __repr__(self) -> str:
        coarse = f", {len(self.coarse)} coarse assets" if self.coarse else ""
        triangles = sum(entry.triangles for entry in self.objects)
        return f"fantex.World({self._place!r}: {len(self.objects)} assets of {triangles} triangles{coarse})"


def _object(parts: Tuple[Any, ...]) -> WorldObject:
    name, place, size, triangles, texels, low, high, preview = parts
    preview = None if preview is None else WorldPreview(*preview)
    return WorldObject(name, place, size, triangles, texels, tuple(low), tuple(high), preview)


def _coarse(parts: Tuple[Any, ...]) -> WorldCoarse:
    name, place, size, triangles, texels, low, high, detail, stands_for = parts
    return WorldCoarse(name, place, size, triangles, texels, tuple(low), tuple(high), detail, tuple(stands_for))


def split(
    asset: Union[Asset, Path],
    folder: Path,
    *,
    triangles: float = 250_000,
    previews: bool = True,
    preview_triangles: Optional[float] = None,
    preview_texels: Optional[float] = None,
    overwrite: bool = False,
    memory: float = 1 << 30,
    progress: Optional[Progress] = None,
) -> World:
    """Splits a large asset into a world of sectors, assets that show exactly what the whole shows, and opens it.

    Args:
        asset: an :class:`Asset`, or its path or URL. It stays as it is.
        folder: where ``sector-0001.fan`` and so on, of more than 16 sectors ``coarse-0001.fan`` and so on, and the index, named after
            the asset, go: a new or empty folder, or an ``s3://``, ``gs://`` or ``az://`` address. They appear when all are there, or not at all.
        triangles: of a sector, about.
        previews: make previews and coarse assets.
        preview_triangles: of a preview and of a coarse asset, about; by default a 64th of a sector's, and what its border needs.
        preview_texels: of their finest levels; by default a 64th of a sector's, at least 16 per triangle.
        overwrite: write into a folder that is not empty, and over a world that is there.
        memory: bytes that texels may take while previews are made.
        progress: called with ``(done, total)`` texels, then bytes that are sent to a store; what it raises ends the split.

    Returns:
        The world; its ``made`` has the number of ``repeated_texels``, which several sectors have.

    Raises:
        ValueError: an argument is out of its range, or the address names no store that is written to.
        FileNotFoundError, FileExistsError, OSError: as their names say.
        Error: the asset is damaged, the folder is not empty, or a limit would be exceeded.
        KeyboardInterrupt: Ctrl-C; nothing is left of the world.
    """
    asset = asset if isinstance(asset, Asset) else Asset(asset)
    sizes = None
    if previews:
        sizes = tuple(None if size is None else int(size) for size in (preview_triangles, preview_texels))
    elif preview_triangles is not None or preview_texels is not None:
        raise ValueError("preview_triangles and preview_texels are for previews; leave previews=False out")
    made = _native.split(asset._native, os.fspath(folder), int(triangles), sizes, overwrite, int(memory), progress)
    world = World(made["index"])
    world.made = made
    return world


def make_world(
    assets: Union[Asset, Path, Iterable[Union[Asset, Path]]],
    index: Path,
    *,
    remove: Union[Path, Iterable[Path]] = (),
    make_previews: bool = False,
    memory: float = 1 << 30,
    progress: Optional[Progress] = None,
) -> World:
    """Makes the index of assets that are shown together, or changes one that is there, and opens it.

    Args:
        assets: what to add, and what to read again because it has changed: assets, their paths or URLs; one, or any number. They stay
            where they are: below the folder of the index, or at addresses.
        index: the index, ``.fanworld``; also an ``s3://``, ``gs://`` or ``az://`` address, which then names assets at addresses.
        remove: assets to take out, by their names in the index or by their places; their files stay.
        make_previews: give a preview to assets of the index that have none, which keeps their open borders; they are changed in place.
        memory: bytes that texels may take while previews are made.
        progress: called with ``(done, total)`` assets; what it raises ends the change.

    Returns:
        The world; its ``made`` has what was ``added``, ``updated`` and ``removed``, ``coarse_removed`` (coarse assets that showed what has
        changed), ``previews_made``, and ``notes``, a sentence each.

    Raises:
        ValueError: nothing is to be done, or ``index`` is no name for a world.
        FileNotFoundError, OSError: as their names say.
        Error: a file is no asset or damaged, an asset cannot be named by the index, there is none of those to remove, or somebody else has
            changed an index in a store meanwhile.
        KeyboardInterrupt: Ctrl-C; the index is as it was.
    """
    put, gone = _places(assets), _places(remove)
    if not put and not gone and not make_previews:
        raise ValueError("give assets to put into the world, remove= or make_previews=True")
    made = _native.change_world(os.fspath(index), put, gone, make_previews, int(memory), progress)
    world = World(made["index"])
    world.made = made
    return world


def _places(assets: Any) -> List[str]:
    """Paths and addresses of one asset or of several."""
    one = isinstance(assets, (str, os.PathLike, Asset))
    return [asset.place if isinstance(asset, Asset) else os.fspath(asset) for asset in ([assets] if one else assets)]
