"""What comes back of light at each slant, by the skin's medium: found once, then kept for every look of the user."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from skinbake.io.code_digest import code_digest
from skinbake.io.digests import key_of
from skinbake.io.user_cache import user_cache
from skinbake.profile import GaussianSum
from skinbake.profile.entered_skin import EnteredSkin
from skinbake.profile.incidence import Incidence
from skinbake.profile.skin_medium import SkinMedium, medium_incidence
from skinbake.scene.spec import TermsSpec


def entered_skin(
    gaussians: GaussianSum, medium: SkinMedium, terms: TermsSpec, say: Callable[[str], None] = lambda _: None
) -> EnteredSkin:
    """A skin as light enters it: with R(mu) where slanted light is to count and the medium is known.

    Parameters
    ----------
    gaussians : GaussianSum
    medium : SkinMedium
    terms : TermsSpec
    say : callable
        As of `incidence_table`.
    """
    slanted = terms.incidence != "off" and medium.layers
    return EnteredSkin(gaussians, medium, incidence_table(medium, say) if slanted else None)


def incidence_table(medium: SkinMedium, say: Callable[[str], None] = lambda _: None) -> Incidence:
    """R(mu) of a medium, from the user's cache or computed.

    Parameters
    ----------
    medium : SkinMedium
        With layers.
    say : callable
        Told when that begins.

    Raises
    ------
    ValueError
        If the medium has no layers.
    """
    key = key_of(code_digest("skinbake.profile.skin_medium"), medium.identity, medium.to_rgb is None)

    def find(names: tuple[str, ...]) -> dict[str, dict[str, NDArray[np.float64]]]:
        say("following light into the skin at every slant, once for this medium")
        return {name: dict(vars(medium_incidence(medium))) for name in names}

    if key not in _KNOWN:
        cache = user_cache()
        found = cache.get_many({"incidence": key}, find) if cache else find(("incidence",))
        _KNOWN[key] = Incidence(**{name: np.asarray(of, np.float64) for name, of in found["incidence"].items()})
    return _KNOWN[key]


_KNOWN: dict[str, Incidence] = {}  # of this process
