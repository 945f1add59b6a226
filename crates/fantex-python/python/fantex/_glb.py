"""Models of other packages as glTF in memory, which the one reader takes."""

from __future__ import annotations

import json
import struct
from typing import Any, Dict, List

import numpy as np

from ._given import failed

# glTF's numbers.
_FLOAT, _UINT = 5126, 5125
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


class Glb:
    """A document of glTF and its bytes, which grow."""

    def __init__(self) -> None:
        self.json: Dict[str, Any] = {"asset": {"version": "2.0", "generator": "fantex"}, "extensionsUsed": []}
        self.chunks: List[bytes] = []
        self.length = 0

    def add(self, kind: str, item: Dict[str, Any]) -> int:
        items = self.json.setdefault(kind, [])
        items.append(item)
        return len(items) - 1

    def view(self, data: bytes) -> int:
        view = self.add("bufferViews", {"buffer": 0, "byteOffset": self.length, "byteLength": len(data)})
        data += b"\0" * (-len(data) % 4)
        self.chunks.append(data)
        self.length += len(data)
        return view

    def accessor(self, values: np.ndarray, is_position: bool = False) -> int:
        is_index = values.dtype.kind in "iu"
        values = np.ascontiguousarray(values, np.uint32 if is_index else np.float32)
        accessor = {
            "bufferView": self.view(values.tobytes()),
            "componentType": _UINT if is_index else _FLOAT,
            "count": len(values),
            "type": _TYPES[1 if values.ndim == 1 else values.shape[1]],
        }
        if is_position:
            accessor["min"], accessor["max"] = values.min(0).tolist(), values.max(0).tolist()
        return self.add("accessors", accessor)

    def extension(self, name: str, values: Dict[str, Any]) -> Dict[str, Any]:
        if name not in self.json["extensionsUsed"]:
            self.json["extensionsUsed"].append(name)
        return {name: values}

    def image(self, data: bytes, name: str) -> int:
        """An image of a PNG or JPEG file."""
        mime = "image/png" if data.startswith(b"\x89PNG") else "image/jpeg"
        return self.add("images", {"bufferView": self.view(data), "mimeType": mime, "name": name})

    def finished(self) -> bytes:
        if not self.json["extensionsUsed"]:
            del self.json["extensionsUsed"]
        self.json["buffers"] = [{"byteLength": self.length}]
        text = json.dumps(self.json, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        total = 12 + 8 + len(text) + 8 + self.length
        if total >= 1 << 32:
            raise failed(f"the scene takes {total} bytes as a GLB, whose limit are 4 GiB; take its parts one by one")
        head = struct.pack("<4sII", b"glTF", 2, total) + struct.pack("<I4s", len(text), b"JSON")
        return b"".join([head, text, struct.pack("<I4s", self.length, b"BIN\0"), *self.chunks])
