"""SceneSpec: one look, parsed and checked. Field by field the configuration of the README."""

from __future__ import annotations

from collections import Counter
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationInfo, field_validator, model_validator
from pydantic_core import PydanticCustomError

from skinbake.scene.frames import frame_numbers
from skinbake.scene.lights import LightSpec
from skinbake.scene.skin import SkinSpec
from skinbake.scene.strict import Fraction, NonNegative, Positive, Strict

AUTO = "auto"  # the cheapest diffusion method for each lobe, as measured
# Key of the validation context: a function that gives, by name, whether a method knows sums that are not normalised
DIFFUSION_METHODS = "diffusion_methods"
MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "dm": 100.0, "m": 1000.0, "inch": 25.4}


Patterns = Annotated[tuple[str, ...], BeforeValidator(lambda value: [value] if isinstance(value, str) else value)]


class MeshFileSpec(Strict):
    """A mesh file and how it lies in the scene, whose y is up and whose face looks along z."""

    path: str
    unit: Literal["mm", "cm", "dm", "m", "inch", "file"] | None = None
    mm_per_unit: Positive | None = None
    up: Literal["y", "z"] | None = None  # which of the file's axes; by default what it says of itself, else y
    front: Literal["z", "-z", "x", "-x"] = "z"  # along which the face looks once up is up
    flip_v: bool = False
    uv_set: Annotated[int, Field(ge=0, le=63)] | None = None  # of a glTF; by default its material's
    time: Annotated[float, Field(ge=-1e6, le=1e6)] | None = None  # of a USD stage; by default its earliest

    @model_validator(mode="after")
    def _one_unit(self) -> MeshFileSpec:
        if (self.unit is None) == (self.mm_per_unit is None):
            raise ValueError("expected exactly one of unit (mm, cm, dm, m, inch, file) and mm_per_unit")
        return self

    @property
    def millimetres_per_unit(self) -> float | None:
        """Length of one mesh unit; None: the file says it."""
        return MM_PER_UNIT.get(str(self.unit), self.mm_per_unit)


OF_FILE = "file"  # in place of a path: what the mesh's own file holds


def _picture_of_all(value: Any) -> Any:
    """One picture as that of all parts."""
    return {"*": value} if isinstance(value, str) else value


class MeshSpec(MeshFileSpec):
    """The head, and what its file's parts are: names or patterns with * and ?.

    `skin` is baked; without it everything is that neither casts nor is ignored. `cast` shadows the skin, as does all
    that `skin` leaves out; `ignore` is as if it were not there. `opacity` is a picture for all that casts, or one for
    each name of a part: its alpha, or grey, says what stops light; `file` is the alpha of a glTF's own materials.
    """

    any_size: bool = False  # skips the scale gate, for test scenes that are not heads
    skin: Patterns = ()
    cast: Patterns = ()
    ignore: Patterns = ()
    opacity: Annotated[dict[str, str], BeforeValidator(_picture_of_all)] = Field({}, max_length=256)


class OccluderSpec(MeshFileSpec):
    """A file of things that shadow the skin: a hat, hair, glasses; those of its `parts` that match."""

    parts: Patterns = ("*",)
    opacity: str | None = None  # picture whose alpha, or grey, says what stops light; `file` as of a mesh


def _lower(value: Any) -> Any:
    return value.lower() if isinstance(value, str) else value


class FileMapSpec(Strict):
    """An image file. A bare path in the configuration means `{path: ...}`.

    `color_space` is auto (what the file says), srgb, linear (Rec.709, or plain data) or a name that OCIO knows;
    `layer` one of an EXR.
    """

    path: str
    color_space: str = "auto"
    layer: str | None = None


class MapSpec(FileMapSpec):
    """One texture map; `channel` is the one it is in, `invert` makes of x 1 - x."""

    channel: Annotated[Literal["r", "g", "b", "a"] | None, BeforeValidator(_lower)] = None
    invert: bool = False


class RoughnessMapSpec(MapSpec):
    """Beckmann m, or with `kind: ggx` the roughness r that glTF and painters mean, alpha = r^2."""

    kind: Literal["beckmann", "ggx"] = "beckmann"


