"""Bakes in parts, in one process."""

import json
import os
import pickle

import numpy as np
import pytest

import fantex
from conftest import grid_sphere, pattern


def parts_of(plan, folder, count, **given):
    """All parts of a plan, the last first."""
    paths = [folder / f"{number}.part" for number in range(1, count + 1)]
    for number in range(count, 0, -1):
        size = fantex.bake_part(plan, (number, count), paths[number - 1], **given)
        assert size == paths[number - 1].stat().st_size
    return paths


@pytest.mark.parametrize("format, count", [("bc7", 3), ("float", 2)])
def test_merged_parts_are_the_bake(tmp_path, sphere, format, count):
    settings = {"texels": 60_000, "format": format, "source": pattern}
    fantex.bake(sphere, tmp_path / "whole.fan", **settings)
    plan = fantex.plan(sphere, tmp_path / "a.plan", **settings)
    assert plan.channels == ("base-color",) and plan.texels > 10_000 and plan.tiles > 1
    with pytest.raises(ValueError, match="a.plan was planned for a mesh in memory; give it as mesh="):
        fantex.bake_part(plan, (1, 2), tmp_path / "x.part", source=pattern)
    with pytest.raises(ValueError, match="a.plan was planned for a source in memory; give it as source="):
        fantex.bake_part(plan, (1, 2), tmp_path / "x.part", mesh=sphere)
    parts = parts_of(plan, tmp_path, count, mesh=sphere, source=pattern)
    merged = fantex.merge(plan, parts, tmp_path / "merged.fan")
    assert merged.channels == ["base-color"]
    assert (tmp_path / "merged.fan").read_bytes() == (tmp_path / "whole.fan").read_bytes()
    with pytest.raises(FileExistsError):
        fantex.merge(plan, parts, tmp_path / "merged.fan")


def test_a_plan_knows_its_files(tmp_path, bottle, monkeypatch):
    fantex.bake(bottle, tmp_path / "whole.fan", texels=100_000)
    monkeypatch.chdir(bottle.parent)
    fantex.plan(bottle.name, tmp_path / "a.plan", texels=100_000)
    # Relative paths count from the folder in which the plan was made.
    monkeypatch.chdir(tmp_path)
    parts = parts_of("a.plan", tmp_path, 2)
    fantex.merge("a.plan", parts, "merged.fan")
    assert (tmp_path / "merged.fan").read_bytes() == (tmp_path / "whole.fan").read_bytes()


