import logging
import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bunraku.errors import Code
from bunraku.formats.bvh import read_recording
from bunraku.formats.bvh_text import Recording, parse_recording
from bunraku.skinning import clip_transforms, forward_kinematics
from bunraku.types import NO_PARENT, FormatError

LEG = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Knee
  {
    OFFSET 0 -90 0
    CHANNELS 3 Yrotation Zrotation Xrotation
    End Site
    {
      OFFSET 0 -90 10
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.0333333
1 180 2 0 0 0 0 0 0
1 180 2 90 0 0 0 0 90
"""


def read(folder, text, name="a.bvh"):
    content = text if isinstance(text, bytes) else text.encode()
    (folder / name).write_bytes(content)
    return read_recording(folder / name, content)


def places(skeleton, clip):
    return forward_kinematics(skeleton.parents, clip_transforms(clip))[..., :3, 3]


def test_a_leg_worked_out_by_hand(tmp_path):
    skeleton, clip = read(tmp_path, LEG)
    assert skeleton.names == ("Hips", "Knee", "Knee_end")
    assert skeleton.parents.tolist() == [-1, 0, 1]
    np.testing.assert_array_equal(skeleton.rest[:, :3, :3], np.tile(np.eye(3), (3, 1, 1)))
    np.testing.assert_allclose(skeleton.rest[2, :3, 3], [0, -0.9, 0.1])
    np.testing.assert_allclose(clip.times, [0, 1 / 30], atol=1e-6)
    assert clip.name == "a"
    first, second = places(skeleton, clip)
    np.testing.assert_allclose(first, [[0.01, 1.8, 0.02], [0.01, 0.9, 0.02], [0.01, 0, 0.12]])
    # 90 degrees about Z takes the thigh to +X; then the shin bends about its own X, towards -Z
    np.testing.assert_allclose(second[1], [0.91, 1.8, 0.02])
    np.testing.assert_allclose(second[2], [0.91 + 0.1, 1.8, 0.02 - 0.9], atol=1e-9)


@pytest.mark.parametrize("order", ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"])
def test_rotations_follow_the_order_of_the_channels(tmp_path, order):
    channels = " ".join(f"{axis}rotation" for axis in order)
    text = LEG.replace("Yrotation Zrotation Xrotation", channels)
    _, clip = read(tmp_path, text.replace("90 0 0 0 0 90\n", "0 0 0 10 20 30\n"))
    expected = Rotation.from_euler(order, [10, 20, 30], degrees=True)
    assert (Rotation.from_quat(clip.rotations[1, 1]) * expected.inv()).magnitude() < 1e-9


def read_strictly(path):
    """Let pybvh read a file, as we would have."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its own, of matplotlib
        from pybvh import read_bvh_file

        read = read_bvh_file(path, world_up="+y")
    number = {id(node): i for i, node in enumerate(read.nodes)}
    ends = [node.is_end_site() for node in read.nodes]
    channels = [
        []
        if end
        else [*(f"P{axis}" for axis in getattr(node, "pos_channels", ()))]
        + [f"R{axis}" for axis in node.rot_channels]
        for node, end in zip(read.nodes, ends, strict=True)
    ]
    angles = np.degrees(read.joint_angles).reshape(len(read.root_pos), -1)
    return Recording(
        [
            f"{node.parent.name}_end" if end else node.name
            for node, end in zip(read.nodes, ends, strict=True)
        ],
        [NO_PARENT if node.parent is None else number[id(node.parent)] for node in read.nodes],
        np.array([node.offset for node in read.nodes], np.float64),
        channels,
        np.column_stack([read.root_pos, angles]),
        float(read.frame_time),
    )


def test_pybvh_reads_the_same(tmp_path):
    (tmp_path / "a.bvh").write_text(LEG)
    strict = read_strictly(tmp_path / "a.bvh")
    loose = parse_recording("a.bvh", LEG.encode())
    assert strict.names == loose.names
    assert strict.parents == loose.parents
    assert strict.channels == loose.channels
    np.testing.assert_allclose(strict.offsets, loose.offsets)
    np.testing.assert_allclose(strict.values, loose.values)
    assert strict.frame_time == pytest.approx(loose.frame_time, rel=1e-4)


@pytest.mark.parametrize(
    ("factor", "unit"), [(1.0, 0.01), (0.01, 1.0), (10.0, 0.001), (0.1, 0.1), (1 / 2.54, 0.0254)]
)
def test_any_unit_becomes_metres(tmp_path, factor, unit):
    scaled = LEG.replace("-90", str(-90 * factor)).replace(" 10\n", f" {10 * factor}\n")
    skeleton, _ = read(tmp_path, scaled)
    np.testing.assert_allclose(skeleton.rest[1, 1, 3], -0.9, rtol=1e-9)


def test_a_recording_with_z_up_is_turned(tmp_path):
    text = LEG.replace("OFFSET 0 -90 0", "OFFSET 0 0 -90").replace("0 -90 10", "0 -10 -90")
    text = text.replace("1 180 2 0 0 0 0 0 0", "1 -2 180 0 0 0 0 0 0")
    skeleton, clip = read(tmp_path, text)
    np.testing.assert_allclose(skeleton.rest[2, :3, 3], [0, -0.9, 0.1])
    np.testing.assert_allclose(places(skeleton, clip)[0, 0], [0.01, 1.8, 0.02])


def test_positions_of_inner_joints_replace_their_offsets_or_are_zero(tmp_path):
    whole = LEG.replace("3 Yrotation", "6 Xposition Yposition Zposition Yrotation")
    for given, expected in (("0 -90 0", -0.9), ("0 0 0", -0.9), ("0 -80 0", -0.8)):
        row = f"1 180 2 0 0 0 {given} 0 0 0"
        text = whole[: whole.index("1 180")] + f"{row}\n{row}\n"
        _, clip = read(tmp_path, text)
        np.testing.assert_allclose(clip.translations[0, 1], [0, expected, 0], atol=1e-12)


def test_zero_length_bones_are_a_warning(tmp_path, caplog):
    with caplog.at_level(logging.WARNING):
        read(tmp_path, LEG.replace("-90", "0").replace("0 10\n", "0 0\n"))
    assert "all bones have length 0" in caplog.text


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0.0333333", "0", "Frame Time: is 0.0; wanted seconds above 0"),
        ("0.0333333", "-1", "Frame Time: is -1"),
        ("0.0333333", "nan", "Frame Time: is nan"),
        ("0 -90 0\n", "0 nan 0\n", "joint 'Knee': has an OFFSET that is not finite"),
        ("90 0 0 0 0 90", "90 0 0 0 0 inf", "frame 1: holds a number that is not finite"),
        ("Yrotation Zrotation Xrotation", "Xrotation Yrotation Yrotation", "channel twice"),
    ],
)
def test_values_that_mean_nothing_are_refused(tmp_path, old, new, message):
    with pytest.raises(FormatError, match=message):
        read(tmp_path, LEG.replace(old, new))


