import inspect
import subprocess
import sys

import numpy as np
import pytest

import bunraku
from bunraku.cli import animate as animate_command
from bunraku.cli import repose as repose_command
from bunraku.cli import rig as rig_command
from bunraku.formats import write_mesh
from bunraku.types import FormatError, MatchError, Mesh
from bunraku.verbs import animating

FILES = {"out", "report", "bvh"}  # of commands; in Python, `write` is called for each
WRITING = {"vrm", "engine"}  # options of `write`


@pytest.fixture(scope="module")
def animated(creature):
    """The creature's own surface, stripped, moved by the creature."""
    return bunraku.animate(creature.mesh, creature, ["Wave"])


def test_every_stage_is_there_to_look_at(animated, creature):
    assert animated.performer is creature
    assert [clip.name for clip in animated.character.clips] == ["Wave"]
    assert animated.character.mesh is creature.mesh
    assert 0.5 < animated.confidence <= 1
    assert animated.transfer.registration.strain < 0.3
    assert next(iter(animated.seconds)) == "proxy"
    assert animated.total_seconds >= sum(animated.seconds.values())
    assert animated.report["confidence"] == animated.confidence


def test_rig_and_repose_are_animate_without_clips(animated, creature):
    rigged = bunraku.rig(creature.mesh, creature)
    assert rigged.character.clips == ()
    np.testing.assert_array_equal(rigged.character.skin.weights, animated.character.skin.weights)
    rested = bunraku.repose(creature.mesh, creature)
    np.testing.assert_array_equal(rested.vertices, animated.at_rest.vertices)
    assert np.linalg.norm(rested.vertices - creature.mesh.vertices, axis=1).mean() < 0.03


def test_a_result_is_written_by_suffix(animated, tmp_path):
    bunraku.write(tmp_path / "moving.glb", animated)
    bunraku.write(str(tmp_path / "moving.json"), animated)
    bunraku.write(tmp_path / "rest.ply", animated.at_rest)
    assert bunraku.read_performer(tmp_path / "moving.glb").clips[0].name == "Wave"
    assert len(bunraku.read(tmp_path / "rest.ply").mesh.vertices) == len(animated.at_rest.vertices)
    assert b'"confidence"' in (tmp_path / "moving.json").read_bytes()
    with pytest.raises(FormatError, match=r"moving\.fbx: cannot hold a result as \.fbx"):
        bunraku.write(tmp_path / "moving.fbx", animated)


@pytest.mark.parametrize(
    ("command", "verb"),
    [
        (animate_command, animating.animate),
        (rig_command, animating.rig),
        (repose_command, animating.repose),
    ],
)
def test_commands_and_functions_can_do_the_same(command, verb):
    """Every option of a command is an argument of its function, and the other way round."""
    options = {"clips" if n == "clip" else n for n in inspect.signature(command).parameters}
    arguments = set(inspect.signature(verb).parameters)
    assert options - FILES - WRITING == arguments
    assert set(inspect.signature(bunraku.write).parameters) == {"path", "thing"} | WRITING
    for name in arguments & set(inspect.signature(command).parameters) - {"figure"}:
        default = inspect.signature(verb).parameters[name].default
        assert inspect.signature(command).parameters[name].default == default


def test_a_job_of_a_batch_can_do_what_animate_can():
    options = set(inspect.signature(animate_command).parameters) - {"out", "report", "clip"}
    endings = {"usd"}  # of -o; a job always writes a GLB, and this besides
    assert set(bunraku.Job.__struct_fields__) == options | endings | {"clips"}


def test_errors_name_the_file(tmp_path, cube):
    with pytest.raises(FormatError, match=r"missing\.obj: does not exist"):
        bunraku.animate("missing.obj")
    with pytest.raises(FormatError, match="built-in human: has no clip 'fly'"):
        bunraku.animate(cube, clips=["fly"])
    with pytest.raises(FormatError, match="landmarks: /tail: no such joint"):
        bunraku.animate(cube, landmarks={"tail": (0.0, 0.0, 0.0)})
    with pytest.raises(ValueError, match="are about files"):
        bunraku.animate(cube, up="z")


def test_a_figure_that_fits_nobody_is_refused_by_name(tmp_path, creature):
    path = tmp_path / "ball.ply"
    angles = np.linspace(0, np.pi, 24)[:, None], np.linspace(0, 2 * np.pi, 25)[None, :-1]
    ball = sphere(*angles)
    write_mesh(path, ball)
    with pytest.raises(MatchError, match=r"ball\.ply: the figure does not fit"):
        bunraku.rig(path)


def sphere(polar, around) -> Mesh:
    """A ball of squares cut in two."""
    places = np.stack(
        np.broadcast_arrays(
            np.sin(polar) * np.cos(around), np.cos(polar), np.sin(polar) * np.sin(around)
        ),
        axis=-1,
    )
    rows, columns = places.shape[:2]
    first = np.arange(rows - 1)[:, None] * columns + np.arange(columns)
    beside = np.arange(rows - 1)[:, None] * columns + (np.arange(columns) + 1) % columns
    corners = [first, beside, beside + columns, first, beside + columns, first + columns]
    return Mesh(places.reshape(-1, 3), np.stack(corners, axis=-1).reshape(-1, 3))


def test_importing_the_package_costs_nothing():
    """Only what is asked for is imported: .15 s were allowed, processor time, at most."""
    program = "import time; b = time.process_time(); import bunraku; print(time.process_time() - b)"
    seconds = [
        float(subprocess.run([sys.executable, "-c", program], capture_output=True).stdout)
        for _ in range(3)
    ]
    assert min(seconds) < 0.15


def test_names_are_listed_and_found_once():
    assert set(bunraku.__all__) <= set(dir(bunraku))
    for name in bunraku.__all__:
        assert getattr(bunraku, name) is getattr(bunraku, name)
    with pytest.raises(AttributeError, match="has no attribute 'dance'"):
        _ = bunraku.dance
