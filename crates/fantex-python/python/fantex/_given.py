"""Arguments as users have them: paths, whole numbers, names."""

from __future__ import annotations

import math
import operator
import os
from typing import Any, Iterable, List, Optional, Sequence, Union

import numpy as np

from . import _native

Path = Union[str, bytes, os.PathLike]

#: Types of paths and addresses.
PATHS = (str, bytes, os.PathLike)


class _ErrorPath:
    """The file, or None."""

    def __get__(self, error: Any, kind: Any = None) -> Any:
        # Errors that are about a file have an attribute of their own, which comes first.
        return self if error is None else None


_native.Error.path = _ErrorPath()


def failed(sentence: str) -> _native.Error:
    """An error that is about no file."""
    return _native.Error(sentence)


def is_address(place: str) -> bool:
    return "://" in place


def is_usd(place: Any) -> bool:
    """Whether a path names a stage of USD."""
    return isinstance(place, PATHS) and os.fsdecode(place).lower().endswith((".usd", ".usda", ".usdc", ".usdz"))


def is_stage(thing: Any) -> bool:
    """Whether it is an open stage of USD."""
    return hasattr(thing, "GetPseudoRoot") and hasattr(thing, "GetRootLayer")


def absolute(place: Path) -> str:
    """An absolute path, or an address as it is."""
    place = os.fsdecode(place)
    return place if is_address(place) else os.path.abspath(place)


def whole(value: Any, name: str, most: int = (1 << 32) - 1) -> int:
    """A whole number from 0 to ``most``; floats such as ``1e3`` may be one."""
    try:
        number = operator.index(value)
    except TypeError:
        if not isinstance(value, (float, np.floating)):
            raise TypeError(f"{name} is of type {type(value).__name__}; expected a whole number") from None
        if not math.isfinite(value) or value != math.floor(value):
            raise ValueError(f"{name} is {value}; expected a whole number") from None
        number = int(value)
    if number < 0:
        raise ValueError(f"{name} is {value}; it cannot be negative")
    if number > most:
        raise ValueError(f"{name} is {value}; expected at most {most}")
    return number


def number(value: Any, name: str) -> float:
    """A number of whatever type, as Python's own."""
    try:
        if not isinstance(value, (str, bytes, bytearray)):
            return float(value)
    except TypeError:
        pass
    except OverflowError:
        raise ValueError(f"{name} is larger than any number of double precision") from None
    raise TypeError(f"{name} is of type {type(value).__name__}; expected a number")


def text(value: Any, name: str) -> str:
    """A word."""
    if not isinstance(value, str):
        raise TypeError(f"{name} is of type {type(value).__name__}; expected a text")
    return value


def length(value: Any, name: str) -> Optional[float]:
    """A length above zero, where one is given."""
    if value is None:
        return None
    given = number(value, name)
    if not 0 < given < math.inf:
        raise ValueError(f"{name} is {value}; expected a length above zero")
    return given


def amount(value: Any, name: str) -> int:
    """A number of bytes, texels or triangles: whole, or rounded down."""
    is_float = isinstance(value, (float, np.floating)) and math.isfinite(value)
    return whole(math.floor(value) if is_float else value, name, (1 << 63) - 1)


def size(sides: Any, name: str) -> List[int]:
    """Columns and rows."""
    if isinstance(sides, (str, bytes)) or not isinstance(sides, Iterable):
        raise TypeError(f"{name} is {sides!r}; expected two whole numbers, columns and rows")
    sides = list(sides)
    if len(sides) != 2:
        raise ValueError(f"{name} has {len(sides)} numbers; expected two, columns and rows")
    return [whole(side, name) for side in sides]


def vector(numbers: Any, name: str) -> List[float]:
    """Three numbers."""
    if isinstance(numbers, (str, bytes)) or not isinstance(numbers, Iterable):
        raise TypeError(f"{name} is {numbers!r}; expected three numbers")
    numbers = list(numbers)
    if len(numbers) != 3:
        raise ValueError(f"{name} has {len(numbers)} numbers; expected three")
    try:
        return [number(each, name) for each in numbers]
    except TypeError:
        raise TypeError(f"{name} is {numbers}; expected three numbers") from None


def names(given: Union[str, Iterable[str]], name: str) -> Sequence[str]:
    """Several names, or one."""
    if not isinstance(given, Iterable):
        raise TypeError(f"{name} is of type {type(given).__name__}; expected a text or several")
    return [given] if isinstance(given, str) else [text(each, name) for each in given]


def plain(values: Any) -> np.ndarray:
    """An array of whatever type."""
    if not isinstance(values, np.ndarray) and hasattr(values, "__dlpack__"):
        return np.from_dlpack(values.detach() if hasattr(values, "detach") else values)
    return np.asarray(values)
