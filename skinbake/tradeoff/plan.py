"""Settings to measure around a look, and what each is measured against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinbake.diffuse.methods import METHODS
from skinbake.irradiance.decide import decide
from skinbake.profile.skin_medium import skin_medium
from skinbake.scene.skin import DipoleSkin, LayerSpec, MultipoleSkin, TransportSkin
from skinbake.scene.spec import SceneSpec

EXTENTS = ("quick", "default", "full")
FINEST = 12  # Gaussians of a reference
# Several knobs turned at once: share of the size, method, number of Gaussians
TOGETHER = ((0.5, "texture", 3), (0.5, "auto", 4), (0.25, "texture", 2), (1, "texture", 4), (0.5, "texture", 4))

KNOB, KNOB_VALUES = "tolerance", (0.05, 0.02, 0.01, 0.005, 0.003)  # from draft to final
NEAR_EXACT_RMS = 0.0010  # of the light that leaves, between such a bake and the exact integral of the same light
WHOLE = "every term"  # the reference that leaves out nothing that the knob may

Overrides = tuple[str, ...]


@dataclass(frozen=True)
class Reference:
    """Exact surface integral of a finest profile on a finest texture, against which rows are measured.

    Attributes
    ----------
    name : str
    overrides : tuple of str
        As given to `--set`; the integral takes light, profile, `separate` and `normalise` from them.
    meaning : str
        One sentence for the report.
    integral : bool
        False: a bake by these overrides instead, so fine that others may be judged by it.
    """

    name: str
    overrides: Overrides
    meaning: str
    integral: bool = True


@dataclass(frozen=True)
class Setting:
    """One bake to measure: the knob and its value, as overrides of a look, and the name of its reference."""

    sweep: str
    label: str
    overrides: Overrides
    reference: str


@dataclass(frozen=True)
class Sweep:
    """Everything one command measures. Settings with the same overrides are measured once and shown in each sweep.

    Attributes
    ----------
    references : tuple of Reference
    settings : tuple of Setting
    twice : tuple of str
        Overrides of the first reference on twice the texture size.
    """

    references: tuple[Reference, ...]
    settings: tuple[Setting, ...]
    twice: Overrides = ()  # of the first reference, on twice the texture size


def plan_sweep(spec: SceneSpec, size: tuple[int, int], extent: str = "default") -> Sweep:
    """Settings around a look, one knob at a time and a few together.

    Parameters
    ----------
    spec : SceneSpec
        The look.
    size : (width, height)
        Texture size the sweep is about; `twice` of the result tells what that size itself leaves out.
    extent : "quick", "default" or "full"
    """
    level = EXTENTS.index(extent)
    # Terms that `auto` decides by the tolerance must not change along the way
    oil = "on" if decide(spec).energy_conservation.enabled else "off"
    terms = ("incidence", "beam", "curvature", "interreflection", "diffuse_profile", "transmission")
    off = tuple(f"terms.{term}=off" for term in terms)
    base = (_size(size, 1), "texture.reduce=off", "diffusion.probes=0", *off, f"terms.energy_conservation={oil}")
    finest_skin = _finest_skin(spec)
    references = [
        Reference(
            WHOLE,
            (_size(size, 1), *near_exact(spec), *finest_skin),
            f"a bake of the finest profile on {size[0]} x {size[1]} texels at tolerance 0.001, with each term that the "
            f"look leaves to be decided, itself wrong by about {NEAR_EXACT_RMS:.2%} (rms)",
            integral=False,
        ),
        Reference(
            "finest",
            (*base, *finest_skin, *_samples(spec, 1024)),
            f"the surface integral of the finest profile (all of a given sum, else {FINEST} Gaussians) over the light "
            f"on {size[0]} x {size[1]} texels" + (", area lights with 1024 samples" if _area_lights(spec) else ""),
        ),
    ]
    settings: list[Setting] = []

    def add(sweep: str, label: str, *overrides: str, reference: str = "finest") -> None:
        settings.append(Setting(sweep, label, base + overrides, reference))

    # The one knob, with all that it governs: the size, the sky's directions, the terms
    whole = (_size(size, 1), "texture.reduce=auto", "diffusion.probes=0")
    for tolerance in KNOB_VALUES if level else (KNOB_VALUES[0], KNOB_VALUES[2]):
        settings.append(Setting(KNOB, f"{tolerance:g}", (*whole, f"diffusion.tolerance={tolerance}"), WHOLE))
    add("look", "the look as it is")
    for count in ((2, 4), (1, 2, 3, 4, 8), (1, 2, 3, 4, 5, 6, 8, 10, 12))[level]:
        add("Gaussians", f"{count}", f"skin.fit={{gaussians: {count}}}")
    methods = [m for m in METHODS.values() if m.asked_for and not m.exact and (m.classical or spec.diffusion.normalise)]
    for swept in methods if level else dict.fromkeys((methods[0], methods[-1])):  # the roughest and the finest
        add("method", swept.name, f"diffusion.method={swept.name}")
    for scale in ((0.5,), (0.25, 0.5), (0.125, 0.25, 0.5, 0.75))[level]:
        add("size", _size(size, scale).partition("=")[2].strip("[]").replace(", ", " x "), _size(size, scale))
    storage = {"float": "output.precision=float", "lights summed": "output.lights=total"}
    storage |= {"uncompressed": "output.compression=none", "zip": "output.compression=zip"}
    for label in list(storage)[: (1, 3, 4)[level]]:
        add("storage", label, storage[label])
    if _area_lights(spec):
        for samples in ((16,), (16, 64), (1, 4, 16, 64, 256, 1024))[level]:
            add("shadow samples", f"{samples}", *_samples(spec, samples))
    for scale, method, count in TOGETHER[: (1, 4, 5)[level]] if spec.diffusion.normalise else ():
        label = f"{round(size[0] * scale)}, {method}, {count} G"
        add("together", label, _size(size, scale), f"diffusion.method={method}", f"skin.fit={{gaussians: {count}}}")
    if level:
        # What is modelled is compared under one and the same light, whatever tolerance a reference is baked to
        same_light = (*base, *_samples(spec, 256))
        for reference, rows in _terms(spec, same_light, level):
            references.append(reference)
            settings += rows
        for reference, rows in _models(spec, same_light, level):
            references.append(reference)
            settings += rows
    twice = (_size(size, 2), *references[1].overrides[1:]) if level else ()
    return Sweep(tuple(references), tuple(settings), twice)


def near_exact(spec: SceneSpec) -> Overrides:
    """Overrides of a bake that leaves next to nothing to the one knob.

    It takes a third to a sixth of the seconds of the exact integral over the same light, and was `NEAR_EXACT_RMS` from
    it on the sample head at 256 x 256 and 512 x 512.
    """
    stored = ("output.lights=total", "output.precision=float")
    return ("diffusion.tolerance=0.001", "texture.reduce=off", *stored, *_samples(spec, 512))


def _size(size: tuple[int, int], scale: float) -> str:
    """Override that sets the texture's size to `scale` times `size`."""
    return "texture.size=[" + ", ".join(str(max(1, round(side * scale))) for side in size) + "]"


