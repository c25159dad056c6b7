"""Which lights a transfer is made of: harmonics or fitted ones, as few as the tolerance allows or as many as asked."""

from __future__ import annotations

import math

import numpy as np

from skinbake.numerics import Float
from skinbake.relight.basis import LightBasis, harmonic_basis
from skinbake.relight.fitted_basis import fitted_basis, gram
from skinbake.relight.grey_lights import lights_in
from skinbake.scene.decision import Decision
from skinbake.scene.spec import RelightSpec

HIGHEST = 6  # order of harmonics


def choose_basis(spec: RelightSpec, irradiance: Float, sky_harmonics: Float, seed: int) -> tuple[LightBasis, Decision]:
    """The smaller of the two bases that keep skies within the tolerance; else the one that errs less.

    Parameters
    ----------
    spec : RelightSpec
    irradiance : ndarray of shape (points, J)
        At points of equal area, under each harmonic.
    sky_harmonics : ndarray of shape (J, S)
        Of some skies that will not judge the basis.
    seed : int
    """
    products = gram(irradiance) / max(len(irradiance), 1)
    options: list[tuple[float, int, LightBasis]] = []
    told = []
    sky_irradiance = irradiance @ sky_harmonics
    whole = np.maximum((sky_irradiance**2).sum(axis=0), 1e-30)

    def errors(basis: LightBasis) -> Float:
        """With the first light alone, with two, ... all of them."""
        size = basis.of_harmonics.shape[1]
        lit, amount = irradiance[:, :size] @ basis.radiance, basis.of_harmonics @ sky_harmonics[:size]
        wrong, found = sky_irradiance.copy(), []
        for k in range(len(basis)):
            wrong -= np.outer(lit[:, k], amount[k])
            found.append(np.sqrt(((wrong**2).sum(axis=0) / whole).mean()))
        return np.array(found)

    if spec.basis != "fitted":
        orders = range(1, min(HIGHEST, math.isqrt(spec.textures) - 1) + 1)
        found = [(float(errors(basis)[-1]), basis) for basis in map(harmonic_basis, orders)]
        rms, basis = next((each for each in found if spec.fewer and each[0] <= spec.tolerance), found[-1])
        options.append((rms, len(basis), basis))
        told.append(f"{len(basis)} harmonics {rms:.2%}")
    if spec.basis != "harmonics":
        basis = fitted_basis(products, min(sum(lights_in(spec.textures)), irradiance.shape[1]), seed)
        of_count = errors(basis)
        found_in = {count: float(of_count[sum(lights_in(count)) - 1]) for count in range(1, spec.textures + 1)}
        enough = (count for count, rms in found_in.items() if spec.fewer and rms <= spec.tolerance)
        count = next(enough, spec.textures)
        rms, basis = found_in[count], first(basis, count)
        options.append((rms, count, basis))
        told.append(f"{count} fitted {rms:.2%}")
    within = [each for each in options if spec.fewer and each[0] <= spec.tolerance]
    rms, _, basis = min(within, key=lambda each: each[1]) if within else min(options, key=lambda each: each[0])
    verdict = f"within {spec.tolerance:.2%}" if within else f"the most asked for, above {spec.tolerance:.2%}"
    verdict = verdict if spec.fewer else "as many as asked for"
    why = f"{spec.basis}: of skies before scattering {' or '.join(told)} are off, {verdict}"
    return basis, Decision(f"relight.{basis.kind}", True, why)


def first(basis: LightBasis, textures: int) -> LightBasis:
    """The first lights of a fitted basis, the best of them, as many as so many textures hold."""
    coloured, grey = lights_in(textures)
    count = coloured + grey
    return LightBasis(basis.kind, basis.of_harmonics[:count], basis.radiance[:, :count], grey)
