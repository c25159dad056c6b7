"""Decision: one line of the plan; Decisions: what follows from a look alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

from skinbake.scene.budget import Budget

TOTAL_LIGHT = "total"
NO_DIRECTIONS = "the irradiance was given, and with it no directions"


@dataclass(frozen=True)
class Decision:
    """One line of the plan.

    Attributes
    ----------
    term : str
        What was decided about.
    enabled : bool
        Whether the term is computed.
    why : str
        The number that decided, in a sentence.
    error : float
        Estimated root mean square, as a share of the light, that this choice leaves wrong.
    how : str
        How it is done, in a few words; empty where that is whether it is.
    """

    term: str
    enabled: bool
    why: str
    error: float = 0.0
    how: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "error", round(float(self.error), 6))  # as files hold it

    def record(self) -> dict[str, Any]:
        """The line as the manifest and the EXR headers hold it: `term`, `kept`, `why`, `error`, `how`."""
        return {"term": self.term, "kept": self.enabled, "why": self.why, "error": self.error, "how": self.how}

    @staticmethod
    def from_record(record: Mapping[str, Any]) -> Decision:
        """The line that `record` made.

        Raises
        ------
        KeyError, TypeError
            The mapping is not such a line.
        """
        if not all(isinstance(record[key], of) for key, of in (("term", str), ("kept", bool), ("why", str))):
            raise TypeError(f"expected a term, whether it is kept, and why, got {record!r:.100}")
        error = record.get("error", 0.0)
        if not isinstance(error, float | int) or not isfinite(error):
            raise TypeError(f"expected a number as error, got {error!r:.100}")
        return Decision(record["term"], record["kept"], record["why"], float(error), str(record.get("how", "")))


def uncounted_words(lines: Iterable[Mapping[str, Any]]) -> str:
    """What no sum of errors holds, since light was given without its directions; empty where nothing is missing.

    Parameters
    ----------
    lines : iterable of mapping
        The plan, as `Decision.record` gives it.
    """
    terms = [line["term"] for line in lines if NO_DIRECTIONS in line.get("why", "")]
    return f"{', '.join(terms)} left out and not counted, as the light was given without directions" if terms else ""


def kept_of_any_light(plan: Iterable[Decision], term: str) -> bool:
    """Whether a term that is decided light by light, as `NAME.term`, is computed for any of them."""
    return any(line.enabled for line in plan if line.term.endswith(f".{term}"))


@dataclass(frozen=True)
class Decisions:
    """What follows from a look alone, before anything is computed; made once by `decide` and passed on.

    Attributes
    ----------
    energy_conservation : Decision
        Whether the oil layer's share is taken off the light that enters the skin.
    separate_lights : bool
        Whether each light is diffused and stored on its own.
    stored_lights : tuple of str
        Names of the lights that lobes hold: those of the look, or "total" where they are summed before diffusion.
    budget : Budget
        How the tolerance is parted.
    texture_size : Decision, optional
        Whether the size that the look asks for is kept; None where its tolerance leaves no choice.
    """

    energy_conservation: Decision
    separate_lights: bool
    stored_lights: tuple[str, ...]
    budget: Budget
    texture_size: Decision | None = None

    @property
    def of_look(self) -> tuple[Decision, ...]:
        """The first lines of the plan."""
        return (*((self.texture_size,) if self.texture_size else ()), self.energy_conservation)
