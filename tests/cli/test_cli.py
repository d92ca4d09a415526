"""The contract of the command line, kept by real runs of the console script."""

import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import fast_simplification
import numpy as np
import pytest
from scipy.spatial import KDTree

from bunraku import builtin
from bunraku.cli import run
from bunraku.formats import read_character, read_figure, write_character, write_mesh
from bunraku.routes.from_rig import animate_from_rig
from bunraku.skinning import play_clip
from bunraku.types import MatchError, Mesh
from bunraku.verbs import animating

PROGRAM = Path(sys.executable).with_name("bunraku")
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def bunraku(*arguments, folder) -> subprocess.CompletedProcess:
    command = [str(PROGRAM), *map(str, arguments)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)


def simplify(character, vertex_count=1500):
    """Keep a character's shape and skin with fewer vertices, so that runs are short."""
    vertices, faces = character.mesh.vertices, character.mesh.faces
    share = 1 - vertex_count / len(vertices)
    small, few = fast_simplification.simplify(vertices.astype(np.float32), faces, share)
    nearest = KDTree(vertices).query(small)[1]
    skin = replace(character.skin, weights=character.skin.weights[nearest])
    mesh = Mesh(small.astype(np.float64), few.astype(np.int64))
    return replace(character, mesh=mesh, skin=skin)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A figure that fits the built-in human, and files that are wrong in one way each."""
    folder = tmp_path_factory.mktemp("files")
    human = simplify(builtin.human())
    write_mesh(folder / "person.obj", human.mesh)
    found = read_figure(folder / "person.obj")
    write_character(folder / "silent.glb", found, replace(human, clips=()))
    write_character(folder / "walker.glb", found, replace(human, clips=human.clips[:2]))
    (folder / "empty.glb").touch()
    (folder / "torn.glb").write_bytes((folder / "silent.glb").read_bytes()[:5000])
    (folder / "picture.glb").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(64))
    (folder / "triangle.obj").write_text(TRIANGLE)
    (folder / "nan.obj").write_text(TRIANGLE.replace("v 1", "v nan"))
    (folder / "range.obj").write_text(TRIANGLE.replace("3\n", "9\n"))
    (folder / "points.obj").write_text(TRIANGLE.split("f")[0])
    return folder


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["missing.obj"], "error: missing.obj: does not exist"),
        (["empty.glb"], "error: empty.glb: is empty"),
        (["torn.glb"], "error: torn.glb: .* cut off"),
        (["picture.glb"], "error: picture.glb: holds a picture"),
        (["nan.obj"], "error: nan.obj: line 2: wanted finite coordinates"),
        (["range.obj"], "error: range.obj: line 4: "),
        (["points.obj"], "error: points.obj: has no faces"),
        (["triangle.obj", "--with", "torn.glb"], "error: torn.glb: "),
        (["triangle.obj", "--with", "triangle.obj"], "error: triangle.obj: "),
        (["triangle.obj", "--with", "silent.glb"], "error: silent.glb: has a rig but no clips"),
        (["triangle.obj", "--with", "."], "error: .: holds no NNNN.png depth frames"),
        (
            ["triangle.obj", "--with", "walker.glb", "--clip", "fly"],
            r"error: walker.glb: has no clip 'fly'; it has 'idle', 'walk' \[CLIP_MISSING\]$",
        ),
        (["triangle.obj", "--seed", "one"], "error: bunraku animate: Invalid value for '--seed'"),
        (["triangle.obj", "--bogus"], "error: bunraku animate: No such option: --bogus"),
        (["triangle.obj", "--up", "q"], "error: triangle.obj: .*wanted y or z"),
    ],
)
def test_bad_input_ends_in_one_line_and_leaves_nothing(
    folder, arguments, words, monkeypatch, capsys
):
    monkeypatch.chdir(folder)
    before = sorted(folder.rglob("*"))
    code = run(["animate", *arguments, "-o", "out.glb"])
    shown = capsys.readouterr()
    expect_one_line(code, shown.out, shown.err, words)
    assert sorted(folder.rglob("*")) == before


def expect_one_line(code, out, errors, words):
    (line,) = errors.splitlines()
    assert code == 2
    assert re.match(words, line), line
    assert len(line) <= 300
    assert out == ""


@pytest.mark.parametrize("path", ["missing.obj", "torn.glb", "range.obj"])
def test_the_program_ends_as_its_commands_do(folder, path):
    """With its own exit code, and no traceback of whatever it imported."""
    done = bunraku("animate", path, "-o", "out.glb", folder=folder)
    expect_one_line(done.returncode, done.stdout, done.stderr, f"error: {path}: ")


@pytest.mark.parametrize(
    ("out", "words"),
    [
        ("nowhere/out.glb", "cannot be written"),
        ("out.fbx", "must end in .glb"),
        ("folder.glb", "is a folder"),
        ("walker.glb", "is also read; write to another file"),
    ],
)
def test_an_output_that_cannot_be_written_is_refused_first(folder, out, words, monkeypatch, capsys):
    def work_in_vain(*arguments, **options):
        raise AssertionError("the outputs must be checked first")

    (folder / "folder.glb").mkdir(exist_ok=True)
    before = (folder / "walker.glb").read_bytes()
    monkeypatch.chdir(folder)
    monkeypatch.setattr(animating, "animate_from_rig", work_in_vain)
    code = run(["animate", "person.obj", "--with", "walker.glb", "-o", out])
    expect_one_line(code, "", capsys.readouterr().err, f"error: {out}: {words}")
    assert (folder / "walker.glb").read_bytes() == before


def test_an_interrupt_leaves_nothing(folder):
    """Even if whoever started us does not listen, as shells do for jobs in the background."""
    before = sorted(folder.rglob("*"))
    work = "lambda *a, **k: (print('at work', flush=True), time.sleep(60))"
    program = (
        "import time; from bunraku.cli import main; from bunraku.verbs import animating; "
        f"animating.animate_from_rig = {work}"
    )
    command = [sys.executable, "-c", f"{program}; main()", "animate", "person.obj"]
    listening = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)}
    with subprocess.Popen(
        [*command, "-o", "late.glb"],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **listening,
    ) as done:
        assert done.stdout.readline() == "at work\n"
        done.send_signal(signal.SIGINT)
        errors = done.communicate(timeout=60)[1]
    assert done.returncode == 130
    assert errors.splitlines()[-1].startswith("error: interrupted")
    assert "Traceback" not in errors
    assert sorted(folder.rglob("*")) == before


@pytest.fixture(scope="module")
def animated(folder) -> subprocess.CompletedProcess:
    """One run of the main job: a person moves itself, stripped."""
    arguments = [
        "--with",
        "walker.glb",
        "--clip",
        "walk",
        "-o",
        "walk.glb",
        "--report",
        "walk.json",
    ]
    return bunraku("animate", "person.obj", *arguments, folder=folder)


def test_the_main_job_succeeds_quietly(animated):
    assert animated.returncode == 0, animated.stderr
    assert animated.stdout == ""
    assert all(line.startswith("warning: person.obj: ") for line in animated.stderr.splitlines())


def test_the_figure_walks_as_the_human_does(animated, folder):
    human, moved = (read_character(folder / name) for name in ("walker.glb", "walk.glb"))
    (clip,) = moved.clips
    own = next(clip for clip in human.clips if clip.name == "walk")
    assert clip.name == "walk"
    frames = slice(0, None, 20)
    distance = np.linalg.norm(
        play_clip(moved, clip, frames) - play_clip(human, own, frames), axis=2
    )
    assert distance.mean() < 0.03


def test_the_report_says_how_far_to_trust_it(animated, folder):
    report = json.loads((folder / "walk.json").read_text())
    assert report["figure"]["vertices"] == len(read_figure(folder / "person.obj").mesh.vertices)
    assert report["figure"]["parts"] == 1
    assert report["route"] == "from_rig"
    assert 0.5 < report["confidence"] <= 1
    assert report["skin"] == {"influences_max": 4, "unweighted_vertices": 0}
    (clip,) = report["clips"]
    assert clip["name"] == "walk"
    assert 1 < clip["stretch_p99"] < 2
    assert 0 <= clip["foot_slide_m"] < 0.2
    assert 0 <= clip["penetration_fraction"] < 0.1


def test_feet_can_be_left_to_slide(animated, folder):
    """The switch changes legs and nothing above them."""
    options = ["--with", "walker.glb", "--clip", "walk", "--no-contacts", "-o", "sliding.glb"]
    assert bunraku("animate", "person.obj", *options, folder=folder).returncode == 0
    paths = folder / "walk.glb", folder / "sliding.glb"
    ours, free = (read_character(path).clips[0] for path in paths)
    names = read_character(paths[0]).skeleton.names
    changed = np.abs(ours.rotations - free.rotations).max(axis=(0, 2)) > 1e-4
    legs = {name for name, moved in zip(names, changed, strict=True) if moved}
    assert legs and all("Leg" in name or "Foot" in name for name in legs)


@pytest.fixture(scope="module")
def transfer(folder):
    """The same run again, in this process."""
    source = read_character(folder / "walker.glb")
    figure = read_figure(folder / "person.obj").mesh
    return animate_from_rig(source, figure, clips=source.clips[1:])


def test_the_same_input_gives_the_same_bytes(animated, transfer, folder):
    found = read_figure(folder / "person.obj")
    write_character(folder / "again.glb", found, transfer.character)
    assert (folder / "again.glb").read_bytes() == (folder / "walk.glb").read_bytes()


@pytest.fixture
def quick(monkeypatch, transfer, folder):
    """Run a command in this process, in the folder, with the route's work already done."""

    def answer(source, figure, *, clips, seed, force, landmarks):
        kept = [clip for clip in transfer.character.clips if clip.name in {c.name for c in clips}]
        return replace(transfer, character=replace(transfer.character, clips=tuple(kept)))

    monkeypatch.setattr(animating, "animate_from_rig", answer)
    monkeypatch.chdir(folder)
    return run


