"""Pictures: what they show, how they are shown, and how much two differ."""

from __future__ import annotations

import io
import math
import os
import warnings
from dataclasses import dataclass
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np

from . import _native
from ._given import PATHS, Path, number, plain, size as _size, vector, whole


class Picture(np.ndarray):
    """A picture, ``(h, w, c)`` uint8 with row 0 on top, that shows itself in a notebook."""

    def to_png(self) -> bytes:
        """The bytes of a PNG file."""
        array = np.asarray(self)
        if array.dtype != np.uint8 or array.ndim not in (2, 3):
            raise TypeError(f"a picture is (h, w) or (h, w, c) uint8, not {array.shape} {array.dtype}")
        return _native.encode_png(np.ascontiguousarray(array[:, :, None] if array.ndim == 2 else array))

    def save(self, path: Path) -> None:
        """Writes a PNG file, over one that is there."""
        path = os.fsdecode(path)
        if os.path.splitext(path)[1].lower() not in ("", ".png"):
            raise ValueError(f"{path} names no PNG file; PIL.Image.fromarray(picture).save(...) writes others")
        _write(path, self.to_png())

    def _repr_png_(self) -> Optional[bytes]:
        is_picture = self.dtype == np.uint8 and self.ndim in (2, 3) and self.size > 0
        return self.to_png() if is_picture and (self.ndim == 2 or self.shape[2] <= 4) else None


@dataclass(frozen=True)
class Camera:
    """A pinhole camera in the world: place, what it looks at, what is up, vertical opening angle in degrees."""

    eye: Sequence[float]
    target: Sequence[float] = (0.0, 0.0, 0.0)
    up: Sequence[float] = (0.0, 1.0, 0.0)
    fov: float = 35.0

    def __post_init__(self) -> None:
        # Arrays, too, as tuples of numbers, which can be compared.
        for part in ("eye", "target", "up"):
            object.__setattr__(self, part, tuple(vector(getattr(self, part), f"the camera's {part}")))
        object.__setattr__(self, "fov", number(self.fov, "the camera's fov"))


def _view(
    *,
    size: Optional[Sequence[int]] = None,
    camera: Optional[Camera] = None,
    samples: Optional[int] = None,
    filter: Optional[str] = None,
    light: Optional[Sequence[float]] = None,
    environment: Optional[Path] = None,
    environment_strength: float = 1.0,
    environment_rotation: float = 0.0,
    transparent: bool = False,
) -> Dict[str, Any]:
    """A picture to be taken, as the compiled part takes it."""
    if environment is None and (environment_strength, environment_rotation) != (1.0, 0.0):
        raise ValueError("environment_strength and environment_rotation are those of an environment; give environment=")
    view = None
    if camera is not None:
        if not isinstance(camera, Camera):
            raise TypeError(f"camera is of type {type(camera).__name__}; expected a fantex.Camera")
        view = ([*camera.eye], [*camera.target], [*camera.up], camera.fov)
    if light is not None:
        light = vector(light, "light")
        if not (any(light) and all(map(math.isfinite, light))):
            raise ValueError(f"light is {light}; expected a direction, finite numbers of which one at least is not 0")
    return {
        "size": None if size is None else _size(size, "size"),
        "camera": view,
        "samples": None if samples is None else whole(samples, "samples"),
        "filter": filter,
        "light": light,
        "environment": None if environment is None else os.fsdecode(environment),
        "environment_strength": number(environment_strength, "environment_strength"),
        "environment_rotation": number(environment_rotation, "environment_rotation"),
        "transparent": bool(transparent),
    }


def _taken(rendered: Tuple[np.ndarray, List[str]]) -> Picture:
    """A picture that the compiled part made; what is to be known of it becomes warnings of the caller's caller."""
    picture, notes = rendered
    _warn(notes, 4)
    return picture.view(Picture)


def _write(path: str, data: bytes, overwrite: bool = True) -> None:
    """Makes bytes a file, whole or not at all; what is no file, such as a pipe, gets them as they come."""
    if overwrite and os.path.exists(path) and not os.path.isfile(path):
        with io.open(path, "wb") as file:
            file.write(data)
    else:
        _native.write_whole(path, data, overwrite)


def _warn(notes: List[str], stacklevel: int) -> None:
    for note in notes:
        warnings.warn(note, stacklevel=stacklevel)


def compare_pictures(reference: Any, test: Any, *, counts: Any = None) -> Dict[str, float]:
    """How much two pictures of one size differ on a screen; alpha is left out.

    Args:
        reference: ``(h, w)`` or ``(h, w, c)``: ``uint8`` in sRGB or linear floats, a :class:`Picture`, a PIL image.
        test: what is compared with it.
        counts: ``(h, w)`` bool: the pixels that count; all where there are none.

    Returns:
        ``psnr_db``, decibels, infinite for equal pictures; ``ssim``, at most 1; ``flip``, 0 for equal pictures to 1.
    """
    reference, test = _linear(reference, "reference"), _linear(test, "test")
    if counts is not None:
        counts = np.asarray(counts)
        if counts.dtype != np.bool_:
            raise TypeError(f"counts holds {counts.dtype}; expected bool")
        if counts.shape != reference.shape[:2]:
            raise ValueError(f"counts has the shape {counts.shape}; expected that of the pictures, {reference.shape[:2]}")
        counts = np.ascontiguousarray(counts)
        if not counts.any():
            raise ValueError("counts leaves no pixel to compare")
    sizes = [tuple(picture.shape[:2]) for picture in (reference, test)]
    if sizes[0] != sizes[1]:
        raise ValueError(f"reference has {sizes[0]} rows and columns, test has {sizes[1]}; pictures of one size are compared")
    found = _native.compare_pictures(reference, test, counts)
    return dict(zip(("psnr_db", "ssim", "flip"), found))


def _srgb8(values: np.ndarray) -> np.ndarray:
    """Linear grey, RGB or RGBA as sRGB bytes."""
    table = np.asarray(_native.LINEAR_FROM_SRGB8, np.float32)
    between = (table[1:] + table[:-1]) / 2
    values = np.nan_to_num(values)
    result = np.empty(values.shape, np.uint8)
    colors = values.shape[-1] - (values.shape[-1] in (2, 4))
    result[..., :colors] = np.searchsorted(between, values[..., :colors])
    result[..., colors:] = np.clip(values[..., colors:], 0, 1) * 255 + 0.5
    return result


def _linear(picture: Any, name: str) -> np.ndarray:
    """A picture as linear floats ``(h, w, c)``."""
    if isinstance(picture, PATHS):
        raise TypeError(f"{name} is a path; expected the picture in it, as PIL.Image.open gives it")
    array = plain(picture)
    if array.ndim == 2:
        array = array[:, :, None]
    if array.ndim != 3 or array.shape[2] not in (1, 2, 3, 4):
        raise ValueError(f"{name} has the shape {np.shape(picture)}; expected (h, w) or (h, w, 1 to 4)")
    if array.dtype == np.uint8:
        linear = np.asarray(_native.LINEAR_FROM_SRGB8, np.float32)[array]
        if array.shape[2] in (2, 4):
            linear[:, :, -1] = array[:, :, -1] / np.float32(255)
        return np.ascontiguousarray(linear)
    if array.dtype.kind != "f":
        raise TypeError(f"{name} holds {array.dtype}; expected uint8 in sRGB or linear floats")
    if np.isnan(array).any():
        raise ValueError(f"{name} holds NaN, which differs from nothing by any measure")
    return np.ascontiguousarray(array, np.float32)
