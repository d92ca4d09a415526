import msgspec
import pytest

from bunraku.batching.jobs import Job
from bunraku.batching.records import Record, find_record, write_record

JOB = Job(figure="hero.obj")


def as_report(**parts):
    return {name: msgspec.Raw(msgspec.json.encode(part)) for name, part in parts.items()}


def test_a_record_comes_back_with_its_numbers(tmp_path):
    clips = [{"name": "a", "stretch_p99": 1.5}, {"name": "b", "stretch_p99": 1.25}]
    report = as_report(confidence=0.75, warnings=["two hats"], clips=clips)
    (tmp_path / "hero-1.glb").write_bytes(b"1234")
    record = Record(name="hero-1", job=JOB, state="done", files={"hero-1.glb": 4}, report=report)
    write_record(tmp_path, record)
    found = find_record(tmp_path, "hero-1")
    assert (found.confidence, found.warnings) == (0.75, ["two hats"])
    assert found.worst("stretch_p99") == 1.5


def test_what_nobody_measured_is_left_out_of_the_worst():
    clips = [{"name": "a", "seen": None}, {"name": "b", "seen": 0.5}, {"name": "c"}]
    record = Record(name="hero-1", job=JOB, state="done", report=as_report(clips=clips))
    assert record.worst("seen") == 0.5
    assert record.worst("unseen") is None


def test_without_a_report_there_are_no_numbers():
    record = Record(name="hero-1", job=JOB, state="no match")
    assert (record.confidence, record.warnings, record.worst("stretch_p99")) == (0.0, [], None)


@pytest.mark.parametrize(
    ("state", "is_final"),
    [
        ("done", True),
        ("bad input", True),
        ("no match", True),
        ("out of time", False),
        ("out of memory", False),
        ("crashed", False),
    ],
)
def test_what_may_end_otherwise_is_tried_again(tmp_path, state, is_final):
    write_record(tmp_path, Record(name="hero-1", job=JOB, state=state))
    assert (find_record(tmp_path, "hero-1") is not None) == is_final


def test_results_that_are_gone_or_cut_are_made_again(tmp_path):
    record = Record(name="hero-1", job=JOB, state="done", files={"hero-1.glb": 4})
    write_record(tmp_path, record)
    assert find_record(tmp_path, "hero-1") is None
    (tmp_path / "hero-1.glb").write_bytes(b"123")
    assert find_record(tmp_path, "hero-1") is None
    (tmp_path / "hero-1.glb").write_bytes(b"1234")
    assert find_record(tmp_path, "hero-1") == record
    (tmp_path / "hero-1.json").write_text("{")
    assert find_record(tmp_path, "hero-1") is None