def test_too_many_joints_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("bunraku.limits.JOINTS", 2)
    with pytest.raises(FormatError, match="has 3 joints, at most 2 are read") as caught:
        read(tmp_path, LEG)
    assert caught.value.code is Code.LIMIT_JOINTS


def test_too_many_frames_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("bunraku.limits.JOINT_FRAMES", 5)
    with pytest.raises(FormatError, match=r"2 frames of 3 joints, at most .* 5 joints times"):
        read(tmp_path, LEG)


def test_bytes_that_no_text_has_are_refused(tmp_path):
    with pytest.raises(FormatError, match="holds NUL bytes"):
        read(tmp_path, LEG.replace("Knee", "Kn\0e"))


def test_what_other_programs_trip_over_is_announced(tmp_path, caplog):
    read(tmp_path, LEG.replace("Knee", "Hips"))
    assert "1 joints have a name that another joint has" in caplog.text


def test_recordings_of_shared_data_are_upright_and_about_as_tall_as_people(data):
    from bunraku.formats import read_motion

    files = sorted((data / "mocap").glob("*/*.bvh"))
    assert files
    for path in files:
        skeleton, clip = read_motion(path)
        rest = forward_kinematics(skeleton.parents, skeleton.rest)[:, :3, 3]
        _, height, depth = np.ptp(rest, axis=0)
        assert height > depth, path
        assert 0.9 < np.ptp(places(skeleton, clip)[0], axis=0).max() < 3.0, path
