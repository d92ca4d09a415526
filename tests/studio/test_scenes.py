"""What is sent to the viewer moves as the character does; the viewer is a stand-in here."""

from types import SimpleNamespace

import numpy as np
import pytest

from bunraku.rotations import compose_transforms, quaternions_to_matrices
from bunraku.skinning import linear_blend_skinning, play_clip
from bunraku.studio.scenes import Actor, split_by_colour


class Scene:
    """Keeps what is added to it."""

    def __init__(self):
        self.nodes = {}

    def _add(self, name, **properties):
        node = SimpleNamespace(**properties, remove=lambda: self.nodes.pop(name))
        self.nodes[name] = node
        return node

    def add_mesh_skinned(self, name, vertices, faces, **more):
        bones = [SimpleNamespace(wxyz=None, position=None) for _ in more["bone_wxyzs"]]
        return self._add(name, vertices=vertices, faces=faces, bones=bones, **more)

    def add_line_segments(self, name, points, colors, **more):
        return self._add(name, points=points, **more)

    def add_point_cloud(self, name, points, colors, **more):
        return self._add(name, points=points, colors=colors, **more)


def transforms(turns, places):
    turns = np.array(turns)[:, [1, 2, 3, 0]]
    return compose_transforms(np.array(places), quaternions_to_matrices(turns))


@pytest.fixture
def halves(creature):
    """Red above, green below."""
    above = creature.mesh.vertices[:, 1] > np.median(creature.mesh.vertices[:, 1])
    return np.where(above[:, None], (250.0, 10, 10), (10.0, 250, 10))


def test_a_surface_is_cut_by_colour(creature, halves):
    parts = split_by_colour(creature.mesh.faces, halves)
    faces = np.concatenate([own for _, own in parts])
    assert len(faces) == len(creature.mesh.faces)
    assert len(np.unique(faces, axis=0)) == len(np.unique(creature.mesh.faces, axis=0))
    colours = [colour for colour, _ in parts]
    assert (250, 10, 10) in colours
    assert (10, 250, 10) in colours


def test_the_viewers_skinning_gives_our_vertices(creature, halves):
    scene, clip = Scene(), creature.clips[0]
    actor = Actor(scene, "/a", creature, halves)
    share = 0.4
    actor.pose(actor.world(clip, share))
    frame = int(np.searchsorted(clip.times, share * clip.times[-1]))
    ours = play_clip(creature, clip, slice(frame, frame + 1))[0]
    for node in scene.nodes.values():
        bind = transforms(node.bone_wxyzs, node.bone_positions)
        now = transforms([b.wxyz for b in node.bones], [b.position for b in node.bones])
        motion = now @ np.linalg.inv(bind)
        theirs = linear_blend_skinning(node.vertices, node.skin_weights, motion)
        distance = np.linalg.norm(theirs[:, None] - ours, axis=2).min(axis=1)
        assert distance.max() < 1e-9


def test_skeleton_and_points_come_and_go(creature, halves):
    scene, clip = Scene(), creature.clips[0]
    actor = Actor(scene, "/a", creature, halves)
    surfaces = set(scene.nodes)
    actor.show_skeleton(actor.world(clip, 0.0), wanted=True)
    colours = np.tile([1.0, 2.0, 3.0], (len(creature.mesh.vertices), 1))
    actor.show_points(actor.world(clip, 0.0), colours)
    cloud = scene.nodes["/a/points"]
    assert not any(scene.nodes[name].visible for name in surfaces)
    assert cloud.colors.dtype == np.uint8
    assert np.array_equal(cloud.colors, colours)
    before = scene.nodes["/a/skeleton"].points, cloud.points
    actor.pose(actor.world(clip, 0.5))
    assert np.abs(scene.nodes["/a/skeleton"].points - before[0]).max() > 0.01
    assert np.abs(cloud.points - before[1]).max() > 0.01
    actor.show_skeleton(actor.world(clip, 0.0), wanted=False)
    actor.show_points(actor.world(clip, 0.0), None)
    assert set(scene.nodes) == surfaces
    assert all(node.visible for node in scene.nodes.values())
    actor.leave()
    assert not scene.nodes
