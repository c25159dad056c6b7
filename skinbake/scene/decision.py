"""Decision: one line of the plan."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Decision:
    """One decision: what was kept or left out, and the number that decided it."""

    term: str
    kept: bool
    why: str
