from dataclasses import replace

import numpy as np

from bunraku import builtin
from bunraku.cli import run, showing
from bunraku.evaluate.pictures import CLAY
from bunraku.formats import read_figure, write_mesh
from bunraku.types import Character, Skin


def wear(mesh, human):
    """Hang a mesh on the human's first joint."""
    weights = np.zeros((len(mesh.vertices), len(human.skeleton.names)))
    weights[:, 0] = 1.0
    return Character(mesh, human.skeleton, Skin(weights, human.skin.inverse_bind), human.clips[:1])


def test_colours_come_from_the_figures_materials():
    path = builtin.figure_paths()["stylised"]
    found = read_figure(path)
    colours = showing.read_colours(path, wear(found.mesh, builtin.human()))
    assert colours.shape == found.mesh.vertices.shape
    assert len(np.unique(colours.round(), axis=0)) > 3
    assert 0 <= colours.min() <= colours.max() <= 255


def test_a_file_cannot_hold_the_demo(tmp_path, capsys):
    (tmp_path / "demo").write_text("a file")
    assert run(["demo", "-o", str(tmp_path / "demo")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_mesh_without_colours_is_clay(tmp_path, cube):
    write_mesh(tmp_path / "cube.obj", cube)
    colours = showing.read_colours(tmp_path / "cube.obj", wear(cube, builtin.human()))
    np.testing.assert_array_equal(colours, np.tile(CLAY, (8, 1)))


def test_every_clip_is_drawn_with_the_figure_in_the_middle(cube):
    human = builtin.human()
    away = human.clips[0].translations + np.array([9.0, 0, 0])
    far = replace(human.clips[0], translations=away)
    body = replace(wear(cube, human), clips=(human.clips[0], far))
    strips = showing.draw_clips(body, np.tile(CLAY, (8, 1)))
    assert len(strips) == 2
    assert len(strips[0]) == len(showing.PHASES)
    np.testing.assert_allclose(strips[0][0].astype(int), strips[1][0].astype(int), atol=40)


def test_a_report_becomes_one_line():
    clip = {"stretch_p99": 1.2, "foot_slide_m": 0.1, "penetration_fraction": 0.0}
    report = {
        "figure": {"vertices": 9, "parts": 2},
        "clips": [clip, {**clip, "stretch_p99": 1.5}],
        "seconds": {"total": 3.0},
        "confidence": 0.9,
    }
    assert showing.summarise(report) == ["9", "2", "2", 3.0, 0.9, 1.5, 0.1, 0.0]
