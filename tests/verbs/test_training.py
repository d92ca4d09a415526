import os
import signal
import subprocess
import sys
import time

import pytest

from bunraku.errors import Code
from bunraku.types import FormatError
from bunraku.verbs import training
from bunraku.verbs.training import train_deform, train_shape

pytest.importorskip("torch", reason="torch is not there: pip install bunraku[neural]")
pytest.importorskip("safetensors", reason="safetensors is not there: pip install bunraku[neural]")

from bunraku.neural import checkpoints
from bunraku.neural.corpus import Size
from bunraku.neural.implicit.corpus import Size as DeformSize
from bunraku.neural.implicit.training import Course, load_form

SIZE = DeformSize("quadruped", labelled=2, unlabelled=2)
COURSE = Course(
    "quadruped",
    **{"pose_steps": 10, "shape_steps": 10, "offset_steps": 200},
    **{"pose_batch": 4, "shape_batch": 4, "offset_batch": 4, "points": 8},
)
_KILLED = """
import sys
from bunraku.neural import checkpoints
from tests.verbs.test_training import COURSE, SIZE
from bunraku.verbs.training import train_deform
checkpoints.KEEP_EVERY = 5
train_deform(sys.argv[1], kind="quadruped", course=COURSE, size=SIZE)
"""


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def train(path, **options):
    return train_deform(path, kind="quadruped", course=COURSE, size=SIZE, **options)


def test_killed_training_goes_on_to_the_same_bytes(tmp_path):
    whole, killed = tmp_path / "whole.safetensors", tmp_path / "killed.safetensors"
    train(whole)
    process = subprocess.Popen([sys.executable, "-c", _KILLED, str(killed)], env=os.environ)
    ends, checkpoint = time.monotonic() + 120, killed.with_suffix(".checkpoint")
    while not checkpoint.is_file() and time.monotonic() < ends and process.poll() is None:
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert checkpoints.read_step(checkpoint.read_bytes()) < COURSE.steps
    assert "trained 220 steps" in train(killed, resume=True)
    assert killed.read_bytes() == whole.read_bytes()
    assert load_form(whole.read_bytes()).kind == "quadruped"


def test_training_that_cannot_be_says_why(tmp_path):
    out = tmp_path / "net.safetensors"
    with pytest.raises(FormatError, match="wanted one of person, quadruped") as caught:
        train_deform(out, kind="fish")
    assert caught.value.code == Code.OPTION
    with pytest.raises(FormatError, match="wanted 1 to 220"):
        train(out, until=221)
    with pytest.raises(FormatError, match=r"net\.checkpoint"):
        train(out, resume=True)


@pytest.mark.parametrize("other", [{"kind": "person"}, {"seed": 1}])
def test_a_course_of_another_kind_or_seed_is_refused(other, monkeypatch):
    monkeypatch.setattr(training, "need_people", lambda count: None)
    with pytest.raises(ValueError, match="kinds of course and size, and seed, are"):
        train_deform(**{"kind": "quadruped", "course": COURSE, "size": SIZE} | other)


def test_the_two_kinds_have_files_of_their_own(tmp_path, monkeypatch):
    monkeypatch.setattr(training, "_train", lambda work, out, **options: work.name)
    monkeypatch.setattr(training, "need_people", lambda count: None)
    names = [train_deform(kind=kind) for kind in ("person", "quadruped")]
    assert names == ["deform-person", "deform-quadruped"]


def test_a_course_may_begin_with_weights_and_says_so(tmp_path):
    first, second = tmp_path / "first.safetensors", tmp_path / "second.safetensors"
    size = Size(people=0, outfits=0, sculpted=2, quadrupeds=2)
    train_shape(first, steps=1, size=size)
    train_shape(second, steps=2, size=size, weights=first)
    notes, tensors = checkpoints.read_tensors(second.read_bytes())
    assert "begins=''" not in notes["course"] and "begins=" in notes["course"]
    before = checkpoints.read_tensors(first.read_bytes())[1]
    name = "embed.0.weight"
    assert 0 < (tensors[name] - before[name]).abs().max() < 0.01
    broken = tmp_path / "broken.safetensors"
    broken.write_bytes(b"nothing")
    with pytest.raises(FormatError, match="holds no shape network"):
        train_shape(tmp_path / "third.safetensors", steps=1, size=size, weights=broken)
