"""Looks and models as pictures and numbers: tables of textures, normal maps."""

from __future__ import annotations

import os
from typing import Any, NamedTuple, Optional, Sequence

import numpy as np

from . import _native
from ._given import Path, amount, size as _size, vector, whole
from ._mesh import Mesh, Progress
from ._picture import _warn


def table(
    look: Path,
    texture: Optional[str] = None,
    *,
    size: Sequence[int] = (512, 512),
    slices: Optional[int] = None,
    start: Sequence[float] = (-0.5, 0.5, 0.0),
    end: Sequence[float] = (0.5, -0.5, 0.0),
    samples: int = 1,
    time: float = 0.0,
    seed: int = 1,
    memory: float = 1 << 30,
    progress: Optional[Progress] = None,
) -> np.ndarray:
    """A texture of a look as numbers, over a box of object space.

    Columns go from the x of ``start`` to that of ``end``, rows from y to y, slices from z to z. Texture coordinates go from 0 to 1 over
    columns and rows, so that images are seen whole. By default the box is the front of a cube of edge 1, the first row on top.

    Args:
        look: the look (``.toml``).
        texture: its name; the only one by default.
        size: columns and rows.
        slices: number of slices along z; without it one, at the z of ``start``.
        samples: per texel along columns and rows; their mean is the texel.
        time: seconds since the start of an animation.
        seed: of recipes.
        memory: bytes that a slice may take.
        progress: called with ``(done, total)`` slices.

    Returns:
        ``(rows, columns, 4)`` float32, linear RGBA; with ``slices`` ``(slices, rows, columns, 4)``.
    """
    options = {
        "start": vector(start, "start"),
        "end": vector(end, "end"),
        "samples": whole(samples, "samples"),
        "time": time,
        "seed": whole(seed, "seed", (1 << 64) - 1),
        "memory": amount(memory, "memory"),
    }
    if not np.isfinite([*options["start"], *options["end"], time]).all():
        raise ValueError(f"start is {start}, end {end} and time {time}; all must be finite")
    shape = [*_size(size, "size"), 1 if slices is None else whole(slices, "slices")]
    if 0 in shape:
        raise ValueError(f"a table of {shape[0]} x {shape[1]} x {shape[2]} texels has nothing in it; all must be at least 1")
    texels = _native.table(os.fsdecode(look), texture, shape, options, progress)
    return texels[0] if slices is None else texels


class NormalMap(NamedTuple):
    """The normals of a detailed mesh over the texture coordinates of a coarse one."""

    #: ``(rows, columns, 3)`` float32: coordinates of -1..1 as 0..1, row 0 at v = 1.
    image: np.ndarray
    #: How far the detailed surface was looked for, world units.
    cage: float
    #: Share of the points that found nothing within it and took the nearest point, 0..1.
    missed_share: float


def normal_map(
    coarse: Any,
    detailed: Any,
    *,
    size: Sequence[int] = (1024, 1024),
    space: str = "tangent",
    uv_set: int = 0,
    padding: int = 8,
    samples: int = 2,
    cage: Optional[float] = None,
) -> NormalMap:
    """Bakes the normals of a detailed mesh into a normal map of a coarse one that has texture coordinates. Without coordinates,
    :func:`bake` with ``source=fantex.mesh(detailed)`` does so. Coordinates that several triangles share are a warning.

    Args:
        coarse: a path, or what else :meth:`Mesh.of` takes.
        detailed: the same, in the same place.
        size: columns and rows, 1 to 8192 each.
        space: ``"tangent"``, glTF's, green to the top of the picture; or ``"object"``, the axes of the model.
        uv_set: the set of texture coordinates, from 0.
        padding: texels by which the edges of charts are continued.
        samples: rays along each side of a texel.
        cage: how far the detailed surface is looked for, world units; measured where it is not given.
    """
    options = {
        "size": _size(size, "size"),
        "space": space,
        "uv_set": whole(uv_set, "uv_set"),
        "padding": whole(padding, "padding"),
        "samples": whole(samples, "samples"),
        "cage": cage,
    }
    image, reach, missed, notes = _native.normal_map(Mesh.of(coarse)._native, Mesh.of(detailed)._native, options)
    _warn(notes, 3)
    return NormalMap(image, reach, missed)
