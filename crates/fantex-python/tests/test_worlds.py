"""Worlds: splits, indexes, pictures, exports, checks."""

import json
import os
import struct
import sys
from pathlib import Path

import numpy as np
import pytest

import fantex
from conftest import pattern

CAMERA = fantex.Camera(eye=(1.5, 1.0, 3.5), fov=40)


def glb_names(path):
    """Names of the nodes of a binary glTF file."""
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    return [node.get("name") for node in json.loads(data[20 : 20 + length])["nodes"]]


def test_a_split_shows_the_whole(tmp_path, globe):
    before = Path(globe.place).read_bytes()
    world = fantex.split(globe, tmp_path / "land", triangles=3000)
    assert Path(globe.place).read_bytes() == before
    assert isinstance(world, fantex.World) and world.place == str(tmp_path / "land" / "globe.fanworld")
    assert 3 <= len(world) <= 8 and world.made["sectors"] == len(world) and world.coarse == []
    assert list(world) == world.objects and world[-1] is world.objects[-1]
    assert "World" in repr(world) and str(len(world)) in repr(world)
    files = sorted(path.name for path in (tmp_path / "land").iterdir())
    assert files == ["globe.fanworld", *(f"sector-{number:04}.fan" for number in range(1, len(world) + 1))]
    for entry in world.objects:
        assert entry.place == str(tmp_path / "land" / entry.name)
        assert entry.bytes == (tmp_path / "land" / entry.name).stat().st_size
        assert all(low < high for low, high in zip(entry.low, entry.high))
        assert 0 < entry.preview.triangles < entry.triangles and entry.preview.detail > 0
    np.testing.assert_allclose(world.bounds, [[-1, -1, -1], [1, 1, 1]], atol=1e-6)

    info = world.info
    assert info == fantex.info(world.place) and info["kind"] == "world"
    assert info["triangles"] == globe.info["triangles"] and info["texels"] >= globe.info["texels"]
    assert info["objects"] == info["previews"] == len(world)
    assert info["low"] == world.bounds[0].tolist()
    assert info["assets"] == [entry.name for entry in world.objects]

    told = []
    report = world.verify(progress=lambda *state: told.append(state))
    assert report["ok"] and report["faults"] == [] and report["faulty"] == 0
    assert report["seam_edges"] > 50 and report["largest_jump"] <= report["bound"]

    whole = globe.render((480, 360), CAMERA, samples=2)
    sectors = world.render((480, 360), CAMERA, samples=2)
    assert sectors.shape == (360, 480, 4) and isinstance(sectors, fantex.Picture)
    assert fantex.compare_pictures(whole, sectors)["psnr_db"] > 45
    # All of it is seen without a camera.
    clear = world.render((80, 80), samples=1, transparent=True)
    assert clear[0, 0, 3] == 0 and clear[40, 40, 3] == 255

    sector = world.objects[0].open()
    points = sector.positions[sector.faces[::7]].mean(1)
    np.testing.assert_allclose(sector.sample(points), globe.sample(points), atol=1e-4)


def test_less_memory_shows_less(tmp_path, globe):
    world = fantex.split(globe, tmp_path / "land", triangles=3000)
    with pytest.warns(UserWarning, match="coarser than the picture could show; give more memory="):
        coarse = world.render((480, 360), CAMERA, samples=2, memory=4 << 20)
    assert coarse.shape == (360, 480, 4)


def test_many_sectors_get_coarse_assets(tmp_path, globe):
    world = fantex.split(globe, tmp_path / "land", triangles=500)
    assert len(world) > 16 and world.made["coarse"] == len(world.coarse) == world.info["coarse"] > 1
    assert f"{len(world.coarse)} coarse assets" in repr(world)
    top = world.coarse[-1]
    assert set(top.parts) == {entry.name for entry in world.coarse[:-1]}
    assert top.open().info["triangles"] == top.triangles
    # Without a sector, what shows it goes.
    changed = fantex.make_world((), world.place, remove=world.objects[0].name)
    assert changed.made["removed"] == 1 and changed.made["coarse_removed"] == 2
    (note,) = [note for note in changed.made["notes"] if "coarse assets showed what has changed" in note]
    assert "fantex.split of the whole asset" in note and "make_coarse=True those of" in note and "--" not in note
    assert len(changed) == len(world) - 1


def test_splits_that_are_refused_or_ended(tmp_path, globe):
    def stop(done, total):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        fantex.split(globe, tmp_path / "no", triangles=500, progress=stop)
    assert not (tmp_path / "no").exists()
    with pytest.raises(ValueError, match="at least one triangle"):
        fantex.split(globe, tmp_path / "no", triangles=0)
    with pytest.raises(ValueError, match="preview_texels are for previews"):
        fantex.split(globe, tmp_path / "no", previews=False, preview_texels=1000)
    with pytest.raises(FileNotFoundError, match="nowhere.fan"):
        fantex.split(tmp_path / "nowhere.fan", tmp_path / "no")

    world = fantex.split(globe.place, tmp_path / "land", triangles=3000, previews=False)
    assert all(entry.preview is None for entry in world.objects) and world.info["preview_detail"] is None
    with pytest.raises(FileExistsError, match="land is not empty; .* with overwrite=True"):
        fantex.split(globe, tmp_path / "land")
    again = fantex.split(
        globe, tmp_path / "land", triangles=6000, preview_triangles=500, preview_texels=9000, overwrite=True
    )
    assert len(again) < len(world) and all(entry.preview for entry in again.objects)


