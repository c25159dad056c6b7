"""One budget for all that `auto` decides: what each choice leaves wrong adds up, as squares, to the tolerance at most.

Errors that know nothing of each other add up as squares. Lights stay live: each may be the only one that shines, so
that each has the whole tolerance for what is left out of its own light, and what all of them share counts for each.
The texture's size takes first; the rest is parted here, before anything is computed, into what the blur may take, what
the light of a sky or of a rectangle may, and what the terms of a light may that are left out. Nobody's part is kept for
who is not there. What costs next to nothing is not left out for its error, whatever the tolerance (`NEGLIGIBLE`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from math import hypot, sqrt
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skinbake.scene.decision import Decision
    from skinbake.scene.spec import DiffusionSpec, SceneSpec

# Parts of the square that the size leaves. A sky's directions get dearer soonest; a rectangle's rays have as much
BLUR, SKY, TERMS = 1.5, 3.5, 1.0
FIT = "fit"  # term of the plan
SKIN_TO_SKIN = 0.0018  # what light of a sky that skin sends on leaves, as finely as it is taken, on two heads
_LESS, _LEAST = 0.8, 0.5  # of its part, that the blur is given where others took more than theirs
DIGITS = 6  # of an error that bake.json holds
NEGLIGIBLE = 0.02  # of the tolerance: below this not even what costs next to nothing is computed


@dataclass(frozen=True)
class Budget:
    """Root mean square errors, as shares of a light, that may be made.

    Attributes
    ----------
    tolerance : float
        What all together may be wrong by.
    size : float
        Lost by a texture that is coarser than asked for.
    blur : float
        What the lobes may be wrong by: method and storage.
    sky : float
        What the light of a sky or of a rectangle may be wrong by.
    skies : frozenset of str
        Lights that take that, where nobody has said how many rays they have; the others leave it to their terms.
    """

    tolerance: float
    size: float
    blur: float
    sky: float
    skies: frozenset[str] = frozenset()

    @property
    def left(self) -> float:
        """What the size leaves."""
        return sqrt(max(self.tolerance**2 - self.size**2, 0.0))

    @property
    def sky_directions(self) -> float:
        """What the number of directions or rays may leave of `sky`: less where light from skin to skin needs more."""
        room = self.left**2 - self.blur**2 - SKIN_TO_SKIN**2
        return sqrt(min(max(room, self.sky**2 / 4), self.sky**2))

    @property
    def negligible(self) -> float:
        """Error below which a term is not worth even the little that it costs."""
        return NEGLIGIBLE * self.tolerance

    def terms_left(self, light: str, spent: float = 0.0) -> float:
        """What the terms of a light may be wrong by that are left out, less the root of squares `spent` already."""
        square = self.left**2 - self.blur**2 - (self.sky**2 if light in self.skies else 0.0)
        return sqrt(max(square - spent**2, 0.0))

    def of_blur(self, spec: DiffusionSpec, spent: float = 0.0) -> DiffusionSpec:
        """How the lobes are made, with the tolerance that is theirs.

        They are planned last: where the light took more than its part, they have to do with less, by steps, lest every
        light has sums of its own. Where that would not do, nothing is gained by it.

        Parameters
        ----------
        spec : DiffusionSpec
        spent : float, optional
            By all else.
        """
        blur = self.blur
        while hypot(blur, spent) > self.tolerance and blur * _LESS > _LEAST * self.blur:
            blur *= _LESS
        return spec.model_copy(update={"tolerance": blur if hypot(blur, spent) <= self.tolerance else self.blur})

    def record(self) -> dict[str, Any]:
        """As keys of stages hold it."""
        return asdict(self) | {"skies": sorted(self.skies)}


def budget_of(spec: SceneSpec, lost: float = 0.0) -> Budget:
    """Part the tolerance among what the look leaves to be decided.

    Parameters
    ----------
    spec : SceneSpec
    lost : float
        By a coarser texture.
    """
    terms = spec.terms
    sampled = [light for light in spec.lights if light.type in ("environment", "rectangle")]
    skies = frozenset(light.name for light in sampled if light.samples is None)
    # Light from skin to skin is as coarse as it may be, also where somebody has switched it on
    undecided = "auto" in (terms.beam, terms.transmission) or terms.interreflection != "off"
    whole = BLUR + (SKY if skies else 0.0) + (TERMS if undecided else 0.0)
    left = sqrt(max(spec.diffusion.tolerance**2 - lost**2, 0.0))
    sky = left * sqrt(SKY / whole) if skies else left
    # A method that is given has the same part: its sizes are still chosen, and terms would have nothing else
    return Budget(spec.diffusion.tolerance, lost, left * sqrt(BLUR / whole), sky, skies)


def is_within(wrong: float, tolerance: float) -> bool:
    """Whether an error keeps a tolerance: to a millionth, as bake.json holds errors, so that all its readers agree."""
    return round(wrong, DIGITS) <= tolerance


def left_wrong(plan: Iterable[Decision], lights: Iterable[str], blur: float) -> float:
    """Root mean square of all that the plan leaves wrong, of the light that it is worst for.

    How many Gaussians there are is the look's own choice (`skin.fit`), whose error stands beside.

    Parameters
    ----------
    plan : iterable of Decision
        Those of one light are named `LIGHT.term`; all others, and those of the sum `total`, count for each light.
    lights : iterable of str
    blur : float
        The blur's error.
    """
    shared, own = blur**2, dict.fromkeys(lights, 0.0)
    for line in plan:
        if line.term == FIT:
            continue
        name = line.term.rpartition(".")[0]
        if name in own:
            own[name] += line.error**2
        elif name in ("", "total"):
            shared += line.error**2
    return sqrt(shared + max(own.values(), default=0.0))
