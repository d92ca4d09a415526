"""What a visitor uploads; the page is a stand-in here, test_studio.py has a real one."""

import io
import tempfile
import threading
import zipfile
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("viser", reason="the studio needs viser")

from bunraku.studio import visits
from bunraku.studio.visits import FIGURES, FILM_STAGES, PERFORMANCES, RESULTS, STAGES, Visit


class EndlessCrew:
    def end(self):
        """There is no job to end."""


@pytest.fixture
def visit(tmp_path):
    """A visit without a page."""
    visit = object.__new__(Visit)
    visit.kept = tempfile.TemporaryDirectory(dir=tmp_path)
    visit.folder = Path(visit.kept.name)
    for name in (FIGURES, PERFORMANCES, RESULTS):
        (visit.folder / name).mkdir()
    visit.status = SimpleNamespace(content="")
    visit.progress = SimpleNamespace(value=0.0)
    visit.busy, visit.keeping, visit.gone = threading.Lock(), threading.Lock(), threading.Event()
    visit.numbers, visit.crew, visit.places = count(), EndlessCrew(), threading.Semaphore(1)
    visit.figures, visit.performances = {}, {}
    yield visit
    visit.kept.cleanup()


def take(visit, name, content, kind=FIGURES):
    known = visit.figures if kind == FIGURES else visit.performances
    choice = SimpleNamespace(options=(), value="")
    visit._take(SimpleNamespace(name=name, content=content), kind, known, choice)
    return known.get(name)


def packed(*names):
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name in names:
            archive.writestr(name, b"x")
    return content.getvalue()


def test_uploads_of_one_stem_lie_apart(visit):
    first = take(visit, "walk.zip", packed("0000.png"), PERFORMANCES)
    second = take(visit, "walk.v2", packed("0005.png"), PERFORMANCES)
    assert [path.name for path in first.glob("*.png")] == ["0000.png"]
    assert [path.name for path in second.glob("*.png")] == ["0005.png"]
    third = take(visit, "walk", b"a file", PERFORMANCES)
    assert third.read_bytes() == b"a file"


def test_a_damaged_upload_is_one_line_and_leaves_the_earlier_one(visit):
    first = take(visit, "walk.zip", packed("0000.png"), PERFORMANCES)
    assert take(visit, "walk.zip", packed("0000.png")[:50], PERFORMANCES) == first
    assert visit.status.content.startswith("error: walk.zip: is a damaged or locked zip file")
    assert (first / "0000.png").exists()
    assert len(list((visit.folder / PERFORMANCES).iterdir())) == 1


def test_an_upload_that_a_job_reads_stays_until_the_end(visit):
    first = take(visit, "a.obj", b"1")
    with visit.busy:
        second = take(visit, "a.obj", b"2")
    third = take(visit, "a.obj", b"3")
    assert (first.read_bytes(), third.read_bytes()) == (b"1", b"3")
    assert not second.exists()


def test_what_is_not_ours_is_never_removed(visit, tmp_path):
    given = tmp_path / "given.obj"
    given.write_bytes(b"given")
    visit.figures["given.obj"] = given
    assert take(visit, "given.obj", b"mine").read_bytes() == b"mine"
    assert given.read_bytes() == b"given"


def test_an_upload_after_the_visit_leaves_nothing(visit):
    visit.leave()
    assert take(visit, "a.obj", b"late") is None
    assert not visit.folder.exists()
    visit.animate()  # does nothing either
    assert not visit.folder.exists()


def test_an_upload_of_too_much_is_told(visit, monkeypatch):
    monkeypatch.setattr(visits, "LARGEST_UPLOAD", 3)
    assert take(visit, "a.obj", b"1234") is None
    assert "error: a.obj: has 0 MB, more than may be uploaded here" in visit.status.content


def test_messages_are_without_our_folders(visit):
    path = take(visit, "a.obj", b"1")
    visit._say(f"bad input: {path}: has no faces")
    assert visit.status.content == "bad input: a.obj: has no faces"


@pytest.mark.parametrize("stages", [STAGES, FILM_STAGES])
def test_progress_is_that_of_the_job_whatever_is_chosen_meanwhile(visit, monkeypatch, stages):
    def supervise(request, seconds, tell, crew):
        visit.performances["walk"] = None
        tell(stages[0])
        raise KeyboardInterrupt

    monkeypatch.setattr(visits, "supervise", supervise)
    figure = take(visit, "a.obj", b"1")
    visit.performances["walk"] = None
    if stages is FILM_STAGES:
        visit.performances["walk"] = take(visit, "b.zip", packed("0000.png"), PERFORMANCES)
    with pytest.raises(KeyboardInterrupt):
        visit._run(figure, "walk")
    assert visit.progress.value == pytest.approx(50.0 / len(stages))
