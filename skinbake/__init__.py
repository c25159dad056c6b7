"""Texture-space diffusion of human skin: irradiance baked to UV space, blurred by a physical profile, added up live.

`load_look`, `bake`, `open_bake`, `fit_skin` and `profile_of` are meant for other programs; each is imported when it is
first asked for.
"""

from __future__ import annotations

TYPE_CHECKING = False  # what type checkers take for true; `typing` takes as long to import as all that runs before main
if TYPE_CHECKING:
    from typing import Any

    from skinbake.api import BakedSkin, bake, fit_skin, load_look, open_bake, profile_of

__version__ = "0.1.0"
__all__ = ["BakedSkin", "bake", "fit_skin", "load_look", "open_bake", "profile_of"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module("skinbake.api"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
