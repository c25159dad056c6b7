"""`skinbake truth CONFIG`: how far a bake is from light transport in the same skin."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import click

from skinbake.cli.options import config_argument, json_option, lit, out_option, quiet_option, set_option


@click.command("truth")
@config_argument
@out_option
@set_option
@click.option("--points", type=click.IntRange(1, 100_000), default=300, show_default=True, help="Points of the skin.")
@click.option(
    "--walks", type=click.IntRange(1, 10_000_000), default=1600, show_default=True, help="Walks a point and channel."
)
@click.option("--terms/--no-terms", default=True, help="Also bake without each term, to tell what it brings.")
@json_option
@quiet_option
def command(
    config: str,
    out: str | None,
    overrides: tuple[str, ...],
    points: int,
    walks: int,
    terms: bool,
    as_json: bool,
    verbosity: int,
) -> None:
    """Measure how far the bake of CONFIG is from light transport: random walks inside the closed mesh.

    Maps but those of the skin's width, melanin and blood are left out on both sides, and the skin keeps its medium's
    colour. Walks that were done are kept: a command that was stopped goes on where it was, and
    another number of Gaussians needs no others.
    """
    from skinbake.baking.truth import bare_look, measure_truth
    from skinbake.io.config import load_look
    from skinbake.io.fingerprint import every_input
    from skinbake.io.output_names import refuse_inputs
    from skinbake.io.truth import NAME, WALKS
    from skinbake.io.truth_plot import write_truth_chart

    look = lit(load_look(config, overrides, out))
    folder = Path(bare_look(look).output.dir)
    chart = folder / "truth.png"
    refuse_inputs([chart, folder / NAME, folder / WALKS], [config, *every_input(look)])
    truth = measure_truth(look, points, walks, terms, verbosity)
    write_truth_chart(chart, f"{Path(config).name}: {points} points, {walks} walks", truth["error"], truth["split"])
    if as_json:
        print(json.dumps({name: truth[name] for name in ("medium", "error", "without", "split")}, indent=1))
    elif verbosity:
        _print(truth["error"], truth["split"])
        print(f"{folder / 'truth.json'}, truth.png", file=sys.stderr)


FEW = 20  # points of a group that say little
_LEGEND = """\
Shares of each group's light. A figure after < is the noise of the walks, in which the error is
lost: more --walks say more. bias: by how much the bake is brighter. edges: within 3 mm of an edge
of light, cast edges: of a cast shadow, thin: flesh below 8 mm, creases: where skin sees much skin.
few: less than 20 points say little of such skin."""


def _print(error: dict[str, Any], split: dict[str, Any]) -> None:
    """Tables on the terminal."""
    from rich.console import Console
    from rich.table import Table

    def row(values: list[float]) -> str:
        return " ".join(f"{100 * value:.1f}" for value in values)

    def off(found: dict[str, Any]) -> str:
        """The rms of each channel; of one that is lost in the walks' noise, what it is below."""
        pairs = zip(found["rms_rgb"], found["stderr_rgb"], strict=True)
        return " ".join(f"<{100 * noise:.1f}" if rms < noise else f"{100 * rms:.1f}" for rms, noise in pairs)

    console = Console(soft_wrap=True, width=99)
    table = Table(title="the model's error: distance from light transport, rms % (R, G, B)")
    for column in ("skin", "points", "rms", "stderr", "bias"):
        table.add_column(column, justify="left" if column == "skin" else "right", no_wrap=True)
    for name, found in error.items():
        figures = (off(found), row(found["stderr_rgb"]), row(found["bias_rgb"]))
        few = found["points"] < FEW
        table.add_row(name, f"{'few: ' if few else ''}{found['points']}", *figures)
    console.print(table)
    console.print(_LEGEND, highlight=False)
    if not split:
        return
    table = Table(title="what each term takes off it, rms % (R, G, B)")
    for column in ("skin", "term", "takes off", "stderr"):
        table.add_column(column, justify="left" if column in ("skin", "term") else "right", no_wrap=True)
    for name, found in error.items():
        for place, (term, of) in enumerate(split.items()):
            share = of[name]
            table.add_row("" if place else name, term, row(share["rms_rgb"]), row(share["stderr_rgb"]))
        table.add_row("", "the rest", off(found), row(found["stderr_rgb"]), end_section=True)
    console.print(table)
