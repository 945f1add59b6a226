"""Bakes: a mesh and a source become an asset."""

from __future__ import annotations

import math
import os
from typing import Any, Dict, Optional, Tuple, Union

from . import _native
from ._asset import Asset, _atlas_options
from ._function import Function, FunctionSource
from ._given import PATHS, Path, absolute, amount, length, number, text, vector, whole
from ._mesh import Mesh, Progress


class Source:
    """What is baked: see :func:`own_materials`, :func:`vertex_colors`, :func:`solid`, :func:`image`, :func:`mesh`,
    :func:`photos`, :func:`look`."""

    def __init__(self, name: str, /, **parts: Any) -> None:
        self._name = name
        self._parts = {key: value for key, value in parts.items() if value is not None}
        # What the mesh of `mesh` was made of, which travels to other processes in its place.
        self._given: Any = None

    def __reduce__(self) -> Tuple[Any, ...]:
        if self._given is not None:
            return _mesh_source, (self._given, self._parts.get("cage"))
        return _source, (self._name, self._found())

    def _found(self) -> Dict[str, Any]:
        """Its parts for processes in other folders."""
        return {key: absolute(value) if key in ("path", "images") else value for key, value in self._parts.items()}

    def __repr__(self) -> str:
        parts = ", ".join(f"{key}={value!r}" for key, value in self._parts.items())
        return f"fantex.Source({self._name}{': ' if parts else ''}{parts})"


def _source(name: str, parts: Dict[str, Any]) -> Source:
    return Source(name, **parts)


def _mesh_source(given: Any, cage: Optional[float]) -> Source:
    return mesh(given, cage=cage)


def own_materials() -> Source:
    """The model's own materials: colours, textures and all other channels."""
    return Source("uv")


def vertex_colors() -> Source:
    """The mesh's vertex colours."""
    return Source("vertex_colors")


def solid(name: str) -> Source:
    """A recipe that is defined everywhere in space, one of :data:`SOLIDS`: ``"marble"``, ``"wood"`` ..."""
    return Source("solid", name=text(name, "name"))


def image(path: Path, mapping: str = "triplanar") -> Source:
    """An image laid over the mesh: ``planar``, ``box``, ``cylinder``, ``sphere`` or ``triplanar``."""
    if not isinstance(path, PATHS):
        raise TypeError(f"path is of type {type(path).__name__}; expected that of a picture's file, such as Picture.save writes")
    return Source("image", path=os.fsdecode(path), mapping=text(mapping, "mapping"))


def mesh(other: Any, *, cage: Optional[float] = None) -> Source:
    """Another, more detailed mesh: its materials or colours, and its normals. An :class:`Asset`, or the path or URL of one, gives all
    its channels. ``cage``: how far its surface is looked for, world units; measured where it is not given."""
    is_path = isinstance(other, PATHS)
    cage = None if cage is None else number(cage, "cage")
    if is_path and _native.kind(os.fsdecode(other)) == "asset":
        other = Asset(other)
    if isinstance(other, Asset):
        source = Source("mesh", asset=other, cage=cage)
    else:
        source = Source("mesh", mesh=Mesh.of(other), cage=cage)
    source._given = other._path if isinstance(other, Asset) else absolute(other) if is_path else other
    return source


def photos(
    path: Path,
    *,
    images: Optional[Path] = None,
    original_frame: bool = False,
    keep_exposure: bool = False,
    unseen: Optional[Tuple[float, float, float]] = None,
) -> Source:
    """Photographs with cameras: a sparse model of COLMAP, a folder with one, or a ``transforms.json``.

    Args:
        images: where the photographs are, if not beside it.
        original_frame: take a ``transforms.json`` in the coordinates from before nerfstudio has moved them.
        keep_exposure: do not bring the photographs to one exposure.
        unseen: linear colour of what no photograph sees; its surroundings' colours by default.
    """
    return Source(
        "photos",
        path=os.fsdecode(path),
        images=None if images is None else os.fsdecode(images),
        original_frame=bool(original_frame),
        keep_exposure=bool(keep_exposure),
        unseen=None if unseen is None else tuple(vector(unseen, "unseen")),
    )


def look(path: Path) -> Source:
    """The materials of a look (``.toml``)."""
    return Source("look", path=os.fsdecode(path))


