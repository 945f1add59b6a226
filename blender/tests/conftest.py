# SPDX-License-Identifier: GPL-3.0-or-later
import importlib.util
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def load_extension():
    """The folder as a package, as Blender loads it."""
    folder = ROOT / "blender"
    spec = importlib.util.spec_from_file_location(
        "fantex_extension", folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    module = importlib.util.module_from_spec(spec)
    sys.modules["fantex_extension"] = module
    spec.loader.exec_module(module)
    module.register()
    return module


@pytest.fixture(scope="session")
def extension():
    module = load_extension()
    yield module
    module.unregister()


@pytest.fixture(autouse=True)
def empty_scene():
    bpy = pytest.importorskip("bpy")
    bpy.ops.wm.read_factory_settings(use_empty=True)
