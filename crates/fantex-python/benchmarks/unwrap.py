"""Unwraps models with fantex, xatlas and uvunwrap into pictures of any shape, and with fantex into squares, too, and prints the table of
docs/benchmarks.md.

    pip install . xatlas uvunwrap
    FANTEX_DATA=... python benchmarks/unwrap.py [--limit SECONDS] [--models WORD]

Each model and tool runs in a process of its own, which a time limit ends. Columns: seconds of processor time of all threads; charts, connected
by shared corners; share of the square or rectangle that triangles cover; stretch, the area-weighted L2 stretch of Sander et al. (2001),
1 is perfect, over triangles with area in both; seams, the length of edges between two triangles that do not share both corners, over the
square root of the area; lost, triangles with area on the model and none in the picture.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np

TOOLS = ("fantex", "square", "xatlas", "uvunwrap")


def grid(rows, columns, place):
    """A grid of (rows x columns) cells whose corners `place(u, v)` puts into space."""
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    positions = place(u.ravel(), v.ravel())
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a = (i * (columns + 1) + j).ravel()
    b, c, d = a + 1, a + columns + 1, a + columns + 2
    return positions, np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)])


def sphere(rows, columns):
    """A unit sphere, cut along a meridian."""
    return grid(
        rows,
        columns,
        lambda u, v: np.stack(
            [np.sin(np.pi * v) * np.cos(2 * np.pi * u), np.cos(np.pi * v), np.sin(np.pi * v) * np.sin(2 * np.pi * u)], 1
        ),
    )


def flat(u, v):
    return np.stack([u, v, np.zeros_like(u)], 1)


def generated():
    """Models that scans, CAD and generators give, by name."""
    random = np.random.default_rng(1)
    plane, faces = grid(24, 24, flat)
    ball, ball_faces = sphere(24, 48)
    soup = random.normal(size=(600, 1, 3)) + random.normal(size=(600, 3, 3)) * 0.1
    shells = [(ball * 0.05 + offset, ball_faces + i * len(ball)) for i, offset in enumerate(random.random((40, 3)) * 3)]
    needles, needle_faces = grid(2, 400, lambda u, v: np.stack([u, v * 1e-4, 0 * u], 1))
    bumps = grid(100, 100, lambda u, v: np.stack([u, v, 0.05 * np.sin(40 * u) * np.sin(40 * v)], 1))
    torus = grid(
        48,
        96,
        lambda u, v: np.stack(
            [
                (2 + np.cos(2 * np.pi * v)) * np.cos(2 * np.pi * u),
                (2 + np.cos(2 * np.pi * v)) * np.sin(2 * np.pi * u),
                np.sin(2 * np.pi * v),
            ],
            1,
        ),
    )
    holes = np.linalg.norm((plane[faces].mean(1)[:, :2] * 6) % 1 - 0.5, axis=1) > 0.3
    book = np.array([[0, 0, 0], [0, 0, 1], *[[np.cos(a), np.sin(a), h] for a in np.arange(12) / 2 for h in (0, 1)]])
    leaves = [face for k in range(12) for face in ((0, 2 + 2 * k, 1), (1, 2 + 2 * k, 3 + 2 * k))]
    return {
        "single triangle": (np.eye(3), np.array([[0, 1, 2]])),
        "flat plane": (plane, faces),
        "plane with holes": (plane, faces[holes]),
        "bumps": bumps,
        "torus": torus,
        "soup": (soup.reshape(-1, 3), np.arange(1800).reshape(-1, 3)),
        "40 shells": (np.concatenate([p for p, _ in shells]), np.concatenate([f for _, f in shells])),
        "needles": (needles, needle_faces),
        "T-junctions": (
            np.concatenate([grid(8, 1, flat)[0], grid(5, 1, flat)[0] + (1, 0, 0)]),
            np.concatenate([grid(8, 1, flat)[1], grid(5, 1, flat)[1] + 18]),
        ),
        "non-manifold book": (book, np.array(leaves)),
        "duplicate faces": (ball, np.concatenate([ball_faces, ball_faces[:300], ball_faces[:100, ::-1]])),
        "degenerate faces": (plane, np.concatenate([faces, np.repeat(faces[:50, :1], 3, 1), faces[:50][:, [0, 1, 1]]])),
        "mixed winding": (ball, np.where(random.random((len(ball_faces), 1)) < 0.5, ball_faces, ball_faces[:, ::-1])),
        "noise": (plane + random.normal(size=plane.shape) * 0.03, faces),
        "far away": (plane * 1e-3 + 1e3, faces),
    }


def models():
    """Names of all models: files of FANTEX_DATA and generated ones."""
    data = os.environ.get("FANTEX_DATA")
    found = []
    for folder in ("meshes", "landscapes") if data else ():
        for path in sorted(Path(data, folder).rglob("*")):
            if path.suffix.lower() in (".ply", ".obj", ".glb", ".gltf", ".stl"):
                found.append(str(path))
    return list(generated()) + found


def load(name):
    """Positions (n, 3) float64 and faces (m, 3); files are cleaned, generated models are as they are."""
    known = generated()
    if name in known:
        positions, faces = known[name]
        return np.asarray(positions, np.float64), np.asarray(faces, np.int64)
    import fantex

    mesh = fantex.Mesh.load(name)
    return mesh.positions, mesh.faces.astype(np.int64)


def unwrap(tool, positions, faces):
    """vmapping, faces and coordinates in texels, and the size of the picture."""
    if tool in ("fantex", "square"):
        import fantex

        result = fantex.parametrize(positions, faces, resolution=1024, padding=2, square=tool == "square")
        vertices, corners, uv = result
        return vertices, corners, uv * result.size, result.size
    if tool == "xatlas":
        import xatlas

        atlas = xatlas.Atlas()
        atlas.add_mesh(positions.astype(np.float32), faces.astype(np.uint32))
        atlas.generate()
        vertices, corners, uv = atlas[0]
        return vertices, corners, uv * (atlas.width, atlas.height), (atlas.width, atlas.height)
    import uvunwrap

    mesh = uvunwrap.Mesh(positions.astype(np.float32).ravel().tolist(), faces.astype(np.uint32).ravel().tolist())
    atlas = uvunwrap.generate([mesh])
    out = atlas.meshes[0]
    uv = np.asarray(out.uv, np.float64).reshape(-1, 2)
    if len(uv) and uv.max() <= 1.001:
        uv = uv * (atlas.width, atlas.height)
    # A share below one page per model is a share of all pages.
    size = (atlas.width, atlas.height * max(atlas.page_count, 1))
    return np.asarray(out.xref), np.asarray(out.indices).reshape(-1, 3), uv, size


def measure(tool, name):
    """The figures of one unwrapping."""
    positions, faces = load(name)
    before = resource.getrusage(resource.RUSAGE_SELF)
    vertices, corners, uv, size = unwrap(tool, positions, faces)
    after = resource.getrusage(resource.RUSAGE_SELF)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    corners = np.asarray(corners, np.int64)
    world = positions[np.asarray(vertices, np.int64)[corners]]
    e1, e2 = world[:, 1] - world[:, 0], world[:, 2] - world[:, 0]
    area = np.linalg.norm(np.cross(e1, e2), axis=1) / 2
    flat_uv = np.asarray(uv, np.float64)[corners]
    f1, f2 = flat_uv[:, 1] - flat_uv[:, 0], flat_uv[:, 2] - flat_uv[:, 0]
    signed = (f1[:, 0] * f2[:, 1] - f1[:, 1] * f2[:, 0]) / 2
    texels, total = np.abs(signed), area.sum()
    has_area = area > 1e-9 * max(total, 1e-300)
    # Coordinates that are no numbers are lost, too.
    lost = has_area & ~(texels > 1e-12 * np.nansum(texels))
    good = has_area & ~lost
    # Derivatives of space by texels: Ss and St of Sander et al.
    double = 2 * signed[good, None]
    ss = (e1[good] * f2[good, 1:] - e2[good] * f1[good, 1:]) / double
    st = (e2[good] * f1[good, :1] - e1[good] * f2[good, :1]) / double
    if not good.any():
        return {"faces": len(faces), "seconds": seconds, "charts": 0, "used": 0.0, "stretch": 0.0, "seams": 0.0, "lost": int(lost.sum())}
    squares = ((ss**2).sum(1) + (st**2).sum(1)) / 2
    stretch = np.sqrt((squares * area[good]).sum() / area[good].sum() * texels[good].sum() / area[good].sum())
    return {
        "faces": len(faces),
        "seconds": seconds,
        "charts": components(corners),
        "used": float(texels.sum() / (size[0] * size[1])),
        "stretch": float(stretch),
        "seams": float(seams(positions, np.asarray(vertices, np.int64), corners) / np.sqrt(total)),
        "lost": int(lost.sum() + len(faces) - len(corners)),
    }


def components(corners):
    """Parts of triangles that are connected by shared corners."""
    label = np.arange(corners.max() + 1)
    while True:
        least = label[corners].min(1)
        new = label.copy()
        np.minimum.at(new, corners.ravel(), np.repeat(least, 3))
        new = new[new]
        if (new == label).all():
            return len(np.unique(label[corners[:, 0]]))
        label = new


def seams(positions, vertices, corners):
    """Length of edges of two triangles that are apart in the picture."""
    _, welded = np.unique(positions, axis=0, return_inverse=True)
    seen = {}
    for triangle in corners:
        for a, b in ((0, 1), (1, 2), (2, 0)):
            pair = sorted((int(welded.ravel()[vertices[v]]), int(v)) for v in (triangle[a], triangle[b]))
            seen.setdefault((pair[0][0], pair[1][0]), []).append((pair[0][1], pair[1][1]))
    length = 0.0
    for sides in seen.values():
        if len(sides) == 2 and sides[0] != sides[1]:
            a, b = (positions[vertices[v]] for v in sides[0])
            length += float(np.linalg.norm(a - b))
    return length


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--limit", type=float, default=60, help="seconds per model and tool")
    parser.add_argument("--models", default="", help="only models whose name holds this")
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        print(json.dumps(measure(*arguments.one)))
        return
    print("| model | triangles | tool | seconds | charts | used | stretch | seams | lost |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name in (name for name in models() if arguments.models in name):
        for tool in TOOLS:
            label = Path(name).name if os.sep in name else name
            try:
                done = subprocess.run(
                    [sys.executable, __file__, "--one", tool, name],
                    capture_output=True,
                    text=True,
                    timeout=arguments.limit,
                )
                lines = (done.stderr.strip() or f"ended by signal {-done.returncode}").splitlines()
                if done.returncode:
                    print(f"| {label} | | {tool} | failed: {lines[-1][:90]} | | | | | |", flush=True)
                    continue
            except subprocess.TimeoutExpired:
                print(f"| {label} | | {tool} | more than {arguments.limit:g} | | | | | |", flush=True)
                continue
            f = json.loads(done.stdout.splitlines()[-1])
            print(
                f"| {label} | {f['faces']} | {tool} | {f['seconds']:.2f} | {f['charts']} | {f['used']:.3f} | "
                f"{f['stretch']:.3f} | {f['seams']:.1f} | {f['lost']} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
