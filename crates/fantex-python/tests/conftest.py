import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import fantex

ROOT = Path(__file__).resolve().parents[3]


def grid_sphere(rows=24, columns=48):
    """A unit sphere of quads cut in two: positions and faces."""
    theta = np.linspace(0, np.pi, rows + 1)[:, None]
    phi = np.linspace(0, 2 * np.pi, columns, endpoint=False)[None]
    ring = np.stack(
        [np.sin(theta) * np.cos(phi), np.cos(theta) * np.ones_like(phi), -np.sin(theta) * np.sin(phi)], -1
    )
    ring[-1] = (0, -1, 0)
    positions = ring.reshape(-1, 3)
    faces = []
    for i in range(rows):
        for j in range(columns):
            a, b = i * columns + j, i * columns + (j + 1) % columns
            c, d = a + columns, b + columns
            faces += [(a, c, b), (b, c, d)]
    return positions, np.array(faces)


@pytest.fixture(scope="session")
def sphere():
    return grid_sphere()


@pytest.fixture(scope="session")
def data():
    """The folder of real models; tests without it are skipped."""
    for folder in (os.environ.get("FANTEX_DATA"), ROOT.parent / "shared" / "data"):
        if folder and Path(folder).is_dir():
            return Path(folder)
    pytest.skip("no real models (set FANTEX_DATA)")


@pytest.fixture(scope="session")
def bottle():
    return ROOT / "assets" / "WaterBottle" / "WaterBottle.gltf"


@pytest.fixture(scope="session")
def waves(sphere, tmp_path_factory):
    """A sphere with a smooth pattern, as an asset."""
    path = tmp_path_factory.mktemp("waves") / "waves.fan"
    return fantex.bake(sphere, path, texels=200_000, source=pattern, format="float")


@pytest.fixture(scope="session")
def globe(tmp_path_factory):
    """The same on a finer sphere: 14 160 triangles."""
    path = tmp_path_factory.mktemp("globe") / "globe.fan"
    return fantex.bake(grid_sphere(60, 120), path, texels=150_000, source=pattern)


@pytest.fixture
def store(tmp_path, monkeypatch):
    """A bucket, ``s3://scans``, in the object store that tests of the command line use; gives the folder that holds its objects."""
    folder = tmp_path / "bucket"
    folder.mkdir()
    program = ROOT / "crates" / "fantex-cli" / "tests" / "cli" / "object_store.py"
    # Those of Amazon's examples.
    keys = ("AKIAIOSFODNN7EXAMPLE", "wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY")
    server = subprocess.Popen(
        [sys.executable, str(program), str(folder), "scans", *keys, "public.fan"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        port = server.stdout.readline().strip()
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}")
        monkeypatch.setenv("AWS_REGION", "eu-west-1")
        monkeypatch.setenv("AWS_ACCESS_KEY_ID", keys[0])
        monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", keys[1])
        for name in ("AWS_SESSION_TOKEN", "AWS_ENDPOINT_URL_S3"):
            monkeypatch.delenv(name, raising=False)
        yield folder
    finally:
        server.kill()
        server.communicate()


def pattern(points, normals=None):
    """Smooth linear colours of places."""
    x, y, z = np.asarray(points).T
    return np.stack([0.5 + 0.4 * np.sin(3 * x), 0.5 + 0.4 * np.sin(2 * y + 1), 0.5 + 0.3 * z], -1)
