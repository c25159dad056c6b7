"""Jobs of a batch on a Dask cluster, an existing one or one of our own. All its machines must see the files.

A job is one task: it is never split over writers of one file. The job of a worker that is lost is taken up by another,
which waits for the folder's lock, should the first one still be alive somewhere.
"""

from __future__ import annotations

import contextlib
import logging
import platform
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from skinbake.batch.dask_workers import DaskWorkers
from skinbake.batch.process_pool import Listen, Work, fewer_threads
from skinbake.errors import InputError, MachineError, SkinbakeError
from skinbake.interrupt import starting_children

LOCAL = "local"
CONNECT_S = 15
LOOK_S = 0.25  # between two looks at who is there
WAIT_SAID_S = 5.0  # between two lines that say what is waited for
_ONE_BAKE = threading.Lock()  # kernels use every thread of a process: a worker with several would run them at once


def run_on_dask(
    address: str,
    work: Work,
    payloads: Mapping[str, Any],
    listen: Listen,
    workers: int = 1,
    retries: int = 1,
    keep_going: bool = True,
) -> dict[str, dict[str, Any]]:
    """Run jobs on a Dask cluster; the result of each by name, as `ProcessPool.run` gives them.

    Parameters
    ----------
    address : str
        Scheduler's address ("tcp://host:8786"), or "local" for a cluster of `workers` processes here.
    work : callable
        From a payload and a function that takes events to the result.
    payloads : mapping of name to payload
    listen : callable
        Takes a job's name and an event.
    workers : int
    retries : int
        How often a job is tried again after its machine failed it; bad input is not tried again.
    keep_going : bool
        Go on after a job has failed.

    Raises
    ------
    InputError
        The address is not one.
    MachineError
        The extra `farm` is not installed, or no scheduler answers.
    """
    with _client(address, workers) as client:
        topic = f"skinbake-{uuid.uuid4().hex}"
        client.subscribe_topic(topic, lambda event: listen(event[1]["name"], event[1]))

        def submit(name: str, fit: list[str], number: int) -> Any:
            how = {"retries": retries, "workers": fit, "pure": False, "key": f"{name}-{topic}-{number}"}
            return client.submit(_on_worker, work, payloads[name], name, topic, **how)

        results = _run_all(client, list(payloads), submit, lambda why: listen("--dask", {"event": "wait", "why": why}),
                           listen, keep_going)  # fmt: skip
    return {name: results.get(name, {"status": "skipped", "error": "an earlier job failed"}) for name in payloads}


def _run_all(
    client: Any,
    todo: list[str],
    submit: Callable[[str, list[str], int], Any],
    say: Callable[[str], None],
    listen: Listen,
    keep_going: bool,
) -> dict[str, dict[str, Any]]:
    """Give jobs to the workers that fit, as these come and go; the result of each by name.

    Parameters
    ----------
    client : distributed.Client
    todo : list of str
        Names of jobs.
    submit : callable
        Given a job's name, the addresses that may run it and how often jobs were submitted before, its future.
    say : callable
        Told what is waited for.
    listen : callable
        Takes a job's name and an event.
    keep_going : bool
        Go on after a job has failed.
    """
    from distributed import wait

    workers, told, said_s = DaskWorkers(client), set[str](), time.monotonic()
    running: dict[Any, tuple[str, list[str]]] = {}
    results: dict[str, dict[str, Any]] = {}
    submitted = 0
    while todo or running:
        fit = workers.look()
        for address in workers.unfit.keys() - told:
            say(f"{address}: {workers.unfit[address]}")
            told.add(address)
        for future, (name, given) in list(running.items()):
            if not fit.keys() & set(given) and not future.done():  # all that might have run it are gone
                future.cancel()
                del running[future]
                todo.insert(0, name)
        while todo and len(running) < sum(fit.values()):
            name = todo.pop(0)
            running[submit(name, list(fit), submitted)] = name, list(fit)
            submitted += 1
        if not running and time.monotonic() - said_s > WAIT_SAID_S:
            others = f", none of {len(workers.unfit)} fits" if workers.unfit else ""
            say(f"waiting for workers{others}; `dask worker ADDRESS` starts one")
            said_s = time.monotonic()
        with contextlib.suppress(TimeoutError):
            if running:
                wait(list(running), timeout=LOOK_S, return_when="FIRST_COMPLETED")
            else:
                time.sleep(LOOK_S)
        for future in [future for future in running if future.done()]:
            name, _ = running.pop(future)
            results[name] = _result(future)
            listen(name, {"event": "end", **results[name]})
            future.release()
            if results[name]["status"] == "failed" and not keep_going:
                client.cancel(list(running))
                return results
    return results


def _result(future: Any) -> dict[str, Any]:
    """Result of a finished task; an error becomes a failed job."""
    try:
        return dict(future.result())
    except SkinbakeError as error:
        return {"status": "failed", "error": str(error)}
    except BaseException as error:  # a lost worker, a cancelled task, a fault of ours: the other jobs go on
        if isinstance(error, KeyboardInterrupt):
            raise
        return {"status": "failed", "error": f"{type(error).__name__}: {error}"}


def _on_worker(work: Work, payload: Any, name: str, topic: str) -> dict[str, Any]:
    """One job, on a worker."""
    from distributed import get_worker

    worker = get_worker()
    with _ONE_BAKE:
        worker.log_event(topic, {"name": name, "event": "begin", "host": platform.node()})
        result = work(payload, lambda event: worker.log_event(topic, {"name": name, **event}))
    return result | {"host": platform.node()}


@contextlib.contextmanager
def _client(address: str, workers: int) -> Iterator[Any]:
    """Client of a scheduler, or of a local cluster, closed at the end."""
    try:
        import distributed
        from distributed.comm import get_address_host_port
    except ImportError as error:
        raise MachineError("--dask: dask.distributed is not installed; pip install 'skinbake[farm]'") from error
    logging.getLogger("distributed").setLevel(logging.ERROR)
    with contextlib.ExitStack() as stack:
        if address == LOCAL:
            stack.enter_context(fewer_threads(workers))
            try:
                with starting_children():
                    cluster = distributed.LocalCluster(
                        n_workers=workers, threads_per_worker=1, dashboard_address=None, silence_logs=logging.ERROR
                    )
            except (OSError, TimeoutError, RuntimeError) as error:
                raise MachineError(f"--dask local: its {workers} processes did not start: {error}; use -j") from error
            address = stack.enter_context(cluster).scheduler_address
        else:
            try:
                get_address_host_port(address)
            except ValueError as error:
                raise InputError(f"--dask {address}: expected HOST:PORT or {LOCAL}, got: {error}") from error
        try:
            client = distributed.Client(address, timeout=CONNECT_S)
        except Exception as error:  # dask takes what another protocol says for lengths: MemoryError, struct.error, ...
            raise MachineError(
                f"--dask {address}: no scheduler answers there; `dask scheduler` starts one, `dask worker {address}` "
                f"gives it workers ({type(error).__name__})"
            ) from error
        yield stack.enter_context(client)
