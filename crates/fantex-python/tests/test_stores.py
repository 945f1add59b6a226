"""Assets, plans, parts and worlds in an object store, which checks signatures by itself."""

import os
import pickle
import urllib.request

import numpy as np
import pytest

import fantex
from conftest import pattern


def test_bakes_plans_parts_and_merges(tmp_path, store, sphere):
    settings = {"texels": 60_000, "source": fantex.solid("marble")}
    fantex.bake(sphere, tmp_path / "whole.fan", **settings)
    whole = (tmp_path / "whole.fan").read_bytes()
    place = "s3://scans/a/b c.fan"
    asset = fantex.bake(sphere, place, **settings)
    assert (store / "a" / "b c.fan").read_bytes() == whole
    assert asset.place == place and asset.baked["bytes"] == len(whole)
    assert asset.sample([[0, 0, 1]]).shape == (1, 4) and asset.verify()["ok"]
    with pytest.raises(FileExistsError, match="s3://scans/a/b c.fan exists already; give overwrite=True"):
        fantex.bake(sphere, place, **settings)
    fantex.bake(sphere, place, overwrite=True, **settings)

    plan = fantex.plan(sphere, "s3://scans/farm/a.plan", **settings)
    assert plan.path == "s3://scans/farm/a.plan"
    assert pickle.loads(pickle.dumps(plan)).texels == plan.texels
    parts = [f"s3://scans/farm/{number}.part" for number in (1, 2)]
    for number in (2, 1):
        size = fantex.bake_part(plan.path, (number, 2), parts[number - 1], mesh=sphere)
        assert size == (store / "farm" / f"{number}.part").stat().st_size
    fantex.check_parts(plan, parts)
    assert not (store / "farm" / "a.fan").exists()
    merged = fantex.merge(plan, parts, "s3://scans/farm/a.fan")
    assert merged.place == "s3://scans/farm/a.fan"
    assert (store / "farm" / "a.fan").read_bytes() == whole
    with pytest.raises(FileExistsError):
        fantex.merge(plan, parts, "s3://scans/farm/a.fan")
    # From there to a file, too.
    fantex.merge("s3://scans/farm/a.plan", parts, tmp_path / "merged.fan")
    assert (tmp_path / "merged.fan").read_bytes() == whole

    with pytest.raises(fantex.Error, match=r"missing \(shard 2/2\)"):
        fantex.check_parts(plan, parts[:1])
    part = store / "farm" / "2.part"
    content = bytearray(part.read_bytes())
    content[len(content) // 2] ^= 1
    part.write_bytes(content)
    with pytest.raises(fantex.Error, match="s3://scans/farm/2.part") as damaged:
        fantex.merge(plan, parts, "s3://scans/farm/b.fan")
    assert damaged.value.path == parts[1]
    assert not (store / "farm" / "b.fan").exists()


def test_each_step_of_a_merge_is_told(store, sphere):
    """Parts are read once to see what the store could copy, and again where that is nothing: as many bytes both times."""
    plan = fantex.plan(sphere, "s3://scans/a.plan", texels=60_000, source=fantex.solid("marble"))
    parts = [f"s3://scans/{number}.part" for number in (1, 2)]
    for number, part in enumerate(parts, 1):
        fantex.bake_part(plan, (number, 2), part, mesh=sphere)
    urllib.request.urlopen(os.environ["AWS_ENDPOINT_URL"] + "/faults?latency=0.1", b"").close()
    told = []
    merged = fantex.merge(plan, parts, "s3://scans/a.fan", progress=lambda *state: told.append(state))
    read = told[0][1]
    both = [done for done, total in told if total == read]
    assert any(after < before for before, after in zip(both, both[1:])), told
    assert told[-1] == (merged.info["bytes"], merged.info["bytes"])


def test_what_cannot_be_written_is_refused_before_any_work(store, sphere, monkeypatch):
    def never(points, normals):
        raise AssertionError("asked")

    with pytest.raises(ValueError, match="cannot write https://example.org/a.fan"):
        fantex.bake(sphere, "https://example.org/a.fan", source=never)
    with pytest.raises(ValueError, match="names a folder"):
        fantex.bake(sphere, "s3://scans/a/", source=never)
    with pytest.raises(OSError, match="404"):
        fantex.bake(sphere, "s3://other/a.fan", source=never)
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "wrong")
    with pytest.raises(OSError, match="403.*check AWS_ACCESS_KEY_ID"):
        fantex.bake(sphere, "s3://scans/a.fan", source=never)
    assert list(store.iterdir()) == []


