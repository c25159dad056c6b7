"""SceneSpec: one look, parsed and checked. Field by field the configuration of the README."""

from __future__ import annotations

from collections import Counter
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationInfo, field_validator, model_validator
from pydantic_core import PydanticCustomError

from skinbake.scene.frames import frame_numbers
from skinbake.scene.lights import LightSpec
from skinbake.scene.map_files import SKIN_RGB, Maps, MapsSpec
from skinbake.scene.mesh_files import MeshSpec, OccluderSpec
from skinbake.scene.output import OutputSpec, PreviewSpec
from skinbake.scene.skin import GaussiansSkin, PhysiologySkin, SkinSpec
from skinbake.scene.strict import Also, Between, Fraction, Strict

AUTO = "auto"  # the cheapest diffusion method for each lobe, as measured
# Key of the validation context: a function that gives, by name, whether a method knows sums that are not normalised
DIFFUSION_METHODS = "diffusion_methods"
MOST_BOUNCES = 16
AUTO_BOUNCES = 64  # most that `auto` goes on for: in a nostril of skin that hardly absorbs, each keeps 0.9 of the last
LARGEST_SIZE = 32768
Size = Annotated[int, Field(ge=1, le=LARGEST_SIZE)]


def _switch(value: Any) -> Any:
    """YAML 1.1 reads a bare on/off as a boolean."""
    return {True: "on", False: "off"}.get(value, value) if isinstance(value, bool) else value


Switch = Annotated[Literal["auto", "on", "off"], BeforeValidator(_switch), Also("boolean")]


class TextureSpec(Strict):
    """The UV raster. `size` is an int or [width, height]."""

    size: Annotated[tuple[Size, Size], Also("integer", minimum=1, maximum=LARGEST_SIZE)] = (2048, 2048)
    """Texels a side, or [width, height], of each tile."""
    gutter: Annotated[int, Field(ge=0, le=256)] = 8
    """Texels that are filled beyond the border of each chart."""
    udim: bool = False
    """Whether the UVs lie on several tiles, 1001 and on."""
    unwrap: Literal["none", "xatlas"] = "none"
    """`xatlas` makes a UV layout of its own; maps are read by the old one."""
    reduce: Annotated[Literal["auto", "off"], BeforeValidator(_switch), Also("boolean")] = "auto"
    """`auto` works at 1/4, 1/2 or 3/4 of `size` where the tolerance is above 1 % and allows it; `off` never."""

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


# Half floats alone leave 0.00014 of a blur on our heads, one bounce of skin lighting skin 0.001
DRAFT = 0.05  # from this tolerance on a bake is a draft: looked at, and made again
DRAFT_GAUSSIANS = 4  # by which its skin is fitted where the look leaves that open
Tolerance = Annotated[
    float, Between(1e-4, 1, "a share of the light: 0.01 is 1 %, less than 0.0001 is finer than light is stored")
]


class DiffusionSpec(Strict):
    """Method of the blur, and the error that it may have.

    Methods are known to `skinbake.diffuse.methods` alone, which stands further right: whoever reads a look hands them
    in (`parse`, DIFFUSION_METHODS).
    """

    method: str = AUTO
    """How lobes are blurred; `auto` takes the cheapest for each lobe, as measured on this head."""
    tolerance: Tolerance = 0.01
    """Root mean square error, a share of the light, of all that is left wrong: blur, texture size, omitted terms."""
    separate: bool = True
    """Keep apart what faces across air (lips, eyelids), so that neither lights the other through it."""
    normalise: bool = True
    """Divide each sum by that of its weights: constant light stays constant. `false` is the classical integral."""
    probes: Annotated[int, Field(ge=0, le=1_000_000)] | None = None
    """Places of the skin at which the blur is compared with the exact integral; 0 measures nothing, and the blur counts
    as wrong by all that it may be, so that less else is left out. By default 2000; the more the blur may be off the
    fewer, down to 400: a coarse error need not be known so closely."""

    @property
    def probe_count(self) -> int:
        """How many places: `probes`, else by the tolerance."""
        return min(max(round(10 / self.tolerance), 400), 2000) if self.probes is None else self.probes

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
    """Albedo before the blur (`pre-scatter`), after it (`post-scatter`), or split between them (`mix`)."""
    mix: Fraction = 0.5
    """Exponent of the albedo before the blur, with `mode: mix`."""

    @property
    def exponent_before(self) -> float:
        """Exponent x of theory.md 5.1: albedo^x multiplies the irradiance before the blur, albedo^(1-x) after it."""
        return {"pre-scatter": 1.0, "post-scatter": 0.0, "mix": self.mix}[self.mode]


