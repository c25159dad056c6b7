"""`skinbake fit`: a skin's profile as a sum of Gaussians."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinbake.cli.options import config_argument, json_option, out_option, quiet_option, set_option

if TYPE_CHECKING:
    from skinbake.profile import FitReport


@click.command("fit")
@config_argument
@out_option
@json_option
@click.option(
    "--against", type=click.Path(dir_okay=False), help="CSV of another profile to compare the Gaussians with."
)
@set_option
@quiet_option
def command(
    config: str, out: str | None, as_json: bool, against: str | None, overrides: tuple[str, ...], verbosity: int
) -> None:
    """Fit a sum of Gaussians to a skin's profile, and say how good it is. CONFIG is a look, or just its skin part.

    A look whose tolerance makes it a draft is fitted as its bake is.

    With --out writes profile.json, profile.csv and profile.png there.
    """
    from skinbake.errors import ToleranceMissedError, printable
    from skinbake.io.config import load_skin
    from skinbake.io.output_names import FIT_FILES, refuse_foreign, refuse_inputs
    from skinbake.io.profile import as_json as dump
    from skinbake.io.profile import fit_record, write_fit
    from skinbake.io.table import read_profile_csv
    from skinbake.profile import fit_skin
    from skinbake.progress import Progress

    skin = load_skin(config, overrides, as_baked=True)
    if out:
        outputs = [Path(out) / name for name in FIT_FILES]
        refuse_inputs(outputs, filter(None, [config, getattr(skin, "path", None), against]))
        refuse_foreign(outputs)
    with Progress(verbosity > 0).task("fitting Gaussians to the skin"):
        report = fit_skin(skin, read_profile_csv(skin.path) if skin.model == "table" else None)
        extra = compare(report, against) if against else {}
        written = write_fit(report, out, extra) if out else []
    if as_json:
        click.echo(dump(fit_record(report) | extra), nl=False)
    elif verbosity:
        click.echo(printable(readable(report, extra)))
        for path in written:
            click.echo(printable(f"wrote {path}"))
    if not report.tolerance_met:
        raise ToleranceMissedError(
            f"fit.tolerance: no sum of up to 12 Gaussians meets {report.tolerance:g}; the best, of "
            f"{len(report.gaussians.variance_mm2)}, errs by {report.relative_error_rgb.max():.3g} in its worst channel"
        )


def compare(report: FitReport, path: str) -> dict[str, Any]:
    """Distance of the Gaussians from the profile of a CSV, as they are and with the best scale a channel."""
    from skinbake.io.table import read_profile_csv
    from skinbake.profile.fit_report import error_against
    from skinbake.profile.table import TableProfile

    error, scale, scaled = error_against(report.gaussians, TableProfile(*read_profile_csv(path)).fit_nodes())
    return {
        "against": {
            "path": path,
            "relative_error_rgb": error.tolist(),
            "best_scale_rgb": scale.tolist(),
            "relative_error_at_best_scale_rgb": scaled.tolist(),
        }
    }


def readable(report: FitReport, extra: dict[str, Any]) -> str:
    """The fit as a table for a person."""
    gaussians = report.gaussians
    sums = gaussians.weight_rgb.sum(axis=0)
    lines = [f"model {gaussians.model}, normalise {gaussians.normalise}", ""]
    lines.append(f"{'variance, mm^2':>15}{'sigma, mm':>12}   {'weight R':>10}{'G':>10}{'B':>10}")
    for variance, weight in zip(gaussians.variance_mm2, gaussians.weight_rgb, strict=True):
        lines.append(f"{variance:15.6g}{variance**0.5:12.5g}   " + "".join(f"{w:10.5f}" for w in weight))
    lines.append(f"{'sum':>27}   " + "".join(f"{w:10.5f}" for w in sums))
    lines += ["", _line("model reflects", report.energy_rgb, "{:10.5f}")]
    lines.append(_line("light kept", report.energy_ratio_rgb, "{:10.5f}"))
    lines.append(_line("relative error, %", 100 * report.relative_error_rgb))
    noise = report.profile.relative_noise
    if noise is not None:
        lines.append(_line("of it noise of the photons, %", 100 * noise))
    lines.append(_line("largest residual of r R, %", 100 * report.largest_residual_rgb))
    lines.append(_line("  at r, mm", report.largest_residual_radius_mm))
    lines.append(f"{'condition number':>27}   {report.condition_number:10.3g}")
    if extra:
        other = extra["against"]
        lines += ["", f"against {other['path']}"]
        lines.append(_line("relative error, %", [100 * e for e in other["relative_error_rgb"]]))
        lines.append(_line("best scale", other["best_scale_rgb"], "{:10.5f}"))
        lines.append(_line("  error at that scale, %", [100 * e for e in other["relative_error_at_best_scale_rgb"]]))
    return "\n".join(lines)


def _line(name: str, rgb: Any, form: str = "{:10.4g}") -> str:
    return f"{name:>27}   " + "".join(form.format(value) for value in rgb)
