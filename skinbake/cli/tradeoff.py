"""`skinbake tradeoff CONFIG`: seconds, memory and bytes against error, measured."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinbake.cli.options import Output, config_argument, json_option, lit, quiet_option, set_option

if TYPE_CHECKING:
    from skinbake.scene.spec import SceneSpec
    from skinbake.tradeoff import Reference, Row, Setting, Sweep

CLOCKS = {"wall": "wall time", "cpu": "processor time of all cores together"}


@click.command("tradeoff")
@config_argument
@click.option("--out", type=Output(file_okay=False), help="Folder for the results; output.dir/tradeoff by default.")
@set_option
@click.option("--quick", "extent", flag_value="quick", help="A handful of settings.")
@click.option("--full", "extent", flag_value="full", help="Every knob, finer steps, at the look's own texture size.")
@click.option("--size", type=click.IntRange(16, 32768), help="Texture size (longer side); at most 1024 by default.")
@click.option("--repeats", type=click.IntRange(1, 99), help="Runs of each setting; the median counts.")
@click.option("--points", type=click.IntRange(10, 1_000_000), default=2000, show_default=True, help="Common probes.")
@click.option(
    "--clock",
    type=click.Choice(["wall", "cpu"]),
    default="wall",
    show_default=True,
    help="What counts as seconds: wall time, or processor time, which other work on the machine hardly moves.",
)
@click.option("--picture/--no-picture", default=True, help="Compare previews by HDR-FLIP and SSIM.")
@json_option
@quiet_option
def command(
    config: str,
    out: str | None,
    overrides: tuple[str, ...],
    extent: str | None,
    size: int | None,
    repeats: int | None,
    points: int,
    clock: str,
    picture: bool,
    as_json: bool,
    verbosity: int,
) -> int:
    """Measure what CONFIG's knobs cost and what they buy; writes tradeoff.csv, tradeoff.md and tradeoff.png.

    Ctrl-C keeps what was measured; the same command again takes up from there.
    """
    import json
    from dataclasses import asdict

    from skinbake.errors import printable
    from skinbake.io.config import load_look
    from skinbake.io.fingerprint import every_input
    from skinbake.io.lock import folder_lock
    from skinbake.io.output_names import refuse_inputs
    from skinbake.io.tradeoff import RUNS, advice
    from skinbake.tradeoff import plan_sweep

    spec = lit(load_look(config, overrides))
    folder = Path(out) if out else Path(spec.output.dir) / "tradeoff"
    tables = [folder / f"tradeoff.{kind}" for kind in ("csv", "md", "png")]
    refuse_inputs([*tables, folder / RUNS], [config, *every_input(spec)])
    extent = extent or "default"
    runs = repeats or {"quick": 1, "default": 2, "full": 5}[extent]
    sweep = plan_sweep(spec, _sweep_size(spec, size, extent), extent)
    with folder_lock(folder, lambda line: click.echo(printable(line), err=True)):  # which tells what is wrong with it
        work = Measurements(config, overrides, sweep, folder, points, picture, verbosity, clock)
        stopped = work.measure(runs)
        rows = work.rows()
        work.write(rows, final=True)
    if not rows:
        with suppress(OSError):
            folder.rmdir()  # where it was made for the lock alone
    if as_json:
        click.echo(json.dumps([asdict(row) for row in rows], indent=1, default=list))
    elif verbosity and rows:
        click.echo(printable("\n".join(advice(rows))))
        click.echo(printable(f"{folder / 'tradeoff.md'}, .csv and .png: {len(rows)} settings"))
    if stopped:
        click.echo("stopped" + (": what was measured is kept, run again to go on" if rows else ""), err=True)
        return 130
    return 0


def _sweep_size(spec: SceneSpec, asked: int | None, extent: str) -> tuple[int, int]:
    """The look's size, scaled down to 1024 unless `--full` or `--size` says otherwise."""
    longest = max(spec.texture.size)
    wanted = asked or (longest if extent == "full" else min(longest, 1024))
    width, height = (max(1, round(side * wanted / longest)) for side in spec.texture.size)
    return width, height


