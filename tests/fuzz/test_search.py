"""A short search in every run of the tests; `make fuzz` is the long one."""

import struct

import numpy as np
import pytest

from bunraku.formats import inspect
from bunraku.types import FormatError
from tests.fuzz import run
from tests.fuzz.mutants import make_seeds, mutate
from tests.fuzz.run import read_all, search

KINDS = sorted(make_seeds())
COUNT = 250


@pytest.mark.parametrize("kind", KINDS)
def test_seeds_are_sound(tmp_path, kind):
    for number, content in enumerate(make_seeds()[kind]):
        path = tmp_path / f"{number}.{kind}"
        path.write_bytes(content)
        assert {fault.severity for fault in inspect(path).faults} <= {"note"}


@pytest.mark.parametrize("kind", KINDS)
def test_only_the_declared_error_escapes_from_damaged_files(tmp_path, monkeypatch, kind):
    monkeypatch.setattr(run, "FINDINGS", tmp_path)
    done, outcomes, found = search(kind, seed=20261125, count=COUNT, seconds=60)
    assert found == 0, [path.read_text() for path in tmp_path.glob("*.txt")]
    assert done == COUNT
    assert len(outcomes) > 4  # mutants reach different checks, not only the first


def test_the_search_finds_what_escapes(tmp_path, monkeypatch):
    def leak(path):
        if b"nan" in path.read_bytes():
            raise KeyError("x")
        raise FormatError(path, "", "is refused")

    monkeypatch.setattr(run, "inspect", leak)
    monkeypatch.setattr(run, "FINDINGS", tmp_path)
    _, outcomes, found = search("obj", seed=1, count=400, seconds=60)
    assert found == outcomes["ESCAPED"] > 0
    assert b"nan" in next(tmp_path.glob("*.obj")).read_bytes()


def test_a_result_that_is_not_finite_is_a_finding(tmp_path, monkeypatch):
    from dataclasses import replace

    path = tmp_path / "a.obj"
    path.write_bytes(make_seeds()["obj"][0])
    sound = inspect(path)
    monkeypatch.setattr(run, "inspect", lambda path: replace(sound, high=(np.inf, 0.0, 0.0)))
    with pytest.raises(AssertionError, match="not finite"):
        read_all(path, "obj")


def test_mutations_differ_and_repeat_with_their_seed():
    (seed,) = make_seeds()["glb"]
    first = [mutate(seed, np.random.default_rng(i)) for i in range(20)]
    again = [mutate(seed, np.random.default_rng(i)) for i in range(20)]
    assert first == again
    assert len(set(first)) > 15
    whole = [c for c in first if len(c) > 12 and struct.unpack_from("<I", c, 8)[0] == len(c)]
    assert len(whole) > 5  # most containers stay sound, so that what is inside is read
