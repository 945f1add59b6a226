# SPDX-License-Identifier: GPL-3.0-or-later
"""Seamless textures on any mesh, without UV coordinates: bake, show, paint and export fans in Blender."""

import atexit
import math
import os
import re
import shutil
import subprocess
import tempfile
import threading
import time

import bpy
import fantex
from bpy.app.handlers import persistent
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ExportHelper, ImportHelper

from . import fans, objects

#: The asset that an object was baked to last, which its next bake may replace.
BAKED_KEY = "fantex_baked"

SOURCES = [
    ("MATERIALS", "Materials", "Its materials: textures, factors, normal maps"),
    ("COLORS", "Colors", "Its active color attribute"),
    ("SOLID", "Solid", "A recipe that is defined everywhere in space"),
    ("LOOK", "Look", "A look file (.toml)"),
]


def settings(context):
    """The extension's preferences; None where it runs without being installed."""
    addon = context.preferences.addons.get(__package__)
    return addon and addon.preferences


#: GiB that the pictures of an asset may take on their way into Blender, unless the preferences say otherwise.
MEMORY = 8


def fans_of(asset, context):
    """What Blender shows of an asset. Raises ``fantex.Error``, which says how to allow more, where that takes too much memory."""
    preferences = settings(context)
    memory = preferences.memory if preferences else MEMORY
    try:
        return asset.fan_attributes(memory=memory << 30)
    except fantex.Error as error:
        if "memory=" not in str(error):
            raise
        raise fantex.Error(
            f"{asset.place} takes more than {memory} GiB of memory to show; allow more in the extension's preferences"
        ) from error


def show(asset, name, y_up, context, beside=None):
    """Adds an object that shows an asset: to the first collection of the object beside which it belongs, or to the active one."""
    item = fans.build_object(asset, fans_of(asset, context), name, y_up)
    collections = beside.users_collection if beside else ()
    next((each for each in collections if each.is_editable), context.collection).objects.link(item)
    return item


def activate(item, context):
    """Selects an object and makes it the active one, where the view layer has it."""
    if context.view_layer.objects.get(item.name) == item:
        item.select_set(True)
        context.view_layer.objects.active = item


def object_of(session_uid):
    """The object with that number, however it is called by then; None where it is gone."""
    return next((item for item in bpy.data.objects if item.session_uid == session_uid), None)


def default_folder():
    """Where assets go: beside the .blend file, or among the documents. Blender empties its temporary folder when it ends."""
    if bpy.data.filepath:
        return os.path.dirname(bpy.data.filepath)
    home = os.path.expanduser("~")
    documents = os.path.join(home, "Documents")
    return documents if os.path.isdir(documents) else home


def default_path(item):
    return os.path.join(default_folder(), bpy.path.clean_name(item.name) + ".fan")


def absolute(path):
    """A path that a user has given. Raises ``ValueError``."""
    if path.startswith("//") and not bpy.data.filepath:
        raise ValueError(f"{path} lies beside the .blend file: save that first, or give a whole path")
    return path if "://" in path else os.path.abspath(bpy.path.abspath(path))


def found(place, item):
    """An asset of an object: where it was, or, if it is gone, beside the .blend file or as far below that as it was below a folder. Projects
    are moved, and go to other machines."""
    if "://" in place or os.path.exists(place):
        return place
    blend = item.library.filepath if item.library else bpy.data.filepath
    parts = re.split(r"[\\/]", place) if blend else []
    folder = os.path.dirname(os.path.abspath(bpy.path.abspath(blend)))
    below = (os.path.join(folder, *parts[first:]) for first in range(1, len(parts)))
    return next(filter(os.path.isfile, below), place)


def owns(item, path):
    """Whether an asset is of this object alone. Copies of an object have its properties."""
    return [other for other in bpy.data.objects if found(other.get(BAKED_KEY, ""), other) == path] == [item]


class Cancelled(Exception):
    """The user has ended the bake."""


#: Bakes whose threads run.
RUNNING = set()

#: How long the end of Blender may wait for bakes to notice that they are cancelled.
CANCEL_SECONDS = 10


class Bake:
    """A bake on a thread of its own."""

    def __init__(self, mesh, path, **settings):
        self.step, self.done, self.total = "baking", 0, 1
        self.is_cancelled = False
        self.error = None
        self.asset = None
        # Blender ends without waiting for such threads.
        self.thread = threading.Thread(target=self._run, args=(mesh, path, settings), daemon=True)
        RUNNING.add(self)
        self.thread.start()

    def _run(self, mesh, path, settings):
        try:
            self.asset = fantex.bake(mesh, path, progress=self._progress, **settings)
        except Exception as error:  # Shown by whoever waits.
            self.error = error
        finally:
            RUNNING.discard(self)

    def _progress(self, done, total, step):
        self.step, self.done, self.total = step, done, max(total, 1)
        # At the end the file is written.
        if self.is_cancelled and done < total:
            raise Cancelled

    @property
    def is_finished(self):
        return not self.thread.is_alive()


