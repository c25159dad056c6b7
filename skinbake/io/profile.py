"""Writing profiles and fits: JSON, CSV, and the plot."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from skinbake.io.atomic import write_text
from skinbake.io.weight_table import KEY, table_csv, table_of_record, table_record
from skinbake.profile import Evaluated, FitReport, GaussianSum

EDGES = "edge_error_rgb"  # in profile.json


def profile_record(values: Evaluated) -> dict[str, Any]:
    """A profile at some radii as plain lists, keys as the `profile` verb prints them."""
    record = {
        "model": values.model,
        "radius_mm": values.radius_mm.tolist(),
        "reflectance_per_mm2": values.reflectance_per_mm2.tolist(),
        "transmittance_per_mm2": values.transmittance_per_mm2.tolist(),
        "total_reflectance": values.total_reflectance.tolist(),
        "total_transmittance": values.total_transmittance.tolist(),
        "sharp_transmittance": values.sharp_transmittance.tolist(),
    }
    if values.stderr_per_mm2 is not None and values.total_stderr is not None:
        record["stderr_per_mm2"] = values.stderr_per_mm2.tolist()
        record["total_stderr"] = values.total_stderr.tolist()
    return record


def profile_csv(values: Evaluated) -> str:
    """A profile at some radii as CSV: r_mm, R, G, B, then transmittance and, for transport, standard errors."""
    header = ["r_mm", "R", "G", "B", "T_R", "T_G", "T_B"]
    columns = [values.radius_mm[:, None], values.reflectance_per_mm2, values.transmittance_per_mm2]
    if values.stderr_per_mm2 is not None:
        header += ["stderr_R", "stderr_G", "stderr_B"]
        columns.append(values.stderr_per_mm2)
    return _csv(header, np.hstack(columns))


def fit_record(report: FitReport) -> dict[str, Any]:
    """A fit as plain lists: what profile.json holds."""
    gaussians = report.gaussians
    noise, footprint = report.profile.relative_noise, report.profile.footprint_mm
    return {
        "variance_mm2": gaussians.variance_mm2.tolist(),
        "weight_rgb": gaussians.weight_rgb.tolist(),
        "relative_error_rgb": report.relative_error_rgb.tolist(),
        "energy_rgb": report.energy_rgb.tolist(),
        "energy_ratio_rgb": report.energy_ratio_rgb.tolist(),
        "condition_number": report.condition_number,
        "largest_residual_rgb": report.largest_residual_rgb.tolist(),
        "largest_residual_radius_mm": report.largest_residual_radius_mm.tolist(),
        "model": gaussians.model,
        "normalise": gaussians.normalise,
        "tolerance": report.tolerance,
        "tolerance_met": report.tolerance_met,
        **({} if footprint == 0 else {"footprint_mm": footprint}),
        **({} if gaussians.edge_error_rgb is None else {EDGES: gaussians.edge_error_rgb.tolist()}),
        **({} if noise is None else {"noise_rgb": noise.tolist()}),
        **({} if gaussians.table is None else {KEY: table_record(gaussians.table)}),
    }


def fit_csv(report: FitReport) -> str:
    """Model (R, G, B) and fit (fit_R, fit_G, fit_B) at the plot's radii, in the unit of the fit; a table skin.

    What maps vary follows as lines that begin with #: nodes, their errors and weights.
    """
    curve = report.curve
    header = ["r_mm", "R", "G", "B", "fit_R", "fit_G", "fit_B"]
    curves = _csv(header, np.hstack([curve.radius_mm[:, None], curve.model_rgb, curve.fit_rgb]))
    gaussians = report.gaussians
    return curves if gaussians.table is None else curves + table_csv(gaussians.table, gaussians.variance_mm2)


def write_fit(report: FitReport, folder: Path | str, extra: dict[str, Any] | None = None) -> list[Path]:
    """Write profile.json, profile.csv and profile.png, each whole or not at all; their paths.

    Parameters
    ----------
    report : FitReport
    folder : path
    extra : dict, optional
        More keys for the JSON.

    Raises
    ------
    InputError, MachineError
        As `atomic_write`.
    """
    from skinbake.io.profile_plot import write_fit_plot

    folder = Path(folder)
    written = [folder / f"profile.{kind}" for kind in ("json", "csv", "png")]
    write_text(written[0], as_json(fit_record(report) | (extra or {})))
    write_text(written[1], fit_csv(report))
    write_fit_plot(written[2], report)
    return written


def read_gaussians(path: Path | str, key: str) -> GaussianSum | None:
    """Gaussians of a profile.json that was written under `key`; None where there is none, or an older one."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, ValueError):
        return None
    return gaussians_of_text(text, key)


def gaussians_of_text(text: str, key: str) -> GaussianSum | None:
    """Gaussians of what profile.json holds; None where it was written under another key, or is damaged."""
    try:
        record = json.loads(text)
        if record["key"] != key:
            return None
        told = [np.array(record[name], np.float64) for name in ("relative_error_rgb", "energy_rgb")]
        edges = np.array(record[EDGES], np.float64) if EDGES in record else None
        checked = told if edges is None else [*told, edges]
        if any(values.shape != (3,) or not np.isfinite(values).all() for values in checked):
            return None
        variance = np.array(record["variance_mm2"], np.float64)
        return GaussianSum(
            variance,
            np.array(record["weight_rgb"], np.float64),
            told[0],
            told[1],
            str(record["model"]),
            str(record["normalise"]),
            table_of_record(record.get(KEY), len(variance)),
            edges,
        )
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return None


def as_json(record: dict[str, Any]) -> str:
    """Indented JSON with a last newline; NaN and infinity are errors."""
    return json.dumps(record, indent=2, allow_nan=False) + "\n"


def _csv(header: list[str], rows: np.ndarray) -> str:
    """A header and rows as CSV."""
    return "\n".join([",".join(header), *(",".join(f"{value:.12g}" for value in row) for row in rows)]) + "\n"
