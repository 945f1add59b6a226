"""Bakes on a real scheduler of Dask with two worker processes."""

import os
import re
import shutil
import signal
import time

import numpy as np
import pytest

import fantex
from conftest import ROOT, grid_sphere, pattern

distributed = pytest.importorskip("distributed", reason="no distributed (Dask) for Python")
import fantex.distributed  # noqa: E402


@pytest.fixture(scope="module")
def cluster():
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=30
    ) as cluster:
        yield cluster


@pytest.fixture
def client(cluster):
    with distributed.Client(cluster) as client:
        client.wait_for_workers(2)
        yield client


def leftovers(folder):
    return [path.name for path in folder.iterdir() if ".parts-" in path.name]


class Deadly:
    """The pattern; the first process that asks for colours of many points notes who it is and waits to be killed. (The caller asks for one.)"""

    def __init__(self, note):
        self.note = os.fspath(note)

    def __call__(self, points, normals):
        try:
            if len(points) > 1:
                with open(self.note, "x", encoding="ascii") as file:
                    file.write(str(os.getpid()))
                time.sleep(60)
        except FileExistsError:
            pass
        x, y, z = points.T
        return np.stack([0.5 + 0.4 * np.sin(3 * x), 0.5 + 0.4 * np.sin(2 * y + 1), 0.5 + 0.3 * z], -1)


def kill_noted(note):
    """Kills the process in a note, when the note is there."""
    for _ in range(600):
        text = note.read_text(encoding="ascii") if note.exists() else ""
        if text:
            os.kill(int(text), signal.SIGKILL)
            return int(text)
        time.sleep(0.05)
    raise AssertionError("no worker has asked for colours")


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL")
def test_a_killed_worker_costs_its_part(tmp_path, client, sphere):
    from concurrent.futures import ThreadPoolExecutor

    fantex.bake(sphere, tmp_path / "whole.fan", texels=200_000, source=pattern)
    note, told = tmp_path / "worker", []
    workers = set(client.run(os.getpid).values())
    with ThreadPoolExecutor(1) as pool:
        killed = pool.submit(kill_noted, note)
        asset = fantex.distributed.bake(
            client,
            sphere,
            tmp_path / "farm.fan",
            texels=200_000,
            source=Deadly(note),
            shards=6,
            progress=lambda done, total: told.append((done, total)),
        )
        assert killed.result() in workers
    assert asset.verify()["ok"]
    assert (tmp_path / "farm.fan").read_bytes() == (tmp_path / "whole.fan").read_bytes()
    assert len(told) == 6 and told == sorted(told) and told[-1][0] == told[-1][1]
    assert not leftovers(tmp_path)


def test_files_and_default_shards(tmp_path, client, bottle):
    fantex.bake(bottle, tmp_path / "whole.fan", texels=100_000)
    fantex.distributed.bake(client, bottle, tmp_path / "farm.fan", texels=100_000)
    assert (tmp_path / "farm.fan").read_bytes() == (tmp_path / "whole.fan").read_bytes()
    with pytest.raises(FileExistsError, match="farm.fan exists"):
        fantex.distributed.bake(client, bottle, tmp_path / "farm.fan", texels=100_000)


