"""Light arriving at each texel."""

from skinbake.irradiance.irradiance_map import IrradianceMap
from skinbake.irradiance.light_texels import light_texels

__all__ = ["IrradianceMap", "light_texels"]
