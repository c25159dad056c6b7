"""Bumps of a normal map at the terminator of the skin under them."""

from __future__ import annotations

from skinbake.kernels.compile import kernel

BUMP_GAIN = 4.0  # reached 14 degrees and nearer to the terminator, where a bump faces the light


@kernel(inline=True)
def bump_terminator(cos_mapped: float, cos_smooth: float) -> float:
    """Factor min(1, BUMP_GAIN cos_smooth / cos_mapped) for a bump that faces a light the skin under it turns away from.

    So bumps fade out at the terminator of the smooth surface instead of being cut off there; theory.md 10.1. Away from
    it all of them keep their cosine: a factor that is below 1 for every bump that faces the light better than the skin
    under it, as the one in [Chiang2019], takes energy off lit skin. The shader has the same formula, and the gain from
    here.

    Parameters
    ----------
    cos_mapped, cos_smooth : float
        Of the angle between the light and the normal with and without the normal map; `cos_mapped` above 0.
    """
    if cos_smooth <= 0.0:
        return 0.0
    return min(1.0, BUMP_GAIN * cos_smooth / cos_mapped)
