# SPDX-License-Identifier: GPL-3.0-or-later
"""What runs beside Blender: bakes and painters, and what has become of the scene when they end."""

import io
import subprocess
import sys
import time
import types
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
fantex = pytest.importorskip("fantex")

from test_extension import bake, paint_blue, pixels, red_cube  # noqa: E402


def slow(points, normals):
    time.sleep(0.2)
    return np.full((len(points), 3), 0.5)


def slow_bake(extension, path):
    """A bake that takes minutes."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32)
    mesh = extension.objects.plain_mesh(bpy.context.object, bpy.context.evaluated_depsgraph_get())
    running = extension.Bake(mesh, str(path), texels=4e6, source=slow)
    while running.total == 1 and not running.is_finished:
        time.sleep(0.01)
    assert running in extension.RUNNING
    return running


@pytest.mark.parametrize("end", ["load", "unregister"])
def test_bakes_end_with_their_file(tmp_path, extension, end):
    running = slow_bake(extension, tmp_path / "a.fan")
    if end == "load":
        bpy.ops.wm.read_factory_settings(use_empty=True)
    else:
        extension.unregister()
        extension.register()
    assert running.is_finished and isinstance(running.error, extension.Cancelled)
    assert not extension.RUNNING
    assert list(tmp_path.iterdir()) == []


def test_blender_does_not_wait_for_bakes(tmp_path, extension):
    program = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
import conftest
import test_meanwhile as tests
extension = conftest.load_extension()
tests.slow_bake(extension, {str(tmp_path / "a.fan")!r})
print("baking")
"""
    done = subprocess.run([sys.executable, "-B", "-c", program], timeout=60, capture_output=True, text=True)
    assert done.returncode == 0 and "baking" in done.stdout, done.stderr
    assert list(tmp_path.iterdir()) == []


def test_escape_at_the_very_end_is_too_late(tmp_path, extension, monkeypatch):
    """A file that is written is not said to be as it was."""
    def escape(self, done, total, step, progress=extension.Bake._progress):
        self.is_cancelled = done >= total
        progress(self, done, total, step)

    monkeypatch.setattr(extension.Bake, "_progress", escape)
    red_cube()
    bake(tmp_path / "a.fan")
    assert (tmp_path / "a.fan").exists()


def test_dialogs_may_be_closed(extension):
    """Blender then calls ``cancel``, without a bake."""
    operator = types.SimpleNamespace(_bake=extension.FANTEX_OT_bake._bake, _timer=extension.FANTEX_OT_bake._timer)
    extension.FANTEX_OT_bake.cancel(operator, bpy.context)


class Painter:
    """A window that is closed."""

    def poll(self):
        return 0


def test_painted_objects_are_found_by_whatever_name(tmp_path, extension, monkeypatch, capfd):
    red_cube()
    item = bake(tmp_path / "a.fan")
    looks = []
    monkeypatch.setattr(bpy.app.timers, "register", lambda look, **_: looks.append(look), raising=False)
    extension.watch(Painter(), item.session_uid, io.BytesIO())
    item.name = "Other"
    mesh = item.data.session_uid
    assert looks[0]() is None and item.data.session_uid != mesh
    # Without the file.
    extension.watch(Painter(), item.session_uid, io.BytesIO())
    (tmp_path / "a.fan").unlink()
    assert looks[1]() is None
    assert "Other was not reloaded" in capfd.readouterr().out
    # Without the object.
    extension.watch(Painter(), item.session_uid, io.BytesIO())
    bpy.data.objects.remove(item)
    assert looks[2]() is None
    assert not extension.WATCHES


def test_edited_meshes_are_reloaded_afterwards(tmp_path, extension, monkeypatch):
    """Blender lets nobody exchange the mesh of Edit Mode: Reload says so and changes nothing, and a painter's end is waited for."""
    red_cube()
    item = bake(tmp_path / "a.fan")
    mesh = item.data
    image, = extension.fans.made_images(mesh.materials[0])
    before, meshes = pixels(image), len(bpy.data.meshes)
    paint_blue(tmp_path / "a.fan")
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="is in Edit Mode; leave that first"):
        bpy.ops.fantex.reload()
    looks = []
    monkeypatch.setattr(bpy.app.timers, "register", lambda look, **_: looks.append(look), raising=False)
    extension.watch(Painter(), item.session_uid, io.BytesIO())
    assert looks[0]() == 0.5
    assert item.data == mesh and len(bpy.data.meshes) == meshes
    np.testing.assert_array_equal(pixels(image), before)
    bpy.ops.object.mode_set(mode="OBJECT")
    assert looks[0]() is None and not extension.WATCHES
    assert (pixels(image) != before).any() and len(bpy.data.meshes) == meshes


