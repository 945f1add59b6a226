"""Prints the seconds that xatlas takes to unwrap and pack a binary or ASCII PLY triangle mesh with default options."""

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


def main():
    positions, triangles = read_ply(sys.argv[1])
    started = time.monotonic()
    atlas = xatlas.Atlas()
    atlas.add_mesh(positions, triangles)
    atlas.generate()
    print(time.monotonic() - started)


main()
