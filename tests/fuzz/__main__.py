"""`python -m tests.fuzz [--minutes M] [--seed S] [--keep DIR] [TARGET ...]`: damage files until something gives way.

Each target runs in a child process with a memory limit, which notes every input before it reads it: a crash or a hang
leaves its input behind. Findings are told once a place; `--keep` holds one input of each, to become a test.
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import os
import resource
import subprocess
import sys
import time
import traceback
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from tests.fuzz.targets import TARGETS, survives

MEMORY = 4 << 30
HANG_S = 60  # of the clock: a first input that imports SciPy beside other work has taken more than 20


def main() -> int:
    """Give 1 when anything was found."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__.split("\n")[0])
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"of {', '.join(TARGETS)}; all of them by default")
    parser.add_argument("--minutes", type=float, default=10.0, help="in all, shared equally")
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--keep", type=Path, default=Path("out/fuzz"))
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        return child(options.targets[0], options.seed, options.minutes * 60, options.keep)
    names = options.targets or list(TARGETS)
    found = 0
    for name in names:
        found += fuzz(name, options.seed, options.minutes * 60 / len(names), options.keep)
    return int(found > 0)


def fuzz(name: str, seed: int, seconds: float, keep: Path) -> int:
    """Fuzz one target for a while; a child that dies is started again with the next seed."""
    end, inputs, refused, places = time.monotonic() + seconds, 0, 0, dict[str, str]()
    while (left := end - time.monotonic()) > 1:
        with TemporaryDirectory() as folder:
            command = [
                sys.executable,
                "-m",
                "tests.fuzz",
                "--child",
                name,
                "--seed",
                str(seed),
                "--minutes",
                str(left / 60),
            ]
            done = subprocess.run([*command, "--keep", folder], capture_output=True, text=True, check=False)
            report = json.loads(line) if (line := done.stdout.rpartition("REPORT ")[2].strip()).startswith("{") else {}
            notes = Path(folder) / "notes.json"
            if not report and notes.exists():
                report = json.loads(notes.read_text())
            inputs, refused = inputs + report.get("inputs", 0), refused + report.get("refused", 0)
            new = {where: what for where, what in report.get("findings", {}).items() if where not in places}
            if done.returncode:
                last = [line.strip() for line in done.stderr.splitlines() if "File" in line][:3]
                new[f"died {done.returncode} {' < '.join(last)}"] = "current"
            for where, file in new.items():
                places[where] = file
                keep.mkdir(parents=True, exist_ok=True)
                kept = next((p for p in Path(folder).glob(f"{file}.*")), None)
                if kept:
                    target = keep / f"{name}-{seed}-{len(places)}{kept.suffix}"
                    target.write_bytes(kept.read_bytes())
                    where += f"\n    {target}"
                print(f"{name}: {where}", flush=True)
        seed += 1
    counts = f"{inputs:>8} inputs, {refused / max(inputs, 1):4.0%} refused"
    print(f"{name:<10} {counts}, {len(places)} findings, {seconds:.0f} s", flush=True)
    return len(places)


def child(name: str, seed: int, seconds: float, folder: Path) -> int:
    """Read damaged files until the time is up; the report goes to stdout, the input at hand to a file."""
    if name not in ("image", "exr"):
        from skinbake.io import mesh  # noqa: F401  # before the limit: libraries reserve address space
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    target, rng = TARGETS[name], Random(seed)
    seeds = target.seeds()
    end, report = time.monotonic() + seconds, {"inputs": 0, "refused": 0, "findings": {}}
    work = folder / "work"
    work.mkdir()
    os.chdir(work)
    while time.monotonic() < end:
        suffix, content = target.damage(seeds, rng)
        for stale in folder.glob("current.*"):
            stale.unlink()
        (folder / f"current{suffix}").write_bytes(content)
        if report["inputs"] % 500 == 0:
            (folder / "notes.json").write_text(json.dumps(report))
        report["inputs"] += 1
        faulthandler.dump_traceback_later(HANG_S, exit=True)
        try:
            report["refused"] += survives(target, suffix, content, work) == "refused"
        except BaseException as error:
            frames = [
                f
                for f in traceback.extract_tb(error.__traceback__)
                if "skinbake/skinbake" in f.filename or "/skinbake/" in f.filename
            ]
            here = traceback.extract_tb(error.__traceback__)[-1]
            places = " < ".join(f"{Path(f.filename).name}:{f.lineno}" for f in [here, *frames[::-1][:2]])
            where = f"{type(error).__name__} at {places}: {str(error)[:120]!r}"
            key = f"{type(error).__name__} at {places}"
            if not any(known.startswith(key) for known in report["findings"]):
                file = f"finding_{len(report['findings'])}"
                (folder / f"{file}{suffix}").write_bytes(content)
                report["findings"][where] = file
        finally:
            faulthandler.cancel_dump_traceback_later()
        for left in work.iterdir():
            if left.is_file():
                left.unlink()
    print("REPORT " + json.dumps(report))
    return 0


if __name__ == "__main__":
    sys.exit(main())
