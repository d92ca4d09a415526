"""A short search in every run of the tests; `make fuzz` is the long one."""

import struct
import time

import numpy as np
import pytest

from bunraku.formats import inspect
from bunraku.types import FormatError
from tests.fuzz import run
from tests.fuzz.mutants import make_seeds, mutate
from tests.fuzz.run import ESCAPED, make_mutant, read_all, search, search_everywhere

KINDS = run.kinds()
COUNT = 250


@pytest.fixture
def findings(tmp_path, monkeypatch):
    monkeypatch.setattr(run, "FINDINGS", tmp_path)
    return tmp_path


@pytest.mark.parametrize("kind", KINDS)
def test_seeds_are_sound(tmp_path, kind):
    for number, content in enumerate(run.seeds_of(kind)):
        path = tmp_path / f"{number}.{kind}"
        run.store(path, content)
        assert {fault.severity for fault in inspect(path).faults} <= {"note"}


@pytest.mark.parametrize("kind", KINDS)
def test_only_the_declared_error_escapes_from_damaged_files(findings, kind):
    outcomes = search(kind, range(COUNT), seed=20261125)
    assert outcomes[ESCAPED] == 0, [path.read_text() for path in findings.glob("*.txt")]
    assert outcomes.total() == COUNT
    assert len(outcomes) > 4  # mutants reach different checks, not only the first


def test_the_search_finds_what_escapes(findings, monkeypatch):
    def leak(path):
        if b"usemtl red" not in path.read_bytes():
            raise KeyError("x")
        raise FormatError(path, "", "is refused")

    monkeypatch.setattr(run, "inspect", leak)
    outcomes = search("obj", range(20), seed=1)
    kept = [path.read_bytes() for path in findings.glob("*.obj")]
    assert 20 > outcomes[ESCAPED] >= len(kept) > 0
    assert not any(b"usemtl red" in content for content in kept)


def test_what_takes_too_long_is_a_finding(findings, monkeypatch):
    def stall(path):
        try:
            time.sleep(30)
        except Exception as error:  # a reader that would swallow whatever interrupts it
            raise FormatError(path, "", "is refused") from error

    monkeypatch.setattr(run, "inspect", stall)
    monkeypatch.setattr(run, "SLOWEST", 0.05)
    assert search("obj", range(1), seed=1)[ESCAPED] == 1
    assert "TooSlow" in next(findings.glob("*.txt")).read_text()


def test_a_search_goes_on_where_it_was_cut_off(findings):
    progress = findings / "progress.jsonl"
    options = {"seed": 3, "workers": 1, "progress": progress}
    whole = search_everywhere(["off"], count=1200, **options)
    assert whole["off"].total() == 1200
    lines = progress.read_text().splitlines(keepends=True)
    progress.write_text(lines[0])
    assert search_everywhere(["off"], count=1200, **options) == whole
    assert sorted(progress.read_text().splitlines(keepends=True)) == sorted(lines)


def test_a_result_that_is_not_finite_is_a_finding(tmp_path, monkeypatch):
    from dataclasses import replace

    path = tmp_path / "a.obj"
    path.write_bytes(make_seeds()["obj"][0])
    sound = inspect(path)
    monkeypatch.setattr(run, "inspect", lambda path: replace(sound, high=(np.inf, 0.0, 0.0)))
    with pytest.raises(AssertionError, match="not finite"):
        read_all(path, "obj")


def test_mutants_differ_and_come_again_with_their_number():
    first = [make_mutant("glb", 5, i) for i in range(20)]
    assert first == [make_mutant("glb", 5, i) for i in range(20)]
    assert len(set(first)) > 15
    whole = [c for c in first if len(c) > 12 and struct.unpack_from("<I", c, 8)[0] == len(c)]
    assert len(whole) > 5  # most containers stay sound, so that what is inside is read


def test_mutations_repeat_with_their_generator():
    (seed,) = make_seeds()["bvh"]
    assert mutate(seed, np.random.default_rng(1)) == mutate(seed, np.random.default_rng(1))


@pytest.mark.parametrize("text", [b"7", b"null", b'"x"', b"[]", b"[1, [2]]"])
def test_any_json_in_a_container_can_be_mutated(text, rng):
    """A tree without branches has no place to change, and is no reason to fail."""
    chunk = text + b" " * (-len(text) % 4)
    content = b"glTF" + struct.pack("<IIII", 2, 20 + len(chunk), len(chunk), 0x4E4F534A) + chunk
    for _ in range(40):
        assert isinstance(mutate(content + b"\0" * 16, rng), bytes)
