"""What a first bake compiles: `python -m tests.bench.bench_compile [CONFIG] [--set KEY=VALUE] [--json FILE]`.

A child process bakes with an empty cache of kernels while numba's own events are listened to. CPU seconds are those of
the thread that compiles (numba compiles one function at a time), each without those of the functions compiled
meanwhile on its behalf. A function of numba's own is named with the module that it comes from.
"""

from __future__ import annotations

import argparse
import collections
import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

_ROOT = Path(__file__).parents[2]


class Compilations:
    """Own CPU seconds of each function that numba compiles, from the moment this is made."""

    def __init__(self) -> None:
        from numba.core import event

        self.rows: list[dict[str, Any]] = []
        self._open = threading.local()
        listener = _listener(self)
        for kind in ("numba:compile", "numba:run_pass"):
            event.register(kind, listener)

    def begin(self, what: Any) -> None:
        """A function or a pass over one begins on this thread."""
        if not hasattr(self._open, "stack"):
            self._open.stack = []
        callers = [outer["name"] for outer, *_ in self._open.stack if outer["name"] != what["name"]]
        self._open.stack.append([{**what, "caller": callers[-1] if callers else ""}, time.thread_time(), 0.0])

    def end(self) -> None:
        """What began last on this thread is done."""
        what, begun, inner = self._open.stack.pop()
        took = time.thread_time() - begun
        if self._open.stack:
            self._open.stack[-1][2] += took
        self.rows.append({**what, "own": took - inner})


def _listener(found: Compilations) -> Any:
    from numba.core import event

    class Listener(event.Listener):
        def on_start(self, event: Any) -> None:
            found.begin(_told(event))

        def on_end(self, event: Any) -> None:
            found.end()

    return Listener()


def _told(event: Any) -> dict[str, str]:
    data = event.data
    if event.kind == "numba:compile":
        function = data["dispatcher"].py_func
        name = f"{function.__module__}.{function.__qualname__}"
        return {"kind": "function", "name": name, "types": str(tuple(data["args"]))}
    name = f"{data['module']}.{data['qualname']}"
    return {"kind": "pass", "name": name, "types": str(data["args"]), "pass": data["name"].partition(" ")[0]}


def record(command: list[str], file: Path) -> None:
    """Run the command line in this process, and write what was compiled."""
    from skinbake.cli import run

    compilations = Compilations()
    code = run(command)
    usage: dict[str, Any] = {"code": code, "cpu": time.process_time(), "rows": list(compilations.rows)}
    usage["yardstick"] = seconds_of_yardstick()
    file.write_text(json.dumps(usage))


def seconds_of_yardstick() -> float:
    """CPU seconds of compiling one function that never changes: how fast this machine compiles just now."""
    from numba import njit, types

    def yardstick(a, b, out):
        for i in range(len(a)):
            x, y, z = a[i, 0] - b[i, 0], a[i, 1] - b[i, 1], a[i, 2] - b[i, 2]
            length = (x * x + y * y + z * z) ** 0.5
            if length > 0:
                for k in range(3):
                    out[i, k] = max(a[i, k], b[i, k]) / length + min(a[i, k] * x, b[i, k] * y)

    array = types.Array(types.float64, 2, "C")
    seconds = []
    for _ in range(5):
        begun = time.thread_time()
        njit(types.none(array, array, array))(yardstick)
        seconds.append(time.thread_time() - begun)
    return min(seconds)


def first_bake(config: str, overrides: list[str]) -> tuple[list[dict[str, Any]], dict[str, float]]:
    """A row for each function and combination of types, and the CPU seconds of a bake with and without compiling."""
    with TemporaryDirectory() as folder:
        home = Path(folder)
        environment = os.environ | {"NUMBA_CACHE_DIR": str(home / "kernels"), "SKINBAKE_CACHE": ""}
        found = []
        for run in ("cold", "warm"):
            command = ["bake", config, "--out", str(home / run), "--quiet", *_sets(overrides)]
            file = home / f"{run}.json"
            subprocess.run(
                [sys.executable, "-m", "tests.bench.bench_compile", "--record", str(file), *command],
                check=True, cwd=_ROOT, env=environment,
            )  # fmt: skip
            found.append(json.loads(file.read_text()))
            if found[-1]["code"]:
                raise RuntimeError(f"skinbake {' '.join(command)}: exit code {found[-1]['code']}")
        kept = sum(entry.stat().st_size for entry in (home / "kernels").iterdir())
    cold, warm = found
    if warm["rows"]:
        raise AssertionError(f"compiled again: {sorted({row['name'] for row in warm['rows']})}")
    whole = {"cold_cpu": cold["cpu"], "warm_cpu": warm["cpu"], "kept_mib": kept / 2**20}
    return cold["rows"], whole | {"yardstick": cold["yardstick"]}


