from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bunraku.evaluate import capture_across
from bunraku.evaluate.capture_across import (
    Row,
    Task,
    bone_directions,
    describe,
    may_perform,
    measure,
    performs_alike,
    seen_joints,
    shared_clip,
    tabulate,
    true_motion,
)
from bunraku.evaluate.families import Member, play_at
from bunraku.evaluate.metrics import bone_direction_error
from bunraku.evaluate.rendering import filmed_phases, view_from
from bunraku.evaluate.results import append_row, read_rows
from bunraku.rotations import vectors_to_matrices
from bunraku.types import Mesh


@pytest.fixture(scope="module")
def pair(creature):
    """The creature and the same one on another mesh."""
    rounder = creature.mesh.vertices * 1.3
    skin = replace(creature.skin, inverse_bind=scale_bind(creature.skin.inverse_bind, 1.3))
    rest = creature.skeleton.rest.copy()
    rest[:, :3, 3] *= 1.3
    clips = tuple(replace(clip, translations=1.3 * clip.translations) for clip in creature.clips)
    other = replace(
        creature,
        mesh=Mesh(rounder, creature.mesh.faces),
        skin=skin,
        skeleton=replace(creature.skeleton, rest=rest),
        clips=clips,
    )
    return Member(Path("creature"), creature), Member(Path("other"), other)


def scale_bind(inverse_bind, scale):
    scaled = inverse_bind.copy()
    scaled[:, :3, 3] *= scale
    return scaled


def test_a_bone_points_from_the_border_with_its_parent_to_its_own_middle():
    places = np.array([[[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0.0]]])
    weights = np.array([[1, 0], [0.5, 0.5], [0, 1], [0, 1.0]])
    parents, kept = np.array([-1, 0]), np.ones(2, bool)
    found = bone_directions(places, weights, parents, kept)
    np.testing.assert_allclose(found, [[[2.2 - 1.0, 0.0, 0.0]]])  # (.5 + 2 + 3) / 2.5
    turn = vectors_to_matrices(np.array([0.0, 0.0, 0.4]))
    turned = bone_directions(places @ turn.T, weights, parents, kept)
    assert bone_direction_error(turned, found) == pytest.approx(np.degrees(0.4))
    assert bone_directions(places, weights, parents, ~kept).shape == (1, 0, 3)


def test_the_truth_is_the_other_s_own_clip_in_step(pair):
    first, other = pair
    filmed = first.character.clips[0]
    truth = true_motion(other.character, other.character.clips[0], filmed, "side")
    played = play_at(first.character, filmed, filmed_phases(filmed))
    np.testing.assert_allclose(truth, view_from(played, 90.0)[0], atol=1e-6)  # both at diagonal 2
    assert shared_clip(first, other) == "wave" and performs_alike(first, other)
    still = replace(other, character=replace(other.character, clips=()))
    assert not performs_alike(first, still)


def test_files_that_no_wanted_pair_can_need_are_not_read():
    assert may_perform("animals/Horse", ()) and may_perform("animals/Horse", ["animals"])
    assert may_perform("animals/Horse", ["Horse>Cow:walk"])
    assert not may_perform("animals/Fox", ["Horse>Cow:walk"])
    for part in ("Cow:walk:side", "walk:side", ":side"):  # of whatever performs for the cow
        assert may_perform("animals/Horse", [part])
    assert not may_perform("animals/Fox", ["animals/Fox:walk:side"])  # a row of the other table


def test_some_limbs_are_seen(creature, film):
    seen = seen_joints(creature, film)
    assert set(seen) == set(creature.skeleton.names) and sum(seen.values()) >= 3


def test_the_creature_moves_another_one(pair):
    row = measure(Task("made", *pair, "wave", "front"))
    assert not row.failure and row.bones >= 3
    assert row.angle < 0.5 * row.angle_static


def test_a_pair_whose_bones_nobody_saw_fails_and_can_be_kept(pair, monkeypatch, tmp_path):
    monkeypatch.setattr(capture_across, "seen_joints", lambda source, film: {})
    row = measure(Task("made", *pair, "wave", "front"))
    assert row.failure == "no bone was seen" and row.angle is None
    append_row(tmp_path / "rows", row)
    assert read_rows(tmp_path / "rows", Row) == {row.key(): row}
    assert "no bone was seen" in describe(row) and "FAILED" in describe(replace(row, failure=""))


def test_a_table_counts_failures_and_pairs_that_are_near_enough():
    rows = [
        Row("f", "a", "b", "walk", "side", 9, 5, 10.0, 30.0, seconds=1.0),
        Row("f", "b", "c", "walk", "side", 9, 5, 20.0, 30.0, True, 1.0),
        Row("f", "c", "a", "walk", "side", failure="no subject"),
    ]
    assert "10.0 degrees (still 30.0) on 5 seen bones" in describe(rows[0])
    assert "WARNED" in describe(rows[1]) and "FAILED: no subject" in describe(rows[2])
    cells = {str(c.header): list(c.cells) for c in tabulate(rows).columns}
    assert cells["pairs"] == ["3 (1 failed)"] * 2 and cells["degrees"][0] == "15"
    assert cells["<= 15 %"][0] == "50" and cells["warned"][0] == "1"
    assert list(tabulate(rows[2:]).columns[2].cells) == ["nan", "nan"]
