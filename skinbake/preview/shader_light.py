"""Lights as the shader's specular sees them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from skinbake.errors import InputError
from skinbake.numerics import Float, normalized
from skinbake.preview.scene import PreviewScene
from skinbake.scene.lights import DirectionalLight, LightSpec, PointLight, RectangleLight, SpotLight

DIRECTIONAL, POINT, SPOT, FACET, ENVIRONMENT = range(5)  # kinds, also in the shader
_UP = (0.0, 1.0, 0.0)


@dataclass(frozen=True)
class ShaderLight:
    """One source that the oil layer mirrors.

    Attributes
    ----------
    kind : int
        DIRECTIONAL, POINT, SPOT, FACET or ENVIRONMENT.
    light : int
        Index of the look's light.
    at : ndarray of shape (3,)
        Unit direction to a directional light, else position in mm.
    axis : ndarray of shape (3,)
        Where a spot or a facet points.
    cosines : tuple of 2 floats
        Cosines of a spot's outer and inner angle.
    color_rgb : ndarray of shape (3,)
        Irradiance facing it, or intensity in W/sr; for an environment the factor on what it gives to each texel.
    """

    kind: int
    light: int
    at: Float
    axis: Float
    cosines: tuple[float, float]
    color_rgb: Float


def shader_lights(lights: Sequence[LightSpec]) -> tuple[ShaderLight, ...]:
    """Sources that the specular pass evaluates for the look's lights.

    Directional, point and spot lights are themselves. A rectangle is four points at the centres of its quarters, each
    with a quarter of its power: good where it is far compared to its size, or the skin rough. An environment is
    mirrored as if its irradiance at the texel, with what the bake's oil kept back of it, came evenly from everywhere,
    times the oil's albedo A(N.V, m): exact for a constant environment without shadows, without any picture of the
    environment otherwise.
    """
    found = []
    for index, light in enumerate(lights):
        if isinstance(light, DirectionalLight):
            towards = -normalized(light.direction)
            found.append(
                ShaderLight(DIRECTIONAL, index, towards, np.array(_UP), (0.0, 1.0), np.array(light.irradiance))
            )
        elif isinstance(light, PointLight):
            at = np.array(light.position_mm, float)
            found.append(ShaderLight(POINT, index, at, np.array(_UP), (0.0, 1.0), np.array(light.intensity)))
        elif isinstance(light, SpotLight):
            outer, inner = np.cos(np.radians([light.outer_deg, light.inner_deg]))
            at, axis = np.array(light.position_mm, float), normalized(light.axis)
            found.append(ShaderLight(SPOT, index, at, axis, (float(outer), float(inner)), np.array(light.intensity)))
        elif isinstance(light, RectangleLight):
            u, v = np.array(light.edge_u_mm, float), np.array(light.edge_v_mm, float)
            area_vector = np.cross(u, v)
            power = np.array(light.radiance) * np.linalg.norm(area_vector) / 4
            for su, sv in ((-1, -1), (1, -1), (-1, 1), (1, 1)):
                at = np.array(light.position_mm, float) + su * u / 4 + sv * v / 4
                found.append(ShaderLight(FACET, index, at, normalized(area_vector), (0.0, 1.0), power))
        elif light.everywhere:
            found.append(ShaderLight(ENVIRONMENT, index, np.array(_UP), np.array(_UP), (0.0, 1.0), np.ones(3)))
    return tuple(found)


Gains = Mapping[str, "float | Sequence[float]"]


def gains_rgb(scene: PreviewScene, gains: Gains | None) -> Float:
    """Factor on each light of a scene, as `gains_of_lights`."""
    return gains_of_lights([light.name for light in scene.lights], scene.separate, gains)


def gains_of_lights(names: Sequence[str], separate: bool, gains: Gains | None) -> Float:
    """Factor on each light, shape (L, 3): 1 where `gains` does not name it.

    Parameters
    ----------
    names : sequence of str
        Of the lights.
    separate : bool
        Whether each light was stored on its own.
    gains : mapping of light name to float or RGB, optional

    Raises
    ------
    InputError
        A name that is no light of the look, a gain that is negative or not finite, or a bake that summed its lights.
    """
    if gains and not separate:
        raise InputError("--lights: this bake summed its lights; bake with output.lights: separate to change them live")
    rgb = np.ones((len(names), 3))
    for name, gain in (gains or {}).items():
        if name not in names:
            raise InputError(f"--lights: expected names among {', '.join(names)}, got {name}")
        value = np.asarray(gain, dtype=np.float64)
        if value.shape not in ((), (3,)) or not np.isfinite(value).all() or (value < 0).any():
            raise InputError(f"--lights: expected {name}=gain or {name}=r/g/b, each >= 0, got {gain}")
        rgb[names.index(name)] = value
    return rgb
