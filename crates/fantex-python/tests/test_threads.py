"""Several threads of Python at once, with and without a global lock."""

import sys
import sysconfig
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import fantex
from conftest import pattern


def test_bakes_at_the_same_time(tmp_path, sphere):
    """Each with a function that the other one's threads call into, too: the files are those of bakes one after the other."""

    def source(number):
        return lambda points, normals: np.abs(np.sin(pattern(points) * number))

    def bake(name, number):
        fantex.bake(sphere, tmp_path / name, texels=150_000, source=source(number))
        return (tmp_path / name).read_bytes()

    alone = [bake(f"alone-{number}.fan", number) for number in range(4)]
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(lambda number: bake(f"together-{number}.fan", number), range(4)))
    assert together == alone and len(set(alone)) == 4


def test_one_asset_for_all_threads(waves):
    """Look-ups, pictures and atlases of one open asset; its small cache throws tiles out all the time."""
    asset = fantex.open(waves.place, memory=1 << 18)
    points = np.random.default_rng(4).normal(size=(3000, 3))

    def read(_):
        return (
            asset.sample(points),
            asset.render(size=(64, 48), samples=1),
            asset.atlas(resolution=128).images["base-color"],
        )

    expected = read(0)
    with ThreadPoolExecutor(4) as threads:
        for found in threads.map(read, range(8)):
            for one, other in zip(found, expected):
                np.testing.assert_array_equal(one, other)


def test_an_asset_is_read_while_it_is_changed(tmp_path, sphere):
    """Readers of other threads wait until the file is open again."""
    white = lambda points, normals: np.ones_like(points)
    asset = fantex.bake(sphere, tmp_path / "a.fan", texels=60_000, source=white)
    painted = threading.Event()

    def read():
        seen = []
        while not painted.is_set():
            seen.append(float(asset.sample([0, 0, 1])[1]))
        return seen + [float(asset.sample([0, 0, 1])[1])]

    with ThreadPoolExecutor(2) as threads:
        reading = [threads.submit(read) for _ in range(2)]
        try:
            for color in np.linspace(0.9, 0.1, 5):
                asset.paint(
                    [
                        {
                            "brush": {"size": {"texels": 40}, "hardness": 1},
                            "channels": [{"kind": "base_color", "color": {"srgb": [1, color, 1]}}],
                            "samples": [{"at": {"position": [0, 0, 1]}}],
                        }
                    ]
                )
        finally:
            painted.set()
        for future in reading:
            seen = future.result()
            # Each stroke is seen whole or not at all, and none is taken back.
            assert seen[-1] < 0.05 and all(after <= before + 1e-3 for before, after in zip(seen, seen[1:]))


def test_mistakes_stay_in_their_thread(tmp_path, sphere):
    def bake(number):
        def source(points, normals):
            if number % 2:
                raise RuntimeError(f"number {number}")
            return pattern(points)

        try:
            return fantex.bake(sphere, tmp_path / f"{number}.fan", texels=50_000, source=source).channels
        except RuntimeError as error:
            return str(error)

    with ThreadPoolExecutor(4) as threads:
        results = list(threads.map(bake, range(6)))
    assert results == [["base-color"], "number 1", ["base-color"], "number 3", ["base-color"], "number 5"]


@pytest.mark.skipif(not sysconfig.get_config_var("Py_GIL_DISABLED"), reason="no free-threaded Python")
def test_the_global_lock_stays_off():
    """A module that did not declare itself safe would have turned it on."""
    assert not sys._is_gil_enabled()


def test_the_lock_is_released_for_normals(waves):
    random = np.random.default_rng(6)
    face = random.integers(0, len(waves.faces), 1_000_000)
    barycentric = random.dirichlet((1, 1, 1), len(face)).astype(np.float32)
    ticks, done = [0], threading.Event()

    def tick():
        while not done.is_set():
            ticks[0] += 1
            time.sleep(0.001)

    native = waves._native
    with ThreadPoolExecutor(1) as threads:
        ticking = threads.submit(tick)
        try:
            time.sleep(0.05)
            before = ticks[0]
            native.normals(face, barycentric)
            assert ticks[0] - before > 5
        finally:
            done.set()
            ticking.result()