@pytest.mark.parametrize("is_shown", [True, False])
def test_bakes_end_in_other_scenes(tmp_path, extension, is_shown):
    """The result stands beside its object, whatever scene is shown when the bake ends."""
    item = red_cube()
    collection = bpy.data.collections.new("theirs")
    bpy.context.scene.collection.children.link(collection)
    collection.objects.link(item)
    bpy.context.collection.objects.unlink(item)
    asset = fantex.bake(
        extension.objects.plain_mesh(item, bpy.context.evaluated_depsgraph_get()),
        tmp_path / "a.fan", texels=5000, source=fantex.solid("wood"),
    )
    other = bpy.data.scenes.new("other")
    said = []
    operator = types.SimpleNamespace(report=lambda kind, text: said.append((kind, text)), filepath=str(tmp_path / "a.fan"))
    done = types.SimpleNamespace(error=None, asset=asset)
    shown = other if not is_shown else bpy.context.scene
    with bpy.context.temp_override(scene=shown, view_layer=shown.view_layers[0], collection=shown.collection):
        assert extension.FANTEX_OT_bake.finish(operator, bpy.context, done, item) == {"FINISHED"}
    assert not any(kind == {"ERROR"} for kind, _ in said)
    made = bpy.data.objects[f"{item.name} fans"]
    assert list(made.users_collection) == [collection] and not other.objects
    if is_shown:
        assert item.hide_get() and bpy.context.view_layer.objects.active == made and made.select_get()


def test_painters_that_fail_say_why(tmp_path, extension, monkeypatch, capfd):
    red_cube()
    item = bake(tmp_path / "a.fan")
    mesh = item.data.session_uid
    looks = []
    monkeypatch.setattr(bpy.app.timers, "register", lambda look, **_: looks.append(look), raising=False)
    program = tmp_path / "painter"
    program.write_text("#!/bin/sh\necho 'a warning' >&2\necho 'fantex: no graphics device was found' >&2\nexit 1\n")
    program.chmod(0o755)
    monkeypatch.setattr(extension.shutil, "which", lambda _: str(program))
    assert bpy.ops.fantex.paint() == {"FINISHED"}
    deadline = time.monotonic() + 30
    while looks[0]() is not None and time.monotonic() < deadline:
        time.sleep(0.05)
    assert "The painter has failed: fantex: no graphics device was found" in capfd.readouterr().out
    assert item.data.session_uid == mesh and not extension.WATCHES


def test_bakes_that_are_dropped_leave_nothing_behind(extension):
    """The timer, the progress and the text of a bake go with it, also where another file is loaded."""
    gone = []
    manager = types.SimpleNamespace(
        event_timer_remove=lambda timer: gone.append(timer), progress_end=lambda: gone.append("progress")
    )
    context = types.SimpleNamespace(
        window_manager=manager, workspace=types.SimpleNamespace(status_text_set=lambda text: gone.append(text))
    )
    bake = types.SimpleNamespace(is_cancelled=False)
    operator = types.SimpleNamespace(_bake=bake, _timer="timer")
    operator._end = types.MethodType(extension.FANTEX_OT_bake._end, operator)
    extension.FANTEX_OT_bake.cancel(operator, context)
    assert bake.is_cancelled and gone == ["timer", "progress", None]
    extension.FANTEX_OT_bake.cancel(operator, context)
    assert len(gone) == 3


def test_painters_may_not_start(tmp_path, extension, monkeypatch):
    red_cube()
    bake(tmp_path / "a.fan")
    monkeypatch.setattr(extension.shutil, "which", lambda _: str(tmp_path))
    with pytest.raises(RuntimeError, match="does not start"):
        bpy.ops.fantex.paint()


def test_timers_end_with_the_extension(tmp_path, extension):
    class Open:
        def poll(self):
            return None

    extension.watch(Open(), 0, io.BytesIO())
    look, = extension.WATCHES
    assert bpy.app.timers.is_registered(look)
    extension.unregister()
    try:
        assert not bpy.app.timers.is_registered(look) and not extension.WATCHES
    finally:
        extension.register()
