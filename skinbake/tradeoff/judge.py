"""Conclusions from measurements: errors, the Pareto front, the cheapest setting for a limit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from skinbake.numerics import Float, norm_of_all

LIMITS = (0.05, 0.02, 0.01, 0.005)


@dataclass(frozen=True)
class Row:
    """Measurements of one setting.

    Attributes
    ----------
    key, sweep, label, reference : str
        Identity of the setting, the knob it turns, its name in tables, and what it was measured against.
    overrides : tuple of str
        As given to `--set`.
    rms, p95, max : float
        Error of the diffuse light at the common probes: rms relative to the reference's, p95 and max to its mean.
    seconds : float
        Median over runs of the whole bake without its preview.
    stage_seconds : mapping
        Medians of its stages.
    peak_mib : float
        Largest resident size of the process that baked.
    bytes : int
        Size of the EXRs written.
    flip, ssim : float
        HDR-FLIP and structural similarity of the preview against the reference's; NaN where there was no picture.
    runs : int
    """

    key: str
    sweep: str
    label: str
    reference: str
    overrides: tuple[str, ...]
    rms: float
    p95: float
    max: float
    seconds: float
    peak_mib: float
    bytes: int
    flip: float
    ssim: float
    runs: int
    stage_seconds: Mapping[str, float] = field(default_factory=dict)


def difference(values: Float, wanted: Float) -> tuple[float, float, float]:
    """Difference of diffuse light from a reference.

    Parameters
    ----------
    values, wanted : ndarray of one shape
        By probe and channel.

    Returns
    -------
    rms, p95, max : float
        rms relative to that of `wanted`, p95 and max relative to its mean.

    Raises
    ------
    ValueError
        If the reference is black.
    """
    off = np.abs(values - wanted)
    norm, mean = norm_of_all(wanted), float(np.mean(np.abs(wanted)))
    if norm == 0 or mean == 0:
        raise ValueError("difference: expected a reference with some light")
    return norm_of_all(off) / norm, float(np.percentile(off, 95)) / mean, float(off.max()) / mean


def pareto_front(rows: Sequence[Row]) -> list[Row]:
    """Rows that no other beats in both seconds and error, fastest first.

    An error smaller by less than a hundredth is no gain.
    """
    front: list[Row] = []
    for row in sorted(rows, key=lambda row: (row.seconds, row.rms)):
        if np.isfinite(row.rms) and (not front or row.rms < 0.99 * front[-1].rms):
            front.append(row)
    return front


def cheapest(rows: Sequence[Row], limit: float) -> Row | None:
    """Fastest row whose rms is within `limit`, or None."""
    within = [row for row in rows if row.rms <= limit]
    return min(within, key=lambda row: row.seconds, default=None)
