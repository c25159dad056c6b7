"""Light leaving the skin: each Gaussian's blur of the light that arrives, and how wrong it is."""

from skinbake.diffuse.diffuse import diffuse
from skinbake.diffuse.diffuse_map import Decision, DiffuseMap, Lobe, MeasuredError
from skinbake.diffuse.error import measure_error
from skinbake.diffuse.memory import memory_needed_bytes
from skinbake.diffuse.planning.lobe_plan import plan_lobes
from skinbake.diffuse.surface_space.reference_integral import reference_integral
from skinbake.diffuse.surface_space.surface_light import surface_blur, surface_light
from skinbake.diffuse.texture_space.blur import texture_blur, texture_pyramid

__all__ = [
    "Decision",
    "DiffuseMap",
    "Lobe",
    "MeasuredError",
    "diffuse",
    "measure_error",
    "memory_needed_bytes",
    "plan_lobes",
    "reference_integral",
    "surface_blur",
    "surface_light",
    "texture_blur",
    "texture_pyramid",
]