class HeightMapSpec(MapSpec):
    """Heights of pores and wrinkles outwards, from 0 to `scale_mm`."""

    scale_mm: Annotated[float, Field(gt=-1000, lt=1000)]


Encoding = Literal["auto", "unsigned", "signed"]
Green = Literal["opengl", "directx"]


class NormalMapSpec(FileMapSpec):
    """Normal map with its conventions; `encoding` unsigned holds 0 ... 1 for -1 ... 1."""

    space: Literal["tangent", "object"] = "tangent"
    green: Green = "opengl"
    encoding: Encoding = "auto"
    strength: NonNegative = 1.0


class DetailMapSpec(FileMapSpec):
    """Tangent-space normals of a patch of skin; `repeat` times over a tile, or so often along u and along v."""

    repeat: tuple[Positive, Positive]
    green: Green = "opengl"
    encoding: Encoding = "auto"
    strength: NonNegative = 1.0

    @field_validator("repeat", mode="before")
    @classmethod
    def _both(cls, value: Any) -> Any:
        return (value, value) if isinstance(value, int | float) and not isinstance(value, bool) else value


def _path_as_map(value: Any) -> Any:
    """A bare path as the mapping it stands for."""
    return {"path": value} if isinstance(value, str) else value


Map = Annotated[MapSpec, BeforeValidator(_path_as_map)]
NormalMap = Annotated[NormalMapSpec, BeforeValidator(_path_as_map)]
RoughnessMap = Annotated[RoughnessMapSpec, BeforeValidator(_path_as_map)]
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
    vertex_colors: bool = False
    albedo: Map | None = None
    albedo_rgb: tuple[Fraction, Fraction, Fraction] | None = None
    normal: NormalMap | None = None
    roughness: RoughnessMap | None = None
    specular: Map | None = None
    height: HeightMap | None = None
    detail: DetailMap | None = None

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


Size = Annotated[int, Field(ge=1, le=32768)]


def _switch(value: Any) -> Any:
    """YAML 1.1 reads a bare on/off as a boolean."""
    return {True: "on", False: "off"}.get(value, value) if isinstance(value, bool) else value


Switch = Annotated[Literal["auto", "on", "off"], BeforeValidator(_switch)]


class TextureSpec(Strict):
    """The UV raster. `size` is an int or [width, height]."""

    size: tuple[Size, Size] = (2048, 2048)
    gutter: Annotated[int, Field(ge=0, le=256)] = 8
    udim: bool = False
    unwrap: Literal["none", "xatlas"] = "none"
    reduce: Annotated[Literal["auto", "off"], BeforeValidator(_switch)] = "auto"

    @model_validator(mode="after")
    def _one_tile_is_made(self) -> TextureSpec:
        if self.udim and self.unwrap != "none":
            raise ValueError("unwrap: makes one tile, expected udim: false")
        return self

    @field_validator("size", mode="before")
    @classmethod
    def _square(cls, value: Any) -> Any:
        if not isinstance(value, int | list | tuple) or isinstance(value, bool):
            raise ValueError("expected a whole number or [width, height]")
        return (value, value) if isinstance(value, int) else value


class DiffusionSpec(Strict):
    """Method of the blur, and the error that it may have.

    Methods are known to `skinbake.diffuse.methods` alone, which stands further right: whoever reads a look hands them
    in (`parse`, DIFFUSION_METHODS).
    """

    method: str = AUTO
    tolerance: Positive = 0.01
    separate: bool = True
    normalise: bool = True
    probes: Annotated[int, Field(ge=0, le=1_000_000)] = 2000

    @field_validator("method")
    @classmethod
    def _known(cls, name: str, info: ValidationInfo) -> str:
        if name != AUTO and info.context is not None:
            names = [AUTO, *info.context[DIFFUSION_METHODS]()]
            if name not in names:
                listed = ", ".join(map(repr, names[:-1])) + f" or {names[-1]!r}"
                raise PydanticCustomError("literal_error", "Input should be {expected}", {"expected": listed})
        return name

    @model_validator(mode="after")
    def _knows_the_classical_integral(self, info: ValidationInfo) -> DiffusionSpec:
        if not self.normalise and info.context is not None:
            classical = [name for name, knows in info.context[DIFFUSION_METHODS]().items() if knows]
            if self.method not in classical:
                raise ValueError(f"normalise: false needs method {' or '.join(classical)}, got {self.method}")
        return self