def test_what_is_wrong_with_parts_is_named(tmp_path, sphere):
    plan = fantex.plan(sphere, tmp_path / "a.plan", texels=20_000, source=fantex.solid("marble"))
    parts = parts_of(plan, tmp_path, 3, mesh=sphere)
    with pytest.raises(fantex.Error, match=r"missing \(shard 2/3\); bake it from") as missing:
        fantex.merge(plan, [parts[0], parts[2]], tmp_path / "b.fan")
    assert missing.value.path is None
    with pytest.raises(ValueError, match="have the same tiles"):
        fantex.merge(plan, [*parts, parts[0]], tmp_path / "b.fan")
    content = bytearray(parts[1].read_bytes())
    content[len(content) // 2] ^= 1
    parts[1].write_bytes(content)
    with pytest.raises(fantex.Error, match="2.part") as damaged:
        fantex.merge(plan, parts, tmp_path / "b.fan")
    assert damaged.value.path == parts[1]
    again = pickle.loads(pickle.dumps(damaged.value))
    assert str(again) == str(damaged.value) and again.path == parts[1]
    assert not (tmp_path / "b.fan").exists()


def test_wrong_requests(tmp_path, sphere):
    plan = fantex.plan(sphere, tmp_path / "a.plan", texels=20_000, source=fantex.solid("marble"))
    for shard in ["1/2", (1,)]:
        with pytest.raises(ValueError, match="shard is .*; expected two whole numbers"):
            fantex.bake_part(plan, shard, tmp_path / "x.part", mesh=sphere)
    for shard in [(0, 2), (3, 2)]:
        with pytest.raises(ValueError, match="there is no part .* parts count from 1"):
            fantex.bake_part(plan, shard, tmp_path / "x.part", mesh=sphere)
    with pytest.raises(ValueError, match="a.plan was made for; plan anew"):
        fantex.bake_part(plan, (1, 2), tmp_path / "x.part", mesh=grid_sphere(10, 20))
    with pytest.raises(ValueError, match="the source is not what .*a.plan was made for"):
        fantex.bake_part(plan, (1, 2), tmp_path / "x.part", mesh=sphere, source=fantex.solid("wood"))
    fantex.bake(sphere, tmp_path / "a.fan", texels=9_000, source=fantex.solid("wood"))
    with pytest.raises(ValueError, match="a.fan is an asset, and no plan"):
        fantex.Plan(tmp_path / "a.fan")
    with pytest.raises(FileNotFoundError):
        fantex.Plan(tmp_path / "none.plan")
    assert not (tmp_path / "x.part").exists()

    def stop(done, total):
        raise RuntimeError("enough")

    def slow(points, normals):
        return np.ones((len(points), 3)) * 0.5

    other = fantex.plan(sphere, tmp_path / "b.plan", texels=2_000_000, source=slow)
    with pytest.raises(RuntimeError, match="enough"):
        fantex.bake_part(other, (1, 2), tmp_path / "x.part", mesh=sphere, source=slow, progress=stop)
    assert not (tmp_path / "x.part").exists()


def test_sources_travel(tmp_path, sphere):
    """Plans and sources as other processes get them."""
    plan = fantex.plan(sphere, tmp_path / "a.plan", texels=20_000, source=fantex.mesh(sphere, cage=0.1))
    again = pickle.loads(pickle.dumps(plan))
    assert (again.path, again.texels, again.tiles) == (plan.path, plan.texels, plan.tiles)
    for source in [fantex.solid("marble"), fantex.vertex_colors(), fantex.image(tmp_path / "a.png", "box")]:
        assert repr(pickle.loads(pickle.dumps(source))) == repr(source)
    # Other processes may be in other folders.
    assert pickle.loads(pickle.dumps(fantex.look("a.toml")))._parts == {"path": os.path.abspath("a.toml")}
    source = pickle.loads(pickle.dumps(fantex.mesh(sphere, cage=0.1)))
    assert source._parts["cage"] == 0.1 and len(source._parts["mesh"].faces) > 1000


def test_numbers_of_numpy(tmp_path, sphere):
    """A plan notes what a bake takes."""
    settings = {"density": np.float32(20), "match": np.bool_(False), "source": fantex.mesh(sphere, cage=np.float32(0.1))}
    fantex.plan(sphere, tmp_path / "a.plan", **settings)
    assert fantex.bake(sphere, tmp_path / "a.fan", **settings).info["texels"] > 1000
    note = fantex._plan._noted_source(fantex.photos("scan", unseen=np.ones(3, np.float32), keep_exposure=np.bool_(True)))
    assert json.loads(json.dumps(note)) == {**note, "parts": {**note["parts"], "unseen": [1.0, 1.0, 1.0]}}
    with pytest.raises(TypeError, match="density is of type str; expected a number"):
        fantex.plan(sphere, tmp_path / "b.plan", density="20", source=fantex.solid("marble"))


@pytest.mark.parametrize("error", [ValueError, TypeError, FileNotFoundError, fantex.Error])
def test_workers_try_again_whatever_a_function_raises(tmp_path, sphere, error):
    """A task of a cluster raises what is worth another attempt, and returns what is not."""
    from fantex.distributed import _part

    def flaky(points, normals):
        raise error("the disk hiccups")

    plan = fantex.plan(sphere, tmp_path / "a.plan", texels=5_000, source=pattern)
    with pytest.raises(error, match="the disk hiccups"):
        _part(plan.path, (1, 1), str(tmp_path / "1.part"), sphere, flaky, 1 << 30)
    shapeless = lambda points, normals: np.zeros((7, 3))
    lasting = _part(plan.path, (1, 1), str(tmp_path / "1.part"), sphere, shapeless, 1 << 30)
    assert isinstance(lasting, ValueError) and "the source's result has the shape" in str(lasting)
    assert _part(plan.path, (1, 1), str(tmp_path / "1.part"), sphere, pattern, 1 << 30) is None