def test_worlds_of_objects(tmp_path, sphere):
    positions, faces = sphere
    (tmp_path / "houses").mkdir()
    houses = [tmp_path / "houses" / f"{name}.fan" for name in "ab"]
    for number, path in enumerate(houses):
        fantex.bake((positions + (3 * number, 0, 0), faces), path, texels=20_000, source=pattern)
    index, told = tmp_path / "town.fanworld", []
    world = fantex.make_world(houses, index, make_previews=True, progress=lambda *state: told.append(state))
    assert (world.made["added"], world.made["previews_made"], world.made["notes"]) == (2, 2, [])
    assert [entry.name for entry in world.objects] == ["houses/a.fan", "houses/b.fan"]
    assert fantex.info(houses[0])["preview_bytes"] > 0
    assert all(done <= total == 2 for done, total in told)
    np.testing.assert_allclose(world.bounds, [[-1, -1, -1], [4, 1, 1]], atol=1e-6)
    assert isinstance(fantex.open(index), fantex.World)
    assert isinstance(fantex.open(index, memory=1 << 28).objects[1].open(), fantex.Asset)

    # One that has changed is read again.
    fantex.open(houses[0]).remove_preview()
    faults = world.verify()["faults"]
    assert faults and all("houses/a.fan" in fault and "the index says" in fault for fault in faults)
    world = fantex.make_world(fantex.open(houses[0]), index)
    assert world.made["updated"] == 1 and world.objects[0].preview is None
    assert world.verify()["ok"]

    # Whole assets become one model.
    files = world.export(tmp_path / "town.glb", resolution=128)
    assert files == [str(tmp_path / "town.glb")]
    assert {"houses-a", "houses-b"} <= set(glb_names(tmp_path / "town.glb"))
    with pytest.raises(FileExistsError, match="overwrite=True"):
        world.export(tmp_path / "town.glb", resolution=128)
    world.export_fans(tmp_path / "fans.glb")
    assert {"houses-a", "houses-b"} <= set(glb_names(tmp_path / "fans.glb"))
    with pytest.raises(ValueError, match="s3://bucket/a.glb: files are written here"):
        world.export("s3://bucket/a.glb")

    # From afar one stands for both.
    town = fantex.make_world([], index, make_previews=True, make_coarse=True)
    assert (town.made["previews_made"], town.made["coarse_made"]) == (1, 1)
    assert [entry.name for entry in town.coarse] == ["town-coarse-0001.fan"]
    assert town.verify()["ok"]

    smaller = fantex.make_world([], index, remove=[houses[1]])
    assert len(smaller) == smaller.made["removed"] == 1 and houses[1].exists()
    assert smaller.made["coarse_removed"] == 1
    with pytest.raises(fantex.Error, match="has no asset .*b.fan that could be removed"):
        fantex.make_world([], index, remove="houses/b.fan")
    with pytest.raises(ValueError, match="give assets to put into the world"):
        fantex.make_world([], index)
    with pytest.raises(ValueError, match="no name for a world"):
        fantex.make_world(houses, tmp_path / "town.json")
    with pytest.raises(fantex.Error, match="is not an asset"):
        (tmp_path / "a.obj").write_text("v 0 0 0\n")
        fantex.make_world([tmp_path / "a.obj"], index)
    with pytest.raises(fantex.Error, match="no world"):
        index.write_text("{")
        fantex.open(index)


def test_what_is_wrong_is_said(tmp_path, globe):
    world = fantex.split(globe, tmp_path / "land", triangles=3000, previews=False)
    sector = tmp_path / "land" / "sector-0002.fan"
    content = bytearray(sector.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 64] = bytes([0x55]) * 64
    sector.write_bytes(content)
    report = world.verify()
    assert not report["ok"] and report["faulty"] == 1
    assert any("sector-0002.fan" in fault for fault in report["faults"])
    sector.unlink()
    assert any("cannot read" in fault for fault in world.verify()["faults"])
    with pytest.raises(FileNotFoundError, match="sector-0002.fan"):
        world.render((80, 60), CAMERA, samples=1)
    empty = fantex.make_world([], world.place, remove=[entry.name for entry in world.objects])
    assert len(empty) == 0 and empty.bounds is None and empty.info["low"] is None
    with pytest.raises(fantex.Error, match="nothing to show"):
        empty.render((80, 60))


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are text elsewhere")
def test_folders_whose_names_are_no_text(tmp_path, globe):
    folder = os.fsencode(tmp_path) + b"/\xff"
    world = fantex.split(globe, folder, triangles=6000, previews=False)
    assert world.place == os.fsdecode(folder + b"/globe.fanworld")
    assert world.objects[0].open().channels == ["base-color"] and world.verify()["ok"]


def test_notes_name_arguments(tmp_path, sphere):
    positions, faces = sphere
    places = [tmp_path / f"{name}.fan" for name in "ab"]
    for number, place in enumerate(places):
        fantex.bake((positions + (3 * number, 0, 0), faces), place, texels=20_000, source=pattern)
    town = fantex.make_world(places, tmp_path / "town.fanworld", make_coarse=True)
    assert any("make_previews=True gives them some" in note for note in town.made["notes"]), town.made["notes"]
