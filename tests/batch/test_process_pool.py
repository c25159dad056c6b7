import os
import subprocess
import sys
import time

import pytest

from skinbake.batch.process_pool import ProcessPool
from skinbake.kernels.threads import processors
from tests.batch.fake_jobs import work
from tests.conftest import ROOT

pytestmark = pytest.mark.slow  # processes, waits, or many bakes


def run(payloads, workers=2, retries=0, keep_going=True):
    events = []
    crew = ProcessPool(work, workers, retries, lambda name, event: events.append((name, event)))
    return crew.run(payloads, keep_going), events, crew


def test_every_job_gives_its_result(tmp_path):
    """Nine jobs on two processes: each runs once, in order of begin, with its own result and its events."""
    log = tmp_path / "log"
    payloads = {f"job{i}": {"value": i, "log": str(log), "seconds": 0.01} for i in range(9)}
    results, events, crew = run(payloads)
    assert [results[name]["value"] for name in payloads] == list(range(9))
    lines = [line.split() for line in log.read_text().splitlines()]
    assert sorted(value for what, value, _ in lines if what == "begin") == [str(i) for i in range(9)]
    assert len({pid for *_, pid in lines}) == 2
    assert [name for name, event in events if event["event"] == "begin"] == list(payloads)
    assert [event.get("stage") for name, event in events if name == "job3"] == [None, "irradiance", None]
    assert crew.peak_mib > 10


def test_threads_are_divided_among_processes():
    """Two processes on two processors get one thread each, and the parent keeps its own setting."""
    before = os.environ.get("NUMBA_NUM_THREADS")
    for workers in (1, 2):
        results, _, _ = run({"a": {}}, workers)
        assert results["a"]["threads"] == str(max(1, int(before or processors()) // workers))
    assert os.environ.get("NUMBA_NUM_THREADS") == before


@pytest.mark.parametrize("do", ["fail", "raise", "kill"])
def test_a_failure_does_not_stop_the_others(do):
    """A job that says no, one that breaks, and one whose process is killed: the other four are done."""
    payloads = {f"job{i}": {"value": i, "do": do if i == 1 else "done"} for i in range(5)}
    results, _, _ = run(payloads)
    assert [result["status"] for result in results.values()] == ["done", "failed", "done", "done", "done"]
    assert ("SIGKILL" if do == "kill" else "no such mesh") in results["job1"]["error"]


def test_fail_fast_hands_out_no_more():
    """What had not begun is told as skipped."""
    payloads = {f"job{i}": {"do": "fail" if i == 0 else "done"} for i in range(4)}
    results, _, _ = run(payloads, workers=1, keep_going=False)
    assert [result["status"] for result in results.values()] == ["failed", "skipped", "skipped", "skipped"]


def test_a_killed_process_is_tried_again(tmp_path):
    """The job goes to a new process, as often as `retries` says; one that is always killed fails in the end."""
    payloads = {"a": {"do": "die", "mark": str(tmp_path / "mark"), "value": 7}, "b": {"do": "kill"}, "c": {}}
    results, events, _ = run(payloads, retries=1)
    assert [result["status"] for result in results.values()] == ["done", "failed", "done"]
    assert results["a"]["value"] == 7
    assert [name for name, event in events if event["event"] == "again"] == ["a", "b"] or [
        name for name, event in events if event["event"] == "again"
    ] == ["b", "a"]


def test_a_process_killed_while_it_gives_its_result_stops_nobody(tmp_path):
    """No lock that others wait for dies with it: they end at once, as if it had died in the middle of its job."""
    payloads = {"a": {"do": "die giving"}, "b": {"seconds": 2.0, "value": 1}, "c": {"value": 2}}
    begun = time.monotonic()
    results, _, _ = run(payloads)
    assert [result["status"] for result in results.values()] == ["failed", "done", "done"]
    assert "SIGKILL" in results["a"]["error"]
    assert time.monotonic() - begun < 20


def test_workers_end_with_a_killed_parent(tmp_path):
    """After SIGKILL of the batch no process goes on holding folders."""
    code = (
        "from skinbake.batch.process_pool import ProcessPool; from tests.batch.fake_jobs import work\n"
        f"if __name__ == '__main__': ProcessPool(work, 2, 0, lambda *_: None).run("
        f"{{n: {{'seconds': 60, 'log': {str(tmp_path / 'log')!r}}} for n in 'ab'}})\n"
    )
    (tmp_path / "main.py").write_text(code)
    with subprocess.Popen([sys.executable, str(tmp_path / "main.py")], env=os.environ | {"PYTHONPATH": str(ROOT)}) as p:
        deadline = time.monotonic() + 30
        while not (tmp_path / "log").exists() or len((tmp_path / "log").read_text().splitlines()) < 2:
            assert time.monotonic() < deadline
            time.sleep(0.05)
        p.kill()
    pids = [int(line.split()[-1]) for line in (tmp_path / "log").read_text().splitlines()]
    deadline = time.monotonic() + 10
    while any(_runs(pid) for pid in pids):
        assert time.monotonic() < deadline, "a worker outlived the batch"
        time.sleep(0.05)


def _runs(pid: int) -> bool:
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
