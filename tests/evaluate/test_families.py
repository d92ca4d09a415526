from dataclasses import replace

import numpy as np
import pytest

from bunraku.evaluate import families
from bunraku.skinning import play_clip
from bunraku.types import Clip


def still(name, joints=2, frames=3):
    return Clip(
        name,
        np.arange(frames, dtype=float),
        np.zeros((frames, joints, 3)),
        np.tile([0.0, 0, 0, 1], (frames, joints, 1)),
        np.ones((frames, joints, 3)),
    )


def test_plain_names_drop_what_all_names_begin_with():
    clips = [still("Human|Man_Walk"), still("Human|Man_Run_Fast"), still("Human|Man_Run")]
    assert list(families.plain_names(clips)) == ["walk", "run_fast", "run"]
    assert list(families.plain_names([still("Man_Walk")])) == ["man_walk"]
    assert list(families.plain_names([still("1H_Stab"), still("2H_Stab")])) == [
        "1h_stab",
        "2h_stab",
    ]


def test_sticks_of_one_rig_share_their_clips(stick, tall_stick):
    assert families.can_teach(stick, tall_stick)
    assert families.common_clips(stick, tall_stick) == ["bend", "nod", "wave"]


def test_a_target_without_clips_takes_them_by_joint_name(stick, tall_stick):
    silent = replace(tall_stick, clips=())
    assert families.can_teach(stick, silent)
    assert not families.can_teach(silent, stick)
    assert families.common_clips(stick, silent) == ["bend", "nod", "wave"]


def test_other_joint_names_are_another_family(stick, tall_stick):
    renamed = replace(tall_stick, skeleton=replace(tall_stick.skeleton, names=("root", "other")))
    assert families.shared_joints(stick, renamed) == 0.5
    assert not families.can_teach(stick, renamed)


def test_clips_that_do_not_move_are_not_compared(stick):
    with_rest = replace(stick, clips=(*stick.clips, still("Armature|Stick_Rest Pose")))
    assert families.common_clips(with_rest, with_rest) == ["bend", "nod", "wave"]


def test_the_clip_a_figure_is_frozen_in_is_not_compared():
    for count in (1, 2, 3, 9):
        compared, frozen = families.choose_clips(["a", "b", "c", "d"], count)
        assert len(compared) == min(count, 3)
        assert frozen not in compared
    assert families.choose_clips(["a"], 3) == (["a"], None)


def test_play_at_agrees_with_play_clip_at_frames(stick):
    clip = stick.clips[0]
    np.testing.assert_allclose(
        families.play_at(stick, clip, np.linspace(0, 1, 9)), play_clip(stick, clip)
    )


def test_play_at_between_frames_is_half_way(stick):
    clip = stick.clips[0]
    first, second = play_clip(stick, clip, slice(0, 2))
    half = families.play_at(stick, clip, np.array([1 / 16]))
    np.testing.assert_allclose(half[0], (first + second) / 2)


def test_a_frozen_figure_is_the_middle_of_its_clip(stick):
    frozen = families.freeze(stick, stick.clips[2])
    np.testing.assert_allclose(frozen.vertices, play_clip(stick, stick.clips[2])[4])
    assert families.strip(stick) is stick.mesh


def test_only_files_that_may_be_rigged_are_listed(tmp_path):
    for name in ("family/a.glb", "family/b.VRM", "family/c.obj", "unrigged/d.glb"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.touch()
    assert families.rigged_files(tmp_path) == {
        tmp_path / "family": [tmp_path / "family/a.glb", tmp_path / "family/b.VRM"]
    }


@pytest.mark.parametrize("names", [[], ["only"]])
def test_too_few_clips_freeze_nothing(names):
    assert families.choose_clips(names, 3) == (names, None)