def test_a_bake_that_is_ended_leaves_no_object(store, sphere):
    def broken(points, normals):
        raise RuntimeError("no idea")

    with pytest.raises(RuntimeError, match="no idea"):
        fantex.bake(sphere, "s3://scans/a.fan", texels=20_000, source=broken)
    assert list(store.iterdir()) == []


def test_worlds_in_a_bucket(tmp_path, store, globe):
    here = fantex.split(globe, tmp_path / "land", triangles=3000)
    there = fantex.split(globe, "s3://scans/land", triangles=3000)
    assert there.place == "s3://scans/land/globe.fanworld" and len(there) == len(here)
    names = sorted(path.name for path in (tmp_path / "land").iterdir())
    assert sorted(path.name for path in (store / "land").iterdir()) == names
    for name in names:
        assert (store / "land" / name).read_bytes() == (tmp_path / "land" / name).read_bytes()
    assert there.objects[0].place == "s3://scans/land/sector-0001.fan"
    assert there.objects[0].open().info["triangles"] == here.objects[0].triangles
    assert there.verify()["ok"]
    camera = fantex.Camera(eye=(0, 1, 4))
    picture = there.render((120, 90), camera, samples=2)
    np.testing.assert_array_equal(picture, here.render((120, 90), camera, samples=2))
    there.export(tmp_path / "land.glb", resolution=128)
    assert (tmp_path / "land.glb").stat().st_size > 1000
    with pytest.raises(FileExistsError, match="s3://scans/land/globe.fanworld"):
        fantex.split(globe, "s3://scans/land")
    fewer = fantex.split(globe, "s3://scans/land/", triangles=8000, overwrite=True)
    assert len(list((store / "land").iterdir())) == len(fewer) + 1

    # An index at an address names assets there.
    index = "s3://scans/town.fanworld"
    town = fantex.make_world([entry.place for entry in fewer.objects], index)
    assert town.objects[0].name == "land/sector-0001-2.fan"
    assert len(fantex.make_world([], index, remove=town.objects[0].place)) == len(town) - 1
    with pytest.raises(fantex.Error, match="lies on this machine"):
        fantex.make_world(globe, index)


def test_what_is_not_sent_is_kept_and_can_be_sent(tmp_path, store, sphere, globe, monkeypatch):
    folder = tmp_path / "tmp"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    place = "s3://scans/a.fan"

    def somebody_is_faster(points, normals):
        (store / "a.fan").write_bytes(b"first")
        return pattern(points, normals)

    with pytest.raises(FileExistsError, match="the finished file is kept") as raised:
        fantex.bake(sphere, place, texels=20_000, source=somebody_is_faster)
    (kept,) = folder.glob("fantex-unsent-*/a.fan")
    assert f"fantex upload {kept} -o {place}" in str(raised.value)
    with pytest.raises(FileExistsError):
        fantex.upload(kept, place)
    fantex.upload(kept, place, overwrite=True)
    assert fantex.open(place).verify()["ok"]

    # A world, too, over another one.
    fantex.split(globe, "s3://scans/land", triangles=3000)
    here = fantex.split(globe, tmp_path / "land", triangles=8000)
    index = "s3://scans/land/globe.fanworld"
    fantex.upload(here.place, index, overwrite=True)
    there = fantex.open(index)
    assert [entry.name for entry in there.objects] == [
        entry.name.replace(".fan", "-2.fan") for entry in here.objects
    ]
    assert there.verify()["ok"] and len(list((store / "land").iterdir())) == len(there) + 1
    with pytest.raises(ValueError, match="nothing is sent to"):
        fantex.upload(kept, tmp_path / "b.fan")


def test_assets_there_are_changed(store, sphere):
    asset = fantex.bake(sphere, "s3://scans/a.fan", texels=60_000, source=pattern)
    assert asset.info["preview_bytes"] is None
    made = asset.make_preview(triangles=300, texels=4000)
    assert asset.info["preview_bytes"] == made["bytes"] and 50 < made["triangles"] < 500
    assert fantex.open("s3://scans/a.fan").verify()["ok"]
    assert asset.remove_preview() and not asset.remove_preview()
    stroke = {
        "brush": {"size": {"texels": 40}, "hardness": 0.5},
        "channels": [{"kind": "base_color", "color": {"srgb": [1, 0, 0]}}],
        "samples": [{"at": {"position": [0, 0, 1]}}],
    }
    assert asset.paint([stroke])["strokes"] == 1
    assert asset.sample([0, 0, 1])[1] < 0.2
    # Exports are files.
    with pytest.raises(ValueError, match="give a path"):
        asset.export("s3://scans/a.glb")