class Measurements:
    """Runs of a sweep in a folder, each kept as soon as it is there."""

    def __init__(
        self,
        config: str,
        overrides: tuple[str, ...],
        sweep: Sweep,
        folder: Path,
        points: int,
        picture: bool,
        verbosity: int,
        clock: str = "wall",
    ) -> None:
        from skinbake.io.config import load_look
        from skinbake.io.fingerprint import input_hashes
        from skinbake.io.tradeoff import read_runs

        self.sweep, self.folder, self.points, self.picture, self.verbosity = sweep, folder, points, picture, verbosity
        self.config, self.clock = config, clock
        wanted = {setting.overrides for setting in sweep.settings} | {r.overrides for r in sweep.references}
        wanted |= {sweep.twice} - {()}
        self.specs = {own: load_look(config, (*overrides, *own)) for own in wanted}
        self.inputs = input_hashes(next(iter(self.specs.values())))
        self.references = {reference.name: reference for reference in sweep.references}
        self.values: dict[str, dict[str, Any]] = {}
        self.runs = read_runs(folder)
        self.failed: dict[str, str] = {}

    def key(self, setting: Setting) -> str:
        """Key of a row: it depends on the code, the files, the look, the reference and the probes."""
        return self._key(self.specs[setting.overrides], self.references[setting.reference])

    def _key(self, spec: SceneSpec, reference: Reference) -> str:
        from skinbake.io.code_digest import code_digest
        from skinbake.io.digests import key_of

        parts = (_plain(spec), _plain(self.specs[reference.overrides]), self.inputs, self.points, self.picture)
        return key_of(code_digest("skinbake.cli.measuring", "skinbake.tradeoff"), *parts)[:16]

    def measure(self, repeats: int) -> bool:
        """Bring every setting to `repeats` runs, in alternating order; True if Ctrl-C ended it."""
        from skinbake.cli.child_process import Child, in_child
        from skinbake.interrupt import saving
        from skinbake.progress import counted

        todo = list(self._todo(repeats))
        again: Child | None = None  # repeats need no process of their own: the first run has told the memory
        names = {s.reference for s in self.sweep.settings} & set(self.references)
        missing = [name for name in names if self._stored(name) is None]
        try:
            with saving(), counted("measuring", len(todo) + 3 * len(missing), self.verbosity > 0) as step:
                for name in self.references:
                    if name in missing:
                        start = time.perf_counter()
                        self._make_reference(name)
                        step(f"reference {name}: {time.perf_counter() - start:.1f} s", 3)
                self._measure_size()
                for setting in todo:
                    if self.key(setting) not in self.runs:
                        step(self._run(setting, in_child), 1)
                    else:
                        again = again or Child()
                        step(self._run(setting, again), 1)
                    self.write(self.rows())
        except KeyboardInterrupt:
            return True
        finally:
            if again:
                again.__exit__()
        return False

    def _todo(self, repeats: int) -> Iterator[Setting]:
        """Each setting's missing runs; every other round goes backwards, so that a slow spell hits none alone."""
        once = list({self.key(setting): setting for setting in reversed(self.sweep.settings)}.values())[::-1]
        for turn in range(repeats):
            for setting in once if turn % 2 == 0 else once[::-1]:
                if len(self.runs.get(self.key(setting), [])) <= turn:
                    yield setting

    def _stored(self, name: str) -> dict[str, Any] | None:
        from skinbake.io.tradeoff import read_reference

        if name not in self.values:
            found = read_reference(self._reference_path(name))
            if found is None:
                return None
            self.values[name] = found
        return self.values[name]

    def _reference_path(self, name: str) -> Path:
        reference = self.references[name]
        return self.folder / "references" / f"{self._key(self.specs[reference.overrides], reference)}.npz"

    def _make_reference(self, name: str) -> None:
        from skinbake.cli.child_process import in_child
        from skinbake.cli.measuring import measure_near_exact, measure_reference
        from skinbake.io.tradeoff import write_reference

        reference = self.references[name]
        measured = measure_reference if reference.integral else measure_near_exact
        found = in_child(measured, self.specs[reference.overrides], self.points, self.picture)
        write_reference(self._reference_path(name), found)
        self.values[name] = found

    def _measure_size(self) -> None:
        """Error of the sweep's texture size itself: the same integral over twice the size, at the same probes."""
        from skinbake.cli.child_process import in_child
        from skinbake.cli.measuring import measure_reference
        from skinbake.io.tradeoff import append_run
        from skinbake.tradeoff import difference

        if not self.sweep.twice or self._size_key in self.runs:
            return
        finest = self.values["finest"]
        values = in_child(measure_reference, self.specs[self.sweep.twice], self.points, False, _probed(finest))[
            "values"
        ]
        rms, p95, _ = difference(finest["values"], values)
        run = {"key": self._size_key, "rms": rms, "p95": p95}
        self.runs[self._size_key] = [run]
        append_run(self.folder, run)

    @property
    def _size_key(self) -> str:
        return "size-" + self._key(self.specs[self.sweep.twice], self.references["finest"])

    def _run(self, setting: Setting, run_in: Callable[..., Any]) -> str:
        """Run one bake, the first also for its error, and give a line for the terminal."""
        from skinbake.cli.measuring import measure_bake
        from skinbake.errors import SkinbakeError
        from skinbake.io.tradeoff import append_run
        from skinbake.preview.image_metrics import image_similarity
        from skinbake.tradeoff import difference

        key, name = self.key(setting), f"{setting.sweep} {setting.label}"
        if key in self.failed:
            return f"{name}: left out"
        wanted = self.values[setting.reference]
        first = key not in self.runs
        try:
            found = run_in(
                measure_bake, self.specs[setting.overrides], _probed(wanted) if first else None, first and self.picture
            )
        except SkinbakeError as error:  # this look cannot be baked so, others can
            self.failed[key] = str(error)
            return f"{name}: left out, {error}"
        run = {"key": key} | {k: found[k] for k in ("seconds", "cpu_seconds", "stages", "peak_mib", "bytes")}
        if first:
            run["rms"], run["p95"], run["max"] = difference(found["values"], wanted["values"])
            if found.get("picture") is not None and wanted.get("picture") is not None:
                run["flip"], run["ssim"] = image_similarity(found["picture"], wanted["picture"])
        self.runs.setdefault(key, []).append(run)
        append_run(self.folder, run)
        return f"{name}: {run['seconds']:.2f} s, rms {self.runs[key][0]['rms']:.2%}"

    def rows(self) -> list[Row]:
        """Rows measured so far, in the sweep's order."""
        import numpy as np

        from skinbake.tradeoff import Row

        found = []
        for setting in self.sweep.settings:
            runs = self.runs.get(self.key(setting), [])
            if not runs:
                continue
            first = runs[0]
            stages = sorted({stage for run in runs for stage in run["stages"]})
            found.append(
                Row(
                    self.key(setting),
                    setting.sweep,
                    setting.label,
                    setting.reference,
                    setting.overrides,
                    first["rms"],
                    first["p95"],
                    first["max"],
                    float(np.median([run["cpu_seconds" if self.clock == "cpu" else "seconds"] for run in runs])),
                    first["peak_mib"],
                    first["bytes"],
                    first.get("flip", float("nan")),
                    first.get("ssim", float("nan")),
                    len(runs),
                    {stage: float(np.median([run["stages"].get(stage, 0.0) for run in runs])) for stage in stages},
                )
            )
        return found

    def write(self, rows: list[Row], final: bool = False) -> None:
        """Write the tables, and the chart if `final`."""
        from skinbake.io.tradeoff import write_tables
        from skinbake.kernels.threads import processors

        if not rows:
            return
        name = Path(self.config).stem
        size = self.specs[self.sweep.settings[0].overrides].texture.size
        note = (
            f"{Path(self.config).name} around {size[0]} x {size[1]} texels, {self.points} common probes, "
            f"{processors()} cores, {CLOCKS[self.clock]}, medians of {min(row.runs for row in rows)} or more runs in "
            "alternating order."
        )
        if self.sweep.twice and self._size_key in self.runs:
            size_run = self.runs[self._size_key][0]
            note += (
                f"\n\nThe texture size itself: over twice as many texels a side the same integral differs by "
                f"{size_run['rms']:.2%} (rms; p95 {size_run['p95']:.2%}), which no row below includes."
            )
        for reason in sorted(set(self.failed.values())):
            note += f"\n\nLeft out: {reason}"
        write_tables(self.folder, f"Trade-off of {name}", self.sweep, rows, note)
        if final:
            from skinbake.io.tradeoff_plot import write_chart

            title = f"{name}, {size[0]} x {size[1]}, {processors()} cores"
            write_chart(self.folder / "tradeoff.png", title, rows, CLOCKS[self.clock])


def _probed(reference: dict[str, Any]) -> Any:
    from skinbake.cli.exact_values import Probed

    return Probed.of(reference)


def _plain(spec: SceneSpec) -> dict[str, Any]:
    """Configuration of a look without the paths, whose contents are hashed instead."""
    plain = spec.model_dump(
        mode="json", exclude={"output": {"dir"}, "mesh": {"path"}, "maps": True, "preview": {"view"}}
    )
    return plain | {"view": spec.preview.view}
