"""`skinbake batch FILE`: many looks from one file."""

from __future__ import annotations

import json

import click

from skinbake.cli.options import Output, Within, force_option, json_option, out_option, quiet_option, set_option


@click.command("batch")
@click.argument("file", type=click.Path(dir_okay=False))
@out_option
@set_option
@click.option("-j", "--jobs", "workers", type=click.IntRange(min=1), default=1, help="Looks baked at a time.")
@click.option("--only", multiple=True, metavar="NAME", help="Only looks of this name (a * stands for any letters).")
@click.option("--dry-run", is_flag=True, help="Say what would be done, and why.")
@click.option("--keep-going/--fail-fast", default=True, help="What a failure means for the other looks.")
@force_option
@click.option("--cache", type=Output(file_okay=False), help="Folder of shared results [$SKINBAKE_CACHE, .cache].")
@click.option("--cache-gib", type=Within(0, 1e9), default=8.0, show_default=True, help="Its size at most.")
@click.option("--no-cache", is_flag=True, help="Share nothing between looks.")
@click.option("--dask", metavar="ADDRESS", help="Bake on this Dask cluster; `local` starts one of -j processes.")
@click.option("--retries", type=click.IntRange(min=0), default=1, show_default=True, help="After a lost process.")
@click.option("--preview/--no-preview", default=True, help="Render each look's preview.png, and batch.png of all.")
@json_option
@quiet_option
def command(
    file: str,
    out: str | None,
    overrides: tuple[str, ...],
    workers: int,
    only: tuple[str, ...],
    dry_run: bool,
    keep_going: bool,
    force: bool,
    cache: str | None,
    cache_gib: float,
    no_cache: bool,
    dask: str | None,
    retries: int,
    preview: bool,
    as_json: bool,
    verbosity: int,
) -> int:
    """Bake every look of FILE, or every frame of the look that it is, each into its own folder.

    What several share is computed once.

    Writes batch.json and batch.png beside them. Exit code 1 if a look failed or missed its tolerance.
    """

    from rich.console import Console

    from skinbake.batch.batching import Plan, dry_run_lines, run_batch
    from skinbake.errors import printable
    from skinbake.io.batch_file import load_batch
    from skinbake.io.cache import cache_folder

    batch = load_batch(file, overrides, out, only)
    folder = cache_folder(cache, batch.folder / ".cache")
    plan = Plan(
        batch=batch,
        workers=workers,
        keep_going=keep_going,
        force=force,
        preview=preview,
        cache=None if no_cache else folder,
        cache_bytes=int(cache_gib * 2**30),
        dask=dask,
        retries=retries,
    )
    if dry_run:
        lines, ok = dry_run_lines(plan)
        print(printable("\n".join(lines)))
        return 0 if ok else 1
    from sys import stderr

    console = Console(file=stderr, quiet=verbosity == 0, highlight=False)
    report = run_batch(plan, console)
    if as_json:
        print(json.dumps(report, indent=1))
    return 0 if all(job["status"] in ("done", "fresh") for job in report["jobs"] if job["selected"]) else 1
