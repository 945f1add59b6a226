"""Work within work, and what other processes get."""

import copy
import multiprocessing
import os
import pickle
import subprocess
import sys
import time

import numpy as np
import pytest

import fantex
from conftest import pattern


def run(script, folder, **variables):
    """Runs a program, which may not hang, beside `conftest`; gives what it prints."""
    start = f"import sys\nsys.path.insert(0, {os.path.dirname(__file__)!r})\n"
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", start + script],
        cwd=folder,
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("threads", ["1", "2"])
def test_a_source_may_use_fantex(tmp_path, waves, threads):
    """Its calls come from the threads that bake, all of which may be waiting for one."""
    script = (
        "import fantex\n"
        "from conftest import grid_sphere\n"
        f"waves = fantex.open({waves.place!r})\n"
        "def source(points, normals):\n"
        "    face, barycentric, places = waves.nearest(points)\n"
        "    return waves.sample(face=face, barycentric=barycentric)\n"
        "copied = fantex.bake(grid_sphere(), 'a.fan', texels=150_000, source=source, format='float')\n"
        "points = copied.positions[::7]\n"
        "print(abs(copied.sample(points) - waves.sample(points)).max())\n"
    )
    assert float(run(script, tmp_path, RAYON_NUM_THREADS=threads)) < 2e-3


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork")
def test_forked_processes_work(tmp_path, waves):
    """They have none of the threads of the process that they were forked from."""
    script = (
        "import multiprocessing, os\n"
        "import fantex\n"
        "from conftest import grid_sphere, pattern\n"
        f"waves = fantex.open({waves.place!r})\n"
        "def work(number):\n"
        "    asset = fantex.bake(grid_sphere(), f'{number}.fan', texels=50_000, source=pattern)\n"
        "    same = (waves.sample(asset.positions[:500]) == expected).all()\n"
        "    return os.getpid(), bool(same), open(f'{number}.fan', 'rb').read()\n"
        "mine = fantex.bake(grid_sphere(), 'mine.fan', texels=50_000, source=pattern)\n"
        "expected = waves.sample(mine.positions[:500])\n"
        "with multiprocessing.get_context('fork').Pool(2) as pool:\n"
        "    done = pool.map_async(work, range(3), chunksize=1).get(120)\n"
        "whole = open('mine.fan', 'rb').read()\n"
        "print(all(process != os.getpid() and same and data == whole for process, same, data in done))\n"
    )
    assert run(script, tmp_path) == "True\n"


def test_copies_and_pickles(tmp_path, waves, globe):
    for again in (pickle.loads(pickle.dumps(waves)), copy.deepcopy(waves), copy.copy(waves)):
        assert again is not waves and again.baked == waves.baked
        np.testing.assert_array_equal(again.sample([[0, 0, 1]]), waves.sample([[0, 0, 1]]))
    world = fantex.split(globe, tmp_path / "land", triangles=6000, previews=False)
    again = pickle.loads(pickle.dumps(world))
    assert again.objects == world.objects and again.made == world.made
    mesh = fantex.Mesh.of(waves)
    assert copy.deepcopy(mesh) is copy.copy(mesh) is mesh
    with pytest.raises(TypeError, match="send the path or the arrays"):
        pickle.dumps(mesh)


def test_progress_from_none_to_all(tmp_path, sphere):
    def slow(points, normals):
        time.sleep(0.2)
        return pattern(points)

    told, pairs = [], []

    def progress(done, total, step):
        told.append((step, done, total))

    def progress_in_pairs(*state, **named):
        pairs.append((*state, *named))

    small = fantex.Mesh(*sphere).simplified(20)
    fantex.bake(small, tmp_path / "a.fan", texels=5000, tile=0, source=slow, progress=progress)
    # Those who do not ask for the step are not given it.
    wood = fantex.solid("wood")
    fantex.bake(small, tmp_path / "b.fan", texels=5000, tile=0, source=wood, progress=progress_in_pairs)
    # Before texels, thousandths of the covering may have been told.
    covering, baking = [[(done, of) for step, done, of in told if step == word] for word in ("covering", "baking")]
    assert [(done, of) for _, done, of in told] == covering + baking and all(of == 1000 for _, of in covering)
    total = baking[-1][1]
    assert pairs[-1] == baking[-1]
    assert baking[0] == (0, total) and baking[-1] == (total, total) and total > 3000
    assert covering == sorted(covering) and baking == sorted(baking)
