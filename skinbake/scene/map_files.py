"""The maps of a look: image files and how they are read."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator, model_validator

from skinbake.scene.mesh_files import OF_FILE
from skinbake.scene.strict import Also, Fraction, NonNegative, Positive, Strict


def _lower(value: Any) -> Any:
    return value.lower() if isinstance(value, str) else value


class FileMapSpec(Strict):
    """An image file. A bare path in the configuration means `{path: ...}`.

    `color_space` is auto (what the file says), srgb, linear (Rec.709, or plain data) or a name that OCIO knows;
    `layer` one of an EXR.
    """

    path: str
    """Image file; `<UDIM>` or `<UVTILE>` in it stands for the number of a tile."""
    color_space: str = "auto"
    """`auto`: what the file says, else sRGB for 8 and 16 bits, linear for floats; `srgb`, `linear`, a name of OCIO."""
    layer: str | None = None
    """Layer of an EXR."""


class MapSpec(FileMapSpec):
    """One texture map; `channel` is the one it is in, `invert` makes of x 1 - x."""

    channel: Annotated[Literal["r", "g", "b", "a"] | None, BeforeValidator(_lower)] = None
    """Channel that the map is in, where a file packs several."""
    invert: bool = False
    """Read 1 - x in place of x: gloss for roughness."""


class RoughnessMapSpec(MapSpec):
    """Beckmann m, or with `kind: ggx` the roughness r that glTF and painters mean, alpha = r^2."""

    kind: Literal["beckmann", "ggx"] = "beckmann"
    """`beckmann`: m; `ggx`: the roughness r of glTF and of painting programs, m = r^2."""


class ScaledMapSpec(MapSpec):
    """A map of a quantity that may pass 1, or that uses little of it: `scale` is what white stands for."""

    scale: Positive = 1.0
    """What white stands for; with `invert`, what black does."""


class HeightMapSpec(MapSpec):
    """Heights of pores and wrinkles outwards, from 0 to `scale_mm`."""

    scale_mm: Annotated[float, Field(gt=-1000, lt=1000)]
    """Height of white above black, outwards, in mm; negative for maps that are deep where they are white."""


Encoding = Literal["auto", "unsigned", "signed"]
Green = Literal["opengl", "directx"]


class NormalMapSpec(FileMapSpec):
    """Normal map with its conventions; `encoding` unsigned holds 0 ... 1 for -1 ... 1."""

    space: Literal["tangent", "object"] = "tangent"
    """Tangent space of the UVs (MikkTSpace), or object space: along the axes of the mesh's file."""
    green: Green = "opengl"
    """Whether green points along v (`opengl`) or against it (`directx`)."""
    encoding: Encoding = "auto"
    """`unsigned` holds 0 ... 1 for -1 ... 1; `auto` decides by the kind of file."""
    strength: NonNegative = 1.0
    """Factor on the slopes, of tangent space alone."""

    @model_validator(mode="after")
    def _slopes(self) -> NormalMapSpec:
        if self.space == "object" and self.strength != 1:
            raise ValueError("expected strength beside space: tangent, whose slopes it scales, got space: object")
        return self


class DetailMapSpec(FileMapSpec):
    """Tangent-space normals of a patch of skin; `repeat` times over a tile, or so often along u and along v."""

    repeat: Annotated[tuple[Positive, Positive], Also("number", exclusiveMinimum=0)]
    """How often the patch fits into a tile, or [along u, along v]."""
    green: Green = "opengl"
    """As of a normal map."""
    encoding: Encoding = "auto"
    """As of a normal map."""
    strength: NonNegative = 1.0
    """Factor on the slopes."""

    @field_validator("repeat", mode="before")
    @classmethod
    def _both(cls, value: Any) -> Any:
        return (value, value) if isinstance(value, int | float) and not isinstance(value, bool) else value


def _path_as_map(value: Any) -> Any:
    """A bare path as the mapping it stands for."""
    return {"path": value} if isinstance(value, str) else value


