"""Lights of a look, as the configuration gives them. Colours are linear Rec.709, lengths millimetres."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field, model_validator

from skinbake.scene.strict import LARGEST, NonNegative, Positive, Rgb, Strict, Vector

PARALLEL = 1e-6  # sine of the angle between two edges, below which they have no side


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
    """Its name: letters, digits, - and _."""
    shadows: bool | None = None
    """Whether it casts shadows; by default as the look says."""

    def casts(self, shadows: bool) -> bool:
        """Whether it casts shadows in a look that says `shadows`."""
        return shadows if self.shadows is None else self.shadows


class DirectionalLight(_Light):
    """Parallel light. `direction` is where it travels to; `irradiance` falls on a plane facing it."""

    type: Literal["directional"]
    """Parallel light, a sun."""
    direction: Direction
    """Where the light travels to: [0, 0, -1] shines into a face that looks along +z."""
    irradiance: Rgb
    """On a plane that faces it."""


class PointLight(_Light):
    """Point of radiant intensity W/sr: E = intensity cos / distance_mm^2."""

    type: Literal["point"]
    """A point."""
    position_mm: Vector
    """Where it is, mm."""
    intensity: Rgb
    """Radiant intensity, W/sr: E = intensity cos / distance_mm^2."""


class SpotLight(_Light):
    """Point light inside a cone about `axis`: full up to `inner_deg`, falling smoothly to 0 at `outer_deg` (half
    angles).
    """

    type: Literal["spot"]
    """A point in a cone."""
    position_mm: Vector
    """Where it is, mm."""
    intensity: Rgb
    """As of a point."""
    axis: Direction
    """Where it points."""
    inner_deg: Annotated[float, Field(ge=0, lt=180)] = 20.0
    """Half angle of the full beam, degrees."""
    outer_deg: Annotated[float, Field(gt=0, le=180)] = 30.0
    """Half angle at which it has faded, degrees."""

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
    """A window or a soft box, which shines to the side of cross(edge_u_mm, edge_v_mm)."""
    position_mm: Vector
    """Its centre, mm."""
    edge_u_mm: Direction
    """One edge, mm."""
    edge_v_mm: Direction
    """The other, mm."""
    radiance: Rgb
    """W/(sr m^2) on its one side."""
    samples: Annotated[int, Field(ge=1, le=4096)] | None = None
    """Shadow rays a texel; by default as many as the tolerance needs, from 36 on, 144 where `opacity` is used."""

    @model_validator(mode="after")
    def _has_area(self) -> RectangleLight:
        (ux, uy, uz), (vx, vy, vz) = (
            [of / math.hypot(*edge) for of in edge] for edge in (self.edge_u_mm, self.edge_v_mm)
        )
        if math.hypot(uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx) < PARALLEL:
            raise ValueError(f"expected edges that span an area, got {self.edge_u_mm} along {self.edge_v_mm}")
        return self


class EnvironmentLight(_Light):
    """Equirectangular radiance map, y up, u = 0.5 towards +z and 0.75 towards -x (as seen from inside).

    `radiance` gives a constant environment in place of a map. `rotate_deg` turns the map about +y, +z towards +x.
    `clamp` limits each channel of each texel, before `scale`; `color_space` and `layer` are as those of a map.
    """

    everywhere: ClassVar[bool] = True

    type: Literal["environment"]
    """A sky: a constant radiance or an equirectangular picture."""
    path: str | None = None
    """Picture, `.hdr` or `.exr`, twice as wide as high: its middle towards +z, u = 0.75 towards -x, its top row up."""
    color_space: str = "auto"
    """As of a map."""
    layer: str | None = None
    """Layer of an EXR."""
    clamp: Positive | None = None
    """Limit of each channel of each texel, before `scale`."""
    radiance: Rgb | None = None
    """Constant radiance, in place of a picture."""
    scale: NonNegative = 1.0
    """Factor on the radiance."""
    rotate_deg: Annotated[float, Field(ge=-3600, le=3600)] = 0.0
    """Turn about +y, degrees, +z towards +x."""
    samples: Annotated[int, Field(ge=1, le=4096)] | None = None
    """Directions that are traced for its shadows; by default as many as the tolerance needs."""

    @model_validator(mode="after")
    def _one_source(self) -> EnvironmentLight:
        if (self.path is None) == (self.radiance is None):
            raise ValueError("expected exactly one of path and radiance")
        return self


LightSpec = Annotated[
    DirectionalLight | PointLight | SpotLight | RectangleLight | EnvironmentLight, Field(discriminator="type")
]
