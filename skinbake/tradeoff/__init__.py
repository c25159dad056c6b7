"""Settings to measure around a look, and conclusions from the measurements. Nothing is run here."""

from skinbake.tradeoff.judge import LIMITS, Row, cheapest, difference, pareto_front
from skinbake.tradeoff.plan import EXTENTS, KNOB, WHOLE, Reference, Setting, Sweep, plan_sweep

__all__ = [
    "EXTENTS",
    "KNOB",
    "LIMITS",
    "WHOLE",
    "Reference",
    "Row",
    "Setting",
    "Sweep",
    "cheapest",
    "difference",
    "pareto_front",
    "plan_sweep",
]
