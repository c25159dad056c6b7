"""A batch: its looks are baked by a process pool or a cluster; batch.json and batch.png report on them."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from rich.console import Console

import skinbake
from skinbake.baking.shared_blurs import SharedBlurs
from skinbake.batch.job import BakeJob, bake_job
from skinbake.batch.process_pool import ProcessPool
from skinbake.batch.progress import BatchProgress
from skinbake.batch.same_but_skin import shared_among
from skinbake.errors import InputError, SkinbakeError, printable
from skinbake.export.after_bake import FOLDER
from skinbake.export.web import NAME as PAGE
from skinbake.interrupt import undone_at_stop
from skinbake.io.atomic import write_text
from skinbake.io.batch_file import Batch, BatchJob
from skinbake.io.batch_report import NAME, read_batch_report
from skinbake.io.code_digest import package_digest
from skinbake.io.contact_sheet import Cell, write_contact_sheet
from skinbake.io.fingerprint import every_input
from skinbake.io.lock import file_lock, remove_leftovers
from skinbake.io.output_names import refuse_inputs
from skinbake.page.batch_page import NAME as BATCH_PAGE
from skinbake.page.batch_page import PageLook, batch_page, is_batch_page

SHEET = "batch.png"
GOOD = ("done", "fresh")


@dataclass(frozen=True)
class Plan:
    """The batch command's arguments.

    Attributes
    ----------
    batch : Batch
    workers : int
        Processes.
    keep_going : bool
        Go on after a job has failed.
    force, preview : bool
        As the verb `bake`.
    cache : Path or None
        Folder of shared results.
    cache_bytes : int
    dask : str or None
        Address of a scheduler, or "local".
    retries : int
        How often a job is tried again after its machine failed it.
    """

    batch: Batch
    workers: int = 1
    keep_going: bool = True
    force: bool = False
    preview: bool = True
    cache: Path | None = None
    cache_bytes: int = 8 * 2**30
    dask: str | None = None
    retries: int = 1

    @property
    def selected(self) -> tuple[BatchJob, ...]:
        """Jobs to bake."""
        return tuple(job for job in self.batch.jobs if job.wanted)

    @cached_property
    def blurs(self) -> dict[str, SharedBlurs]:
        """Whether each look that differs from an earlier one in its skin alone takes that one's blurs, by name."""
        return shared_among(self.batch.jobs, self.selected) if self.cache else {}

    def bake_job(self, job: BatchJob) -> BakeJob:
        """Order for the process that bakes this job."""
        cache = str(self.cache) if self.cache else None
        blurs = self.blurs.get(job.name)
        return BakeJob(job.spec, self.force, self.preview, cache, self.cache_bytes, package_digest(), blurs=blurs)


def run_batch(plan: Plan, console: Console) -> dict[str, Any]:
    """Bake the selected looks, write batch.json and batch.png, and give what batch.json holds.

    Raises
    ------
    InputError
        One of the two has the name of a file that the batch reads.
    """
    start = time.perf_counter()
    jobs = plan.selected
    _refuse_inputs(plan)
    payloads = {job.name: plan.bake_job(job) for job in jobs}
    peak = None
    tidy = partial(_tidy, [Path(job.spec.output.dir) for job in jobs] if plan.dask in (None, "local") else [])
    quicker = [name for name, blurs in plan.blurs.items() if blurs.base]
    with BatchProgress(len(jobs), plan.workers, console, quicker) as progress, undone_at_stop(tidy):
        if plan.dask:
            from skinbake.batch.dask_cluster import run_on_dask

            results = run_on_dask(
                plan.dask, bake_job, payloads, progress.on_event, plan.workers, plan.retries, plan.keep_going
            )
        else:
            pool = ProcessPool(bake_job, min(plan.workers, len(jobs)), plan.retries, progress.on_event)
            results = pool.run(payloads, plan.keep_going)
            peak = round(pool.peak_mib, 1)
    seconds = round(time.perf_counter() - start, 3)
    report: dict[str, Any] = {
        "version": skinbake.__version__,
        "file": plan.batch.path.name,
        "seconds": seconds,
        "workers": plan.workers,
        "dask": plan.dask,
        "peak_memory_mib": peak,
        "cache": {
            figure: sum(result.get("cache", {}).get(figure, 0) for result in results.values())
            for figure in ("hits", "misses")
        },
    }

    def tell(text: str) -> None:
        console.print(printable(text), markup=False, soft_wrap=True)

    with file_lock(plan.batch.folder / ".batch.lock", tell):  # another batch may bake other looks of the file
        report["jobs"] = _entries(plan, results)
        write_text(plan.batch.folder / NAME, json.dumps(report, indent=1) + "\n")
        if plan.preview:
            _sheet(plan.batch, report["jobs"])
        _page(plan.batch, report["jobs"])
    _summary(report, plan.batch.folder, console)
    return report


