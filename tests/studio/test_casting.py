"""Figure and performer show each other's places in one colour."""

from dataclasses import replace

import numpy as np
import pytest

import bunraku
from bunraku.batching.jobs import Job
from bunraku.batching.records import Request
from bunraku.batching.working import work
from bunraku.studio.casting import (
    AS_FOUND,
    BY_JOINT,
    BY_MAP,
    BY_WEIGHT,
    Cast,
    describe,
    find_counterparts,
)
from bunraku.studio.colouring import COLD, colour_weights
from bunraku.types import Mesh, Skin


@pytest.fixture(scope="module")
def result(creature):
    """The creature as its own performer, so that the true map is known."""
    return bunraku.animate(creature.mesh, creature)


@pytest.fixture(scope="module")
def cast(result, creature):
    figure = result.character
    return Cast(figure, creature, result.counterparts)


def test_a_figures_counterparts_on_itself_are_where_it_is(result, creature):
    size = np.ptp(creature.mesh.vertices, axis=0).max()
    away = np.linalg.norm(result.counterparts - creature.mesh.vertices, axis=1)
    assert away.mean() < 0.02 * size


def test_the_map_gives_equal_places_equal_colours(cast):
    figure, performer = cast.paint(BY_MAP, "")
    assert np.abs(figure - performer).mean() < 6
    wrong = replace(cast, counterparts=np.roll(cast.counterparts, 200, axis=0))
    assert np.abs(wrong.paint(BY_MAP, "")[0] - performer).mean() > 12


def test_parts_are_matched_by_the_names_of_joints(cast, creature):
    figure, performer = cast.paint(BY_JOINT, "")
    assert (figure == performer).all(axis=1).mean() > 0.8
    backwards = creature.skin.weights[:, ::-1]
    order = replace(creature.skeleton, names=creature.skeleton.names[::-1])
    skin = Skin(backwards, creature.skin.inverse_bind)
    turned = replace(cast, performer=replace(creature, skeleton=order, skin=skin))
    assert np.array_equal(turned.paint(BY_JOINT, "")[1], performer)
    names = ("of another name", *creature.skeleton.names[1:])
    other = replace(creature, skeleton=replace(creature.skeleton, names=names))
    assert replace(cast, performer=other).paint(BY_JOINT, "")[1].shape == performer.shape


def test_weights_are_shown_on_both(cast, creature):
    joint = creature.skeleton.names[-1]
    for who, colours in zip((cast.figure, creature), cast.paint(BY_WEIGHT, joint), strict=True):
        weights = who.skin.weights[:, -1]
        assert np.allclose(colours, colour_weights(weights))
        assert weights.max() > 0.5
    figure, _ = cast.paint(BY_WEIGHT, "no such joint")
    assert np.allclose(figure, COLD)


def test_as_found_nothing_is_painted(cast):
    assert cast.paint(AS_FOUND, "") == (None, None)
    assert replace(cast, counterparts=None).paint(BY_MAP, "") == (None, None)


def test_a_job_keeps_its_map_on_request_only(creature, tmp_path):
    bunraku.write(tmp_path / "figure.ply", Mesh(creature.mesh.vertices, creature.mesh.faces))
    bunraku.write(tmp_path / "performer.glb", bunraku.animate(creature.mesh, creature))
    job = Job(figure=str(tmp_path / "figure.ply"), performance=str(tmp_path / "performer.glb"))
    record = work(Request(job, "plain", str(tmp_path), 1 << 32))
    assert not (tmp_path / "plain.npy").exists()
    record = work(Request(job, "mapped", str(tmp_path), 1 << 32, keep_map=True))
    assert "mapped.npy" in record.files
    stored = np.load(tmp_path / "mapped.npy")
    character = bunraku.read_performer(tmp_path / "mapped.glb")
    places = find_counterparts(character, stored)
    size = np.ptp(creature.mesh.vertices, axis=0).max()
    assert np.linalg.norm(places - character.mesh.vertices, axis=1).mean() < 0.02 * size


def test_confidence_is_said_in_words():
    assert [describe(value).split(":")[0] for value in (0.9, 0.6, 0.2)] == [
        "The figure fits the performer well.",
        "The fit is fair",
        "The fit is poor",
    ]
