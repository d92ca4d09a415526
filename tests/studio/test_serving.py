import sys
import threading

import numpy as np
import pytest

from bunraku.cli import run, visiting
from bunraku.cli.failures import INTERRUPTED
from bunraku.errors import Code
from bunraku.studio import visits
from bunraku.studio.serving import Studio
from bunraku.types import FormatError
from tests.depth_folders import write_folder


def test_a_missing_extra_is_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(
        FormatError, match=r"needs the extra: pip install 'bunraku\[studio\]'"
    ) as caught:
        Studio(port=0)
    assert caught.value.code is Code.EXTRA_MISSING


def test_a_missing_figure_is_one_line(capsys):
    assert run(["studio", "missing.obj"]) == 2
    assert capsys.readouterr().err.startswith("error: missing.obj: does not exist")


def test_a_folder_without_frames_is_one_line(capsys, tmp_path):
    for given in (["--with", str(tmp_path)], [str(tmp_path)]):
        assert run(["studio", *given]) == 2
        assert "is a folder without depth frames" in capsys.readouterr().err


def test_a_depth_video_is_served(monkeypatch, tmp_path):
    """Its folder is offered; the rest is the page's, which waits for Ctrl-C."""
    offered = []

    def serve(figure, performance, **more):
        offered.append(performance)
        raise KeyboardInterrupt

    write_folder(tmp_path, 1000 + np.zeros((2, 48, 64)))
    monkeypatch.setattr(visiting, "Studio", serve)
    assert run(["studio", "--with", str(tmp_path)]) == INTERRUPTED
    assert offered == [tmp_path]


def test_what_is_given_is_offered_first(tmp_path):
    figures, performances = visits.choices(tmp_path / "hero.obj", None)
    assert list(figures) == ["hero.obj", "stylised", "realistic"]
    assert list(performances) == ["built-in human"]


class Anything:
    """Takes whatever is done to it, as a page does."""

    def __getattr__(self, name):
        return self.__dict__.setdefault(name, Anything())

    def __call__(self, *arguments, **options):
        return Anything()

    def __enter__(self):
        return self

    def __exit__(self, *error):
        return None


class Upload:
    def __init__(self, name, content):
        self.name, self.content = name, content


def test_uploads_are_capped_renamed_and_removed(monkeypatch):
    visit = visits.Visit(Anything(), threading.Semaphore(1), *visits.choices(None, None))
    monkeypatch.setattr(visits, "LARGEST_UPLOAD", 10)

    def take(name, content):
        visit._take(Upload(name, content), "figures", visit.figures, visit.figure)
        return visit.status.content

    assert take("../../etc/pass word", b"1234") == "pass_word is here. Press **Animate**."
    assert visit.figures["pass_word"].parent.parent == visit.folder / "figures"
    assert take("..", b"1234") == "upload is here. Press **Animate**."
    assert "more than may be uploaded" in take("big.obj", bytes(11))
    monkeypatch.setattr(visits, "MOST_UPLOADS", 10)
    assert "more than may be uploaded" in take("third.obj", b"1234")
    visit.leave()
    assert not visit.folder.exists()


def test_visitors_have_folders_of_their_own():
    first, second = (
        visits.Visit(Anything(), threading.Semaphore(1), *visits.choices(None, None))
        for _ in range(2)
    )
    assert first.folder != second.folder
    first._take(Upload("a.obj", b"v"), "figures", first.figures, first.figure)
    assert "a.obj" not in second.figures
    first.leave()
    assert second.folder.exists()
    second.leave()