class SecondLobeSpec(Strict):
    """Another roughness of the same oil: skin shines by two lobes, one broad, one of its film."""

    roughness: Annotated[float, Field(ge=1e-4, le=1)] = 0.15
    """Beckmann m of the second lobe, the same everywhere."""
    mix: Fraction = 0.15
    """Share of the second lobe; the rest is the first one's."""


class SpecularSpec(Strict):
    """Oily layer: `roughness` is Beckmann m, `strength` rho_s (1/pi is the energy-true value)."""

    f0: Fraction = 0.028
    """Reflectance of the oil at normal incidence, where there is no map."""
    roughness: Annotated[float, Field(ge=1e-4, le=1)] = 0.3
    """Beckmann m, where there is no map."""
    strength: Annotated[float, Field(ge=0, le=1000)] = 0.318
    """rho_s: factor on the reflection; 1 / pi is the value that keeps energy."""
    second: SecondLobeSpec | None = None
    """A second lobe, mixed with the first; what the oil keeps back counts both."""


def _bounces(value: Any) -> Any:
    """One message for both kinds of value."""
    if value == "auto" or (isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= MOST_BOUNCES):
        return value
    raise ValueError(f"expected auto or a whole number from 1 to {MOST_BOUNCES}")


Bounces = Annotated[Literal["auto"] | Annotated[int, Field(ge=1, le=MOST_BOUNCES)], BeforeValidator(_bounces)]


class TermsSpec(Strict):
    """Terms that only some scenes need. `bounces` of light from skin to skin, where `interreflection` is on."""

    energy_conservation: Switch = "auto"
    """Light that the oil reflects does not enter the skin."""
    incidence: Switch = "auto"
    """Light that enters at a slant comes back more than a profile says, which is that of a beam along the normal."""
    beam: Switch = "auto"
    """Light that enters at a slant scatters first a free path further along."""
    curvature: Switch = "auto"
    """Round skin sends back more of the light than flat skin, and hollows less."""
    interreflection: Switch = "auto"
    """Skin lights skin: in nostrils, between lips, behind the ear."""
    bounces: Bounces = "auto"
    """How often light goes from skin to skin; `auto` goes on until the tolerance allows to leave out the rest."""
    diffuse_profile: Switch = "auto"
    """Light of skies and from skin spreads further than the profile says: lobes weigh otherwise for it, by a little."""
    transmission: Switch = "auto"
    """Light through thin parts: ears, nostrils."""

    def bounces_for(self, limit: float, first: float) -> tuple[int, float]:
        """At most how many bounces, and which share of the first one may be left out.

        Parameters
        ----------
        limit : float
            Rms that may be left out, as a share of the light.
        first : float
            Rms of the first bounce, as a share of the same.
        """
        if self.bounces == "auto":
            # A tenth: once rays are traced, another bounce costs little; but no chase after a thousandth of the first
            return AUTO_BOUNCES, max(0.1 * limit / max(first, 1e-12), 1e-3)
        return self.bounces, 0.0


def _reuse(value: Any) -> Any:
    """The text `reuse` as the mapping it stands for."""
    if isinstance(value, str) and value != "reuse":
        raise ValueError(f"expected a mapping, or reuse, got {value}")
    return {"reuse": True} if value == "reuse" else value


