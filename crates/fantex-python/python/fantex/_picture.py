"""Pictures: what they show, how they are shown, and how much two differ."""

from __future__ import annotations

import io
import os
import warnings
from dataclasses import dataclass
from typing import Any, Dict, List, Optional, Sequence, Tuple, Union

import numpy as np

from . import _native


class Picture(np.ndarray):
    """A picture, ``(h, w, c)`` uint8 with row 0 on top, that shows itself in a notebook."""

    def to_png(self) -> bytes:
        """The bytes of a PNG file."""
        array = np.asarray(self)
        return _native.encode_png(np.ascontiguousarray(array[:, :, None] if array.ndim == 2 else array))

    def save(self, path: Union[str, os.PathLike]) -> None:
        """Writes a PNG file."""
        data = self.to_png()
        with io.open(path, "wb") as file:
            file.write(data)

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


def _view(
    *,
    size: Optional[Sequence[int]] = None,
    camera: Optional[Camera] = None,
    samples: Optional[int] = None,
    filter: Optional[str] = None,
    light: Optional[Sequence[float]] = None,
    environment: Union[str, os.PathLike, None] = None,
    environment_strength: float = 1.0,
    environment_rotation: float = 0.0,
    transparent: bool = False,
) -> Dict[str, Any]:
    """A picture to be taken, as the compiled part takes it."""
    view = None
    if camera is not None:
        view = ([*map(float, camera.eye)], [*map(float, camera.target)], [*map(float, camera.up)], float(camera.fov))
    if size is not None:
        width, height = (int(side) for side in size)
        size = [width, height]
    return {
        "size": size,
        "camera": view,
        "samples": samples,
        "filter": filter,
        "light": None if light is None else [*map(float, light)],
        "environment": None if environment is None else os.fspath(environment),
        "environment_strength": environment_strength,
        "environment_rotation": environment_rotation,
        "transparent": transparent,
    }


def _taken(rendered: Tuple[np.ndarray, List[str]]) -> Picture:
    """A picture that the compiled part made; what is to be known of it becomes warnings of the caller's caller."""
    picture, notes = rendered
    _warn(notes, 4)
    return picture.view(Picture)


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
    if counts is not None:
        counts = np.ascontiguousarray(counts, np.bool_)
        if counts.ndim != 2:
            raise ValueError(f"counts has the shape {counts.shape}; expected (h, w)")
    found = _native.compare_pictures(_linear(reference, "reference"), _linear(test, "test"), counts)
    return dict(zip(("psnr_db", "ssim", "flip"), found))


def _linear(picture: Any, name: str) -> np.ndarray:
    """A picture as linear floats ``(h, w, c)``."""
    array = np.asarray(picture)
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
    return np.ascontiguousarray(array, np.float32)
