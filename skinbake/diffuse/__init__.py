"""Light leaving the skin: each Gaussian's blur of the light that arrives, and how wrong it is."""

from skinbake.diffuse.diffuse import diffuse
from skinbake.diffuse.diffuse_map import DiffuseMap, Lobe, MeasuredError
from skinbake.diffuse.memory import memory_needed_bytes
from skinbake.scene.decision import Decision

__all__ = [
    "Decision",
    "DiffuseMap",
    "Lobe",
    "MeasuredError",
    "diffuse",
    "memory_needed_bytes",
]