def _area_lights(spec: SceneSpec) -> list[str]:
    """Names of lights whose shadows are sampled."""
    return [light.name for light in spec.lights if light.type in ("rectangle", "environment")]


def _samples(spec: SceneSpec, samples: int) -> Overrides:
    """Overrides that give each such light a number of samples."""
    return tuple(f"lights.{name}.samples={samples}" for name in _area_lights(spec))


def _finest_skin(spec: SceneSpec) -> Overrides:
    """Override that fits as many Gaussians as there may be; none for a given sum, which stands for itself."""
    if spec.skin.model == "gaussians" and "fit" not in spec.skin.model_fields_set:
        return ()
    return (f"skin.fit={{gaussians: {FINEST}}}",)


def _terms(spec: SceneSpec, base: Overrides, level: int) -> list[tuple[Reference, list[Setting]]]:
    """Each term on (the reference) and off: what leaving it out costs."""
    on_off = {
        "energy conservation": ("terms.energy_conservation=on", "terms.energy_conservation=off"),
        "separate": ("diffusion.separate=true", "diffusion.separate=false"),
        "transmission": ("terms.transmission=on", "terms.transmission=off"),
        "interreflection": ("terms.interreflection=on", "terms.interreflection=off"),
    }
    if skin_medium(spec.skin).layers:
        on_off["incidence"] = ("terms.incidence=on", "terms.incidence=off")
        on_off["curvature"] = ("terms.curvature=on", "terms.curvature=off")
        on_off["beam"] = ("terms.beam=on", "terms.beam=off")
        on_off["diffuse profile"] = ("terms.diffuse_profile=on", "terms.diffuse_profile=off")
    if level == 2:
        on_off["shadows"] = ("shadows=true", "shadows=false")
    found = []
    for term, (on, off) in on_off.items():
        meaning = f"the surface integral of the finest profile at the sweep's size with {on.replace('=', ': ')}"
        if term == "transmission":
            meaning += ", plus the light that the bake itself finds coming through thin parts"
        reference = Reference(f"{term} on", (*base, *_finest_skin(spec), on), meaning)
        rows = [
            Setting("term", f"{term} {word}", (*base, value), reference.name)
            for word, value in (("on", on), ("off", off))
        ]
        found.append((reference, rows))
    return found


