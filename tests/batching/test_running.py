import msgspec
import pytest

import bunraku
from bunraku.batching import working
from bunraku.batching.jobs import Job
from bunraku.batching.records import Request, find_record
from bunraku.batching.running import run_apart


@pytest.fixture
def job(folder):
    return Job(figure=str(folder / "figure0.ply"), performance=str(folder / "performer.glb"))


def test_a_job_that_takes_too_long_is_stopped(job, tmp_path):
    record = run_apart(job, tmp_path, seconds=0.2)
    assert record.state == "out of time"
    assert record.error.startswith(f"error: {job.figure}: took more than 0.2 s")
    assert find_record(tmp_path, record.name) is None  # it may be tried again


def test_a_job_that_needs_too_much_memory_fails_alone(job, tmp_path):
    record = run_apart(job, tmp_path, memory=200 << 20)
    assert record.state in ("out of memory", "crashed")  # some libraries die of it
    assert record.error.startswith(f"error: {job.figure}: ")
    assert record.error.endswith("--memory")
    assert run_apart(job, tmp_path).state == "done"


def test_a_fault_of_ours_is_recorded_with_its_place(job, tmp_path, monkeypatch):
    def stumble(*arguments, **options):
        raise KeyError("left leg")

    monkeypatch.setattr(working, "animate", stumble)
    record = working.work(Request(job, "name", str(tmp_path), 1 << 30))
    assert record.state == "crashed"
    assert "KeyError" in record.error
    assert "in stumble" in record.details


@pytest.mark.parametrize(
    ("error", "state"),
    [
        (bunraku.MatchError("two heads"), "no match"),
        (bunraku.FormatError("a.obj", "line 1", "is torn"), "bad input"),
        (MemoryError(), "out of memory"),
    ],
)
def test_every_end_has_its_state(job, tmp_path, monkeypatch, error, state):
    def fail(*arguments, **options):
        raise error

    monkeypatch.setattr(working, "animate", fail)
    record = working.work(Request(job, "name", str(tmp_path), 1 << 30))
    assert record.state == state
    assert (tmp_path / "name.json").exists()
    assert msgspec.json.decode(msgspec.json.encode(record), type=bunraku.Record) == record
