import json
import os
import shutil
import signal
import socketserver
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, suppress

import pytest

from skinbake.batch.dask_cluster import run_on_dask
from skinbake.errors import InputError
from skinbake.io.mesh import write_obj
from tests.cli.test_batch import BATCH, digests
from tests.conftest import ROOT
from tests.shapes import relief

pytestmark = pytest.mark.slow  # processes, waits, or many bakes

pytest.importorskip("distributed", reason="the extra `farm` is not installed")

CLIENT = """
import json, sys
from skinbake.batch import dask_cluster
from skinbake.batch.dask_cluster import run_on_dask
from tests.batch.fake_jobs import work
if __name__ == "__main__":
    address, payloads = sys.argv[1], json.loads(sys.argv[2])
    dask_cluster.CONNECT_S, dask_cluster.WAIT_SAID_S, events = 5, 0.5, []
    listen = lambda name, event: events.append((name, event.get("why", event["event"])))
    found = run_on_dask(address, work, payloads, listen, **json.loads(sys.argv[3]))
    print(json.dumps({"results": found, "events": events}))
"""
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT), "NUMBA_NUM_THREADS": "1"}


def dask(*arguments, path=str(ROOT), cwd=None):
    command = [sys.executable, "-m", "dask", *arguments]
    environment = ENVIRONMENT | {"PYTHONPATH": path}
    return subprocess.Popen(command, env=environment, cwd=cwd, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory):
    """A scheduler, a process of its own, on loopback: its file, and its workers, to which tests may add."""
    file = tmp_path_factory.mktemp("dask") / "scheduler.json"
    with ExitStack() as stack:
        workers = []
        processes = [
            dask("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
        ]
        stack.callback(lambda: [(p.kill(), p.wait()) for p in processes + workers])
        wait_for(lambda: file.exists() and file.read_text().strip().endswith("}"))
        yield file, workers


@pytest.fixture
def cluster(tmp_path, scheduler):
    """The scheduler's address and two workers, each a process of its own; one that a test has killed is replaced."""
    file, workers = scheduler
    workers[:] = [worker for worker in workers if worker.poll() is None]
    workers += [
        dask("worker", "--scheduler-file", str(file), "--nthreads", "1", "--no-nanny", "--no-dashboard",
             "--local-directory", str(tmp_path / f"worker{i}"))
        for i in range(len(workers), 2)
    ]  # fmt: skip
    return json.loads(file.read_text())["address"], workers


def wait_for(condition, seconds=60):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it did not happen in time"
        time.sleep(0.05)


def client(tmp_path, address, payloads, **options):
    """The client in a process of its own, as `skinbake batch` is."""
    (tmp_path / "client.py").write_text(CLIENT)
    return subprocess.Popen(
        [sys.executable, str(tmp_path / "client.py"), address, json.dumps(payloads), json.dumps(options)],
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def lines(log):
    return [line.split() for line in log.read_text().splitlines()] if log.exists() else []


def test_a_lost_worker_s_job_is_taken_up_by_another(tmp_path, cluster):
    """Two workers, one killed in the middle of its job: every job ends once, and all results arrive."""
    address, workers = cluster
    log = tmp_path / "log"
    payloads = {f"job{i}": {"value": i, "seconds": 0.7, "log": str(log)} for i in range(6)}
    with client(tmp_path, address, payloads) as process:
        wait_for(lambda: len({pid for what, _, pid in lines(log) if what == "begin"}) == 2)
        victim = workers[0]
        wait_for(lambda: any(pid == str(victim.pid) for what, _, pid in lines(log)[-2:] if what == "begin"))
        victim.send_signal(signal.SIGKILL)
        out, err = process.communicate(timeout=90)
    assert process.returncode == 0, err
    found = json.loads(out.splitlines()[-1])
    assert [found["results"][name]["status"] for name in payloads] == ["done"] * 6
    assert [found["results"][name]["value"] for name in payloads] == list(range(6))
    ended = [value for what, value, _ in lines(log) if what == "end"]
    begun = [value for what, value, _ in lines(log) if what == "begin"]
    assert sorted(ended) == [str(i) for i in range(6)], "a job ended twice, or never"
    assert len(begun) == 7, "the lost job begins a second time"
    assert ["job0", "stage"] in found["events"]


def test_a_batch_on_a_farm_leaves_what_one_on_this_machine_does(tmp_path, cluster):
    """Real bakes through the verb; a worker is killed while it holds a folder: the same bytes, nothing half-written."""
    address, workers = cluster
    write_obj(tmp_path / "mesh.obj", relief(segments=24))
    (tmp_path / "looks.yaml").write_text(BATCH)

    def batch(out, *more):
        command = [sys.executable, "-m", "skinbake", "batch", str(tmp_path / "looks.yaml"), "--no-preview", "--quiet"]
        return subprocess.Popen([*command, "--out", str(tmp_path / out), *more], env=ENVIRONMENT, cwd=ROOT)

    def locked():
        """Folders that a worker writes to, by the worker."""
        found = {}
        for path in (tmp_path / "farm").glob("*/.lock"):
            with suppress(OSError):
                found |= dict.fromkeys(path.read_text().split()[1:2], path)
        return found

    with batch("farm", "--dask", address) as process:
        wait_for(lambda: str(workers[0].pid) in locked())
        workers[0].kill()
        assert process.wait(180) == 0
    with batch("here") as process:
        assert process.wait(180) == 0
    assert digests(tmp_path, "farm") == digests(tmp_path, "here")
    report = json.loads((tmp_path / "farm" / "batch.json").read_text())
    assert [job["status"] for job in report["jobs"]] == ["done"] * 4
    assert report["dask"] == address
    assert not list((tmp_path / "farm").rglob("*.part*"))


def test_a_worker_of_other_code_is_told_and_given_no_job(tmp_path):
    """Before any worker is there that is waited for; the one that fits does everything, also as it joins last."""
    shutil.copytree(ROOT / "skinbake", tmp_path / "old" / "skinbake", ignore=shutil.ignore_patterns("__pycache__"))
    with open(tmp_path / "old" / "skinbake" / "numerics.py", "a") as code:
        code.write("# changed\n")
    file, log = tmp_path / "scheduler.json", tmp_path / "log"
    payloads = {f"job{i}": {"value": i, "log": str(log)} for i in range(3)}
    with ExitStack() as stack:
        processes = []
        stack.callback(lambda: [(p.kill(), p.wait()) for p in processes])
        processes += [
            dask("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
        ]
        wait_for(lambda: file.exists() and file.read_text().strip().endswith("}"))
        process = stack.enter_context(client(tmp_path, json.loads(file.read_text())["address"], payloads))
        for name, path in (("old", f"{tmp_path / 'old'}{os.pathsep}{ROOT}"), ("new", str(ROOT))):
            time.sleep(3)
            worker = ["worker", "--scheduler-file", str(file), "--nthreads", "1", "--no-nanny", "--no-dashboard"]
            processes.append(dask(*worker, "--local-directory", str(tmp_path / name), path=path, cwd=tmp_path))
        out, err = process.communicate(timeout=90)
    assert process.returncode == 0, err
    found = json.loads(out.splitlines()[-1])
    assert [found["results"][name]["status"] for name in payloads] == ["done"] * 3
    assert {pid for _, _, pid in lines(log)} == {str(processes[-1].pid)}
    said = [why for name, why in found["events"] if name == "--dask"]
    assert said[0] == "waiting for workers; `dask worker ADDRESS` starts one"
    assert any("left out, it runs other skinbake code; update it" in why for why in said)


def test_failures_arrive_and_do_not_stop_the_others(tmp_path, cluster):
    """A job that says no and one that breaks are told; bad input is not tried again."""
    log = tmp_path / "log"
    payloads = {
        "a": {"do": "fail", "value": 0, "log": str(log)},
        "b": {"do": "raise", "value": 1, "log": str(log)},
        "c": {"value": 2, "log": str(log)},
    }
    with client(tmp_path, cluster[0], payloads, retries=0) as process:
        out, err = process.communicate(timeout=90)
    assert process.returncode == 0, err
    results = json.loads(out.splitlines()[-1])["results"]
    assert [results[name]["status"] for name in "abc"] == ["failed", "failed", "done"]
    assert "no such mesh" in results["a"]["error"]
    assert "no such mesh" in results["b"]["error"]


def test_local_starts_a_cluster_of_its_own(tmp_path):
    """`--dask local` needs nothing beside it."""
    with client(tmp_path, "local", {n: {"value": n} for n in "abc"}, workers=2) as process:
        out, err = process.communicate(timeout=90)
    assert process.returncode == 0, err
    results = json.loads(out.splitlines()[-1])["results"]
    assert [results[name]["value"] for name in "abc"] == ["a", "b", "c"]


class Greeting(socketserver.BaseRequestHandler):
    def handle(self):
        self.request.sendall(b"SSH-2.0-OpenSSH_9.6\r\n")  # dask takes it for a length of 2.8 EiB


@pytest.fixture
def ssh():
    """Address of what answers, but is no scheduler."""
    with socketserver.TCPServer(("127.0.0.1", 0), Greeting) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"tcp://127.0.0.1:{server.server_address[1]}"
        server.shutdown()
        thread.join()


@pytest.mark.parametrize("who", ["nobody", "ssh"])
def test_no_scheduler_is_told(tmp_path, ssh, who):
    """The message says how to start one, also where another protocol answers."""
    address = ssh if who == "ssh" else "tcp://127.0.0.1:9"
    with client(tmp_path, address, {"a": {}}) as process:
        _, err = process.communicate(timeout=90)
    assert f"MachineError: --dask {address}: no scheduler answers there; `dask scheduler` starts one" in err


@pytest.mark.parametrize("address", ["foo", "tcp://foo", "foo:bar", "xyz://foo:1"])
def test_an_address_that_is_none_is_bad_input(address):
    """Nobody is asked."""
    with pytest.raises(InputError, match=f"--dask {address}: expected HOST:PORT or local, got"):
        run_on_dask(address, None, {}, None)
