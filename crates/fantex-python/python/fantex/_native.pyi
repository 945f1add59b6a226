"""The compiled part: strict about types and shapes. Use the package's own functions instead."""

from typing import Any, Callable, Dict, List, Optional, Protocol, Tuple, Union

import numpy as np
from numpy.typing import NDArray

class _StepProgress(Protocol):
    def __call__(self, done: int, total: int, /, *, step: str) -> Any: ...

Progress = Optional[Union[Callable[[int, int], Any], _StepProgress]]
Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]
Indices = NDArray[np.uint32]
Faces = NDArray[np.int64]
Bytes = NDArray[np.uint8]
Point = List[float]
# A picture, and files; with what is to be known of them, a sentence each.
Rendered = Tuple[Bytes, List[str]]
Exported = Tuple[List[Any], List[str]]
# Name, place, bytes, triangles, texels, corners of the box, preview: triangles, texels, detail.
ObjectParts = Tuple[str, str, int, int, int, Point, Point, Optional[Tuple[int, int, float]]]
# Name, place, bytes, triangles, texels, corners of the box, detail, parts.
CoarseParts = Tuple[str, str, int, int, int, Point, Point, float, List[str]]
Rgb = Tuple[float, float, float]
Rgba = Tuple[float, float, float, float]
# Name, alpha, threshold, base colour, metallic, roughness, emission, unlit, double-sided.
MaterialParts = Tuple[str, str, Optional[float], Rgba, float, float, Rgb, bool, bool]

NOTICES: str
SOLIDS: List[str]
LINEAR_FROM_SRGB8: List[float]
__version__: str

class Error(Exception):
    path: Any

class Mesh:
    @staticmethod
    def load(path: str, weld: Optional[float] = None) -> "Mesh": ...
    @staticmethod
    def of_glb(bytes: bytes, path: str, notes: List[str], weld: Optional[float] = None) -> "Mesh": ...
    @staticmethod
    def of_arrays(
        positions: Doubles,
        faces: Faces,
        colors: Optional[Floats] = None,
        normals: Optional[Floats] = None,
        uv: Optional[Floats] = None,
        image: Optional[bytes] = None,
        is_sound: bool = False,
        weld: Optional[float] = None,
    ) -> "Mesh": ...
    @staticmethod
    def of_asset(asset: "Asset") -> "Mesh": ...
    def simplified(self, triangles: int) -> "Mesh": ...
    def save(self, path: str, overwrite: bool) -> None: ...
    def look(self) -> str: ...
    def render(self, options: Dict[str, Any]) -> Rendered: ...
    def figures(self) -> Dict[str, Any]: ...
    positions: Doubles
    faces: Indices
    source_faces: Indices
    colors: Optional[Floats]
    normals: Optional[Floats]
    uv: Optional[Floats]
    notes: List[str]
    has_materials: bool
    has_colors: bool

class Asset:
    def __init__(self, place: str, memory: int) -> None: ...
    positions: Doubles
    faces: Indices
    channels: List[str]
    materials: List[MaterialParts]
    face_materials: Indices
    def figures(self) -> Dict[str, Any]: ...
    def nearest(self, points: Doubles) -> Tuple[Indices, Floats, Doubles]: ...
    def sample(
        self, channel: str, faces: Faces, barycentric: Floats, footprint: Optional[Doubles]
    ) -> Floats: ...
    def render(self, options: Dict[str, Any]) -> Rendered: ...
    def atlas(
        self, resolution: Optional[int], padding: Optional[int], memory: int, progress: Progress
    ) -> Tuple[Indices, Indices, Floats, List[Tuple[str, Bytes, float]], List[str]]: ...
    def export(self, path: str, options: Dict[str, Any], progress: Progress) -> Exported: ...
    def export_channels(
        self, channels: List[Tuple[str, str]], depth: int, options: Dict[str, Any], progress: Progress
    ) -> Exported: ...
    def export_fans(self, path: str, options: Dict[str, Any], progress: Progress) -> Exported: ...
    def fans(self, gutter: int, largest_side: int, memory: int, progress: Progress) -> Dict[str, Any]: ...
    def verify(self, texels: bool, memory: int) -> Dict[str, Any]: ...
    def normals(self, faces: Faces, barycentric: Floats) -> Floats: ...

