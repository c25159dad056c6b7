"""Without a display EGL is chosen, then OSMesa, and where neither is installed the message says what to install."""

import ctypes.util
import subprocess
import sys

import pytest

from skinbake.errors import MachineError
from skinbake.preview.platform import _unload, choose_headless

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="EGL and OSMesa are Linux's")


@linux
@pytest.mark.parametrize(
    ("installed", "chosen"), [(("EGL", "OSMesa"), "egl"), (("EGL",), "egl"), (("OSMesa",), "osmesa")], ids=str
)
def test_what_is_installed_is_chosen(monkeypatch, installed, chosen):
    monkeypatch.setenv("PYOPENGL_PLATFORM", "")
    monkeypatch.delenv("PYOPENGL_PLATFORM")
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: name if name in installed else None)
    assert choose_headless() == chosen


@linux
def test_nothing_installed_says_what_to_install(monkeypatch):
    monkeypatch.setenv("PYOPENGL_PLATFORM", "")
    monkeypatch.delenv("PYOPENGL_PLATFORM")
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: None)
    with pytest.raises(MachineError, match="apt install libegl1") as fault:
        choose_headless()
    assert fault.value.exit_code == 3


@linux
def test_a_users_own_choice_stays(monkeypatch):
    monkeypatch.setenv("PYOPENGL_PLATFORM", "osmesa")
    assert choose_headless() == "osmesa"


@linux
def test_pictures_need_no_library_of_windows_nor_of_meshes():
    """pyglet, Tk and trimesh are not imported for them, and can be afterwards, as can pyrender's own window."""
    code = """
import sys
from skinbake.preview.draw import OffscreenRenderer
from skinbake.preview.platform import import_pyrender
import_pyrender()
import skinbake.preview.renderer
unwanted = {"pyglet", "tkinter", "imageio", "pyrender.viewer", "trimesh"}
print(sorted(unwanted & set(sys.modules)), "pyrender" in sys.modules)
import trimesh
print(trimesh.creation.box().is_watertight)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["[]", "True", "True"]


def test_modules_are_unloaded_while_others_are_imported(monkeypatch):
    """By other threads, which read and trace while the picture's thread starts OpenGL; here as a name is read."""

    class Importing(str):
        """A name whose comparison imports another module."""

        __hash__ = str.__hash__

        def __eq__(self, other):
            sys.modules["imported meanwhile"] = sys
            return str.__eq__(self, other)

    names = [Importing("first"), "unwanted", "unwanted.part", "unwanted_not"]
    with monkeypatch.context() as patched:
        patched.setattr(sys, "modules", sys.modules | dict.fromkeys(names, sys))
        _unload("unwanted")
        left = [str(name) for name in names if name in sys.modules]
    assert left == ["first", "unwanted_not"]
