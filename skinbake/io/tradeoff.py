"""Files of a trade-off: every run as it ends, then a table for programs and one for people."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from skinbake.io.atomic import atomic_write, write_text
from skinbake.tradeoff import KNOB, LIMITS, Row, Sweep, cheapest, pareto_front

RUNS = "tradeoff.runs.jsonl"
STAGES = ("profile", "read", "raster", "irradiance", "diffuse", "write")
COLUMNS = ("sweep", "setting", "reference", "rms", "p95", "max", "seconds", *(f"{stage}_s" for stage in STAGES))
COLUMNS += ("peak_mib", "bytes", "flip", "ssim", "runs", "overrides", "key")


def read_runs(folder: Path) -> dict[str, list[dict[str, Any]]]:
    """Runs of earlier commands by the key of their setting; a line that was cut short is left out."""
    runs: dict[str, list[dict[str, Any]]] = {}
    path = folder / RUNS
    if path.is_file():
        for line in path.read_text(encoding="utf-8").splitlines():
            try:
                run = json.loads(line)
                runs.setdefault(run["key"], []).append(run)
            except (ValueError, KeyError, TypeError):
                continue
    return runs


def append_run(folder: Path, run: dict[str, Any]) -> None:
    """Add one run to the file; at worst a kill costs this line."""
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / RUNS, "a", encoding="utf-8") as file:
        file.write(json.dumps(run) + "\n")


def write_reference(path: Path, found: dict[str, Any]) -> None:
    """Write the values at the probes and the picture, for a command that takes up where this one stopped."""
    arrays = {name: array for name, array in found.items() if array is not None}
    with atomic_write(path) as temporary:
        np.savez_compressed(temporary, **arrays)


def read_reference(path: Path) -> dict[str, Any] | None:
    """Values and picture that `write_reference` wrote; None where there is nothing that can be read."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except Exception:  # a damaged archive is seen as one of many errors
        return None


def write_tables(folder: Path, title: str, sweep: Sweep, rows: Sequence[Row], note: str) -> None:
    """Write tradeoff.csv and tradeoff.md.

    Parameters
    ----------
    folder : Path
    title : str
    sweep : Sweep
    rows : sequence of Row
    note : str
        Paragraph below the title.

    Raises
    ------
    InputError, MachineError
        As `atomic_write`.
    """
    write_text(folder / "tradeoff.csv", _csv(rows))
    write_text(folder / "tradeoff.md", "\n".join(_markdown(title, sweep, rows, note)) + "\n")


def _csv(rows: Iterable[Row]) -> str:
    """Rows as CSV."""
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerow(COLUMNS)
    for row in rows:
        stages = [f"{row.stage_seconds.get(stage, 0.0):.4f}" for stage in STAGES]
        table.writerow(
            [
                row.sweep,
                row.label,
                row.reference,
                *(f"{x:.6g}" for x in (row.rms, row.p95, row.max)),
                f"{row.seconds:.4f}",
                *stages,
                f"{row.peak_mib:.1f}",
                row.bytes,
                f"{row.flip:.5g}",
                f"{row.ssim:.6g}",
                row.runs,
                " ".join(row.overrides),
                row.key,
            ]
        )
    return out.getvalue()


def advice(rows: Sequence[Row]) -> list[str]:
    """The cheapest setting for each limit, in words."""
    lines = [
        f"{KNOB} {row.label}: {row.seconds:.2f} s, {row.peak_mib:.0f} MiB, rms {row.rms:.2%} of all that it governs"
        for row in rows
        if row.sweep == KNOB
    ]
    finest = [row for row in rows if row.reference == "finest"]
    for limit in LIMITS:
        row = cheapest(finest, limit)
        if row is None:
            best = min(finest, key=lambda row: row.rms, default=None)
            nearest = f"; the best was {best.sweep} {best.label} with {best.rms:.2%}" if best else ""
            lines.append(f"within {limit:.1%}: none of the settings measured{nearest}")
        else:
            cost = f"{row.seconds:.2f} s, {row.peak_mib:.0f} MiB, rms {row.rms:.2%}"
            lines.append(f"within {limit:.1%}: {row.sweep} {row.label}: {cost}")
    return lines


def _markdown(title: str, sweep: Sweep, rows: Sequence[Row], note: str) -> list[str]:
    """Lines of tradeoff.md."""
    used = {row.reference for row in rows}
    lines = [f"# {title}", "", note, "", "What the columns mean:", ""]
    lines += [
        "* **rms** is the error of the diffuse light (all lights together, as stored and read bilinearly) at points",
        "  drawn by area over the skin, the same for every row, relative to the reference of its table:",
        "  ||M - M*|| / ||M*||; **p95** and **max** are relative to the mean of M*.",
        "* **seconds** is the whole bake without its preview, **diffuse** the blurring alone: medians, each run in a",
        "  process of its own.",
        "* **peak** is that process's largest resident size, libraries included; **files** the EXRs written.",
        "* **FLIP** (HDR, 0 is equal) and **SSIM** (1 is equal) compare the preview with the reference's.",
        "",
    ]
    front = {row.key for row in pareto_front([row for row in rows if row.reference == "finest"])}
    for reference in sweep.references:
        if reference.name not in used:
            continue
        lines += [f"## Against {reference.name}", "", f"M* is {reference.meaning}.", ""]
        lines += [
            "| sweep | setting | rms | p95 | max | seconds | diffuse | peak | files | FLIP | SSIM |",
            "|" + " --- |" * 11,
        ]
        for row in rows:
            if row.reference == reference.name:
                mark = " **front**" if row.key in front and reference.name == "finest" else ""
                cells = [row.sweep, row.label + mark, f"{row.rms:.2%}", f"{row.p95:.2%}", f"{row.max:.1%}"]
                cells += [
                    f"{row.seconds:.2f}",
                    f"{row.stage_seconds.get('diffuse', 0.0):.2f}",
                    f"{row.peak_mib:.0f} MiB",
                ]
                cells += [f"{row.bytes / 2**20:.1f} MiB", _or_dash(row.flip, ".4f"), _or_dash(row.ssim, ".4f")]
                lines.append("| " + " | ".join(cells) + " |")
        lines.append("")
    lines += ["## The cheapest setting", "", *(f"* {line}" for line in advice(rows)), "", "![chart](tradeoff.png)"]
    return lines


def _or_dash(value: float, form: str) -> str:
    """A formatted number, "-" for none."""
    return format(value, form) if np.isfinite(value) else "-"
