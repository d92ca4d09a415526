"""Depth folders on the command line: what is written, and one line for whatever is wrong."""

import json
import re

import numpy as np
import pytest
from PIL import Image

from bunraku.cli import run
from bunraku.formats import read_character, read_figure, write_mesh
from bunraku.types import DepthVideo
from tests.depth_folders import OURS, ball, save_video, write_folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory, film, creature):
    """A short recording, and the creature without its rig."""
    folder = tmp_path_factory.mktemp("recordings")
    video = film.video
    short = DepthVideo("x", video.times[:6], video.depths[:6], video.intrinsics)
    save_video(folder / "wave", short)
    write_mesh(folder / "creature.ply", creature.mesh)
    return folder


def test_a_performer_is_written_with_its_motion(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    assert run(["capture", "wave", "-o", "performer.glb", "--report", "performer.json"]) == 0
    performer = read_character("performer.glb")
    (clip,) = performer.clips
    assert (clip.name, len(clip.times)) == ("capture", 6)
    assert clip.times[-1] == pytest.approx(5 / 30)
    assert len(performer.mesh.faces) > 1000
    report = json.loads((folder / "performer.json").read_text())
    assert report["route"] == "from_depth"
    assert len(report["tracking_error_m"]) == 6 and max(report["tracking_error_m"]) < 0.03
    assert set(report["seen"]) == set(performer.skeleton.names)
    assert run(["inspect", "wave"]) == 0
    told = capsys.readouterr().out
    assert "wave: depth, folder" in told and "pixels, a view of" in told


def test_a_figure_is_moved_by_a_depth_folder(folder, monkeypatch):
    monkeypatch.chdir(folder)
    arguments = ["animate", "creature.ply", "--with", "wave", "-o", "out.glb"]
    assert run([*arguments, "--report", "out.json"]) == 0
    moved = read_character("out.glb")
    assert [clip.name for clip in moved.clips] == ["capture"]
    assert len(moved.mesh.vertices) == len(read_figure("creature.ply").mesh.vertices)
    report = json.loads((folder / "out.json").read_text())
    assert 0 <= report["confidence"] <= 1
    assert report["figure"]["vertices"] == len(moved.mesh.vertices)
    assert report["skin"]["influences_max"] <= 4 and not report["skin"]["unweighted_vertices"]
    assert report["clips"][0]["frames"] == 6


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("empty", "error: empty: holds no NNNN.png"),
        ("missing", "error: missing: is no folder"),
        ("blind", "error: blind: holds no intrinsics.json"),
        ("grey", r"error: grey: frame 0001\.png: has 8 bits"),
        ("sizes", r"error: sizes: frame 0002\.png: has 32 x 24 pixels"),
        ("nobody", "error: nobody: measured at most 0 pixels a frame"),
        ("one", "error: one: has a single frame, which shows no motion"),
    ],
)
def test_bad_recordings_end_in_one_line(tmp_path, monkeypatch, capsys, name, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    write_folder(tmp_path / "blind", ball(), None)
    write_folder(tmp_path / "grey", ball())
    Image.new("L", (64, 48)).save("grey/0001.png")
    write_folder(tmp_path / "sizes", ball())
    Image.fromarray(np.zeros((24, 32), np.uint16)).save("sizes/0002.png")
    write_folder(tmp_path / "nobody", 0 * ball())
    write_folder(tmp_path / "one", ball(1))
    assert run(["capture", name, "-o", "out.glb"]) == 2
    shown = capsys.readouterr()
    (line,) = shown.err.splitlines()
    assert re.match(words, line) and len(line) <= 300, line
    assert not (tmp_path / "out.glb").exists()


def test_options_that_a_video_cannot_honour_are_refused(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    (folder / "marks.json").write_text("{}")
    common = ["animate", "creature.ply", "--with", "wave", "-o", "no.glb"]
    assert run([*common, "--clip", "fly"]) == 2
    assert "has no clip 'fly'; a depth video is one clip, 'capture'" in capsys.readouterr().err
    assert run([*common, "--landmarks", "marks.json"]) == 2
    assert "leave them out" in capsys.readouterr().err
    assert run(["rig", "creature.ply", "--with", "wave", "-o", "no.glb"]) == 2
    capsys.readouterr()


def test_what_a_folder_does_not_tell_is_warned_about(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    lens = {key: value for key, value in OURS.items() if key != "fps"}
    write_folder(folder / "slow", ball(3), lens)
    run(["inspect", "slow"])
    assert "tells no fps; 30 is taken" in capsys.readouterr().err


def test_nothing_is_written_into_the_recording(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    lens = (folder / "wave" / "intrinsics.json").read_bytes()
    assert run(["capture", "wave", "-o", "x.glb", "--report", "wave/intrinsics.json"]) == 2
    assert "is also read" in capsys.readouterr().err
    assert (folder / "wave" / "intrinsics.json").read_bytes() == lens