@pytest.fixture
def cluster_of_store(store):
    """Workers that have the keys of the bucket."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=30
    ) as cluster:
        yield cluster


def test_parts_in_a_bucket(tmp_path, store, cluster_of_store, sphere):
    source = fantex.solid("marble")
    fantex.bake(sphere, tmp_path / "whole.fan", texels=50_000, source=source)
    whole = (tmp_path / "whole.fan").read_bytes()
    with distributed.Client(cluster_of_store) as client:
        client.wait_for_workers(2)
        bake = fantex.distributed.bake
        seen = []

        def progress(done, total):
            """Removes a part once, as soon as all are there."""
            seen.append(sorted(path.name for path in store.glob("farm/.a.fan.parts-*/*")))
            if len(seen) == 4:
                (part,) = store.glob("farm/.a.fan.parts-*/2.part")
                part.unlink()

        place = "s3://scans/farm/a.fan"
        asset = bake(client, sphere, place, texels=50_000, source=source, shards=4, progress=progress)
        assert asset.place == place and (store / "farm" / "a.fan").read_bytes() == whole
        assert len(seen) == 5 and seen[-1] == ["1.part", "2.part", "3.part", "4.part", "plan"]
        with pytest.raises(FileExistsError, match="farm/a.fan exists"):
            bake(client, sphere, place, texels=50_000, source=source)
        # The result may lie elsewhere than the parts.
        bake(client, sphere, tmp_path / "b.fan", texels=50_000, source=source, shards=2, folder="s3://scans/parts/")
        assert (tmp_path / "b.fan").read_bytes() == whole
        left = [path.name for path in store.rglob("*") if path.is_file()]
        assert left == ["a.fan"] and not leftovers(tmp_path)


@pytest.mark.parametrize("harm", ["damage", "remove"])
def test_bad_parts_are_baked_anew(tmp_path, client, sphere, monkeypatch, harm):
    source = fantex.solid("marble")
    fantex.bake(sphere, tmp_path / "whole.fan", texels=50_000, source=source)
    baked = []

    def progress(done, total):
        """Harms a part once, as soon as all are there."""
        baked.append(done)
        if len(baked) == 4:
            (part,) = tmp_path.glob(".farm.fan.parts-*/2.part")
            if harm == "remove":
                part.unlink()
            else:
                content = bytearray(part.read_bytes())
                content[len(content) // 2] ^= 1
                part.write_bytes(content)

    fantex.distributed.bake(
        client, sphere, tmp_path / "farm.fan", texels=50_000, source=source, shards=4, progress=progress
    )
    assert len(baked) == 5
    assert (tmp_path / "farm.fan").read_bytes() == (tmp_path / "whole.fan").read_bytes()


class Flaky:
    """Fails so often for many points; every attempt leaves a file."""

    def __init__(self, folder, failures, error=RuntimeError("the disk hiccups")):
        self.folder, self.failures, self.error = os.fspath(folder), failures, error

    def __call__(self, points, normals):
        count = len(os.listdir(self.folder))
        if count < self.failures and len(points) > 1:
            with open(os.path.join(self.folder, f"{os.getpid()}-{time.monotonic_ns()}"), "x"):
                raise self.error
        return np.full((len(points), 3), 0.5)


@pytest.mark.parametrize("error", [RuntimeError, ValueError])
def test_failures_are_tried_again(tmp_path, client, sphere, error):
    attempts = tmp_path / "attempts"
    attempts.mkdir()
    source = Flaky(attempts, 1, error("the disk hiccups"))
    asset = fantex.distributed.bake(
        client, sphere, tmp_path / "a.fan", texels=5_000, source=source, shards=1, retries=3
    )
    assert asset.verify()["ok"] and len(os.listdir(attempts)) >= 1


def test_a_failing_source_says_so_once(tmp_path, client, sphere):
    attempts = tmp_path / "attempts"
    attempts.mkdir()
    with pytest.raises(RuntimeError, match="^the disk hiccups$"):
        fantex.distributed.bake(
            client, sphere, tmp_path / "a.fan", texels=5_000, source=Flaky(attempts, 10**9), shards=2, retries=1
        )
    # What is wrong already when the caller asks for one point, and what is wrong later.
    for points in (1, 2):
        with pytest.raises(ValueError, match="the source's result has the shape"):
            shapeless = lambda p, n: np.zeros((7 if len(p) >= points else 1, 3))
            fantex.distributed.bake(client, sphere, tmp_path / "a.fan", texels=5_000, source=shapeless, shards=2)
    assert not (tmp_path / "a.fan").exists() and not leftovers(tmp_path)


def test_channels_and_parameters_of_functions(tmp_path, client, sphere):
    def source(points, normals, footprint):
        return {"base-color": np.abs(points), "roughness": (100 * footprint).clip(0, 1)}

    whole = fantex.bake(sphere, tmp_path / "whole.fan", texels=20_000, source=source)
    assert whole.channels == ["base-color", "orm"]
    fantex.distributed.bake(client, sphere, tmp_path / "farm.fan", texels=20_000, source=source, shards=2)
    assert (tmp_path / "farm.fan").read_bytes() == (tmp_path / "whole.fan").read_bytes()


def test_wrong_requests(tmp_path, client, sphere):
    bake, out = fantex.distributed.bake, tmp_path / "a.fan"
    with pytest.raises(TypeError, match="client is a str; expected a distributed.Client"):
        bake("tcp://here", sphere, out)
    with pytest.raises(ValueError, match="shards is 0"):
        bake(client, sphere, out, shards=0)
    with pytest.raises(ValueError, match="retries is -1"):
        bake(client, sphere, out, retries=-1)
    with pytest.raises(TypeError, match="a fantex.Mesh cannot be sent"):
        bake(client, fantex.Mesh(*sphere), out)
    with pytest.raises(FileNotFoundError):
        bake(client, tmp_path / "none.ply", out)
    with pytest.raises(TypeError, match="texel"):
        bake(client, sphere, out, texel=3)
    with pytest.raises(RuntimeError, match="enough"):

        def stop(done, total):
            raise RuntimeError("enough")

        bake(client, sphere, out, texels=5_000, source=fantex.solid("wood"), progress=stop)
    assert os.listdir(tmp_path) == []


def test_the_page_about_farms(tmp_path, monkeypatch):
    """The example of docs/farms.md runs as it stands."""
    for file in (ROOT / "assets" / "WaterBottle").iterdir():
        if file.is_file():
            shutil.copy(file, tmp_path / file.name.replace("WaterBottle.gltf", "world.gltf"))
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs" / "farms.md").read_text(encoding="utf-8")
    blocks = [block for block in re.findall(r"```python\n(.*?)```", text, re.S) if "fantex.distributed" in block]
    assert len(blocks) == 1
    # A script, as workers import the program that starts them.
    exec(compile(blocks[0], "docs/farms.md", "exec"), {"__name__": "example"})
    assert (tmp_path / "world.fan").stat().st_size > 100_000
