"""Plan of a sky, decided by measuring: harmonics or a table, and how many directions for its shadows.

A tolerance is spent as a sum of squares: the harmonics' cut may take `HARMONICS_SHARE` of it, the interpolation between
traced texels takes about a third, and the directions' noise may take what these leave.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinbake.irradiance.environment_map import SkySamples, cosine_irradiance, irradiance_table, look_up
from skinbake.irradiance.harmonics import harmonic_matrix, light_by_harmonics
from skinbake.irradiance.sky_directions import all_around
from skinbake.irradiance.sky_points import SkyPoints
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, norm_of_all
from skinbake.scene.decision import Decision
from skinbake.scene.lights import EnvironmentLight

Image = NDArray[np.float32]
HARMONICS_SHARE = 0.25
VARIATION = 10.0  # tolerances by which the visible share may differ between texels that are interpolated
INTERPOLATED = 0.35  # tolerances, rms, that this costs; rays that count as settled cost 0.05, whose square is nothing
WIDEST_VARIATION = 0.2
MOST, FEWEST = 4096, 16  # directions
ROOM = 0.95  # of what may be left: fewer than a power of two are taken below that only, for terms that may need more
NORMALS = 512  # all around, at which the harmonics are compared


@dataclass(frozen=True)
class EnvironmentPlan:
    """Decisions on one sky.

    Attributes
    ----------
    sky : SkySamples
    offset : float
        Shift of its sequence, 0 ... 1.
    samples : int
        Directions traced from each texel; 0 where shadows are left out.
    variation : float
        Difference of the visible share up to which texels between traced ones are interpolated.
    matrix : ndarray of shape (3, 4, 4)
        Harmonics; of size 0 where the table is used.
    table : ndarray of shape (n, n, 3)
        Irradiance of all normals; of size 0 where harmonics are used.
    lines : tuple of Decision
    """

    sky: SkySamples
    offset: float
    samples: int
    variation: float
    matrix: Float
    table: Image
    lines: tuple[Decision, ...]

    def unshadowed(self, normal: Image, addressed: NDArray[np.bool_]) -> Image:
        """Irradiance of an open sky at unit normals (H, W, 3), zero where not addressed."""
        return _unshadowed(self.matrix, self.table, normal, addressed)


def plan_environment(
    light: EnvironmentLight,
    radiance: Image | None,
    points: SkyPoints,
    shadows: bool,
    tolerance: float,
    seed: int,
) -> EnvironmentPlan:
    """Decide how a sky is computed, by what each choice is measured to cost in accuracy.

    Parameters
    ----------
    light : EnvironmentLight
    radiance : ndarray of shape (h, w, 3), optional
        Map of a light with a path.
    points : SkyPoints
        The same for all skies.
    shadows : bool
        For a light that does not say. One that asks for shadows, or for `samples`, gets them.
    tolerance : float
        Rms error of the light that may be made.
    seed : int

    Raises
    ------
    ValueError
        If a light with a path comes without its map.
    """
    if light.radiance is not None:
        radiance = np.full((8, 16, 3), light.radiance, np.float32)
    if radiance is None:
        raise ValueError(f"light {light.name}: expected its radiance map, got none")
    matrix, table, line = _choose_unshadowed(light, radiance, tolerance)
    sky = SkySamples(radiance, light.rotate_deg)
    offset = (seed * 0x9E3779B97F4A7C15 + zlib.crc32(light.name.encode())) % 2**32 / 2**32
    samples, lines, noise = 0, [line], 0.0
    if light.casts(shadows):
        term = f"{light.name}.shadows"
        if light.samples is not None:
            samples, why = light.samples, f"{light.samples} directions, asked for"
        else:

            def unshadowed(normal: Image) -> Image:
                return _unshadowed(matrix, table, normal[None], np.ones((1, len(normal)), np.bool_))[0]

            limit = float(np.sqrt(tolerance**2 * (1 - INTERPOLATED**2) - line.error**2))
            samples, why, noise = _fewest_samples(sky, offset, points, unshadowed, limit, bool(light.shadows))
            if samples:
                noise = float(np.hypot(noise, INTERPOLATED * min(tolerance, WIDEST_VARIATION / VARIATION)))
        how = f"{samples} directions" if samples else "no shadows"
        lines.append(Decision(term, samples > 0, why, noise, how))
    variation = min(VARIATION * tolerance, WIDEST_VARIATION)
    return EnvironmentPlan(sky, offset, samples, variation, matrix, table, tuple(lines))


def _choose_unshadowed(light: EnvironmentLight, radiance: Image, tolerance: float) -> tuple[Float, Image, Decision]:
    """Matrix of the harmonics or table of all normals, the other of size 0, and the decision's line."""
    matrix = harmonic_matrix(radiance, light.rotate_deg)
    normal = all_around(NORMALS)
    exact = cosine_irradiance(radiance, light.rotate_deg, normal)
    series = np.zeros((1, NORMALS, 3), np.float32)
    light_by_harmonics(0, 1, matrix, normal[None].astype(np.float32), np.ones((1, NORMALS), np.bool_), series)
    error, limit = _relative(series[0], exact), HARMONICS_SHARE * tolerance
    kept = error <= limit
    why = f"order 2 is off by {error:.2%} rms of the exact cosine, {'within' if kept else 'above'} {limit:.2%}"
    table = np.zeros((0, 0, 3), np.float32) if kept else irradiance_table(radiance, light.rotate_deg)
    matrix = matrix if kept else np.zeros((3, 0, 0))
    return (
        matrix * light.scale,
        table * np.float32(light.scale),
        Decision(f"{light.name}.harmonics", kept, why, error if kept else 0.0, "harmonics" if kept else "table"),
    )


