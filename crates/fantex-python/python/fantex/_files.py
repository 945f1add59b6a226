"""Functions of whatever a file holds, and limits for all files."""

from __future__ import annotations

import os
from typing import Any, Optional, Sequence, Union

from . import _native
from ._asset import Asset
from ._given import PATHS, Path, amount, whole
from ._mesh import Mesh, Progress
from ._picture import Camera, Picture, _taken, _view, _warn
from ._world import World


def open(place: Path, *, memory: Optional[float] = None) -> Any:
    """Opens an asset or a world: a path, or an ``https://``, ``s3://``, ``gs://`` or ``az://`` address.

    Args:
        memory: of an asset, bytes that decoded tiles may take (256 MiB by default); of a world, bytes that what is open may take while
            it is drawn or verified (1 GiB).

    Returns:
        A :class:`World` where the name ends with ``.fanworld``, else an :class:`Asset`.
    """
    given = {} if memory is None else {"memory": memory}
    if _native.kind(os.fsdecode(place)) == "world":
        return World(place, **given)
    return Asset(place, **given)


def info(what: Any) -> dict:
    """What is in a file: the ``info`` of an :class:`Asset`, a :class:`World` or a :class:`Mesh`; of a look (``.toml``) the names of its
    ``textures`` and ``materials``, numbers of ``objects`` and ``lights``, ``has_environment``, the number of ``frames``, and the paths of its
    ``models``. ``kind`` says which.

    Args:
        what: a path or URL, or one of these.
    """
    if isinstance(what, (Asset, World, Mesh)):
        return what.info
    kind = _native.kind(os.fsdecode(what))
    if kind == "look":
        figures = _native.look_figures(os.fsdecode(what))
        figures["models"] = [os.fspath(model) for model in figures["models"]]
        return figures
    return Mesh.load(what).info if kind == "model" else open(what).info


def render(
    what: Any,
    *,
    look: Optional[Path] = None,
    size: Optional[Sequence[int]] = None,
    camera: Optional[Camera] = None,
    samples: Optional[int] = None,
    filter: Optional[str] = None,
    light: Optional[Sequence[float]] = None,
    environment: Optional[Path] = None,
    environment_strength: float = 1.0,
    environment_rotation: float = 0.0,
    transparent: bool = False,
    time: Optional[float] = None,
    seed: int = 1,
    memory: float = 1 << 30,
) -> Picture:
    """A picture of anything that has one, made on the CPU: a model, an asset, a world, or a look with what it names.

    Args:
        what: a path or URL, an :class:`Asset`, a :class:`World`, or what else :meth:`Mesh.of` takes.
        look: a look (``.toml``) for a model: its materials, lamps, surroundings and camera.
        size: columns and rows; those of the look, else 960 x 540.
        camera: from where; by default as the look says, else all of it from the front, the right and above.
        samples: per pixel, 1 to 64; those of the look, else 8.
        filter: of textures, as in :meth:`Asset.render`; that of the look, else ``anisotropic``.
        light: direction to the sun, world axes. Not for looks, like the other lights.
        environment: picture of the surroundings (``.hdr``, ``.exr``), or ``"sky"``.
        environment_strength: factor of its light.
        environment_rotation: degrees by which it is turned to the left.
        transparent: nothing behind the model, alpha 0.
        time: seconds since the start of a look's animation; that of its first picture by default.
        seed: of a look's recipes.
        memory: bytes that texels, images and what is open of a world may take.

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
    kind = _native.kind(os.fsdecode(what)) if isinstance(what, PATHS) else None
    lights = {"light": light, "environment": environment}
    given = [name for name, value in lights.items() if value is not None]
    if look is None and kind != "look":
        if time is not None:
            raise ValueError("time is that of an animation, which looks have; leave it out, or give a look")
        if kind in ("asset", "world"):
            what = open(what, memory=memory)
        if isinstance(what, World):
            return _taken(what._native.render(view, amount(memory, "memory")))
        subject = what if isinstance(what, Asset) else Mesh.of(what)
        return _taken(subject._native.render(view))
    path = os.fsdecode(what if look is None else look)
    if given:
        raise ValueError(f"{path} is a look, which has its lamps and surroundings itself; leave {given[0]} out")
    model = None if look is None else Mesh.of(what)._native
    seed = whole(seed, "seed", (1 << 64) - 1)
    return _taken(_native.render_look(path, model, view, time, seed, amount(memory, "memory")))


def compare(
    reference: Any,
    test: Any,
    *,
    views: int = 8,
    size: Sequence[int] = (960, 720),
    samples: int = 8,
    filter: str = "anisotropic",
    progress: Optional[Progress] = None,
) -> dict:
    """Renders two models or assets from the same cameras around the first and compares the pictures, over the pixels that show either.

    Args:
        reference: a path or URL, an :class:`Asset`, or what else :meth:`Mesh.of` takes; a model shows its own materials.
        test: what is compared with it.
        views: number of cameras, spread evenly, 1 to 1000.
        size: columns and rows of the pictures.
        samples: per pixel, 1 to 64.
        filter: of textures, as in :meth:`Asset.render`.
        progress: called with ``(done, total)`` views; what it raises ends the comparison.

    Returns:
        ``psnr_db``, the mean over the pictures that differ, infinite where none does, and ``min_psnr_db``; the means of ``ssim``, ``flip``
        and ``model_share``, the share of pixels that show a model; ``whole_psnr_db``, over all pixels; the number of ``views`` and of
        ``empty_views``, which show neither and do not count; ``per_view``, a dictionary with the measures of each camera.
    """
    views = whole(views, "views")
    if not 1 <= views <= 1000:
        raise ValueError(f"views is {views}; expected 1 to 1000")
    options = _view(size=size, samples=samples, filter=filter)
    found = _native.compare(_subject(reference)._native, _subject(test)._native, views, options, progress)
    _warn(found.pop("notes"), 3)
    return found


def upload(file: Path, address: Path, *, overwrite: bool = False, progress: Optional[Progress] = None) -> None:
    """Sends a finished file to an object store, or the index of a world that :func:`split` has made with all its assets. What other functions have
    finished and could not send they keep, and say where.

    Args:
        file: an asset, a plan, a part, or an index (``.fanworld``).
        address: of the object, or of the index: ``s3://``, ``gs://`` or ``az://``. It appears whole or not at all.
        overwrite: replace what is there; a world at once, with all its assets.
        progress: called with ``(done, total)`` bytes; what it raises ends the upload.

    Raises:
        ValueError: the address names no store that is written to.
        FileNotFoundError, FileExistsError, OSError: as their names say.
        Error: the world's assets are not named as those of a split.
        KeyboardInterrupt: Ctrl-C; nothing is there that was not there before.
    """
    _, _, notes = _native.upload(os.fsdecode(file), os.fsdecode(address), overwrite, progress)
    _warn(notes, 3)


def _subject(what: Any) -> Union[Asset, Mesh]:
    """An asset, or the mesh of a model."""
    if isinstance(what, Asset):
        return what
    if isinstance(what, PATHS) and _native.kind(os.fsdecode(what)) == "asset":
        return Asset(what)
    return Mesh.of(what)


def set_read_limits(*, memory: float = 8 << 30, allow_outside: bool = False) -> None:
    """What files that others made may do, from now on and in all threads.

    Args:
        memory: bytes that all that is read whole may take together: images, volumes, tables, meshes.
        allow_outside: let models, looks in assets and stroke files name files outside their folders.
    """
    _native.set_read_limits(amount(memory, "memory"), allow_outside)
