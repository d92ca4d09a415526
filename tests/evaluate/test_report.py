from dataclasses import replace

import numpy as np
import pytest

from bunraku.evaluate import report
from bunraku.evaluate.families import play_at
from bunraku.graphs import mesh_edges
from bunraku.proxy import Proxy
from bunraku.retargeting import Retarget
from bunraku.routes.from_rig import RigTransfer
from bunraku.types import Mesh


@pytest.fixture
def transfer(stick):
    """As much of a route's result as the report reads."""
    found = object.__new__(RigTransfer)
    proxy = Proxy(stick.mesh, np.zeros((84, 3), np.int64), np.zeros((84, 3)))
    found.__dict__.update(
        character=stick,
        source_proxy=proxy,
        target_proxy=proxy,
        plan=Retarget(stick.skeleton, np.zeros((2, 3)), stick.skeleton.parents, 0.5, np.eye(3)),
        confidence=0.75,
        mirrored=False,
        score=0.1,
        warnings=("loose hat",),
        seconds={"registration": 1.0},
    )
    return found


def test_the_report_has_the_fields_of_the_design(stick, transfer):
    found = report.report_transfer("a.obj", {"path": "b.glb"}, stick, transfer, total_seconds=2.0)
    assert found["figure"] == {
        "path": "a.obj",
        "vertices": 84,
        "faces": 164,
        "parts": 1,
        "height": 1.0,
    }
    assert found["seconds"] == {"total": 2.0, "registration": 1.0}
    assert found["map"] == {"mirrored": False, "score": 0.1}
    assert found["skin"] == {"influences_max": 2, "unweighted_vertices": 0}
    assert found["performance"] == {"path": "b.glb", "joints": 2}
    assert [clip["name"] for clip in found["clips"]] == [clip.name for clip in stick.clips]
    assert found["clips"][0]["frames"] == 9
    assert found["clips"][0]["seconds"] == pytest.approx(8 / 30)


def test_parts_are_counted_after_welding(cube):
    split = Mesh(cube.vertices[cube.faces].reshape(-1, 3), np.arange(36).reshape(12, 3))
    assert report.count_parts(split) == 1
    two = np.vstack([split.vertices, split.vertices + 3.0])
    assert report.count_parts(Mesh(two, np.arange(72).reshape(24, 3))) == 2


def test_sampled_edges_move_as_they_do_in_the_whole(stick):
    every = mesh_edges(stick.mesh.faces)
    sample, ends = report.sample_edges(stick, count=3 * len(stick.mesh.faces))
    phases = np.array([0.0, 0.6])
    whole, part = (play_at(body, stick.clips[0], phases) for body in (stick, sample))
    expected = whole[:, every[:, 0]] - whole[:, every[:, 1]]
    np.testing.assert_allclose(part[:, ends[:, 0]] - part[:, ends[:, 1]], expected)
    assert 0 < len(report.sample_edges(stick, count=10)[1]) < 10


def test_feet_are_low_joints_with_skin(stick):
    np.testing.assert_array_equal(report.find_feet(stick), [0])
    bare = np.column_stack([np.zeros(84), np.ones(84)])
    lifted = replace(stick, skin=replace(stick.skin, weights=bare))
    assert len(report.find_feet(lifted)) == 0


def test_a_planted_foot_that_travels_slides(stick):
    """The sticks' root travels .75 m/s; planted at rest in the source, it slides in the figure."""
    walk = stick.clips[0]
    still = replace(walk, translations=np.zeros_like(walk.translations))
    assert report.slide_of_clip(stick, stick, still, still) == 0.0
    assert report.slide_of_clip(stick, stick, still, walk) == pytest.approx(0.75)


def test_a_bend_stretches_and_penetrates_nothing_much(stick, transfer):
    clips = list(report.describe_clips(stick, transfer))
    assert 1.0 < clips[0].stretch_p99 < 1.5
    assert 0.0 <= clips[0].penetration_fraction < 0.2


def test_the_source_is_measured_beside_the_figure(stick, transfer):
    """Here the source is the figure, but for travelling twice as far."""
    for clip in report.describe_clips(stick, transfer):
        assert clip.penetration_source_fraction == clip.penetration_fraction
        assert clip.foot_slide_source_m == pytest.approx(0.5 * clip.foot_slide_m)
