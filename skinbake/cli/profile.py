"""`skinbake profile`: a skin's R(r), T(r) and totals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from skinbake.cli.options import config_argument, json_option, set_option

if TYPE_CHECKING:
    from skinbake.profile import Evaluated

RADII = "0.01,0.03,0.1,0.3,1,3,10"


@click.command("profile")
@config_argument
@click.option("--radii", default=RADII, show_default=True, metavar="MM,MM,...", help="Distances along the skin.")
@json_option
@click.option(
    "--csv", "as_csv", is_flag=True, help="Report as CSV on stdout; a `table` skin can read it, of close --radii."
)
@click.option("--photons", type=click.IntRange(min=1), help="Photons a channel, for model transport.")
@set_option
def command(
    config: str, radii: str, as_json: bool, as_csv: bool, photons: int | None, overrides: tuple[str, ...]
) -> None:
    """Evaluate R(r), T(r) and totals of a skin. CONFIG is a look, or just its skin part."""
    from skinbake.errors import InputError
    from skinbake.io.config import load_skin
    from skinbake.io.profile import as_json as dump
    from skinbake.io.profile import profile_csv, profile_record
    from skinbake.io.table import read_profile_csv
    from skinbake.profile import evaluate, profile_of
    from skinbake.progress import Progress

    if as_json and as_csv:
        raise InputError("--json and --csv: expected one of them, got both")
    radius = parse_radii(radii)
    skin = load_skin(config, overrides)
    if photons is not None and skin.model != "transport":
        raise InputError(
            f"--photons: expected a skin with model transport, got {skin.model}; add --set skin.model=transport"
        )
    table = read_profile_csv(skin.path) if skin.model == "table" else None
    with Progress().task("evaluating the profile"):
        values = evaluate(profile_of(skin, table, photons=photons), radius)
    if as_json:
        click.echo(dump(profile_record(values)), nl=False)
    elif as_csv:
        click.echo(profile_csv(values), nl=False)
    else:
        click.echo(readable(values))


def parse_radii(text: str) -> list[float]:
    """Radii of a comma-separated list.

    Raises
    ------
    InputError
        If one is not a finite number >= 0.
    """
    from math import inf

    from skinbake.errors import InputError

    radii = []
    for part in text.split(","):
        try:
            value = float(part)
        except ValueError:
            value = -1.0
        if not 0 <= value < inf:
            raise InputError(f"--radii: expected finite numbers >= 0 between commas, got {part.strip()!r}")
        radii.append(value)
    return radii


def readable(values: Evaluated) -> str:
    """The profile as a table for a person."""
    lines = [f"model {values.model}", "", f"{'r, mm':>9}" + _heads("R(r), 1/mm^2") + _heads("T(r), 1/mm^2")]
    for i, r in enumerate(values.radius_mm):
        lines.append(f"{r:9.4g}" + _row(values.reflectance_per_mm2[i]) + _row(values.transmittance_per_mm2[i]))
        if values.stderr_per_mm2 is not None:
            lines.append(f"{'+-':>9}" + _row(values.stderr_per_mm2[i]))
    lines.append(f"{'total':>9}" + _row(values.total_reflectance) + _row(values.total_transmittance))
    if values.total_stderr is not None:
        lines.append(f"{'+-':>9}" + _row(values.total_stderr))
    if values.sharp_transmittance.any():
        lines += ["", "of T, straight through:" + _row(values.sharp_transmittance)]
    return "\n".join(lines)


def _heads(name: str) -> str:
    return f"   {name:^33}"


def _row(rgb: object) -> str:
    return "   " + "".join(f"{value:11.4g}" for value in rgb)  # type: ignore[attr-defined]
