from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bunraku import builtin
from bunraku.evaluate import across, families
from bunraku.evaluate.families import Member, play_at
from bunraku.types import Character


@dataclass(frozen=True)
class Found:
    """As much of a route's result as the table reads."""

    character: Character
    confidence: float = 0.8


@pytest.fixture
def human():
    character = builtin.human()
    return replace(character, clips=character.clips[:2])


def stand_in(monkeypatch, change):
    """Let the route give the human itself, changed."""

    def animate(source, figure, *, clips, seed, force):
        return Found(change(replace(source, clips=tuple(clips))))

    monkeypatch.setattr(across, "animate_from_rig", animate)


@pytest.fixture
def task(human, tmp_path):
    joints = {name: i for i, name in enumerate(human.skeleton.names)}
    return across.Task("people", Member(tmp_path / "twin.glb", human), human, human.clips, joints)


def test_a_twin_follows_exactly(task, monkeypatch):
    stand_in(monkeypatch, lambda found: found)
    row = across.measure(task, frame_count=3)
    # where skin blends, a joint carried by its ring is a little off the rig's
    assert row.degrees["ours"] < 3.0
    assert row.degrees["nearest vertex"] == pytest.approx(row.degrees["ours"])
    assert row.degrees["static"] > 4.0
    assert row.joints == pytest.approx(0.0, abs=1e-9)
    assert not row.mirrored
    assert not row.turned_back


@pytest.mark.parametrize("degrees", [90, 180, -90])
def test_a_file_that_looks_another_way_is_no_error(task, human, monkeypatch, degrees):
    """Its clips play in its own front: the human's bones count as turned with it."""
    turned = np.eye(4)
    turned[:3, :3] = Rotation.from_euler("y", degrees, degrees=True).as_matrix()

    def turn(found):
        inverse = found.skin.inverse_bind @ np.linalg.inv(turned)
        rest = found.skeleton.rest.copy()
        rest[0] = turned @ rest[0]
        mesh = replace(found.mesh, vertices=found.mesh.vertices @ turned[:3, :3].T)
        clips = tuple(turn_clip(clip, turned[:3, :3]) for clip in found.clips)
        skin = replace(found.skin, inverse_bind=inverse)
        skeleton = replace(found.skeleton, rest=rest)
        return replace(found, mesh=mesh, skin=skin, skeleton=skeleton, clips=clips)

    stand_in(monkeypatch, turn)
    member = replace(task.member, character=turn(human))
    row = across.measure(replace(task, member=member), frame_count=3)
    assert row.degrees["ours"] < 3.0
    assert not row.turned_back


def turn_clip(clip, turn):
    """Turn a clip's root about the vertical."""
    rotations, translations = clip.rotations.copy(), clip.translations.copy()
    whole = Rotation.from_matrix(turn)
    rotations[:, 0] = (whole * Rotation.from_quat(rotations[:, 0])).as_quat()
    translations[:, 0] = translations[:, 0] @ turn.T
    return replace(clip, rotations=rotations, translations=translations)


@pytest.mark.parametrize(("flip", "field"), [([-1, 1, 1], "mirrored"), ([1, 1, -1], "turned_back")])
def test_flips_are_seen(task, monkeypatch, flip, field):
    def mirror(found):
        joints = np.linalg.inv(found.skin.inverse_bind)
        joints[:, :3, 3] *= flip
        return replace(found, skin=replace(found.skin, inverse_bind=np.linalg.inv(joints)))

    stand_in(monkeypatch, mirror)
    row = across.measure(task, frame_count=2)
    assert getattr(row, field)
    assert row.mirrored != row.turned_back


def test_joints_are_carried_rigidly(human):
    turn = Rotation.from_rotvec([0.3, 1.0, -0.2]).as_matrix()
    moved = human.mesh.vertices @ turn.T + [1.0, 2.0, 3.0]
    carried = across.carry_joints(human, moved[None])[0]
    heavy = human.skin.weights.sum(axis=0) > 1.0
    expected = families.bind_joints(human) @ turn.T + [1.0, 2.0, 3.0]
    np.testing.assert_allclose(carried[heavy], expected[heavy], atol=1e-9)


def test_carried_joints_follow_a_clip(human):
    clip, phases = human.clips[1], np.array([0.3])
    carried = across.carry_joints(human, play_at(human, clip, phases))[0]
    motion = families.motion_at(human, clip, phases)[0]
    truth = motion[:, :3, :3] @ families.bind_joints(human)[:, :, None]
    wrists = [human.skeleton.names.index(side + "Hand") for side in ("left", "right")]
    expected = truth[:, :, 0] + motion[:, :3, 3]
    np.testing.assert_allclose(carried[wrists], expected[wrists], atol=0.01)


def test_forward_is_left_cross_up():
    joints = np.array([[0.2, 1, 0], [-0.2, 1, 0]])
    np.testing.assert_allclose(across.forward_of(joints, np.array([[0, 1]])), [0, 0, 1])


def test_figures_without_human_joints_are_left_out(tmp_path, monkeypatch, stick, human):
    for name in ("humanoids/a/stick.glb", "stylised/b/person.glb", "creatures/c/person.glb"):
        path = tmp_path / name
        path.parent.mkdir(parents=True)
        path.touch()
    known = {"stick": stick, "person": human}
    monkeypatch.setattr(families, "read_character", lambda path: known[path.stem])
    tasks = list(across.find_tasks(tmp_path, human, clip_count=1))
    assert [task.key() for task in tasks] == [("stylised/b", "person")]
    assert [clip.name for clip in tasks[0].clips] == ["idle"]
    assert not list(across.find_tasks(tmp_path, human, names=["other"]))


def test_a_figure_the_route_fails_on_is_counted(task, monkeypatch):
    def refuse(source, figure, *, clips, seed, force):
        raise ValueError("no")

    monkeypatch.setattr(across, "animate_from_rig", refuse)
    row = across.measure(task, frame_count=2)
    assert row.failure == "no"
    assert "FAILED: no" in across.describe(row)
    table = across.tabulate([row])
    assert list(table.columns[3].cells) == ["failed", "nan"]
