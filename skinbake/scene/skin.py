"""The `skin:` part of a look: a scattering model by name, with its own keys, and how to fit Gaussians to it."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from skinbake.scene.strict import Also, Fraction, NonNegative, Positive, Rgb, Strict

Eta = Annotated[float, Field(ge=1, le=3)]  # beyond 3 the published polynomial of F_dr runs off
Cosine = Annotated[float, Field(ge=0, lt=1)]
Thickness = Annotated[float, Field(ge=0, allow_inf_nan=True)]
LEAST_RADIUS, MOST_RADIUS = 0.05, 20.0  # factors on a profile's width: beyond, another skin is meant
MOST_MELANIN, MOST_HAEMOGLOBIN = 0.5, 0.1  # volume fractions that the model is about


def _one_for_all(value: Any) -> Any:
    return (value,) * 3 if isinstance(value, int | float) and not isinstance(value, bool) else value


PositiveRgb = Annotated[
    tuple[Positive, Positive, Positive], BeforeValidator(_one_for_all), Also("number", exclusiveMinimum=0)
]
FractionRgb = Annotated[
    tuple[Fraction, Fraction, Fraction], BeforeValidator(_one_for_all), Also("number", minimum=0, maximum=1)
]
SpreadRgb = Annotated[
    Rgb, BeforeValidator(_one_for_all), Also("number", minimum=0)
]  # one number stands for three equal ones


class FitSpec(Strict):
    """Number of Gaussians, or the r-weighted relative error (`tolerance`) that as few as possible, up to 12, must
    meet.
    """

    gaussians: Annotated[int, Field(ge=1, le=12)] | None = None
    """How many Gaussians are fitted; 6 by default, 4 in a draft (a tolerance of 0.05 and more) without `skin.fit`."""
    tolerance: Annotated[float, Field(gt=0, lt=1)] | None = None
    """Fit as few Gaussians as have this r-weighted relative error, at most 12."""
    signed: bool = False
    """Allow negative weights: a little closer, and rings at shadow edges."""
    energy: Literal["exact", "free"] = "exact"
    """`exact`: the weights add up to the model's total; `free`: they need not."""

    @model_validator(mode="before")
    @classmethod
    def _six_by_default(cls, value: Any) -> Any:
        if isinstance(value, dict):
            given = [key for key in ("gaussians", "tolerance") if value.get(key) is not None]
            if len(given) == 2:
                raise ValueError("expected either gaussians or tolerance, got both")
            if not given:
                return value | {"gaussians": 6}
        return value


class _Skin(Strict):
    normalise: Literal["white", "none"] = "white"
    """`white`: the weights add up to 1 and colour comes from the albedo alone; `none`: colour is that of the medium."""
    fit: FitSpec = FitSpec(gaussians=6)
    """How Gaussians are fitted to the profile."""
    radius: Annotated[float, Field(ge=LEAST_RADIUS, le=MOST_RADIUS)] = 1.0
    """Factor on the width of the profile, where `maps.radius` has no map."""
    scatter: Fraction = 1.0
    """Share of the light that scatters, where `maps.scatter` has no map; the rest leaves where it arrives."""


class LayerSpec(Strict):
    """One layer, coefficients in 1/mm. `g` makes no difference but in transport, which then uses sigma_sp / (1 - g)."""

    sigma_a_per_mm: SpreadRgb
    """Absorption coefficient, 1/mm, one number or R, G, B."""
    sigma_sp_per_mm: SpreadRgb
    """Reduced scattering coefficient, 1/mm, one number or R, G, B."""
    thickness_mm: Thickness = math.inf
    """Thickness, mm; the last layer may be without end."""
    eta: Eta = 1.4
    """Index of refraction over that of air."""
    g: Cosine = 0.0
    """Mean cosine of scattering; counts in walks only, which then scatter by sigma_sp / (1 - g)."""

    @model_validator(mode="after")
    def _something_happens(self) -> LayerSpec:
        if any(a + s == 0 for a, s in zip(self.sigma_a_per_mm, self.sigma_sp_per_mm, strict=True)):
            raise ValueError("expected sigma_a_per_mm or sigma_sp_per_mm above 0 in every channel, both are 0 in one")
        return self


