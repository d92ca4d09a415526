from dataclasses import replace

import numpy as np

from bunraku import builtin
from bunraku.evaluate.pictures import CLAY
from bunraku.formats import read_figure, write_mesh
from bunraku.types import Character, Skin
from bunraku.verbs import picturing


def wear(mesh, human):
    """Hang a mesh on the human's first joint."""
    weights = np.zeros((len(mesh.vertices), len(human.skeleton.names)))
    weights[:, 0] = 1.0
    return Character(mesh, human.skeleton, Skin(weights, human.skin.inverse_bind), human.clips[:1])


def test_colours_come_from_the_figures_materials():
    path = builtin.figure_paths()["stylised"]
    found = read_figure(path)
    colours = picturing.read_colours(path, wear(found.mesh, builtin.human()))
    assert colours.shape == found.mesh.vertices.shape
    assert len(np.unique(colours.round(), axis=0)) > 3
    assert 0 <= colours.min() <= colours.max() <= 255


def test_a_mesh_without_colours_is_clay(tmp_path, cube):
    write_mesh(tmp_path / "cube.obj", cube)
    colours = picturing.read_colours(tmp_path / "cube.obj", wear(cube, builtin.human()))
    np.testing.assert_array_equal(colours, np.tile(CLAY, (8, 1)))


def test_every_clip_is_drawn_with_the_figure_in_the_middle(cube):
    human = builtin.human()
    away = human.clips[0].translations + np.array([9.0, 0, 0])
    far = replace(human.clips[0], translations=away)
    body = replace(wear(cube, human), clips=(human.clips[0], far))
    strips = picturing.draw_clips(body, np.tile(CLAY, (8, 1)))
    assert len(strips) == 2
    assert len(strips[0]) == len(picturing.PHASES)
    np.testing.assert_allclose(strips[0][0].astype(int), strips[1][0].astype(int), atol=40)