Map = Annotated[MapSpec, BeforeValidator(_path_as_map), Also("string")]
NormalMap = Annotated[NormalMapSpec, BeforeValidator(_path_as_map), Also("string")]
RoughnessMap = Annotated[RoughnessMapSpec, BeforeValidator(_path_as_map), Also("string")]
ScaledMap = Annotated[ScaledMapSpec, BeforeValidator(_path_as_map), Also("string")]
HeightMap = Annotated[HeightMapSpec, BeforeValidator(_path_as_map)]
DetailMap = Annotated[DetailMapSpec, BeforeValidator(_path_as_map)]
SKIN_RGB = (0.57, 0.34, 0.25)  # linear Rec.709, of light skin: sRGB 198 157 137


def _file_as_source(value: Any) -> Any:
    """The text `file` as the mapping it stands for."""
    if isinstance(value, str) and value != OF_FILE:
        raise ValueError("expected a mapping of maps, or file for those of the mesh's own materials")
    return {"source": OF_FILE} if value == OF_FILE else value


class MapsSpec(Strict):
    """Maps of the skin; `maps: file` means `maps: {source: file}`.

    `source: file` takes base colour, normals and roughness from the mesh's own glTF materials where no map is given
    here. `vertex_colors: true` is the albedo that the mesh's vertices hold: linear in glTF, where it multiplies the
    base colour of `source: file`, sRGB in PLY and OBJ.
    `albedo_rgb` is the constant linear albedo used where there is no albedo map; a skin colour where it is not given,
    and white where the colour is that of the scattering medium (`skin.normalise: none`).
    """

    source: Literal["file"] | None = None
    """`file` takes base colour, normals and roughness of the glTF's materials where no map is given (`maps: file`)."""
    vertex_colors: bool = False
    """Albedo from the colours of the vertices: linear in glTF, sRGB in PLY and OBJ."""
    albedo: Map | None = None
    """Colour of the skin, as painted or photographed without light."""
    albedo_rgb: tuple[Fraction, Fraction, Fraction] | None = None
    """Linear albedo where there is no map: by default light skin, and white where `skin.normalise` is `none`."""
    normal: NormalMap | None = None
    """Normal map."""
    roughness: RoughnessMap | None = None
    """Roughness of the oil, in place of `specular.roughness`."""
    specular: Map | None = None
    """Factor on `specular.strength`."""
    cavity: Map | None = None
    """Where the oil is hidden in pores and folds, 0 to 1: another factor on `specular.strength`."""
    f0: ScaledMap | None = None
    """Reflectance of the oil at normal incidence, in place of `specular.f0`."""
    height: HeightMap | None = None
    """Heights of pores and wrinkles, which tilt the normals."""
    detail: DetailMap | None = None
    """Normals of a small patch of pores that is repeated."""
    scatter: Map | None = None
    """Share of the light that scatters: 1 in skin, 0 where it leaves where it arrives, as of nails and make-up."""
    radius: ScaledMap | None = None
    """Factor on the width of the profile, in place of `skin.radius`."""
    melanin: ScaledMap | None = None
    """Volume fraction of melanin, in place of `skin.melanin`, with `skin.model: physiology`."""
    haemoglobin: ScaledMap | None = None
    """Volume fraction of blood, in place of `skin.haemoglobin`, with `skin.model: physiology`."""

    @model_validator(mode="after")
    def _one_albedo(self) -> MapsSpec:
        if self.vertex_colors and self.albedo:
            raise ValueError("expected albedo or vertex_colors, got both")
        return self

    @model_validator(mode="after")
    def _one_space(self) -> MapsSpec:
        if self.normal and self.normal.space == "object" and (self.height or self.detail):
            raise ValueError("expected a normal map in tangent space beside height or detail, got space: object")
        return self

    def files(self) -> dict[str, FileMapSpec]:
        """Maps that come from image files, by their key."""
        found = {name: getattr(self, name) for name in type(self).model_fields}
        return {name: of for name, of in found.items() if isinstance(of, FileMapSpec)}


Maps = Annotated[MapsSpec, BeforeValidator(_file_as_source), Also("string")]
