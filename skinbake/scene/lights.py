"""Lights of a look, as the configuration gives them. Colours are linear Rec.709, lengths millimetres."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field, model_validator

from skinbake.scene.strict import LARGEST, NonNegative, Positive, Rgb, Strict, Vector


def _has_length(vector: Vector) -> Vector:
    """The vector, refused if it has no direction."""
    length = math.hypot(*vector)
    if not 1 / LARGEST <= length <= LARGEST:
        raise ValueError(f"expected a direction that is not zero, {1 / LARGEST:g} to {LARGEST:g} long, got {length:g}")
    return vector


Direction = Annotated[Vector, AfterValidator(_has_length)]


class _Light(Strict):
    everywhere: ClassVar[bool] = False  # no direction or position: it comes from all sides at once

    name: str = Field(pattern=r"^[A-Za-z0-9_-]+$")
    shadows: bool | None = None  # None: as the look's `shadows`


class DirectionalLight(_Light):
    """Parallel light. `direction` is where it travels to; `irradiance` falls on a plane facing it."""

    type: Literal["directional"]
    direction: Direction
    irradiance: Rgb


class PointLight(_Light):
    """Point of radiant intensity W/sr: E = intensity cos / distance_mm^2."""

    type: Literal["point"]
    position_mm: Vector
    intensity: Rgb


class SpotLight(_Light):
    """Point light inside a cone about `axis`: full up to `inner_deg`, falling smoothly to 0 at `outer_deg` (half
    angles).
    """

    type: Literal["spot"]
    position_mm: Vector
    intensity: Rgb
    axis: Direction
    inner_deg: Annotated[float, Field(ge=0, lt=180)] = 20.0
    outer_deg: Annotated[float, Field(gt=0, le=180)] = 30.0

    @model_validator(mode="after")
    def _cone(self) -> SpotLight:
        if self.inner_deg >= self.outer_deg:
            raise ValueError(f"expected inner_deg < outer_deg, got {self.inner_deg} and {self.outer_deg}")
        return self


class RectangleLight(_Light):
    """Lambertian rectangle of one-sided `radiance` W/(sr m^2), edges `edge_u_mm` and `edge_v_mm` about its centre.

    It shines to the side of cross(edge_u_mm, edge_v_mm).
    """

    type: Literal["rectangle"]
    position_mm: Vector
    edge_u_mm: Direction
    edge_v_mm: Direction
    radiance: Rgb
    samples: Annotated[int, Field(ge=1, le=4096)] | None = None


class EnvironmentLight(_Light):
    """Equirectangular radiance map, y up, u = 0.5 towards +z and 0.75 towards -x (as seen from inside).

    `radiance` gives a constant environment in place of a map. `rotate_deg` turns the map about +y, +z towards +x.
    `clamp` limits each channel of each texel, before `scale`; `color_space` and `layer` are as those of a map.
    """

    everywhere: ClassVar[bool] = True

    type: Literal["environment"]
    path: str | None = None
    color_space: str = "auto"
    layer: str | None = None
    clamp: Positive | None = None
    radiance: Rgb | None = None
    scale: NonNegative = 1.0
    rotate_deg: Annotated[float, Field(ge=-3600, le=3600)] = 0.0
    samples: Annotated[int, Field(ge=1, le=4096)] | None = None

    @model_validator(mode="after")
    def _one_source(self) -> EnvironmentLight:
        if (self.path is None) == (self.radiance is None):
            raise ValueError("expected exactly one of path and radiance")
        return self


LightSpec = Annotated[
    DirectionalLight | PointLight | SpotLight | RectangleLight | EnvironmentLight, Field(discriminator="type")
]
