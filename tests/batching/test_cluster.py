import subprocess
import sys
import time
from importlib import import_module, util

import pytest

import bunraku
from bunraku.batching import cluster
from bunraku.cli import run
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
        yield wait_for_workers(found, 2)
    finally:
        for process in reversed(processes):
            process.terminate()
        for process in processes:
            process.wait(timeout=30)


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
    bunraku.batch(folder / "jobs.csv", folder / "here", workers=2)
    for name in ("results.csv", "index.html"):
        assert (folder / "there" / name).exists()
    for record in records:
        for file in record.files:
            here, there = (folder / place / "results" / file for place in ("here", "there"))
            assert here.read_bytes() == there.read_bytes()


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
    with pytest.raises(FormatError, match=r"needs the extra: pip install 'bunraku\[cluster\]'"):
        bunraku.batch(folder / "jobs.csv", folder / "none", cluster="tcp://localhost:8786")
