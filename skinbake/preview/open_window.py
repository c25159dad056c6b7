"""Opens pyglet's window, with an OpenGL context that our shaders can use."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Any

from skinbake.errors import MachineError


def open_window(width: int, height: int, **handlers: Callable[..., Any]) -> Any:
    """pyglet's window with an OpenGL 3.3 context, current.

    Parameters
    ----------
    width, height : int
        Pixels.
    **handlers
        By the event that each hears.

    Raises
    ------
    MachineError
        No window can be opened here.
    """
    if sys.platform.startswith("linux") and "OpenGL" not in sys.modules:
        os.environ["PYOPENGL_PLATFORM"] = "glx"  # the window's contexts are GLX's
    try:
        import pyglet

        pyglet.options["shadow_window"] = False
        config: Any = pyglet.gl.Config(  # type: ignore[abstract]
            double_buffer=True, depth_size=24, major_version=3, minor_version=3
        )
        window = pyglet.window.Window(
            width, height, caption="skinbake preview", resizable=True, config=config, vsync=False
        )
        window.switch_to()
    except Exception as error:  # pyglet has many kinds, none of them public
        raise MachineError(
            f"no window could be opened ({type(error).__name__} {error}); render pictures instead: --png FILE"
        ) from error
    window.push_handlers(**handlers)
    return window
