import importlib.util
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import bunraku
from bunraku.batching.batches import _own
from bunraku.cli import run
from bunraku.types import FormatError

BENCH = Path(__file__).parents[2] / "bench" / "batching.py"


@pytest.fixture(scope="module")
def ended(folder):
    """One batch, two jobs at a time, and all that it said."""
    news = []
    records = bunraku.batch(
        folder / "jobs.csv", folder / "out", workers=2, watch=lambda job, what: news.append(what)
    )
    return records, news


def test_a_bad_figure_stops_no_other(ended, folder):
    records, _ = ended
    assert [record.state for record in records] == ["done", "bad input", "done", "done"]
    assert records[1].error.startswith(f"error: {folder / 'bad.obj'}: has no faces")
    for record in records:
        for name, size in record.files.items():
            assert (folder / "out" / "results" / name).stat().st_size == size
    moved = folder / "out" / "results" / f"{records[3].name}.glb"
    assert [clip.name for clip in bunraku.read_performer(moved).clips] == ["Wave"]


def test_the_summary_is_written(ended, folder):
    page = (folder / "out" / "index.html").read_text()
    assert "3 of 4 figures move" in page
    assert (folder / "out" / "results.csv").read_text().count("\n") == 5


def test_stages_are_told_as_they_begin(ended):
    records, news = ended
    stages = [what for what in news if isinstance(what, str)]
    assert stages.count("registration") == 3
    assert {record.name for record in records} == {r.name for r in news if not isinstance(r, str)}


def test_a_second_run_does_only_what_is_missing(ended, folder):
    records, _ = ended
    results = folder / "out" / "results"
    (results / f"{records[2].name}.glb").unlink()
    before = {path: path.stat().st_mtime_ns for path in results.iterdir()}
    news = []
    again = bunraku.batch(
        folder / "jobs.csv", folder / "out", resume=True, watch=lambda job, what: news.append(what)
    )
    assert [what for what in news if isinstance(what, str)].count("registration") == 1
    made = {path.stem for path in results.iterdir() if before.get(path) != path.stat().st_mtime_ns}
    assert made == {records[2].name}
    assert [r.state for r in again] == [r.state for r in records]


def test_old_results_are_not_mixed_with_new_ones(ended, folder):
    with pytest.raises(FormatError, match=r"out: holds results of an earlier batch; add --resume"):
        bunraku.batch(folder / "jobs.csv", folder / "out")


def test_two_batches_cannot_share_a_folder(tmp_path):
    with (
        _own(tmp_path, resume=True),
        pytest.raises(FormatError, match="in use by another batch"),
        _own(tmp_path, resume=True),
    ):
        pass


def test_a_folder_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(FormatError, match="out: cannot be used"):
        bunraku.batch([bunraku.Job(figure="a.obj")], tmp_path / "out")


def test_the_command_prints_each_end_and_fails_if_one_did(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    (folder / "few.csv").write_text("figure\nbad.obj\nmissing.obj\n")
    assert run(["batch", "few.csv", "-o", "few"]) == 2
    shown = capsys.readouterr()
    assert "index.html" in shown.out
    lines = shown.err.splitlines()
    assert sum(": bad input: " in line for line in lines) == 2
    assert lines[-1].startswith("error: few.csv: 2 of 2 jobs failed; see few/index.html")


def test_an_interrupt_ends_every_process(folder):
    command = [sys.executable, "-m", "bunraku.cli", "batch", "jobs.csv", "-o", "late"]
    listening = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)}
    with subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True, **listening) as p:
        workers = wait_for_workers(p.pid)
        p.send_signal(signal.SIGINT)
        errors = p.communicate(timeout=60)[1]
    assert p.returncode == 130
    assert errors.splitlines()[-1].startswith("error: interrupted")
    for worker in workers:
        with pytest.raises(ProcessLookupError):
            os.kill(worker, 0)


def wait_for_workers(number):
    """Wait until a batch has processes at work; give their numbers."""
    for _ in range(600):
        threads = Path(f"/proc/{number}/task").glob("*/children")
        workers = [int(w) for thread in threads for w in thread.read_text().split()]
        if workers:
            return workers
        time.sleep(0.05)
    raise AssertionError("no process was started")


def test_kills_lose_nothing_and_leave_nothing_torn(folder):
    """A small version of `python bench/batching.py kills`, which kills a hundred times."""
    spec = importlib.util.spec_from_file_location("bench_batching", BENCH)
    bench = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(bench)
    (folder / "kills").mkdir()
    good = [line for line in (folder / "jobs.csv").read_text().splitlines() if "bad" not in line]
    (folder / "good.csv").write_text("\n".join(good) + "\n")
    found = bench.kill_often(
        folder / "good.csv", folder / "kills", count=4, longest=3.0, rng=random.Random(0)
    )
    assert found.pop("ended") >= 1
    found.pop("survived")
    assert found == {"kills": 4, "lost": 0, "redone": 0, "torn": 0, "other": 0}
