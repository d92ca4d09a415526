"""Joints that a visitor drags; the page is a stand-in here, test_studio.py has a real one."""

import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import bunraku
from bunraku.formats import read_character
from bunraku.skinning import play_clip
from bunraku.studio import dragging
from bunraku.studio.dragging import JointMover, joint_places


class Page:
    """Keeps controls and nodes, and calls back as viser does."""

    def __init__(self):
        self.nodes, self.gui, self.scene = {}, self, self

    def add_folder(self, name):
        return self

    def __enter__(self):
        return self

    def __exit__(self, *error):
        return None

    def _control(self, value=None, **more):
        control = SimpleNamespace(value=value, calls=[], **more)
        control.on_update = control.on_click = control.calls.append
        return control

    def add_checkbox(self, name, value, **more):
        return self._control(value, **more)

    def add_dropdown(self, name, options, **more):
        return self._control(options[0], options=options, **more)

    def add_button(self, name, **more):
        return self._control(**more)

    def _node(self, name, **more):
        node = self._control(**more)
        node.remove = lambda: self.nodes.pop(name)
        self.nodes[name] = node
        return node

    add_icosphere = add_transform_controls = _node


@pytest.fixture
def page():
    return Page()


@pytest.fixture
def shown():
    return []


@pytest.fixture
def mover(page, shown, creature):
    mover = JointMover(page, shown.append, lambda: shown.append("posed"))
    mover.take(creature)
    return mover


def begin(mover, name):
    mover.moving.value, mover.joint.value = True, name
    mover.moving.calls[0](None)


def test_nothing_is_drawn_before_joints_are_to_be_moved(mover, page, creature, shown):
    assert page.nodes == {}
    begin(mover, creature.skeleton.names[1])
    assert len(page.nodes) == len(creature.skeleton.names) + 1
    assert shown == ["posed"]
    np.testing.assert_allclose(mover.handles.position, joint_places(creature)[1])


def test_a_dragged_joint_gives_the_figure_another_skin(mover, creature, shown):
    name = creature.skeleton.names[1]
    begin(mover, name)
    goal = joint_places(creature)[1] + (0.0, 0.04, 0.0)
    mover.handles.position = tuple(goal)
    mover.handles.calls[0](SimpleNamespace(phase="update"))
    assert shown == ["posed"], "the handles have not been let go of"
    mover.handles.calls[0](SimpleNamespace(phase="end"))
    moved = shown[-1]
    np.testing.assert_allclose(joint_places(moved)[1], goal)
    assert np.abs(moved.skin.weights - creature.skin.weights).max() > 0.01
    assert mover.moves == {name: pytest.approx(goal.tolist())}
    np.testing.assert_allclose(mover.handles.position, goal)
    mover.undo_all()
    assert mover.moves == {}
    assert shown[-1] is creature


@pytest.mark.parametrize("change", ["take", "undo_all"])
def test_a_change_of_the_figure_waits_for_a_move(mover, creature, shown, monkeypatch, change):
    other = replace(creature, clips=())
    begun, go_on = threading.Event(), threading.Event()

    def slow(character, joint, place):
        begun.set()
        assert go_on.wait(10)
        return replace(character, clips=())

    monkeypatch.setattr(dragging, "move_joint", slow)
    name, place = creature.skeleton.names[1], np.zeros(3)
    moving = threading.Thread(target=mover.move, args=(name, place))
    moving.start()
    assert begun.wait(10)
    target, args = (mover.take, (other,)) if change == "take" else (mover.undo_all, ())
    changing = threading.Thread(target=target, args=args)
    changing.start()
    go_on.set()
    moving.join(10)
    changing.join(10)
    assert mover.character is (other if change == "take" else creature)
    assert mover.undo.disabled


def test_a_move_that_waits_is_dropped_with_its_figure(mover, creature, shown):
    other = replace(creature, clips=())
    with mover.drawing:
        name, place = creature.skeleton.names[1], np.zeros(3)
        moving = threading.Thread(target=mover.move, args=(name, place))
        moving.start()
        moving.join(0.2)
        mover.take(other)
    moving.join(10)
    assert mover.character is other
    assert shown == []


def test_a_dot_that_is_clicked_is_chosen(mover, page, creature):
    begin(mover, creature.skeleton.names[1])
    page.nodes["/joints/3"].calls[0](None)
    assert mover.joint.value == creature.skeleton.names[3]
    np.testing.assert_allclose(mover.handles.position, joint_places(creature)[3])


def test_the_file_has_the_joint_where_it_was_dragged_to(mover, creature, tmp_path):
    path = tmp_path / "result.glb"
    bunraku.write(path, bunraku.animate(creature.mesh, creature))
    before = read_character(path)
    mover.take(before)
    assert mover.write(path) == path.read_bytes()
    busiest = int(np.ptp(before.clips[0].rotations, axis=0).max(axis=1).argmax())
    name = before.skeleton.names[busiest]
    mover.move(name, joint_places(before)[busiest] + (0.04, 0.05, 0.02))
    (tmp_path / "downloaded.glb").write_bytes(mover.write(path))
    after = read_character(tmp_path / "downloaded.glb")
    np.testing.assert_allclose(after.mesh.vertices, before.mesh.vertices, atol=1e-6)
    expected = mover.character
    joint = after.skeleton.names.index(name)
    goal = joint_places(expected)[busiest]
    np.testing.assert_allclose(joint_places(after)[joint], goal, atol=1e-5)
    clip = before.clips[0].name
    assert [c.name for c in after.clips] == [c.name for c in before.clips]
    theirs, ours, old = (play(character, clip) for character in (after, expected, before))
    size = np.ptp(before.mesh.vertices, axis=0).max()
    assert np.abs(theirs - ours).max() < 2e-3 * size
    assert np.abs(theirs - old).max() > 1e-2 * size


def play(character, name):
    """The vertices in the middle of a clip."""
    clip = next(clip for clip in character.clips if clip.name == name)
    return play_clip(character, clip, np.array([len(clip.times) // 3]))[0]
