"""The examples of the documentation run as they stand."""

import importlib.util
import re
import shutil

import fantex
from conftest import ROOT, grid_sphere, pattern


def write_ply(path, positions, faces, colors):
    with open(path, "w", encoding="ascii") as file:
        file.write(f"ply\nformat ascii 1.0\nelement vertex {len(positions)}\n")
        file.write("".join(f"property float {axis}\n" for axis in "xyz"))
        file.write("".join(f"property uchar {color}\n" for color in ("red", "green", "blue")))
        file.write(f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n")
        for p, c in zip(positions, (colors * 255).astype(int)):
            file.write(f"{p[0]} {p[1]} {p[2]} {c[0]} {c[1]} {c[2]}\n")
        for face in faces:
            file.write(f"3 {face[0]} {face[1]} {face[2]}\n")


def test_the_tour(tmp_path, monkeypatch, store):
    for file in (ROOT / "assets" / "WaterBottle").iterdir():
        if file.is_file():
            shutil.copy(file, tmp_path / file.name.replace("WaterBottle.gltf", "bottle.gltf"))
    for name, size in (("fine.ply", (60, 120)), ("coarse.ply", (12, 24))):
        positions, faces = grid_sphere(*size)
        write_ply(tmp_path / name, positions, faces, pattern(positions))
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    names = {}
    blocks = re.findall(r"```python\n(.*?)```", text, re.S)
    assert len(blocks) > 8
    for block in blocks:
        needed = {"to_trimesh": ("PIL", "trimesh"), "pxr": ("pxr",), "fantex.usd": ("pxr",)}
        if any(word in block and not all(map(importlib.util.find_spec, modules)) for word, modules in needed.items()):
            continue
        exec(compile(block, "docs/python.md", "exec"), names)
    assert (tmp_path / "bottle.glb").stat().st_size > 10_000
    assert (tmp_path / "atlas.png").exists()


def test_all_is_documented():
    for name in fantex.__all__:
        value = getattr(fantex, name)
        if callable(value):
            assert value.__doc__, name
            public = [m for m in vars(value) if not m.startswith("_")] if isinstance(value, type) else []
            for member in public:
                doc = getattr(getattr(value, member), "__doc__", None)
                assert doc, f"{name}.{member}"
