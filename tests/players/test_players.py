"""Other programs accept what we write, and move it as we do."""

import os
from dataclasses import replace

import numpy as np
import pytest

from bunraku.formats.gltf import encode_character, encode_mesh, read_character, read_figure
from bunraku.skinning import play_clip
from bunraku.types import Character, Figure
from tests.creatures import make_creature
from tests.formats.made_gltf import TRIANGLE, made_arm, made_triangle

RIGGED = [
    "humanoids/cesium_man/cesium_man.gltf",
    "stylised/kenney_rigid_parts/character.glb",
    "creatures/khronos_fox/Fox.glb",
]
MORE = [
    "humanoids/quaternius_smooth/Smooth_Male_Casual.glb",
    "humanoids/robot_expressive/robot.glb",
    "stylised/kaykit_adventurers/Knight.glb",
    "creatures/quaternius_enemies/Wasp.glb",
]
if os.environ.get("BUNRAKU_THOROUGH"):
    RIGGED += MORE


@pytest.fixture(scope="module")
def creature() -> Character:
    return make_creature()


def made_figure() -> Figure:
    """A turned and scaled arm, its mirrored twin, and a triangle with points beside it."""
    made = made_arm()
    made.add("nodes", mesh=0, scale=[-2, 2, 2], translation=[0, 3, 0])
    mixed = [made.primitive(TRIANGLE), made.primitive(TRIANGLE + 1) | {"mode": 0}]
    made.add("meshes", primitives=mixed)
    made.add("nodes", mesh=1, rotation=[0, 0.6, 0, 0.8])
    made.json["scenes"][0]["nodes"] += [3, 4]
    return read_figure("made.glb", made.glb())


def animate(figure: Figure, creature: Character) -> Character:
    """Bind a figure to the creature's skeleton, each vertex to one or two joints."""
    count, joints = len(figure.mesh.vertices), len(creature.skeleton.names)
    weights = np.zeros((count, joints))
    weights[np.arange(count), np.arange(count) % joints] += 0.75
    weights[np.arange(count), (np.arange(count) + 1) % joints] += 0.25
    skin = type(creature.skin)(weights, creature.skin.inverse_bind)
    return Character(figure.mesh, creature.skeleton, skin, creature.clips)


def expect_no_errors(verdicts):
    faults = [(v["path"], v["messages"][:3]) for v in verdicts if v["errors"]]
    assert not faults


def test_the_validator_finds_no_error_in_made_figures(validate, tmp_path, creature):
    cube = read_figure("creature.glb", encode_mesh(creature.mesh))
    turned = np.diag([2.0, 2.0, 2.0, 1.0])[[0, 2, 1, 3]] * [[1], [1], [-1], [1]]
    files = {
        "mesh": encode_mesh(creature.mesh),
        "creature": encode_character(cube, creature),
        "made": encode_character(made_figure(), animate(made_figure(), creature)),
    }
    for name, make in {"triangle": made_triangle, "arm": made_arm}.items():
        figure = read_figure(f"{name}.glb", make().glb(), world_from_file=turned)
        files[name] = encode_character(figure, animate(figure, creature))
    for name, content in files.items():
        (tmp_path / f"{name}.glb").write_bytes(content)
    expect_no_errors(validate([tmp_path / f"{name}.glb" for name in files]))


def test_the_validator_is_no_yes_man(validate, tmp_path):
    made = made_triangle()
    made.json["accessors"][0]["max"] = [9, 9, 9]
    (tmp_path / "wrong.glb").write_bytes(made.glb())
    assert validate([tmp_path / "wrong.glb"])[0]["errors"] > 0


def expect_equal_poses(figure, character, times, theirs):
    """Compare three.js's vertices with ours, primitive by primitive, in the last clip."""
    clip = character.clips[-1]
    size = np.ptp(figure.mesh.vertices, axis=0).max()
    for time, answer in zip(times, theirs, strict=True):
        frame = int(np.abs(clip.times - time).argmin())
        ours = play_clip(character, clip, slice(frame, frame + 1))[0]
        first = 0
        for block in figure.document.blocks:
            here = slice(first, first := first + len(block.vertices))
            for primitive in block.primitives:
                points = np.reshape(answer[f"{block.node}/{primitive}"], (-1, 3))
                np.testing.assert_allclose(ours[here], points, atol=1e-5 * size, rtol=0)


def moments(clip):
    return [float(clip.times[i]) for i in (0, len(clip.times) // 3, len(clip.times) // 2)]


def test_three_js_poses_made_figures_as_we_do(pose_in_browser, tmp_path, creature):
    figure = made_figure()
    path, clip = tmp_path / "made.glb", creature.clips[0]
    path.write_bytes(encode_character(figure, animate(figure, creature)))
    job = {"path": str(path), "clip": clip.name, "times": moments(clip)}
    posed = pose_in_browser([job])[0]
    expect_equal_poses(read_figure(path), read_character(path), job["times"], posed)


@pytest.fixture(scope="module")
def replaced(data, tmp_path_factory):
    """Strip characters and put their own rigs back, with one clip: sources and jobs by name."""
    folder, sources, jobs = tmp_path_factory.mktemp("replaced"), {}, {}
    for name in RIGGED:
        source = read_character(data / name)
        source = replace(source, clips=source.clips[-1:])
        path = folder / f"{len(jobs)}.glb"
        path.write_bytes(encode_character(read_figure(data / name), source))
        clip = source.clips[0]
        sources[name] = source
        jobs[name] = {"path": str(path), "clip": clip.name, "times": moments(clip)}
    return sources, jobs


def test_the_validator_finds_no_error_in_replaced_rigs(replaced, validate):
    expect_no_errors(validate([job["path"] for job in replaced[1].values()]))


@pytest.fixture(scope="module")
def posed_by_three(replaced, pose_in_browser):
    jobs = replaced[1]
    return dict(zip(jobs, pose_in_browser(list(jobs.values())), strict=True))


@pytest.mark.parametrize("name", RIGGED)
def test_a_replaced_rig_moves_as_before(name, replaced, posed_by_three):
    """Ours before, ours after and three.js agree."""
    source, job = replaced[0][name], replaced[1][name]
    figure, back = read_figure(job["path"]), read_character(job["path"])
    size = np.ptp(figure.mesh.vertices, axis=0).max()
    frames = slice(0, None, max(1, len(source.clips[0].times) // 4))
    expected = play_clip(source, source.clips[0], frames)
    posed = play_clip(back, back.clips[0], frames)
    np.testing.assert_allclose(posed, expected, atol=1e-6 * size, rtol=0)
    expect_equal_poses(figure, back, job["times"], posed_by_three[name])