def _models(spec: SceneSpec, base: Overrides, level: int) -> list[tuple[Reference, list[Setting]]]:
    """Scattering models of one medium against transport in it."""
    skin = spec.skin
    media: dict[str, tuple[LayerSpec, ...]] = {}
    if isinstance(skin, DipoleSkin):
        media["the look's medium"] = (
            LayerSpec(sigma_a_per_mm=skin.sigma_a_per_mm, sigma_sp_per_mm=skin.sigma_sp_per_mm, eta=skin.eta),
        )
    elif isinstance(skin, MultipoleSkin | TransportSkin):
        media["the look's layers"] = skin.layers
    if level == 2:
        media |= NAMED_MEDIA
    elif not media:
        media = dict(list(NAMED_MEDIA.items())[-1:])
    # Pigments are of the look's own model alone
    base = (
        *base,
        *(f"maps.{name}=null" for name in ("melanin", "haemoglobin") if getattr(spec.maps, name) is not None),
    )
    photons = (10_000, 400_000, 4_000_000)[level]
    found = []
    for name, layers in media.items():
        flow = "[" + ", ".join(_layer(layer) for layer in layers) + "]"
        fit = f"fit: {{gaussians: {FINEST}}}"
        transport = f"skin={{model: transport, photons: {photons}, {fit}, layers: {flow}}}"
        reference = Reference(
            f"transport, {name}",
            (*base, transport),
            f"the surface integral of {FINEST} Gaussians fitted to Monte Carlo transport ({photons} photons a channel) "
            f"in {name}",
        )
        models = {"transport": transport}
        if len(layers) == 1:
            coefficients = flow[2:-2]
            for variant in ("classic", "better"):
                plain = ", ".join(part for part in coefficients.split(", thickness_mm")[:1])
                models[f"dipole, {variant}"] = (
                    f"skin={{model: dipole, variant: {variant}, {fit}, {plain}, eta: {layers[0].eta}}}"
                )
            models["multipole"] = f"skin={{model: multipole, {fit}, layers: {flow}}}"
        else:
            for treatment in ("guarded", "ballistic", "continued"):
                models[f"multipole, {treatment}"] = (
                    f"skin={{model: multipole, thin_layers: {treatment}, {fit}, layers: {flow}}}"
                )
        found.append(
            (reference, [Setting("model", f"{m}, {name}", (*base, skin), reference.name) for m, skin in models.items()])
        )
    return found


# Coefficients of configs/skins: a given sum of Gaussians has no medium that models could be compared in
NAMED_MEDIA = {
    "skin1 of Jensen 2001": (
        LayerSpec(sigma_a_per_mm=(0.032, 0.17, 0.48), sigma_sp_per_mm=(0.74, 0.88, 1.01), eta=1.3),
    ),
    "three layers of Donner 2005": (
        LayerSpec(sigma_a_per_mm=(0.21, 0.21, 0.5), sigma_sp_per_mm=(4.8, 6.0, 6.5), thickness_mm=0.25),
        LayerSpec(sigma_a_per_mm=(0.016, 0.019, 0.03), sigma_sp_per_mm=(3.2, 4.0, 4.6), thickness_mm=0.2),
        LayerSpec(sigma_a_per_mm=(0.0085, 0.1, 2.5), sigma_sp_per_mm=(0.45, 0.47, 0.48)),
    ),
}


def _layer(layer: LayerSpec) -> str:
    """A layer as YAML on one line."""
    thickness = ".inf" if np.isinf(layer.thickness_mm) else repr(layer.thickness_mm)
    return (
        f"{{sigma_a_per_mm: {list(layer.sigma_a_per_mm)}, sigma_sp_per_mm: {list(layer.sigma_sp_per_mm)}, "
        f"thickness_mm: {thickness}, eta: {layer.eta}, g: {layer.g}}}"
    )