def cancel_bakes():
    """Ends all bakes, and waits until they leave their files alone."""
    bakes = list(RUNNING)
    for bake in bakes:
        bake.is_cancelled = True
    deadline = time.monotonic() + CANCEL_SECONDS
    for bake in bakes:
        bake.thread.join(max(deadline - time.monotonic(), 0))


@persistent
def before_load(*_):
    """Another file has no operator that waits for the bake, and not its object."""
    cancel_bakes()


class FANTEX_OT_bake(bpy.types.Operator):
    """Bakes the active object's look into an asset, and shows it"""

    bl_idname = "fantex.bake"
    bl_label = "Bake to Fans"
    bl_options = {"REGISTER", "UNDO"}

    # Another object has another file.
    filepath: StringProperty(name="Asset", subtype="FILE_PATH", options={"SKIP_SAVE"})
    overwrite: BoolProperty(
        name="Overwrite",
        description="Replace a file that is not this object's, with all that is painted on it",
        options={"SKIP_SAVE"},
    )
    source: EnumProperty(name="Source", items=SOURCES, default="MATERIALS")
    solid: EnumProperty(name="Solid", items=[(name, name.title(), "") for name in fantex.SOLIDS])
    look: StringProperty(name="Look", subtype="FILE_PATH")
    million_texels: FloatProperty(name="Million Texels", default=4.0, min=0.001, soft_max=1000.0)
    cuts_hard_edges: BoolProperty(
        name="Cut at Hard Edges",
        description="Cut the texture at edges that bend sharply, so that flat faces are sharper up to their edges. "
        "It is not continuous across these",
    )
    hard_angle: FloatProperty(
        name="Hard Edges from",
        description="Edges whose two faces' normals differ by at least so much are cut",
        subtype="ANGLE",
        default=math.radians(60),
        min=0,
        max=math.pi,
    )

    _bake = None
    _timer = None

    @classmethod
    def poll(cls, context):
        cls.poll_message_set("Select an object with a surface: a mesh, a curve, a text or a metaball")
        return context.object is not None and context.object.type in objects.TYPES

    def invoke(self, context, event):
        self.filepath = self.filepath or default_path(context.object)
        return context.window_manager.invoke_props_dialog(self)

    def start(self, context):
        item = context.object
        path = bpy.path.ensure_ext(absolute(self.filepath or default_path(item)), ".fan")
        overwrite = self.overwrite or owns(item, path)
        if os.path.exists(path) and not overwrite:
            raise ValueError(f"{path} exists and is not {item.name}'s: give another path, or tick Overwrite")
        if self.source == "MATERIALS":
            mesh, source = objects.full_mesh(context, item), fantex.own_materials()
        elif self.source == "LOOK":
            if not self.look:
                raise ValueError("no look is given; choose its file (.toml)")
            source = fantex.look(absolute(self.look))
            mesh = objects.full_mesh(context, item, with_colors=True)
        else:
            mesh = objects.plain_mesh(item, context.evaluated_depsgraph_get())
            source = fantex.vertex_colors() if self.source == "COLORS" else fantex.solid(self.solid)
        for note in objects.left_out(item, context.evaluated_depsgraph_get(), self.source == "MATERIALS"):
            self.report({"WARNING"}, note)
        # Angles are radians of single precision here.
        hard_edges = min(round(math.degrees(self.hard_angle), 4), 180) if self.cuts_hard_edges else None
        texels = self.million_texels * 1e6
        return Bake(mesh, path, texels=texels, source=source, overwrite=overwrite, hard_edges=hard_edges)

    def execute(self, context):
        """Without a window: waits for the end."""
        try:
            bake, original = self.start(context), context.object
        except (ValueError, OSError, fantex.Error) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if bpy.app.background:
            bake.thread.join()
            return self.finish(context, bake, original)
        # Another object may be active when the bake ends, and this one be gone.
        self._bake, self._original = bake, original.session_uid
        context.window_manager.progress_begin(0, 100)
        self._timer = context.window_manager.event_timer_add(0.1, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        bake = self._bake
        if event.type == "ESC":
            bake.is_cancelled = True
        if not bake.is_finished:
            share = bake.done / bake.total
            context.window_manager.progress_update(int(100 * share))
            work = "Covering the mesh" if bake.step == "covering" else "Baking fans"
            context.workspace.status_text_set(f"{work}: {100 * share:.0f} %  (Esc ends it)")
            return {"RUNNING_MODAL"} if event.type in {"TIMER", "ESC"} else {"PASS_THROUGH"}
        self._end(context)
        return self.finish(context, bake, object_of(self._original))

    def cancel(self, context):
        """Blender drops the operator, or its dialog is closed."""
        if self._bake is not None:
            self._bake.is_cancelled = True
        if self._timer is not None:
            self._end(context)

    def _end(self, context):
        """Takes away what shows that the bake runs."""
        context.window_manager.event_timer_remove(self._timer)
        self._timer = None
        context.window_manager.progress_end()
        # There is none without a window.
        if context.workspace is not None:
            context.workspace.status_text_set(None)

    def finish(self, context, bake, original):
        if isinstance(bake.error, Cancelled):
            self.report({"WARNING"}, "The bake was cancelled; its file is as it was before")
            return {"CANCELLED"}
        if bake.error is not None:
            self.report({"ERROR"}, str(bake.error))
            return {"CANCELLED"}
        for note in bake.asset.baked["notes"]:
            self.report({"INFO"}, note)
        # The next bake may replace it, whether it can be shown or not.
        if original and original.is_editable:
            original[BAKED_KEY] = bake.asset.place
        name = original.name if original else os.path.splitext(os.path.basename(bake.asset.place))[0]
        try:
            item = show(bake.asset, f"{name} fans", True, context, original)
        except (OSError, ValueError, MemoryError, fantex.Error) as error:
            self.report({"ERROR"}, f"{bake.asset.place} is baked, but cannot be shown: {error}")
            return {"CANCELLED"}
        if original:
            item.matrix_world = original.matrix_world
            # Another scene may be shown by then, which has neither of them.
            if context.view_layer.objects.get(original.name) == original:
                original.hide_set(True)
                original.select_set(False)
        activate(item, context)
        texels, tiles = bake.asset.info["texels"], bake.asset.info["tiles"]
        self.report({"INFO"}, f"{texels} texels in {tiles} tiles")
        return {"FINISHED"}


class FANTEX_OT_import(bpy.types.Operator, ImportHelper):
    """Shows a .fan asset"""

    bl_idname = "fantex.import_fan"
    bl_label = "Import Fans (.fan)"
    bl_options = {"REGISTER", "UNDO"}

    filename_ext = ".fan"
    filter_glob: StringProperty(default="*.fan", options={"HIDDEN"})
    y_up: BoolProperty(name="Y Is Up", description="The model's y axis points upwards, as in glTF", default=True)

    def execute(self, context):
        name = os.path.splitext(os.path.basename(self.filepath))[0]
        try:
            item = show(fantex.open(absolute(self.filepath)), name, self.y_up, context)
        except (OSError, ValueError, MemoryError, fantex.Error) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for other in context.selected_objects:
            other.select_set(False)
        activate(item, context)
        return {"FINISHED"}


def shows_fans(operator, context):
    """Whether the active object shows an asset. Says so where the operator is asked for."""
    operator.poll_message_set("Select an object that shows an asset")
    return is_fans(context)


def is_fans(context):
    return context.object is not None and fans.ASSET_KEY in context.object


def asset_of(item):
    """Where the asset is that an object shows."""
    return found(item[fans.ASSET_KEY], item)


def is_edited(item):
    """Whether the object's mesh is in Edit Mode, in any scene: Blender gives such an object no other one."""
    return getattr(item.data, "is_editmode", False)


def reload(item, context):
    if is_edited(item):
        raise ValueError(f"{item.name} is in Edit Mode; leave that first")
    asset = fantex.open(asset_of(item))
    fans.rebuild(item, asset, fans_of(asset, context), bool(item.get(fans.Y_UP_KEY, False)))


class FANTEX_OT_reload(bpy.types.Operator):
    """Reads the object's asset again"""

    bl_idname = "fantex.reload"
    bl_label = "Reload"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return shows_fans(cls, context)

    def execute(self, context):
        try:
            reload(context.object, context)
        except (OSError, ValueError, MemoryError, fantex.Error) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class FANTEX_OT_export(bpy.types.Operator, ExportHelper):
    """Writes the object's asset as a model with ordinary texture coordinates"""

    bl_idname = "fantex.export_atlas"
    bl_label = "Export Atlas"

    filename_ext = ".glb"
    filter_glob: StringProperty(default="*.glb;*.gltf", options={"HIDDEN"})
    resolution: IntProperty(
        name="Resolution",
        description="Columns and rows of the pictures: the next power of two is taken",
        default=2048,
        min=16,
        max=32768,
    )

    @classmethod
    def poll(cls, context):
        return shows_fans(cls, context)

    def execute(self, context):
        try:
            path = absolute(self.filepath)
            resolution = 1 << (self.resolution - 1).bit_length()
            fantex.open(asset_of(context.object)).export(path, resolution=resolution, overwrite=True)
        except (OSError, ValueError, fantex.Error) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class FANTEX_OT_paint(bpy.types.Operator):
    """Paints on the object's asset in fantex's own window; what was painted is here when that is closed"""

    bl_idname = "fantex.paint"
    bl_label = "Paint"

    @classmethod
    def poll(cls, context):
        return shows_fans(cls, context)

    def execute(self, context):
        preferences = settings(context)
        program = (preferences and preferences.program) or shutil.which("fantex")
        if not program:
            self.report({"ERROR"}, "The program fantex was not found; say where it is in the add-on's preferences")
            return {"CANCELLED"}
        item = context.object
        # In a file, which never fills up as a pipe does.
        said = tempfile.TemporaryFile()
        try:
            painter = subprocess.Popen([bpy.path.abspath(program), "paint", asset_of(item)], stderr=said)
        except OSError as error:
            self.report({"ERROR"}, f"The program {program} does not start: {error}")
            return {"CANCELLED"}
        watch(painter, item.session_uid, said)
        return {"FINISHED"}


#: Timers that wait for the windows of painters.
WATCHES = set()


def last_line(said):
    """The last line of what a program has said."""
    said.seek(0)
    lines = said.read().decode(errors="replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "")


def watch(painter, session_uid, said):
    """Reloads an object when its painter's window is closed; ``said`` holds what the painter says of mistakes."""

    def look():
        code = painter.poll()
        if code is None:
            return 0.5
        item = object_of(session_uid)
        is_there = item is not None and fans.ASSET_KEY in item
        if code == 0 and is_there and is_edited(item):
            return 0.5
        WATCHES.discard(look)
        if code != 0:
            tell(f"The painter has failed: {last_line(said) or f'it ended with {code}'}")
        elif is_there:
            try:
                reload(item, bpy.context)
            except (OSError, ValueError, MemoryError, fantex.Error) as error:
                tell(f"{item.name} was not reloaded: {error}")
        return None

    WATCHES.add(look)
    bpy.app.timers.register(look, first_interval=0.5)


def tell(message):
    """Shows a mistake outside operators, which alone have reports."""
    print(f"fantex: {message}")
    windows = bpy.context.window_manager.windows
    if not bpy.app.background and windows:
        with bpy.context.temp_override(window=windows[0]):
            bpy.context.window_manager.popup_menu(
                lambda menu, _: menu.layout.label(text=message), title="Fantex", icon="ERROR"
            )


class FantexPreferences(bpy.types.AddonPreferences):
    bl_idname = __package__ or "fantex"

    program: StringProperty(name="Program", description="The command fantex, for painting", subtype="FILE_PATH")
    memory: IntProperty(
        name="Memory (GiB)",
        description="What the pictures of an asset may take on their way into Blender",
        default=MEMORY,
        min=1,
        max=1024,
    )

    def draw(self, context):
        self.layout.prop(self, "program")
        self.layout.prop(self, "memory")


class FANTEX_PT_panel(bpy.types.Panel):
    bl_label = "Fans"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Fantex"

    def draw(self, context):
        column = self.layout.column()
        column.operator(FANTEX_OT_bake.bl_idname, icon="RENDER_STILL")
        column.operator(FANTEX_OT_import.bl_idname, icon="IMPORT")
        if is_fans(context):
            column.separator()
            column.label(text=os.path.basename(context.object[fans.ASSET_KEY]))
            column.operator(FANTEX_OT_paint.bl_idname, icon="BRUSH_DATA")
            column.operator(FANTEX_OT_reload.bl_idname, icon="FILE_REFRESH")
            column.operator(FANTEX_OT_export.bl_idname, icon="EXPORT")


def menu_import(self, context):
    self.layout.operator(FANTEX_OT_import.bl_idname)


CLASSES = (
    FantexPreferences,
    FANTEX_OT_bake,
    FANTEX_OT_import,
    FANTEX_OT_reload,
    FANTEX_OT_export,
    FANTEX_OT_paint,
    FANTEX_PT_panel,
)


def register():
    for item in CLASSES:
        bpy.utils.register_class(item)
    bpy.types.TOPBAR_MT_file_import.append(menu_import)
    bpy.app.handlers.load_pre.append(before_load)
    atexit.register(cancel_bakes)


def unregister():
    cancel_bakes()
    atexit.unregister(cancel_bakes)
    if before_load in bpy.app.handlers.load_pre:
        bpy.app.handlers.load_pre.remove(before_load)
    for look in list(WATCHES):
        if bpy.app.timers.is_registered(look):
            bpy.app.timers.unregister(look)
    WATCHES.clear()
    bpy.types.TOPBAR_MT_file_import.remove(menu_import)
    for item in reversed(CLASSES):
        bpy.utils.unregister_class(item)