class _Layered(_Skin):
    layers: Annotated[tuple[LayerSpec, ...], Field(min_length=1)]
    """From the top down; coefficients beside `model` stand for one layer without end."""

    @model_validator(mode="before")
    @classmethod
    def _single_medium(cls, value: Any) -> Any:
        """Coefficients beside `model` describe one semi-infinite layer, so that a dipole's preset suits every model."""
        keys = [key for key in LayerSpec.model_fields if isinstance(value, dict) and key in value]
        if keys and "layers" not in value:
            rest = {key: kept for key, kept in value.items() if key not in keys}
            return rest | {"layers": [{key: value[key] for key in keys}]}
        return value

    @model_validator(mode="after")
    def _reachable(self) -> _Layered:
        if any(math.isinf(layer.thickness_mm) for layer in self.layers[:-1]):
            raise ValueError(
                "layers: expected a finite thickness_mm in every layer but the last, got .inf above another"
            )
        if all(layer.thickness_mm == 0 for layer in self.layers):
            raise ValueError("layers: expected at least one layer with thickness_mm > 0, all are 0")
        return self


class MultipoleSkin(_Layered):
    """Layers joined by adding, theory.md 3.7 [Donner2005]."""

    model: Literal["multipole"]
    """Layers joined by adding [Donner2005]."""
    boundary: Literal["polynomial", "exact"] = "polynomial"
    """How much the surface reflects inwards: the published polynomial, or the integral."""
    thin_layers: Literal["guarded", "ballistic", "continued"] = "guarded"
    """What is done with layers thinner than their free path."""


class TransportSkin(_Layered):
    """Layers by Monte Carlo, theory.md 9.1 [Wang1995]: R(r) of light that enters at a point, per unit flux that
    entered.
    """

    model: Literal["transport"]
    """Layers by Monte Carlo [Wang1995]."""
    photons: Annotated[int, Field(ge=1, le=10**11)] = 400_000
    """A channel."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Of the walks."""
    incidence: Literal["perpendicular", "diffuse"] = "perpendicular"
    """How the light enters: a beam along the normal, or from everywhere, as a sky's light and light from skin do."""


class DipoleSkin(_Skin):
    """A semi-infinite medium [Jensen2001]; `variant: better` is d'Eon's, multiple scattering only [dEon2012]."""

    model: Literal["dipole"]
    """One medium without end [Jensen2001]."""
    sigma_a_per_mm: SpreadRgb
    """Absorption coefficient, 1/mm, one number or R, G, B."""
    sigma_sp_per_mm: SpreadRgb
    """Reduced scattering coefficient, 1/mm, one number or R, G, B."""
    eta: Eta = 1.3
    """Index of refraction over that of air."""
    variant: Literal["classic", "better"] = "classic"
    """`better` is d'Eon's, multiple scattering alone."""
    boundary: Literal["polynomial", "exact"] = "polynomial"
    """How much the surface reflects inwards: the published polynomial, or the integral."""

    @model_validator(mode="after")
    def _something_happens(self) -> DipoleSkin:
        LayerSpec(sigma_a_per_mm=self.sigma_a_per_mm, sigma_sp_per_mm=self.sigma_sp_per_mm)
        return self


class BurleySkin(_Skin):
    """Normalised diffusion [Burley2015]: `d_mm` outright, or `mean_free_path_mm` and `albedo_rgb` [Christensen2015]."""

    model: Literal["burley"]
    """Normalised diffusion [Burley2015]."""
    d_mm: PositiveRgb | None = None
    """Its length, mm, one number or R, G, B."""
    mean_free_path_mm: PositiveRgb | None = None
    """In place of `d_mm`: mean free path, mm, with `albedo_rgb`."""
    mean_free_path: Literal["searchlight", "diffuse", "surface"] = "searchlight"
    """Which free path that is: in the volume by a beam or by diffuse light, or along the surface."""
    albedo_rgb: FractionRgb = (1.0, 1.0, 1.0)
    """Albedo of the surface that the shape is for."""

    @model_validator(mode="after")
    def _one_length(self) -> BurleySkin:
        if (self.d_mm is None) == (self.mean_free_path_mm is None):
            raise ValueError("expected exactly one of d_mm and mean_free_path_mm (with albedo_rgb)")
        if self.mean_free_path_mm is not None and "albedo_rgb" not in self.model_fields_set:
            raise ValueError("mean_free_path_mm: expected albedo_rgb beside it, the shape depends on both")
        return self


