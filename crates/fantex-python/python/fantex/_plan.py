"""Bakes in parts: a plan, its parts in any number of processes, and their merge."""

from __future__ import annotations

import json
import os
from typing import Any, Dict, Iterable, Optional, Tuple, Union

from . import _native
from ._asset import Asset
from ._bake import Function, Source, _options, _parts, _with_notes
from ._given import PATHS, Path, absolute, amount, whole
from ._mesh import Mesh, Progress
from ._picture import _warn

# The key of the note in a plan. Plans of the command line note something else.
_NOTE = "fantex.plan"


class Plan:
    """A planned bake: the mesh, its tiles and channels, and no texels. :func:`plan` writes such a file.

    Args:
        path: the file, also at an ``https://``, ``s3://``, ``gs://`` or ``az://`` address.

    Raises:
        FileNotFoundError, OSError: the file cannot be read.
        Error: it is no plan, or damaged.
    """

    path: str
    """Where it lies: an absolute path, or an address."""
    channels: Tuple[str, ...]
    """Names of the channels."""
    texels: int
    """Texels per channel, of the finest level."""
    tiles: int
    """Number of tiles; more parts than tiles are of no use."""

    def __init__(self, path: Path) -> None:
        self.path = absolute(path)
        self._native = _native.Plan(self.path)
        self.channels = tuple(self._native.channels)
        self.texels, self.tiles, self._triangles = self._native.figures()

    def _note(self) -> Dict[str, Any]:
        try:
            note = json.loads(self._native.about)
        except ValueError:
            note = None
        if not isinstance(note, dict) or not isinstance(note.get(_NOTE), dict):
            raise ValueError(
                f"{self.path} was not made by fantex.plan; bake its parts with `fantex bake {self.path} --shard I/N`"
            )
        return note[_NOTE]

    def __reduce__(self) -> Tuple[Any, ...]:
        return Plan, (self.path,)

    def __repr__(self) -> str:
        return f"fantex.Plan({self.path}: {self.texels} texels in {self.tiles} tiles, {', '.join(self.channels)})"