class TexturingSpec(Strict):
    """Where the albedo is multiplied: before the blur, after it, or split (`mix`: share before)."""

    mode: Literal["pre-scatter", "post-scatter", "mix"] = "pre-scatter"
    mix: Fraction = 0.5

    @property
    def exponent_before(self) -> float:
        """Exponent x of theory.md 5.1: albedo^x multiplies the irradiance before the blur, albedo^(1-x) after it."""
        return {"pre-scatter": 1.0, "post-scatter": 0.0, "mix": self.mix}[self.mode]


class SpecularSpec(Strict):
    """Oily layer: `roughness` is Beckmann m, `strength` rho_s (1/pi is the energy-true value)."""

    f0: Fraction = 0.028
    roughness: Annotated[float, Field(ge=1e-4, le=1)] = 0.3
    strength: Annotated[float, Field(ge=0, le=1000)] = 0.318


class TermsSpec(Strict):
    """Terms that only some scenes need. `bounces` of light from skin to skin, where `interreflection` is on."""

    energy_conservation: Switch = "auto"
    incidence: Switch = "auto"
    beam: Switch = "auto"
    interreflection: Switch = "auto"
    bounces: Annotated[int, Field(ge=1, le=16)] = 1
    transmission: Switch = "auto"


class OutputSpec(Strict):
    """Folder, format and content of what is written."""

    dir: Annotated[str, Field(min_length=1)]
    precision: Literal["half", "float"] = "half"
    compression: Literal["none", "rle", "zips", "zip", "piz"] = "zip"
    lights: Literal["separate", "total"] = "separate"
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    tx: bool = False

    @property
    def separate_lights(self) -> bool:
        """Whether each light is diffused and stored on its own."""
        return self.lights == "separate"


View = Literal["front", "left", "right", "three-quarter", "three-quarter-right", "back", "nose", "lips", "eyes", "ear"]
PictureSize = Annotated[int, Field(ge=1, le=8192)]
STOPS = 100
Shade = Annotated[float, Field(ge=0, le=1e6)]


class PreviewSpec(Strict):
    """Picture that a bake ends with; the verb `preview` can override it."""

    size: tuple[PictureSize, PictureSize] = (768, 960)
    view: View = "three-quarter"
    exposure: Annotated[float, Field(ge=-STOPS, le=STOPS)] = 0.0
    background_rgb: tuple[Shade, Shade, Shade] = (0.018, 0.019, 0.022)


class SceneSpec(Strict):
    """One look: everything that a bake is made from.

    `frames` bakes it once for each number, which stands for #### and %04d in its paths; a look that is baked has none.
    """

    mesh: MeshSpec
    occluders: tuple[OccluderSpec, ...] = ()
    maps: Annotated[MapsSpec, BeforeValidator(_file_as_source)] = MapsSpec()
    texture: TextureSpec = TextureSpec()
    skin: SkinSpec
    lights: Annotated[tuple[LightSpec, ...], Field(min_length=1, max_length=1024)]
    shadows: bool = True
    diffusion: DiffusionSpec = DiffusionSpec()
    texturing: TexturingSpec = TexturingSpec()
    specular: SpecularSpec = SpecularSpec()
    terms: TermsSpec = TermsSpec()
    output: OutputSpec
    preview: PreviewSpec = PreviewSpec()
    frames: Annotated[tuple[int, ...], BeforeValidator(frame_numbers)] | None = None

    @model_validator(mode="after")
    def _albedo(self) -> SceneSpec:
        """Decide the albedo of skin without a map, once for all who ask."""
        if self.maps.albedo_rgb is None:
            colour = SKIN_RGB if self.skin.normalise == "white" else (1.0, 1.0, 1.0)
            object.__setattr__(self, "maps", self.maps.model_copy(update={"albedo_rgb": colour}))
        return self

    @field_validator("lights")
    @classmethod
    def _names_differ(cls, lights: tuple[Any, ...]) -> tuple[Any, ...]:
        names = [light.name for light in lights]
        twice = sorted(name for name, count in Counter(names).items() if count > 1)
        if twice:
            raise ValueError(f"expected light names that differ, got {', '.join(twice)} more than once")
        return lights
