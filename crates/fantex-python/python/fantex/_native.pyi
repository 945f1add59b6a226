"""The compiled part: strict about types and shapes. Use the package's own functions instead."""

from typing import Any, Callable, Dict, List, Optional, Tuple

import numpy as np
from numpy.typing import NDArray

Progress = Optional[Callable[[int, int], Any]]
Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]
Indices = NDArray[np.uint32]
Faces = NDArray[np.int64]
Bytes = NDArray[np.uint8]

NOTICES: str
SOLIDS: List[str]
LINEAR_FROM_SRGB8: List[float]
__version__: str

class Error(Exception):
    path: Optional[str]

class Mesh:
    @staticmethod
    def load(path: str) -> "Mesh": ...
    @staticmethod
    def of_arrays(
        positions: Doubles,
        faces: Faces,
        colors: Optional[Floats] = None,
        normals: Optional[Floats] = None,
        uv: Optional[Floats] = None,
        image: Optional[bytes] = None,
    ) -> "Mesh": ...
    @staticmethod
    def of_asset(asset: "Asset") -> "Mesh": ...
    def simplified(self, triangles: int) -> "Mesh": ...
    positions: Doubles
    faces: Indices
    source_faces: Indices
    notes: List[str]
    has_materials: bool
    has_colors: bool

class Asset:
    def __init__(self, place: str, memory: int) -> None: ...
    positions: Doubles
    faces: Indices
    channels: List[str]
    def figures(self) -> Tuple[int, int, int, int]: ...
    def nearest(self, points: Doubles) -> Tuple[Indices, Floats, Doubles]: ...
    def sample(
        self, channel: str, faces: Faces, barycentric: Floats, footprint: Optional[Doubles]
    ) -> Floats: ...
    def render(
        self,
        size: List[int],
        camera: Optional[Tuple[List[float], List[float], List[float], float]],
        samples: int,
        light: Optional[List[float]],
        environment: Optional[str],
        transparent: bool,
    ) -> Bytes: ...
    def atlas(
        self, resolution: Optional[int], padding: Optional[int], memory: int, progress: Progress
    ) -> Tuple[Indices, Indices, Floats, List[Tuple[str, Bytes]]]: ...
    def export(
        self,
        path: str,
        resolution: Optional[int],
        padding: Optional[int],
        source_uv: bool,
        ktx2: bool,
        overwrite: bool,
        memory: int,
        progress: Progress,
    ) -> List[str]: ...
    def export_fans(
        self,
        path: str,
        gutter: int,
        largest_side: int,
        textures: str,
        shaders: List[str],
        overwrite: bool,
        memory: int,
        progress: Progress,
    ) -> List[str]: ...
    def fans(self, gutter: int, largest_side: int, memory: int, progress: Progress) -> Dict[str, Any]: ...
    def verify(self, texels: bool, memory: int) -> Dict[str, Any]: ...
    def normals(self, faces: Faces, barycentric: Floats) -> Floats: ...

def bake(
    mesh: Mesh, path: str, source: Any, options: Dict[str, Any], progress: Progress
) -> Dict[str, Any]: ...

class Plan:
    def __init__(self, path: str) -> None: ...
    about: bytes
    channels: List[str]
    def figures(self) -> Tuple[int, int, int]: ...

def plan(
    mesh: Mesh, path: str, about: bytes, source: Any, options: Dict[str, Any], progress: Progress
) -> Dict[str, Any]: ...
def bake_part(
    plan: Plan,
    shard: Tuple[int, int],
    mesh: Mesh,
    path: str,
    source: Any,
    options: Dict[str, Any],
    progress: Progress,
) -> Dict[str, Any]: ...
def merge(
    plan: Plan, parts: List[str], path: Optional[str], overwrite: bool, progress: Progress
) -> int: ...
def parametrize(
    positions: Doubles, faces: Faces, side: int, padding: Optional[int], progress: Progress
) -> Tuple[Indices, Indices, Floats, int, int]: ...
def paint(asset: str, strokes: str, folder: str, history: bool, memory: int) -> Tuple[int, int, int]: ...
def is_asset(path: str) -> bool: ...
def encode_png(picture: Bytes) -> bytes: ...
