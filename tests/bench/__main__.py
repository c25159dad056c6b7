"""`python -m tests.bench [--json FILE] [--quick] [NAME ...]`: every bench_*.py that lies here, ratios first.

A bench exports `run(quick) -> list of rows`; a row is a mapping with a `name` and numbers. Numbers whose key holds
`over` are ratios of two things timed in one run, which a busy machine moves least.
"""

from __future__ import annotations

import argparse
import importlib
import json
import platform
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

HERE = Path(__file__).parent


def benches() -> list[str]:
    """Names of the benches: bench_<name>.py."""
    return sorted(path.stem.removeprefix("bench_") for path in HERE.glob("bench_*.py"))


def table_of(name: str, rows: list[dict]) -> Table:
    """Ratios in the first columns, then what they were made of."""
    keys = list(
        dict.fromkeys(key for row in rows for key, of in row.items() if key != "name" and not isinstance(of, dict))
    )
    keys.sort(key=lambda key: "over" not in key)
    table = Table(title=name, title_justify="left")
    table.add_column("")
    for key in keys:
        table.add_column(key.replace("_", " "), justify="left" if key == "note" else "right")
    for row in rows:
        table.add_row(row["name"], *(_shown(row.get(key)) for key in keys))
    return table


def _shown(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def main(arguments: list[str] | None = None) -> int:
    """Run, print, write."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench", description=__doc__.split("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(benches())}; all of them by default")
    parser.add_argument("--json", type=Path, help="write every row to this file")
    parser.add_argument("--quick", action="store_true", help="small cases only")
    options = parser.parse_args(arguments)
    unknown = set(options.names) - set(benches())
    if unknown:
        parser.error(f"expected names of {', '.join(benches())}, got {', '.join(sorted(unknown))}")
    report: dict[str, object] = {
        "machine": platform.processor() or platform.machine(),
        "python": platform.python_version(),
    }
    for name in options.names or benches():
        rows = importlib.import_module(f"tests.bench.bench_{name}").run(options.quick)
        report[name] = rows
        Console(width=160).print(table_of(name, rows))
        if options.json:
            options.json.write_text(json.dumps(report, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