def bake(
    mesh: Any,
    path: Path,
    *,
    texels: Optional[float] = None,
    density: Optional[float] = None,
    match: bool = False,
    source: Union[Source, Function, None] = None,
    tile: Optional[int] = None,
    alpha: Optional[str] = None,
    longest_edge: Union[int, str, None] = None,
    hard_edges: Optional[float] = None,
    weld: Optional[float] = None,
    format: str = "bc7",
    fit: str = "sharp",
    quality: str = "ultra-fast",
    overwrite: bool = False,
    memory: float = 1 << 30,
    seed: int = 1,
    progress: Optional[Progress] = None,
) -> Asset:
    """Bakes a source onto a mesh, and opens the result.

    Args:
        mesh: a path, ``(positions, faces)``, a :class:`Mesh`, a mesh of trimesh or Open3D; or an :class:`Asset` or its path, whose
            mesh is taken, with a ``source``.
        path: the asset to write, ``.fan``, also at an ``s3://``, ``gs://`` or ``az://`` address. It appears at the end, whole, or not at all.
        texels: in all; 4 million where nothing else says how many.
        density: texels per world unit of length, instead.
        match: every triangle gets the density of its texture or photograph, instead.
        source: one of this package's sources, or a function of ``points`` ``(n, 3)`` float64 in the world and ``normals``
            ``(n, 3)`` float32. It gives colours ``(n, 3)`` or ``(n, 4)``, greys ``(n,)``, or one colour for all, linear floats or
            sRGB ``uint8``; or a dictionary of channels: ``base-color``, ``emission`` and ``light`` are such colours, ``normal`` is a direction
            in the world, ``occlusion``, ``roughness``, ``metallic`` (or ``orm`` with all three) and ``displacement`` are numbers from 0
            to 1, ``anisotropy`` is a direction and a strength. If it has parameters ``footprint``, ``face`` or ``barycentric``, it is given the
            widths of texels in world units, and the points as :meth:`Asset.nearest` gives them. It is called from several threads, with blocks of
            points, and first with one point, which says which channels there are. By default the model's own materials or colours.
        tile: longest side of a tile in texels; 0 gives every fan its own.
        longest_edge: cut triangles at bends until their edges are at most so many texels long; ``"auto"``: as far as it makes
            textures sharper, which it does on models of few large triangles; 0: never. By default ``"auto"``, but for functions
            and looks with baked light. The triangles of the asset are then not the model's; its vertices come first.
        hard_edges: cut the texture at edges whose two triangles' normals differ by at least so many degrees, 0 to 180; 60 finds
            those of a box. Models of flat faces are sharper by that, and the texture may jump there, by about a tile's own error.
            By default it is continuous everywhere; but the mesh of an asset keeps the hard edges of that.
        alpha: what is made of the opacity of colours that a function, a solid, an image or vertices give: ``"opaque"``, ``"cut-out"``
            (from a half on), ``"blend"``; by default what the mesh's materials say, which is ``"opaque"`` where it has none.
        weld: join vertices of the mesh that lie up to this far apart, world units; by default only those at the same place.
        format: ``bc7``, ``bc1``, ``rgba8`` or ``float``.
        fit: ``sharp``, ``point`` or ``box``: how texels are found from the source.
        quality: effort of the block encoder: ``ultra-fast``, ``very-fast``, ``fast``, ``basic``.
        overwrite: replace an existing file.
        memory: bytes that texels in flight, images and photographs may take.
        seed: of recipes.
        progress: called with ``(done, total)``: thousandths of the covering, then texels, then bytes that are sent to a store; what it raises
            ends the bake.

    Returns:
        The asset; its ``baked`` has numbers of ``triangles``, ``tiles``, ``texels``, ``bytes``, ``channels``, seconds, and ``notes``, a sentence
        each; of photographs and of baked light what was found out about them.

    Raises:
        ValueError: an argument is out of its range, or the mesh has nothing to bake.
        FileNotFoundError, FileExistsError, OSError: as their names say.
        Error: a file is damaged or unsupported, or a limit would be exceeded.
        KeyboardInterrupt: Ctrl-C; nothing is left of the file.
    """
    options = _options(
        texels=texels,
        density=density,
        match=match,
        tile=tile,
        longest_edge=longest_edge,
        hard_edges=hard_edges,
        alpha=alpha,
        weld=weld,
        format=format,
        fit=fit,
        quality=quality,
        seed=seed,
    )
    mesh = Mesh.of(mesh, weld=options["weld"])
    parts = _parts(source, options)
    figures = _native.bake(
        mesh._native,
        os.fsdecode(path),
        parts,
        {**options, "overwrite": overwrite, "memory": amount(memory, "memory")},
        progress,
    )
    figures = _with_notes(figures, parts, format == "float")
    asset = Asset(path)
    # By their names here.
    asset.baked = {**figures, "channels": asset.channels}
    return asset


