"""Functions as sources of bakes: what they are told of points, and what they give."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any, Callable, Dict, List, NamedTuple, Tuple

import numpy as np

from ._given import plain
from ._mesh import _linear_rgba

Function = Callable[..., Any]

#: What a function is told besides points and normals, if it has parameters of these names.
_PARAMETERS = ("footprint", "face", "barycentric")


class _Given(NamedTuple):
    """What a function gives under a name."""

    channel: str
    #: How many numbers a point may have.
    columns: Tuple[int, ...]
    #: Colours are linear floats or sRGB bytes, shares and heights floats or 255ths, directions and others floats.
    kind: str
    #: Of a part of a channel which of its numbers it is.
    part: int = 0


_GIVEN = {
    "base-color": _Given("base-color", (1, 3, 4), "color"),
    "normal": _Given("normal", (3,), "direction"),
    "orm": _Given("orm", (3,), "share"),
    "occlusion": _Given("orm", (1,), "share", 0),
    "roughness": _Given("orm", (1,), "share", 1),
    "metallic": _Given("orm", (1,), "share", 2),
    "emission": _Given("emission", (1, 3), "color"),
    "displacement": _Given("displacement", (1,), "height"),
    "light": _Given("light", (1, 3), "color"),
    "anisotropy": _Given("anisotropy", (4,), "other"),
}

#: Channels, in the order in which an asset has them.
_CHANNELS = tuple(dict.fromkeys(given.channel for given in _GIVEN.values()))

#: Occlusion, roughness and metallic where a function gives others of them: what a material has that says nothing.
_PLAIN_ORM = (1.0, 0.9, 0.0)


class FunctionSource:
    """A function as the compiled part calls it: a row for each point, and in it four numbers for each channel."""

    def __init__(self, function: Function) -> None:
        self.function = function
        self.parameters = _parameters(function)
        #: How many numbers a point has, by name.
        self.columns: Dict[str, int] = {}
        self.channels: List[str] = []
        self.is_array = False
        # Of each block that has some, at how many points there is no number, and at how many one that 8 bits do not hold. Blocks come on
        # several threads, and lists grow on any.
        self.unknown: Dict[str, List[int]] = {}
        self.beyond: Dict[str, List[int]] = {}

    def first(self, points: np.ndarray, normals: np.ndarray, **more: np.ndarray) -> List[Tuple[str, bool]]:
        """Asks for one point: which channels there are, and whether their fourth number is opacity."""
        given = self._asked(points, normals, more)
        wrong = [name for name in given if name not in _GIVEN]
        if wrong or not given:
            raise ValueError(f"the source gave {_listed(wrong)}; expected some of {_listed(_GIVEN)}")
        parts = [name for name in given if name != "orm" and _GIVEN[name].channel == "orm"]
        if "orm" in given and parts:
            raise ValueError(f"the source gave orm and {_listed(parts)}, which is in it; give one of them")
        there = {_GIVEN[name].channel for name in given}
        self.channels = [channel for channel in _CHANNELS if channel in there]
        self.columns = {name: self._rows(name, values, 1).shape[1] for name, values in given.items()}
        self._forget()
        self._numbers(given, 1)
        # It is asked for again, as one of many.
        self._forget()
        return [(channel, channel == "base-color" and self.columns[channel] == 4) for channel in self.channels]

    def __call__(self, points: np.ndarray, normals: np.ndarray, **more: np.ndarray) -> np.ndarray:
        count = len(points)
        given = self._asked(points, normals, more)
        if given.keys() != self.columns.keys():
            raise ValueError(
                f"the source gave {_listed(given)} and at first {_listed(self.columns)}; give the same for every block of points"
            )
        return self._numbers(given, count)

    def _asked(self, points: np.ndarray, normals: np.ndarray, more: Dict[str, np.ndarray]) -> Dict[str, Any]:
        """What the function gives, by name."""
        given = self.function(points, normals, **more)
        is_array = not isinstance(given, Mapping)
        if not self.columns:
            self.is_array = is_array
        return {"base-color": given} if is_array else dict(given)

    def _forget(self) -> None:
        self.unknown, self.beyond = ({name: [] for name in self.columns} for _ in range(2))

    def _called(self, name: str) -> str:
        return "the source's result" if self.is_array else f"the source's {name}"

    def _numbers(self, given: Dict[str, Any], count: int) -> np.ndarray:
        numbers = np.zeros((count, len(self.channels), 4), np.float32)
        if "orm" in self.channels:
            numbers[:, self.channels.index("orm"), :3] = _PLAIN_ORM
        for name, values in given.items():
            rows = self._checked(name, values, count)
            first = _GIVEN[name].part
            numbers[:, self.channels.index(_GIVEN[name].channel), first : first + rows.shape[1]] = rows
        return numbers.reshape(count, -1)

    def _checked(self, name: str, values: Any, count: int) -> np.ndarray:
        """What was given under a name as the numbers that are stored, a row for each point or one for all."""
        kind = _GIVEN[name].kind
        rows = self._rows(name, values, count)
        if kind == "color":
            rows = _linear_rgba(rows, count, self._called(name))
        elif rows.dtype.kind == "f":
            rows = rows.astype(np.float64)
        elif kind in ("share", "height") and (rows.dtype.kind == "b" or rows.dtype == np.uint8):
            rows = rows / (1 if rows.dtype.kind == "b" else 255)
        else:
            wanted = "floats, or uint8 in 255ths" if kind in ("share", "height") else "floats"
            raise TypeError(f"{self._called(name)} holds {rows.dtype}; expected {wanted}")
        if kind == "direction":
            with np.errstate(all="ignore"):
                length = np.linalg.norm(rows, axis=1, keepdims=True)
                rows = np.where(np.isfinite(length) & (length > 0), rows / length, np.nan)
        self._count(self.unknown[name], np.isnan(rows), count)
        # What is brighter than any number is as bright as the format allows.
        rows = np.nan_to_num(rows, nan=0.0, posinf=65504.0, neginf=0.0)
        if kind == "color":
            # Rounding of white is no glare.
            self._count(self.beyond[name], rows[:, :3] > 1.001, count)
        if kind == "height":
            self._count(self.beyond[name], (rows < 0) | (rows > 1), count)
        return np.clip(rows, 0, 1) if kind == "share" else rows

    @staticmethod
    def _count(counts: List[int], where: np.ndarray, count: int) -> None:
        """Notes how many of so many points are concerned."""
        concerned = int(np.count_nonzero(where.any(1))) * count // max(len(where), 1)
        if concerned:
            counts.append(concerned)

    def _rows(self, name: str, values: Any, count: int) -> np.ndarray:
        """A row for each point, or one for all."""
        values, columns, known = plain(values), _GIVEN[name].columns, self.columns.get(name)
        rows = values.reshape(1, 1) if values.ndim == 0 else values
        if rows.ndim == 1:
            # A number for each point, or what one point has; the first point has told which.
            is_number = len(rows) in (1, count) and known in (1, None) and 1 in columns
            rows = rows[:, None] if is_number else rows[None, :]
        if rows.ndim != 2 or rows.shape[1] not in columns or len(rows) not in (1, count):
            wanted = [f"({count}, {n})" for n in columns if n > 1] or [f"({count},)"]
            raise ValueError(f"{self._called(name)} has the shape {values.shape}; expected {' or '.join(wanted)}")
        if known not in (rows.shape[1], None):
            raise ValueError(
                f"{self._called(name)} has {rows.shape[1]} numbers for each point and had {known} at first; "
                "give the same for every block of points"
            )
        return rows

    def notes(self, keeps_all: bool) -> List[str]:
        """What is to be known of what was given, a sentence each; ``keeps_all``: the format holds numbers beyond 1."""
        notes = []
        became = {"color": "became black", "direction": "have that of the surface"}
        for name, counts in self.unknown.items():
            if counts:
                kind, of = _GIVEN[name].kind, "" if self.is_array else f" as {name}"
                notes.append(
                    f"The source gave no {'direction' if kind == 'direction' else 'number'}{of} for {sum(counts)} points, "
                    f"which {became.get(kind, 'became 0')}."
                )
        for name, counts in self.beyond.items():
            if counts and not keeps_all:
                what = "brighter than 1" if _GIVEN[name].kind == "color" else "outside 0 to 1"
                notes.append(
                    f"T{self._called(name)[1:]} is {what} at {sum(counts)} points and was cut off there; "
                    'fantex.bake with format="float" keeps it.'
                )
        return notes


def _listed(names: Any) -> str:
    return ", ".join(map(str, names)) or "nothing"


def _parameters(function: Function) -> List[str]:
    """Which parameters a function has besides the first two."""
    try:
        parameters = list(inspect.signature(function).parameters.values())[2:]
    except (TypeError, ValueError):
        # Some that are not written in Python have no signature.
        return []
    named = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    return [parameter.name for parameter in parameters if parameter.kind in named and parameter.name in _PARAMETERS]