class RelightSpec(Strict):
    """Transfer of light from everywhere, scattering included: after it any sky and any sun need no bake."""

    textures: Annotated[int, Field(ge=4, le=64)] = 25
    """The most textures; fewer where these keep the tolerance."""
    fewer: bool = True
    """Whether fewer are taken where these keep the tolerance; `false` takes `textures`, of harmonics the most whole
    orders in them."""
    size: Annotated[int, Field(ge=16, le=LARGEST_SIZE)] | None = None
    """Texels of the textures' longer side; by default 1024, or that of the texture where it is smaller."""
    tolerance: Tolerance = 0.02
    """Root mean square error that skies may have, as a share of their light, by which textures are counted; with
    `reuse`, that of their blur, too."""
    basis: Literal["auto", "harmonics", "fitted"] = "auto"
    """Spherical harmonics, or lights fitted to what this head tells apart; `auto` takes what needs fewer."""
    reuse: bool = False
    """Show the look's own lights by textures of the cache, as `relight: reuse` does, and store none; for batches."""


class SceneSpec(Strict):
    """One look: everything that a bake is made from.

    `frames` bakes it once for each number, which stands for #### and %04d in its paths; a look that is baked has none.
    """

    mesh: MeshSpec
    """The head."""
    occluders: tuple[OccluderSpec, ...] = ()
    """Other files that shadow it: hat, hair, glasses."""
    maps: Maps = MapsSpec()
    """Its textures; `file` takes those of the mesh."""
    texture: TextureSpec = TextureSpec()
    """The textures that are baked."""
    skin: SkinSpec
    """How the skin scatters."""
    relight: Annotated[RelightSpec | None, BeforeValidator(_reuse), Also("string")] = None
    """Also bake what any sky and any sun can be shown with; alone where there are no lights."""
    lights: Annotated[tuple[LightSpec, ...], Field(max_length=1024)]
    """What lights it; none only where there is `relight`."""
    shadows: bool = True
    """Whether lights cast shadows that do not say otherwise themselves."""
    tolerance: Tolerance | None = None
    """From draft (0.05) to final (0.003), the one knob: short for `diffusion.tolerance`."""
    diffusion: Annotated[DiffusionSpec, Field(validate_default=True)] = DiffusionSpec()
    """The blur and the error that the bake may have."""
    texturing: TexturingSpec = TexturingSpec()
    """Where the albedo is multiplied."""
    specular: SpecularSpec = SpecularSpec()
    """The oil on the skin."""
    terms: TermsSpec = TermsSpec()
    """What only some scenes need: `auto` weighs each against the tolerance, light by light."""
    output: OutputSpec
    """What is written, and where."""
    preview: PreviewSpec = PreviewSpec()
    """The picture that a bake ends with."""
    frames: Annotated[tuple[int, ...], BeforeValidator(frame_numbers), Also("string"), Also("integer")] | None = None
    """Numbers of a sequence, 1-24 or a list; each stands for #### and %04d in paths."""

    def light(self, name: str) -> LightSpec:
        """Its light of a name."""
        return next(light for light in self.lights if light.name == name)

    @property
    def packing(self) -> str:
        """How EXR files of light and lobes are packed, as `write_parts` takes it: `output.compression`, and what it
        leaves open by RLE, where they are the halves of a draft.
        """
        output = self.output
        quick = self.diffusion.tolerance >= DRAFT and output.precision == "half"
        return "rle" if output.compression == "auto" and quick else output.compression

    @model_validator(mode="after")
    def _albedo(self) -> SceneSpec:
        """Decide the albedo of skin without a map, once for all who ask; a skin that has its own colour has none."""
        own = isinstance(self.skin, PhysiologySkin) and self.skin.albedo is not None
        if self.maps.albedo_rgb is None and not own:
            colour = SKIN_RGB if self.skin.normalise == "white" else (1.0, 1.0, 1.0)
            object.__setattr__(self, "maps", self.maps.model_copy(update={"albedo_rgb": colour}))
        return self

    @model_validator(mode="after")
    def _fewer_gaussians(self) -> SceneSpec:
        """A draft's skin is fitted by fewer of them."""
        object.__setattr__(self, "skin", fitted_for(self.skin, self.diffusion.tolerance))
        return self

    @model_validator(mode="after")
    def _skin_that_its_maps_vary(self) -> SceneSpec:
        """Which maps go with which skins, and with one another."""
        maps, skin = self.maps, self.skin
        pigments = [name for name in ("melanin", "haemoglobin") if getattr(maps, name) is not None]
        if pigments and not isinstance(skin, PhysiologySkin):
            raise ValueError(f"maps.{pigments[0]}: expected skin.model: physiology beside it, got {skin.model}")
        if pigments and maps.radius is not None:
            raise ValueError(f"maps.radius: expected no maps.{pigments[0]} beside it: a table has the one or the other")
        if isinstance(skin, PhysiologySkin) and skin.albedo is not None:
            if skin.normalise == "none":
                raise ValueError("skin.albedo: expected skin.normalise: white beside it: none has the colour already")
            given = [name for name in ("albedo", "albedo_rgb", "vertex_colors") if getattr(maps, name)]
            if given:
                raise ValueError(f"skin.albedo: expected no maps.{given[0]} beside it, which says the colour, too")
        return self

    @model_validator(mode="after")
    def _scatter_needs_a_norm(self) -> SceneSpec:
        """Sources that weigh less are told apart from places without skin by the sum of weights alone."""
        if self.maps.scatter is not None and not self.diffusion.normalise:
            raise ValueError("expected diffusion.normalise: true beside maps.scatter, got false")
        return self

    @model_validator(mode="after")
    def _one_tolerance(self) -> SceneSpec:
        """What the look's own `tolerance` says has gone to where it is read."""
        object.__setattr__(self, "tolerance", None)
        return self

    @field_validator("diffusion")
    @classmethod
    def _with_tolerance(cls, diffusion: DiffusionSpec, info: ValidationInfo) -> DiffusionSpec:
        given = info.data.get("tolerance")
        if given is None or given == diffusion.tolerance:
            return diffusion
        if "tolerance" in diffusion.model_fields_set:
            raise ValueError(
                f"tolerance: expected the same as the look's `tolerance`, {given:g}, or one of the two, got "
                f"{diffusion.tolerance:g}"
            )
        return diffusion.model_copy(update={"tolerance": given})

    @field_validator("relight")
    @classmethod
    def _no_larger(cls, relight: RelightSpec | None, info: ValidationInfo) -> RelightSpec | None:
        largest = max(info.data["texture"].size) if "texture" in info.data else LARGEST_SIZE
        if relight and relight.size is not None and relight.size > largest:
            raise ValueError(f"expected a size of at most that of the texture, {largest}, got {relight.size}")
        return relight

    @field_validator("output")
    @classmethod
    def _lights_to_export(cls, output: OutputSpec, info: ValidationInfo) -> OutputSpec:
        if output.export and info.data.get("lights") == ():
            raise ValueError("expected no export of a look whose lights all come later, got output.export")
        return output

    @field_validator("terms")
    @classmethod
    def _not_beside_relight(cls, terms: TermsSpec, info: ValidationInfo) -> TermsSpec:
        if info.data.get("relight") and terms.beam == "on":
            raise ValueError("expected terms.beam: auto or off beside relight, which knows no beams, got on")
        if info.data.get("relight") and terms.diffuse_profile == "on":
            raise ValueError(
                "expected terms.diffuse_profile: auto or off beside relight, of one profile for all, got on"
            )
        return terms

    @field_validator("lights")
    @classmethod
    def _names_differ(cls, lights: tuple[Any, ...], info: ValidationInfo) -> tuple[Any, ...]:
        relight = info.data.get("relight")
        refused = "relight" not in info.data  # which is told by itself
        if not lights and not refused and (relight is None or relight.reuse):
            raise ValueError("expected at least one light, or relight for those that come later, got none")
        names = [light.name for light in lights]
        twice = sorted(name for name, count in Counter(names).items() if count > 1)
        if twice:
            raise ValueError(f"expected light names that differ, got {', '.join(twice)} more than once")
        return lights


def fitted_for(skin: SkinSpec, tolerance: float) -> SkinSpec:
    """A skin as a look of a tolerance fits it: in a draft by fewer Gaussians, unless it says how it is fitted."""
    given = "fit" in skin.model_fields_set or isinstance(skin, GaussiansSkin)
    if tolerance < DRAFT or given:
        return skin
    return skin.model_copy(update={"fit": skin.fit.model_copy(update={"gaussians": DRAFT_GAUSSIANS})})