def test_rig_keeps_the_figure_and_adds_no_clips(quick, folder):
    report = ["--report", "rigged.json"]
    assert quick(["rig", "person.obj", "--with", "silent.glb", "-o", "rigged.glb", *report]) == 0
    person, rigged = read_figure(folder / "person.obj").mesh, read_character(folder / "rigged.glb")
    np.testing.assert_allclose(rigged.mesh.vertices, person.vertices, atol=1e-5)
    assert rigged.clips == ()
    assert json.loads((folder / "rigged.json").read_text())["clips"] == []


@pytest.mark.parametrize("out", ["rest.obj", "rest.ply", "rest.glb"])
def test_repose_moves_a_person_at_rest_hardly_at_all(quick, folder, out):
    assert quick(["repose", "person.obj", "--with", "silent.glb", "-o", out]) == 0
    person, rested = (read_figure(folder / name).mesh for name in ("person.obj", out))
    np.testing.assert_array_equal(rested.faces, person.faces)
    assert np.linalg.norm(rested.vertices - person.vertices, axis=1).mean() < 0.03


def test_a_motion_and_a_vrm_are_written_on_request(quick, folder):
    options = ["--with", "walker.glb", "--clip", "walk", "--bvh", "walk.bvh", "--for", "unity"]
    assert quick(["animate", "person.obj", *options, "-o", "person.vrm"]) == 0
    assert "ROOT Hips" in (folder / "walk.bvh").read_text()
    content = (folder / "person.vrm").read_bytes()
    assert b'"VRMC_vrm"' in content
    assert b'"LeftUpperArm"' in content


