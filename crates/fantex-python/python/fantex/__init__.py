"""Seamless textures on any mesh, without UV coordinates.

A mesh is covered by parts of its own triangle fans; each is laid flat into a tile of texels, and the tiles are blended where
they meet. The *texture function* that comes out is continuous everywhere, whatever the mesh looks like:

>>> import fantex
>>> asset = fantex.bake("scan.ply", "scan.fan", texels=16e6)    # the model's own textures or colours
>>> colors = asset.sample([[0.1, 0.2, 0.3]])                    # at the nearest point of the surface
>>> asset.render(size=(960, 540)).save("scan.png")
>>> asset.export("scan.glb", resolution=4096)                   # for programs that want UV coordinates
>>> made = fantex.bake_model("scan.ply", "scan.glb")            # the same in one step, without an asset
>>> world = fantex.split("land.fan", "land")                    # what is too large for one viewer

Conventions: positions are in the units of the model's file, y or z up as it says. Faces are triangles, counter-clockwise seen
from outside. Colours are linear RGBA as floats, or sRGB as ``uint8``. Texture coordinates have v upwards, so that row 0 of a
picture lies at v = 1. ``progress(done, total)`` is called on the thread that asked, at the end once more: what it raises then comes
after the result is there. If it has a parameter of the name ``step``, it is given what is done, too: ``"covering"``, ``"baking"``.
"""

from __future__ import annotations

from ._asset import Asset, Atlas, Fans, Material
from ._bake import (
    Source,
    bake,
    bake_model,
    image,
    look,
    mesh,
    own_materials,
    photos,
    solid,
    vertex_colors,
)
from ._files import compare, info, open, render, set_read_limits, upload
from ._look import NormalMap, normal_map, table
from ._mesh import Mesh, parametrize
from ._native import NOTICES, SOLIDS, Error, __version__
from ._picture import Camera, Picture, compare_pictures
from ._plan import Plan, bake_part, check_parts, merge, plan
from ._world import World, WorldCoarse, WorldObject, WorldPreview, make_world, split

__all__ = [
    "NOTICES",
    "SOLIDS",
    "Asset",
    "Atlas",
    "Camera",
    "Error",
    "Fans",
    "Material",
    "Mesh",
    "NormalMap",
    "Picture",
    "Plan",
    "Source",
    "World",
    "WorldCoarse",
    "WorldObject",
    "WorldPreview",
    "__version__",
    "bake",
    "bake_model",
    "bake_part",
    "check_parts",
    "compare",
    "compare_pictures",
    "image",
    "info",
    "look",
    "make_world",
    "merge",
    "mesh",
    "normal_map",
    "open",
    "own_materials",
    "parametrize",
    "photos",
    "plan",
    "render",
    "set_read_limits",
    "solid",
    "split",
    "table",
    "upload",
    "vertex_colors",
]