def _sets(overrides: list[str]) -> list[str]:
    return [word for override in overrides for word in ("--set", override)]


def by_function(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Own seconds of each function, its passes with it, and how often it was compiled; dearest first."""
    seconds: dict[tuple[str, str], float] = collections.Counter()
    caller = {(row["name"], row["types"]): row["caller"] for row in reversed(rows)}
    passes: dict[tuple[str, str], dict[str, float]] = collections.defaultdict(collections.Counter)
    for row in rows:
        key = (row["name"], row["types"])
        seconds[key] += row["own"]
        if row["kind"] == "pass":
            passes[key][row["pass"]] += row["own"]
    return [
        {"name": name, "types": types, "cpu": cpu, "caller": caller[name, types], "passes": dict(passes[name, types])}
        for (name, types), cpu in sorted(seconds.items(), key=lambda item: -item[1])
    ]


def summary(rows: list[dict[str, Any]], whole: dict[str, float]) -> dict[str, Any]:
    """Count and CPU seconds, ours and numba's helpers, by pass."""
    each = by_function(rows)
    ours = [row for row in each if row["name"].startswith("skinbake.")]
    total = sum(row["own"] for row in rows)
    passes: dict[str, float] = collections.Counter()
    for row in rows:
        passes[row.get("pass", "other")] += row["own"]
    return {
        "over_yardstick": total / whole["yardstick"],
        "over_warm_bake": total / whole["warm_cpu"],
        "helpers_over_all": 1 - sum(row["cpu"] for row in ours) / total if total else 0.0,
        "compilations": sum(row["kind"] == "function" for row in rows),
        "functions": len(each),
        "cpu_s": total,
        "lowering_cpu_s": passes["native_lowering"],
        "typing_cpu_s": passes["nopython_type_inference"],
        "cold_minus_warm_cpu_s": whole["cold_cpu"] - whole["warm_cpu"],
        "kept_mib": whole["kept_mib"],
    }


def run(quick: bool) -> list[dict[str, Any]]:
    """The whole, then the twenty dearest functions."""
    rows, whole = first_bake("configs/head.yaml", ["texture.size=512"] if quick else [])
    total = summary(rows, whole)
    worst = [
        {"name": row["name"].removeprefix("skinbake."), "over_all": row["cpu"] / total["cpu_s"], "cpu_s": row["cpu"]}
        for row in by_function(rows)[:20]
    ]
    shown = ("over_yardstick", "over_warm_bake", "compilations", "cpu_s")  # few, so that names stand whole
    return [{"name": "first bake", **{key: total[key] for key in shown}}, *worst]


def main() -> None:
    """Print, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("config", nargs="?", default="configs/head.yaml")
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE")
    parser.add_argument("--worst", type=int, default=40)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows, whole = first_bake(options.config, options.overrides)
    total = summary(rows, whole)
    for key, value in total.items():
        print(f"{key:24s} {value:.3g}" if isinstance(value, float) else f"{key:24s} {value}")
    each = by_function(rows)
    print(f"\n{'share':>6} {'cpu s':>6} {'typing':>6} {'lower':>6}  function(types)")
    for row in each[: options.worst]:
        typing, lowering = (row["passes"].get(name, 0.0) for name in ("nopython_type_inference", "native_lowering"))
        print(
            f"{row['cpu'] / total['cpu_s']:6.1%} {row['cpu']:6.2f} {typing:6.2f} {lowering:6.2f}"
            f"  {row['name'].removeprefix('skinbake.')}{row['types'][:200]}"
        )
    if options.json:
        options.json.write_text(json.dumps({"summary": total, "functions": each}, indent=1))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--record"]:
        record(sys.argv[3:], Path(sys.argv[2]))
    else:
        main()