def test_an_unknown_engine_is_refused_first(quick, capsys):
    assert quick(["animate", "person.obj", "-o", "doom.glb", "--for", "doom"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert (
        line == "error: --for doom: no such preset; wanted blender, godot, unity, unreal [OPTION]"
    )


def test_a_figure_that_cannot_be_matched_has_its_own_exit_code(quick, folder, monkeypatch, capsys):
    def refuse(source, figure, *, clips, seed, force, landmarks):
        raise MatchError("the figure does not fit; choose another performance, or --force")

    monkeypatch.setattr(animating, "animate_from_rig", refuse)
    assert quick(["animate", "person.obj", "--with", "walker.glb", "-o", "poor.glb"]) == 3
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: person.obj: the figure does not fit")
    assert not (folder / "poor.glb").exists()


@pytest.mark.parametrize("command", ["animate", "rig", "repose"])
def test_landmarks_reach_the_route(command, quick, transfer, folder, monkeypatch):
    given = []

    def listen(source, figure, *, clips, seed, force, landmarks):
        given.append(landmarks)
        return transfer

    monkeypatch.setattr(animating, "animate_from_rig", listen)
    (folder / "marks.json").write_text('{"hips": [0, 1, 0]}')
    options = ["person.obj", "--with", "walker.glb", "-o", "marked.glb"]
    assert quick([command, *options, "--landmarks", "marks.json"]) == 0
    assert given == [{"hips": (0.0, 1.0, 0.0)}]


def test_what_the_route_doubts_is_a_warning(quick, transfer, folder, monkeypatch, capsys):
    doubtful = replace(transfer, warnings=("two hats", "two hats"))
    monkeypatch.setattr(animating, "animate_from_rig", lambda *a, **k: doubtful)
    assert quick(["animate", "person.obj", "--with", "walker.glb", "-o", "hats.glb"]) == 0
    assert capsys.readouterr().err == "warning: person.obj: two hats [MATCH_DOUBTFUL]\n"


def test_inspect_prints_text_and_json(folder):
    text = bunraku("inspect", "walker.glb", folder=folder)
    assert text.returncode == 0
    assert "joints          22, skins of 22" in text.stdout
    assert "clip            idle: " in text.stdout
    found = json.loads(bunraku("inspect", "walker.glb", "--json", folder=folder).stdout)
    assert found["joints"] == 22
    assert [clip["name"] for clip in found["clips"]] == ["idle", "walk"]


def test_help_is_quick_and_shows_examples():
    times = []
    for _ in range(3):
        began = os.times()
        done = subprocess.run([str(PROGRAM), "--help"], capture_output=True, text=True)
        ended = os.times()
        times.append(
            ended.children_user
            - began.children_user
            + ended.children_system
            - began.children_system
        )
        assert "animate" in done.stdout
        assert "Example" in done.stdout
    assert min(times) < 0.4  # processor seconds: the machine may be busy


@pytest.mark.parametrize(
    "command", ["animate", "rig", "repose", "inspect", "demo", "evaluate", "batch"]
)
def test_every_command_explains_itself(command, tmp_path):
    done = bunraku(command, "--help", folder=tmp_path)
    assert done.returncode == 0
    assert f"bunraku {command}" in done.stdout


def test_no_command_at_all_shows_help(tmp_path):
    done = bunraku(folder=tmp_path)
    assert done.returncode == 0
    assert "Usage: bunraku" in done.stdout