class World:
    def __init__(self, place: str) -> None: ...
    objects: List[ObjectParts]
    coarse: List[CoarseParts]
    def render(self, options: Dict[str, Any], memory: int) -> Rendered: ...
    def export(self, path: str, options: Dict[str, Any], progress: Progress) -> Exported: ...
    def export_fans(self, path: str, options: Dict[str, Any], progress: Progress) -> Exported: ...

def bake(
    mesh: Mesh, path: str, source: Any, options: Dict[str, Any], progress: Progress
) -> Dict[str, Any]: ...

def bake_model(
    mesh: Mesh, path: str, source: Any, options: Dict[str, Any], progress: Progress
) -> Dict[str, Any]: ...

class Plan:
    def __init__(self, place: str) -> None: ...
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
) -> Tuple[int, Optional[str]]: ...
def cut_polygons(positions: Doubles, counts: Faces, points: Faces) -> Faces: ...
def parametrize(
    positions: Doubles,
    faces: Faces,
    side: int,
    padding: Optional[int],
    square: bool,
    weld: Optional[float],
    progress: Progress,
) -> Tuple[Indices, Indices, Floats, int, Tuple[int, int]]: ...
def paint(
    asset: str, strokes: Optional[Tuple[str, str]], log: Optional[Asset], options: Dict[str, Any]
) -> Tuple[int, int, int, int]: ...
def save_strokes(asset: Asset, path: str) -> Tuple[int, int]: ...
def make_preview(
    asset: str, triangles: int, texels: Optional[int], keep_borders: bool, memory: int, progress: Progress
) -> Tuple[int, int, int]: ...
def remove_preview(asset: str) -> bool: ...
def tell(progress: Progress, done: int, total: int, step: str) -> None: ...
def verify_index(place: str, texels: bool, memory: int, progress: Progress) -> Dict[str, Any]: ...
def split(
    asset: Asset,
    folder: str,
    triangles: int,
    previews: Optional[Tuple[Optional[int], ...]],
    overwrite: bool,
    memory: int,
    progress: Progress,
) -> Dict[str, Any]: ...
def change_world(
    index: str,
    put: List[str],
    remove: List[str],
    make_previews: bool,
    make_coarse: bool,
    memory: int,
    progress: Progress,
) -> Dict[str, Any]: ...
def look_figures(path: str) -> Dict[str, Any]: ...
def render_look(
    look: str, model: Optional[Mesh], options: Dict[str, Any], time: Optional[float], seed: int, memory: int
) -> Rendered: ...
def table(
    look: str, texture: Optional[str], size: List[int], options: Dict[str, Any], progress: Progress
) -> Floats: ...
def normal_map(
    coarse: Mesh, detailed: Mesh, options: Dict[str, Any]
) -> Tuple[Floats, float, float, List[str]]: ...
def compare(
    a: Union[Mesh, Asset], b: Union[Mesh, Asset], views: int, options: Dict[str, Any], progress: Progress
) -> Dict[str, Any]: ...
def compare_pictures(
    reference: Floats, test: Floats, counts: Optional[NDArray[np.bool_]]
) -> Tuple[float, float, float]: ...
def check_target(place: str, overwrite: bool) -> None: ...
def is_there(place: str) -> bool: ...
def remove_object(place: str) -> None: ...
def upload(file: str, place: str, overwrite: bool, progress: Progress) -> Tuple[int, int, List[str]]: ...
def write_whole(path: str, bytes: bytes, overwrite: bool) -> None: ...
def set_read_limits(memory: int, allow_outside: bool) -> None: ...
def kind(place: str) -> str: ...
def encode_png(picture: Bytes) -> bytes: ...
def decode_image(bytes: bytes, label: str, is_srgb: bool) -> Floats: ...