class PhysiologySkin(_Skin):
    """Skin given by what it is made of; coefficients follow per wavelength and are turned to RGB, theory.md 3.9
    [Donner2006].
    """

    model: Literal["physiology"]
    """What skin is made of [Donner2006]."""
    melanin: Annotated[float, Field(ge=0, le=MOST_MELANIN)]
    """Volume fraction of melanin in the epidermis."""
    eumelanin: Fraction = 0.7
    """Brown share of the melanin; the rest is red."""
    haemoglobin: Annotated[float, Field(ge=0, le=MOST_HAEMOGLOBIN)] = 0.005
    """Volume fraction of blood in the dermis."""
    oxygenation: Fraction = 0.75
    """Share of the haemoglobin that carries oxygen."""
    epidermis_mm: Annotated[float, Field(ge=0)] = 0.25
    """Thickness of the epidermis, mm."""
    albedo: Literal["physiology"] | None = None
    """`physiology`: the albedo is what skin of this melanin and blood gives back, place by place, with their maps."""
    eta: Eta = 1.4
    """Index of refraction over that of air."""
    boundary: Literal["polynomial", "exact"] = "polynomial"
    """How much the surface reflects inwards: the published polynomial, or the integral."""


# The key that gives a model away when `model` is not written
_TELLING = {
    "layers": "multipole",
    "sigma_a_per_mm": "dipole",
    "sigma_sp_per_mm": "dipole",
    "d_mm": "burley",
    "mean_free_path_mm": "burley",
    "variance_mm2": "gaussians",
    "weight_rgb": "gaussians",
    "path": "table",
    "melanin": "physiology",
}


def _with_model(value: Any) -> Any:
    """The mapping with its `model`, found by a key that only one model has."""
    if isinstance(value, dict) and value.get("model") is None:
        models = {_TELLING[key] for key in value if key in _TELLING}
        if len(models) != 1:
            raise ValueError(
                "expected a preset, or a model: multipole, dipole, burley, gaussians, table, transport or physiology"
            )
        return {**value, "model": models.pop()}
    return value


MediumSpec = Annotated[
    MultipoleSkin | DipoleSkin | TransportSkin | PhysiologySkin,
    Field(discriminator="model"),
    BeforeValidator(_with_model),
]


class GaussiansSkin(_Skin):
    """Variances and weights as given; fitted again only where `fit` asks for it.

    `medium` is what they are of, for terms that a profile does not tell: slanted light, light through thin parts.
    """

    model: Literal["gaussians"]
    """Gaussians as given."""
    variance_mm2: Annotated[tuple[NonNegative, ...], Field(min_length=1)]
    """Variance of each, mm^2."""
    weight_rgb: Annotated[tuple[tuple[float, float, float], ...], Field(min_length=1)]
    """Weight of each, R, G, B."""
    medium: MediumSpec | None = None
    """What it is of, by its keys or a preset: for slanted light, and for light through thin parts."""
    """What they are of, for terms that a profile does not tell: a model with coefficients, or a preset."""

    @model_validator(mode="after")
    def _one_row_each(self) -> GaussiansSkin:
        if len(self.variance_mm2) != len(self.weight_rgb):
            got = f"{len(self.weight_rgb)} for {len(self.variance_mm2)}"
            raise ValueError(f"expected one row of weight_rgb for each variance_mm2, got {got}")
        return self


class TableSkin(_Skin):
    """A measured or computed profile: CSV with a header r_mm, R, G, B; `medium` as in `GaussiansSkin`."""

    model: Literal["table"]
    """A measured or computed profile."""
    path: str
    """CSV with the header r_mm, R, G, B."""
    medium: MediumSpec | None = None
    """What it is of, by its keys or a preset: for slanted light, and for light through thin parts."""
    """What it is of, as of `gaussians`."""


SkinSpec = Annotated[
    MultipoleSkin | DipoleSkin | BurleySkin | GaussiansSkin | TableSkin | TransportSkin | PhysiologySkin,
    Field(discriminator="model"),
    BeforeValidator(_with_model),
]