def bake_model(
    mesh: Any,
    path: Path,
    *,
    texels: Optional[float] = None,
    density: Optional[float] = None,
    match: bool = False,
    source: Union[Source, Function, None] = None,
    resolution: Optional[int] = None,
    largest_side: int = 8192,
    padding: Optional[int] = None,
    uv: Any = "atlas",
    alpha: Optional[str] = None,
    longest_edge: Union[int, str, None] = None,
    weld: Optional[float] = None,
    ktx2: bool = False,
    overwrite: bool = False,
    memory: float = 1 << 30,
    seed: int = 1,
    progress: Optional[Progress] = None,
) -> Dict[str, Any]:
    """Bakes a source onto a mesh and writes a model with ordinary texture coordinates, in the shortest way: what :func:`bake` and
    :meth:`Asset.export` do, without an asset. Triangles stay whole unless ``longest_edge`` says otherwise.

    Args:
        mesh, density, match, source, alpha, longest_edge, weld, memory, seed: as :func:`bake` takes them.
        path: ``.glb`` with its pictures inside, or ``.gltf`` with files beside it. All files appear at the end, or none.
        texels: of each picture, about; 4 million where nothing else says how many.
        resolution: side of the pictures, a power of two, instead.
        largest_side, padding, uv, ktx2: as :meth:`Asset.export` takes them.
        overwrite: replace existing files.
        progress: called with ``(done, total)``: texels of the surface while it is unwrapped, then texels of the pictures; before them thousandths
            of the covering where triangles are cut or light is baked. What it raises ends the bake.

    Returns:
        The paths of all ``files``; ``resolution``, ``channels``, ``charts``, ``padding`` and ``used_share`` of the pictures; numbers of
        ``triangles``, ``texels`` and ``bytes``; and ``notes``, a sentence each. Of photographs and of baked light what was found out about them.

    Raises:
        ValueError: an argument is out of its range, or the mesh has nothing to bake.
        FileNotFoundError, FileExistsError, OSError: as their names say.
        Error: a file is damaged or unsupported, or a limit would be exceeded.
        KeyboardInterrupt: Ctrl-C; nothing is left of the files.
    """
    options = _options(
        texels=texels,
        density=density,
        match=match,
        resolution=resolution,
        tile=None,
        longest_edge=longest_edge,
        alpha=alpha,
        weld=weld,
        seed=seed,
    )
    options.update(_atlas_options(resolution, largest_side, padding, uv, overwrite, memory))
    mesh = Mesh.of(mesh, weld=options["weld"])
    parts = _parts(source, options)
    figures = _native.bake_model(
        mesh._native,
        os.fsdecode(path),
        parts,
        {**options, "ktx2": ktx2},
        progress,
    )
    figures = _with_notes(figures, parts)
    return {**figures, "files": [os.fspath(file) for file in figures["files"]]}


def _options(**given: Any) -> Dict[str, Any]:
    """Settings of a bake as the compiled part takes them."""
    asked = [name for name in ("texels", "density", "match", "resolution") if given.get(name) not in (None, False)]
    if len(asked) > 1:
        raise ValueError(f"{asked[0]} and {asked[1]} both say how many texels there are; give one of them")
    texels, tile, edge = given["texels"], given["tile"], given["longest_edge"]
    density, hard_edges = given["density"], given.get("hard_edges")
    if density is not None and not 0 < number(density, "density") < math.inf:
        raise ValueError(f"density is {density}; expected a number of texels above zero")
    return {
        **given,
        "density": None if density is None else number(density, "density"),
        "match": bool(given["match"]),
        "texels": None if texels is None else amount(texels, "texels"),
        "tile": None if tile is None else whole(tile, "tile"),
        "longest_edge": edge if edge is None or isinstance(edge, str) else whole(edge, "longest_edge"),
        "hard_edges": None if hard_edges is None else number(hard_edges, "hard_edges"),
        "weld": length(given["weld"], "weld"),
        "seed": whole(given["seed"], "seed", (1 << 64) - 1),
    }


def _parts(source: Union[Source, Function, None], options: Dict[str, Any]) -> Any:
    """A source as the compiled part takes it. The cage of a mesh goes to the options."""
    is_colored = callable(source) or isinstance(source, Source) and source._name in ("solid", "image", "vertex_colors")
    if options.get("alpha") is not None and not is_colored:
        raise ValueError(
            "alpha= is for functions, solids, images and vertex colours; other sources say by their materials what is made of opacity"
        )
    if source is None:
        return None
    if isinstance(source, Source):
        parts = dict(source._parts)
        options["cage"] = parts.pop("cage", None)
        for key in {"mesh", "asset"} & parts.keys():
            parts[key] = parts[key]._native
        return source._name, parts
    if callable(source):
        return FunctionSource(source)
    hint = f"; fantex.solid({source!r}) is a solid" if isinstance(source, str) and source in _native.SOLIDS else ""
    raise TypeError(f"a source is one of fantex's or a function, not {type(source).__name__}{hint}")


def _with_notes(figures: Dict[str, Any], parts: Any, keeps_all: bool = False) -> Dict[str, Any]:
    """What a bake told, and what its function did. ``keeps_all``: the format holds numbers beyond 1."""
    if isinstance(parts, FunctionSource):
        figures["notes"] = [*figures["notes"], *parts.notes(keeps_all)]
    return figures
