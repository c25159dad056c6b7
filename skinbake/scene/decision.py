"""Decision: one line of the plan; Decisions: what follows from a look alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

TOTAL_LIGHT = "total"


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
    """

    term: str
    enabled: bool
    why: str

    def record(self) -> dict[str, Any]:
        """The line as the manifest and the EXR headers hold it: `term`, `kept`, `why`."""
        return {"term": self.term, "kept": self.enabled, "why": self.why}

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
        return Decision(record["term"], record["kept"], record["why"])


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
    texture_size : Decision, optional
        Whether the size that the look asks for is kept; None where its tolerance leaves no choice.
    """

    energy_conservation: Decision
    separate_lights: bool
    stored_lights: tuple[str, ...]
    texture_size: Decision | None = None
