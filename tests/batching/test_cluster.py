import os
import subprocess
import sys
import time
from importlib import import_module, util

import pytest

import bunraku
from bunraku.batching import cluster
from bunraku.batching.running import run_apart
from bunraku.cli import run
from bunraku.errors import Code
from bunraku.types import FormatError

needs_dask = pytest.mark.skipif(
    util.find_spec("distributed") is None,
    reason="no Dask: pip install 'bunraku[cluster]' to test batches on a cluster",
)


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory):
    """A scheduler and two workers, processes each, as on three machines."""
    folder = tmp_path_factory.mktemp("cluster")
    found = folder / "scheduler.json"
    options = ["--scheduler-file", str(found)]
    commands = [
        [sys.executable, "-m", "distributed.cli.dask_scheduler", *options, "--port", "0"],
        *[[sys.executable, "-m", "distributed.cli.dask_worker", *options, "--nthreads", "1"]] * 2,
    ]
    commands[0] += ["--no-dashboard", "--host", "127.0.0.1"]
    processes = []
    try:
        for command in commands:
            quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
            processes.append(subprocess.Popen(command, cwd=folder, **quiet))
        address = wait_for_workers(found, 2)
        yield address
        with import_module("distributed").Client(address, timeout=60) as client:
            client.shutdown()
    finally:
        for process in processes:
            try:
                process.wait(timeout=20)
            except subprocess.TimeoutExpired:  # a busy machine
                process.kill()
                process.wait()


def wait_for_workers(found, count):
    """Give the scheduler's address when so many workers have come."""
    for _ in range(600):
        if found.exists() and found.stat().st_size:
            break
        time.sleep(0.1)
    with import_module("distributed").Client(scheduler_file=str(found), timeout=60) as client:
        client.wait_for_workers(count, timeout=60)
        return client.scheduler.address


@needs_dask
@pytest.mark.filterwarnings("default")  # Dask's own
def test_a_cluster_does_the_same_as_this_machine(folder, scheduler):
    records = bunraku.batch(folder / "jobs.csv", folder / "there", cluster=scheduler)
    assert [record.state for record in records] == ["done", "bad input", "done", "done"]
    before = stamps(folder / "there")
    bunraku.batch(folder / "jobs.csv", folder / "there", cluster=scheduler, resume=True)
    assert stamps(folder / "there") == before
    assert (folder / "there" / "index.html").exists()
    first = run_apart(records[0].job, folder / "there")  # on this machine, in another folder
    for file in first.files:
        there = folder / "there" / "results" / file
        assert (folder / "there" / file).read_bytes() == there.read_bytes()


def stamps(folder):
    return {path: path.stat().st_mtime_ns for path in (folder / "results").iterdir()}


@needs_dask
@pytest.mark.filterwarnings("default")
def test_a_scheduler_that_does_not_answer_is_one_line(folder, monkeypatch, capsys):
    monkeypatch.setattr(cluster, "PATIENCE", 0.5)
    address = "tcp://127.0.0.1:9"
    code = run(
        ["batch", str(folder / "jobs.csv"), "-o", str(folder / "none"), "--cluster", address]
    )
    (line,) = capsys.readouterr().err.splitlines()
    assert code == 2
    assert line.startswith(f"error: --cluster {address}: no scheduler answers")
    assert len(line) <= 300


def test_a_missing_extra_is_one_line(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(
        FormatError, match=r"needs the extra: pip install 'bunraku\[cluster\]'"
    ) as caught:
        bunraku.batch(folder / "jobs.csv", folder / "none", cluster="tcp://localhost:8786")
    assert caught.value.code is Code.EXTRA_MISSING


@needs_dask
@pytest.mark.filterwarnings("default")
def test_a_job_whose_machine_is_lost_fails_alone(folder, scheduler, monkeypatch):
    lost = bunraku.Job(figure=str(folder / "figure0.ply"), seed=9)
    other = bunraku.Job(figure=str(folder / "bad.obj"))

    def die_or_run(job, **limits):
        return os._exit(1) if job.seed else run_apart(job, **limits)

    monkeypatch.setattr(cluster, "run_apart", die_or_run)
    first, second = bunraku.batch([lost, other], folder / "lost", cluster=scheduler)
    assert first.state == "crashed"
    assert "lost on the cluster" in first.error
    assert second.state == "bad input"
