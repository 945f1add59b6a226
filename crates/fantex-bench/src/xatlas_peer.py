"""Unwraps a PLY triangle mesh with xatlas, default options, into an atlas of about so many texels, and prints as JSON what that
costs: seconds, charts, the loss in dB and the worst direction's share as `fantex info` defines them.

    python3 xatlas_peer.py MESH.ply [TEXELS]
"""

import json
import math
import struct
import sys
import time

import numpy
import xatlas

SIZES = {"char": "b", "uchar": "B", "int8": "b", "uint8": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I",
         "int32": "i", "uint32": "I", "float": "f", "float32": "f", "double": "d", "float64": "d"}


def read_ply(path):
    """Positions and triangles of a PLY file whose faces are triangles."""
    with open(path, "rb") as file:
        elements, encoding = [], None
        while (line := file.readline().split()) != [b"end_header"]:
            words = [word.decode() for word in line]
            if words[0] == "format":
                encoding = words[1]
            elif words[0] == "element":
                elements.append((words[1], int(words[2]), []))
            elif words[0] == "property":
                elements[-1][2].append(words[1:])
        order = ">" if encoding == "binary_big_endian" else "<"

        def values(kinds):
            if encoding == "ascii":
                return None
            text = order + "".join(SIZES[kind] for kind in kinds)
            return struct.unpack(text, file.read(struct.calcsize(text)))

        positions, triangles = [], []
        for name, count, properties in elements:
            for _ in range(count):
                words = file.readline().split() if encoding == "ascii" else None
                row = []
                for prop in properties:
                    if prop[0] == "list":
                        length = int(words.pop(0)) if words is not None else values([prop[1]])[0]
                        if words is not None:
                            row.append([int(words.pop(0)) for _ in range(length)])
                        else:
                            row.append(values([prop[2]] * length))
                    else:
                        row.append(float(words.pop(0)) if words is not None else values([prop[0]])[0])
                if name == "vertex":
                    positions.append(row[:3])
                elif name == "face":
                    triangles.append(row[0])
    return numpy.array(positions, dtype=numpy.float32), numpy.array(triangles, dtype=numpy.uint32)


def figures(positions, triangles, corners, texels):
    """Loss in dB and the share of the ideal density in the worst direction; `corners` are the triangles' corners in texels."""
    a, b, c = (positions[triangles[:, k]].astype(float) for k in range(3))
    area = 0.5 * numpy.linalg.norm(numpy.cross(b - a, c - a), axis=1)
    sound = area > 0
    a, b, c, area, corners = a[sound], b[sound], c[sound], area[sound], corners[sound]
    # The triangle in its plane, with the first edge along x.
    length = numpy.linalg.norm(b - a, axis=1)
    x = (b - a) / length[:, None]
    along = ((c - a) * x).sum(axis=1)
    up = numpy.linalg.norm((c - a) - x * along[:, None], axis=1)
    du = (corners[:, 1] - corners[:, 0]) / length[:, None]
    dv = (corners[:, 2] - corners[:, 0] - du * along[:, None]) / up[:, None]
    e, f, g = (du * du).sum(axis=1), (du * dv).sum(axis=1), (dv * dv).sum(axis=1)
    root = numpy.sqrt((e - g) ** 2 + 4 * f * f)
    large, small = 0.5 * (e + g + root), numpy.maximum(0.5 * (e + g - root), 0)
    ideal = texels / area.sum()
    with numpy.errstate(divide="ignore"):
        error = numpy.minimum(0.5 * ideal**2 * (1 / large**2 + 1 / small**2), LARGEST_ERROR)
    return 10 * math.log10((area * error).sum() / area.sum()), (area * small).sum() / texels


# Texels eight times as long as the ideal show nothing of detail that takes sixteen of those.
LARGEST_ERROR = 4096


def unwrapped(positions, triangles, pack):
    atlas = xatlas.Atlas()
    atlas.add_mesh(positions, triangles)
    atlas.generate(pack_options=pack)
    return atlas


def texels_of(atlas):
    return atlas.width * atlas.height * atlas.atlas_count


def main():
    positions, triangles = read_ply(sys.argv[1])
    started = time.monotonic()
    atlas = unwrapped(positions, triangles, xatlas.PackOptions())
    seconds = time.monotonic() - started
    if len(sys.argv) > 2:
        # Resolutions are hints; texels per unit are kept.
        pack = xatlas.PackOptions()
        pack.texels_per_unit = atlas.texels_per_unit * math.sqrt(int(sys.argv[2]) / texels_of(atlas))
        atlas = unwrapped(positions, triangles, pack)
    texels = texels_of(atlas)
    mapping, indices, uvs = atlas[0]
    corners = uvs[indices] * [atlas.width, atlas.height]
    loss, worst = figures(positions, mapping[indices], corners, texels)
    print(json.dumps({"seconds": seconds, "charts": atlas.chart_count, "atlases": atlas.atlas_count, "texels": texels,
                      "loss_db": loss, "worst_share": worst}))


main()