def plan(
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
) -> Plan:
    """Covers a mesh and plans a bake: parts are baked by :func:`bake_part` and joined by :func:`merge`.

    Takes the arguments of :func:`bake` and raises what it raises; ``path`` is the plan to write, also at an ``s3://``, ``gs://`` or ``az://``
    address. The plan notes paths of model and source, absolute, and all settings but ``memory``, ``overwrite`` and ``progress``, which is called
    with ``(done, total)`` thousandths of the covering, then bytes that are sent to a store. It also keeps digests of all that decides the texels, such as the contents of
    looks and pictures, but nothing of functions; parts are baked of nothing else. A function is asked for one point, which says which channels there are.

    What :func:`bake` has as ``notes`` are warnings here: of the plan what is known of model and source, of its parts what shows as they are baked.
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
    loaded = Mesh.of(mesh, weld=options["weld"])
    parts = _parts(source, options)
    note = {_NOTE: {"mesh": _noted_mesh(mesh), "source": _noted_source(source), "options": options}}
    figures = _native.plan(
        loaded._native,
        os.fsdecode(path),
        json.dumps(note).encode(),
        parts,
        {**options, "overwrite": overwrite, "memory": amount(memory, "memory")},
        progress,
    )
    _warn(figures["notes"], 3)
    return Plan(path)


def bake_part(
    plan: Union[Plan, Path],
    shard: Tuple[int, int],
    path: Path,
    *,
    mesh: Any = None,
    source: Union[Source, Function, None] = None,
    overwrite: bool = False,
    memory: float = 1 << 30,
    progress: Optional[Progress] = None,
) -> int:
    """Bakes one part of a plan. Any process may bake any part, in any order, and again where one was lost.

    Args:
        plan: what :func:`plan` made, or its path.
        shard: ``(number, count)``: which part, from 1, and how many there are.
        path: the part to write, also at an ``s3://``, ``gs://`` or ``az://`` address. It appears at the end, whole, or not at all.
        mesh: the planned mesh, where that was no file.
        source: the planned source, where that was a function or a mesh in memory.
        overwrite: replace an existing file.
        memory: bytes that texels in flight, images and photographs may take.
        progress: called with ``(done, total)``: thousandths of the covering where triangles are cut, then texels; what it raises ends the bake.

    Returns:
        Bytes of the part. What is to be known of its texels, such as numbers that a function did not give, are warnings.

    Raises:
        ValueError: there is no such part; the mesh or the source has to be given, or is not what was planned; a file has changed since.
        FileNotFoundError, FileExistsError, OSError: as their names say.
        Error: a file is damaged.
        KeyboardInterrupt: Ctrl-C; nothing is left of the file.
    """
    plan = plan if isinstance(plan, Plan) else Plan(plan)
    if isinstance(shard, (str, bytes)) or len(shard) != 2:
        raise ValueError(f"shard is {shard!r}; expected two whole numbers, which part and how many there are: (1, 4)")
    number, count = (whole(part, "shard") for part in shard)
    if not 1 <= number <= count < 1 << 32:
        raise ValueError(f"there is no part {number} of {count}; parts count from 1")
    note = plan._note()
    options = dict(note["options"])
    if mesh is None:
        mesh = note["mesh"]
        if mesh is None:
            raise ValueError(f"{plan.path} was planned for a mesh in memory; give it as mesh=")
    if source is None and note["source"] is not None:
        source = _source_of(note["source"], plan)
    # One in memory is as it was planned.
    weld = None if isinstance(mesh, Mesh) else options.get("weld")
    mesh = Mesh.of(mesh, weld=weld)
    parts = _parts(source, options)
    figures = _native.bake_part(
        plan._native,
        (number, count),
        mesh._native,
        os.fsdecode(path),
        parts,
        {**options, "overwrite": overwrite, "memory": amount(memory, "memory")},
        progress,
    )
    notes = _with_notes(figures, parts, options["format"] == "float")["notes"]
    # The plan's maker has heard those of the model.
    known = set(mesh.notes)
    _warn([note for note in notes if note not in known], 3)
    return figures["bytes"]


def merge(
    plan: Union[Plan, Path],
    parts: Iterable[Path],
    path: Path,
    *,
    overwrite: bool = False,
    progress: Optional[Progress] = None,
) -> Asset:
    """Joins the parts of a plan, given in any order, into the asset that :func:`bake` would have written, byte for byte.

    Args:
        plan: what :func:`plan` made, or its path.
        parts: all parts, also at addresses.
        path: the asset to write, also at an ``s3://``, ``gs://`` or ``az://`` address. It appears at the end, whole, or not at all. A store that
            has the parts, too, copies most of their texels itself; one that copies none although it might is told of by a warning.
        overwrite: replace an existing file.
        progress: called with ``(done, total)`` bytes, then those that a store copies or that are sent to it; what it raises ends the merge.

    Raises:
        FileExistsError, OSError: as their names say.
        ValueError: two parts have the same tiles, or a part is of another plan.
        Error: a part is missing or damaged; ``path`` of a damaged part is the file.
        KeyboardInterrupt: Ctrl-C; nothing is left of the file.
    """
    plan = plan if isinstance(plan, Plan) else Plan(plan)
    _, note = _native.merge(plan._native, [os.fsdecode(part) for part in parts], os.fsdecode(path), overwrite, progress)
    _warn([note] if note else [], 3)
    return Asset(path)


def check_parts(plan: Union[Plan, Path], parts: Iterable[Path], *, progress: Optional[Progress] = None) -> None:
    """Looks whether the parts of a plan are all there and whole, and writes nothing. Raises what :func:`merge` would raise.

    Args:
        plan: what :func:`plan` made, or its path.
        parts: all parts, also at addresses.
        progress: called with ``(done, total)`` bytes.
    """
    plan = plan if isinstance(plan, Plan) else Plan(plan)
    _native.merge(plan._native, [os.fsdecode(part) for part in parts], None, False, progress)


def _noted_mesh(mesh: Any) -> Optional[str]:
    """The model's path; None for what lies in memory."""
    if isinstance(mesh, Asset):
        return mesh._path
    return absolute(mesh) if isinstance(mesh, PATHS) else None


def _noted_source(source: Union[Source, Function, None]) -> Any:
    """A source as JSON: None for the model's own, ``"memory"`` for what no file describes."""
    if source is None:
        return None
    if not isinstance(source, Source):
        return "memory"
    parts = source._found()
    if {"mesh", "asset"} & parts.keys():
        if not isinstance(source._given, str):
            return "memory"
        parts.pop("asset", None)
        parts["mesh"] = source._given
    return {"name": source._name, "parts": parts}


def _source_of(noted: Any, plan: Plan) -> Source:
    if noted == "memory":
        raise ValueError(f"{plan.path} was planned for a source in memory; give it as source=")
    parts = dict(noted["parts"])
    if "mesh" in parts:
        from ._bake import mesh

        return mesh(parts["mesh"], cage=parts.get("cage"))
    return Source(noted["name"], **parts)