def _tidy(folders: Sequence[Path]) -> None:
    """Once the processes that wrote there are gone."""
    for folder in folders:
        remove_leftovers(folder)


def _refuse_inputs(plan: Plan) -> None:
    """Stop before batch.json or batch.png is written over what the batch, or one of its looks, reads."""
    read = [plan.batch.path]
    for job in plan.selected:
        with suppress(InputError):  # a missing file is the job's failure
            read += every_input(job.spec)
    refuse_inputs([plan.batch.folder / name for name in (NAME, SHEET, BATCH_PAGE)], read)
    page = plan.batch.folder / BATCH_PAGE
    if any("web" in job.spec.output.export for job in plan.selected) and not is_batch_page(page):
        raise InputError(
            f"{page}: expected a page of an earlier batch or none, got one that skinbake has not written; move it away"
        )


def _entries(plan: Plan, results: Mapping[str, dict[str, Any]]) -> list[dict[str, Any]]:
    """One entry a job of the file; a job that was not selected keeps its last one."""
    before: dict[str, Any] = {}
    with suppress(InputError):
        before = {entry["name"]: entry for entry in read_batch_report(plan.batch.folder)["jobs"]}
    entries = []
    for job in plan.batch.jobs:
        named = {"name": job.name, "folder": job.name, "choices": dict(job.choices), "selected": job.name in results}
        entries.append(before.get(job.name, {"status": "not run"}) | named | results.get(job.name, {}))
    return entries


def _sheet(batch: Batch, entries: list[dict[str, Any]]) -> None:
    """Write batch.png, with rows as wide as the matrix's last axis."""
    cells = []
    for entry in entries:
        failed = entry["status"] not in (*GOOD, "not run")
        picture = batch.folder / entry["folder"] / "preview.png" if entry["status"] in (*GOOD, "missed") else None
        note = entry.get("error") if failed else entry.get("note")
        cells.append(Cell(entry["name"], picture, note or entry["status"], failed))
    axes = [list(entry["choices"].items()) for entry in entries]
    columns = None
    if axes and all(axes):
        columns = len({choices[-1][1] for choices in axes})
    write_contact_sheet(batch.folder / SHEET, cells, columns if columns and columns > 1 else None)


def _page(batch: Batch, entries: list[dict[str, Any]]) -> None:
    """Write batch.html where looks have a page of their own, else remove one of ours."""
    shown = [
        PageLook(entry["name"], f"{entry['folder']}/{FOLDER}/{PAGE}", str(entry.get("note") or entry["status"]))
        for entry in entries
        if (batch.folder / entry["folder"] / FOLDER / PAGE).is_file()
    ]
    path = batch.folder / BATCH_PAGE
    if shown:
        write_text(path, batch_page(batch.path.stem, shown))
    elif is_batch_page(path):
        path.unlink(missing_ok=True)


def _summary(report: dict[str, Any], folder: Path, console: Console) -> None:
    """Print how many looks were baked, and the errors of the others."""
    ran = [entry for entry in report["jobs"] if entry["selected"]]
    bad = [entry for entry in ran if entry["status"] not in GOOD]
    hits, misses = report["cache"]["hits"], report["cache"]["misses"]
    text = f"{len(ran) - len(bad)} of {len(ran)} looks in {report['seconds']:.1f} s: {folder / NAME}"
    if hits:
        text += f"; {hits} of {hits + misses} results came from the cache"
    console.print(printable(text), markup=False, soft_wrap=True)
    for entry in bad:
        for line in str(entry.get("error") or entry["status"]).splitlines():
            print(printable(f"  {entry['name']}: {line}"), file=console.file)  # a quiet console would keep it to itself


def dry_run_lines(plan: Plan) -> tuple[list[str], bool]:
    """A line a look, naming the stages that would run and why; and whether every input is there."""
    from skinbake.baking.dry_run import stale_stages
    from skinbake.baking.session import BakeSession
    from skinbake.export.after_bake import refuse_exports, stale_export

    lines, ok = [], True
    for job in plan.selected:
        order = plan.bake_job(job)
        session = BakeSession.of(order.cache, order.cache_bytes, base=order.base)
        try:
            refuse_exports(job.spec)
            stale = stale_stages(job.spec, plan.force, plan.preview, session)
            if job.spec.output.export and (stale or (why := stale_export(job.spec))):
                stale["export"] = "after the bake" if stale else why
            text = "; ".join(f"{stage}: {why}" for stage, why in stale.items()) or "as it was"
            if order.blurs:
                text += f" ({order.blurs.why})" if order.blurs.base else f" (its own blurs: {order.blurs.why})"
        except SkinbakeError as error:
            text, ok = f"cannot be baked: {error}", False
        lines.append(f"{job.name:<28} {text}")
    return lines, ok
