import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bunraku import limits
from bunraku.errors import Code
from bunraku.formats.fbx.clips import read_motions
from bunraku.formats.fbx.records import read_records
from bunraku.formats.fbx.scene import build_scene
from bunraku.rotations import matrices_to_quaternions
from bunraku.types import FormatError
from tests.creatures import make_creature
from tests.formats.made_fbx import TICKS, Maker, Node, encode, properties


def make_clip(*, stacks: int = 1, nodes: int = 1, keys: int = 2, **defaults: float) -> list[Node]:
    """Make stacks that share a layer, whose one curve turns nodes about X by 0 to 10 degrees."""
    objects, links = Node("Objects"), Node("Connections")
    group = objects.add("AnimationCurveNode", 50, "R", "")
    properties(group, **{f"d|{axis}": value for axis, value in defaults.items()})
    objects.add("AnimationLayer", 51, "layer", "")
    curve = objects.add("AnimationCurve", 52, "", "")
    curve.add("KeyTime", np.arange(keys) * TICKS // 30)
    curve.add("KeyValueFloat", np.linspace(0.0, 10.0, keys))
    links.add("C", "OO", 50, 51)
    links.add("C", "OP", 52, 50, "d|X")
    for node in range(nodes):
        properties(objects.add("Model", 100 + node, "n", "Null"), Lcl_Rotation=[1.0, 2.0, 3.0])
        links.add("C", "OP", 50, 100 + node, "Lcl Rotation")
    for stack in range(stacks):
        objects.add("AnimationStack", 1000 + stack, f"s{stack}", "")
        links.add("C", "OO", 51, 1000 + stack)
    return [objects, links]


def read(records: list[Node]):
    return list(read_motions(build_scene("a.fbx", read_records("a.fbx", encode(records)))))


def test_an_axis_without_a_curve_stands_where_its_curve_node_says():
    for defaults, wanted in (
        ({}, (10, 2, 3)),
        ({"Y": 90.0}, (10, 90, 3)),
        ({"X": 5.0}, (10, 2, 3)),
    ):
        ((_, rotations, _),) = read(make_clip(**defaults))[0].moved.values()
        found = matrices_to_quaternions(rotations)[-1]
        turns = Rotation.from_euler("xyz", wanted, degrees=True).as_quat()
        assert abs(found @ turns) == pytest.approx(1.0)


def test_a_curve_node_without_curves_moves_its_node_all_the_same():
    objects, links = make_clip()
    properties(objects.add("AnimationCurveNode", 60, "T", ""), **{"d|Z": 7.0})
    links.add("C", "OO", 60, 51)
    links.add("C", "OP", 60, 100, "Lcl Translation")
    ((moved, _, _),) = read([objects, links])[0].moved.values()
    np.testing.assert_allclose(moved, [[0, 0, 7]] * 2)


def test_counts_of_keys_that_wrap_around_are_left_out():
    creature = make_creature(0.1)
    records = Maker(creature).make()
    curve = next(node for node in records[0].inside if node.name == "AnimationCurve")
    count = len(curve.inside[0].values[0])
    curve.inside[2].values = (np.full(5, 4, "<i4"),)
    curve.inside[3].values = (np.zeros(20, "<f4"),)
    curve.inside[4].values = (np.array([2**62] * 4 + [count], "<i8"),)
    (motion, *_) = read(records)
    assert motion.times[-1] == pytest.approx(1.0)


def test_frames_of_all_clips_together_are_counted_before_any_is_sampled(monkeypatch):
    monkeypatch.setattr(limits, "JOINT_FRAMES", 100)
    assert len(read(make_clip(stacks=5, nodes=4, keys=5))) == 5
    monkeypatch.setattr("bunraku.formats.fbx.clips._bake", None)
    with pytest.raises(FormatError, match="all clips are over 100; cut the clips") as caught:
        read(make_clip(stacks=6, nodes=4, keys=5))
    assert caught.value.code is Code.LIMIT_FRAMES