def _fewest_samples(
    sky: SkySamples,
    offset: float,
    points: SkyPoints,
    unshadowed: Callable[[Image], Image],
    limit: float,
    must: bool,
) -> tuple[int, str, float]:
    """Number of directions that keeps the rms error of the light within `limit`, 0 if shadows matter less, the reason,
    and the error that is left.

    They are doubled until they are enough; between the half and the whole, two halvings then find what is enough to an
    eighth. The noise of n directions is found from their distance to r n others, whose own noise is taken as r^-3/4 of
    it: between that of random directions, r^-1/2, and that of a low-discrepancy sequence, 1 / r. All ask the same few
    texels, whose shadows are traced once for all skies.
    """
    base, share = unshadowed(points.normal), points.shares(*sky.draw(FEWEST, offset))[:, :3]
    without = _relative(base, base * share)
    shadows = f"shadows take {without:.2%} rms off"
    if without <= limit and not must:
        return 0, f"{shadows}, no more than {limit:.2%}", without
    few = unshadowed(points.few_normal)

    def light(count: int, shift: float) -> Float:
        return np.asarray(few * points.few_shares(*sky.draw(count, shift % 1))[:, :3], np.float64)

    def noise(count: int) -> float:
        return _relative(light(count, offset), others) / float(np.sqrt(1 + (count / (4 * samples)) ** 1.5))

    samples, others, before = FEWEST, light(4 * FEWEST, offset + 0.5), ""
    while (error := noise(samples)) > limit:
        if samples == MOST:
            why = f"{shadows}; {samples} directions are off by {error:.2%}, the most there are, above {limit:.2%}"
            return samples, why, error
        before = f" ({samples} by {error:.2%})"
        samples *= 2
        others = light(4 * samples, offset + 0.5)
    too_few, enough = samples // 2, samples
    for _ in range(2 if samples > FEWEST else 0):
        middle = (too_few + enough) // 2
        of_middle = noise(middle)
        if of_middle <= ROOM * limit:
            enough, error = middle, of_middle
        else:
            too_few, before = middle, f" ({middle} by {of_middle:.2%})"
    return enough, f"{shadows}; {enough} directions are off by {error:.2%}{before}, within {limit:.2%}", error


def _unshadowed(matrix: Float, table: Image, normal: Image, addressed: NDArray[np.bool_]) -> Image:
    """Irradiance (H, W, 3) by the matrix if there is one, else by the table."""
    out = np.zeros((*addressed.shape, 3), np.float32)
    if matrix.size:
        parallel_for(light_by_harmonics, len(out), matrix, normal, addressed, out)
    else:
        parallel_for(look_up, len(out), table, normal, addressed, out)
    return out


def _relative(found: Image | Float, exact: Image | Float) -> float:
    """Rms of the difference over the rms of the exact; 0 where both are black."""
    difference = norm_of_all(np.asarray(found, np.float64) - exact)
    if difference == 0:
        return 0.0
    whole = norm_of_all(exact)
    return float(difference / whole) if whole > 0 else float("inf")
