"""What `import skinbake` gives: looks, bakes and profiles as arrays, no file written."""

from skinbake.api.baked_skin import BakedSkin
from skinbake.api.from_folder import open_bake
from skinbake.api.in_memory import bake
from skinbake.api.skins import fit_skin, profile_of
from skinbake.io.config import load_look

__all__ = ["BakedSkin", "bake", "fit_skin", "load_look", "open_bake", "profile_of"]
