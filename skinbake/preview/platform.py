"""Choice of the OpenGL platform, before pyrender (and with it PyOpenGL) is imported for the first time."""

from __future__ import annotations

import ctypes.util
import importlib
import importlib.util
import os
import sys
from types import ModuleType
from typing import Any

from skinbake.errors import MachineError

SOFTWARE = ("llvmpipe", "softpipe", "swrast", "swiftshader", "software", "basic render")
_ADVICE = (
    "install Mesa's EGL (Debian and Ubuntu: apt install libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri; "
    "Fedora: dnf install mesa-libEGL mesa-dri-drivers) or OSMesa (libosmesa6), "
    "or run `python -m skinbake.preview.setup_gl`"
)


def has_display() -> bool:
    """Whether a window could be opened."""
    return not sys.platform.startswith("linux") or bool(os.environ.get("DISPLAY"))


def renderer_words(device: str) -> str:
    """What draws, by the name that OpenGL gives it: "software: llvmpipe", or the graphics card's name."""
    name = device.split("(")[0].strip()
    return f"software: {name}" if any(word in name.lower() for word in SOFTWARE) else name


def any_thread() -> bool:
    """Whether a thread of its own may do all the drawing; where a hidden window is needed, the main thread has to."""
    return sys.platform.startswith("linux")


def choose_headless() -> str:
    """Set PYOPENGL_PLATFORM to `egl`, else to `osmesa`; a platform that the user chose already stays.

    Raises
    ------
    MachineError
        Neither library is there.
    """
    if not sys.platform.startswith("linux"):
        return "pyglet"  # a hidden window: neither library exists there
    chosen = os.environ.get("PYOPENGL_PLATFORM")
    if chosen is None:
        found = (name for name, library in (("egl", "EGL"), ("osmesa", "OSMesa")) if ctypes.util.find_library(library))
        chosen = next(found, None)
        if chosen is None:
            raise MachineError(f"OpenGL without a display needs EGL or OSMesa, and neither is installed: {_ADVICE}")
        os.environ["PYOPENGL_PLATFORM"] = chosen
    return chosen


def headless_context() -> Any:
    """A current OpenGL context without a window, as pyrender's platform object.

    Every EGL device is tried in the driver's order, which puts graphics cards before Mesa's software rasteriser;
    EGL_DEVICE_ID picks one.

    Raises
    ------
    MachineError
        No device gives a context.
    """
    chosen = choose_headless()
    faults = []
    try:
        for make in _candidates(chosen):
            platform = make()
            try:
                platform.init_context()
                platform.make_current()
                return platform
            except Exception as error:  # PyOpenGL, ctypes and asserts in pyrender: the next device may still work
                faults.append(f"{type(error).__name__} {error}".strip().splitlines()[0])
    except Exception as error:  # the library is there but cannot be loaded
        faults.append(f"{type(error).__name__} {error}".strip().splitlines()[0])
    raise MachineError(f"no OpenGL context through {chosen} ({'; '.join(faults) or 'no device'}): {_ADVICE}")


def import_pyrender() -> None:
    """Import pyrender without its window and without all of trimesh but its matrices: .8 s of a processor, for nothing.

    The window brings pyglet, Tk and imageio; trimesh brings graphs, trees and solvers, and pyrender calls them for
    meshes of trimesh alone.
    """
    if "pyrender" in sys.modules:
        return
    window: Any = ModuleType("pyrender.viewer")
    window.Viewer = None
    stand_ins = {window.__name__: window}
    spec = importlib.util.find_spec("trimesh")
    if "trimesh" not in sys.modules and spec is not None:
        package: Any = ModuleType("trimesh")
        package.__path__ = spec.submodule_search_locations  # what lies in it can be imported
        stand_ins["trimesh"] = package
    sys.modules.update(stand_ins)
    try:
        importlib.import_module("pyrender")
    finally:
        for name in stand_ins:
            _unload(name)


def _unload(name: str) -> None:
    """Forget a module and what lies in it. Other threads import meanwhile, so that the names are copied first."""
    for loaded in list(sys.modules):
        if loaded == name or loaded.startswith(f"{name}."):
            del sys.modules[loaded]


def release_context(platform: Any) -> None:
    """Free a platform's context, which must be current.

    pyrender's own `delete_context` would end the whole EGL display, and with it every other context on the device.
    """
    if getattr(platform, "_egl_context", None) is None:
        platform.delete_context()
        return
    from OpenGL.EGL import EGL_NO_CONTEXT, EGL_NO_SURFACE, eglDestroyContext, eglMakeCurrent

    display, context = platform._egl_display, platform._egl_context
    eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT)
    eglDestroyContext(display, context)
    platform._egl_context = platform._egl_display = None  # or its destructor would end the display after all


def _candidates(chosen: str) -> list[Any]:
    import_pyrender()
    if chosen == "egl":
        from pyrender.platforms import egl

        devices = egl.query_devices() or [egl.EGLDevice(None)]
        if "EGL_DEVICE_ID" in os.environ:
            devices = devices[int(os.environ["EGL_DEVICE_ID"]) :][:1]
        return [lambda device=device: egl.EGLPlatform(4, 4, device=device) for device in devices]
    if chosen == "osmesa":
        from pyrender.platforms.osmesa import OSMesaPlatform

        return [lambda: OSMesaPlatform(4, 4)]
    from pyrender.platforms.pyglet_platform import PygletPlatform

    return [lambda: PygletPlatform(4, 4)]
