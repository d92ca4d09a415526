import logging

import numpy as np
import pytest

from bunraku.formats.bvh_text import parse_recording
from bunraku.types import FormatError

TEXT = """HIERARCHY
ROOT Hips
{
  OFFSET 0 1 0
  CHANNELS 3 Zrotation Xrotation Yrotation
  JOINT Left Up Leg
  {
    OFFSET 1 0 0
    CHANNELS 1 Xrotation
  }
}
MOTION
Frames: 2
Frame Time: 0.5
1 2 3 4
5 6 7 8
"""


def parse(text):
    return parse_recording("a.bvh", text.encode())


def test_what_stricter_readers_refuse_is_read():
    found = parse(TEXT)
    assert found.names == ["Hips", "Left Up Leg"]  # spaces, one channel, no end site
    assert found.parents == [-1, 0]
    assert found.channels == [["RZ", "RX", "RY"], ["RX"]]
    np.testing.assert_array_equal(found.values, [[1, 2, 3, 4], [5, 6, 7, 8]])
    np.testing.assert_array_equal(found.offsets, [[0, 1, 0], [1, 0, 0]])
    assert found.frame_time == 0.5


@pytest.mark.parametrize(
    "text",
    [
        TEXT.replace("\n", "\r"),
        TEXT.replace("\n", " "),
        TEXT.lower(),
        TEXT.replace("1 2 3 4\n", "1 2\n3 4\n\n"),
        TEXT.replace("ROOT Hips\n{", "ROOT Hips{"),
        "\ufeff" + TEXT,
    ],
)
def test_lines_and_case_do_not_matter(text):
    found = parse(text)
    np.testing.assert_array_equal(found.values, parse(TEXT).values)
    assert found.channels == parse(TEXT).channels


def test_two_roots_and_a_joint_without_channels_are_kept():
    second = "ROOT Prop\n{\nOFFSET 0 0 0\nCHANNELS 0\n}\nMOTION"
    assert parse(TEXT.replace("MOTION", second)).parents == [-1, 0, -1]


def test_a_deep_chain_needs_no_recursion():
    depth = 3000
    joints = "JOINT j\n{\nOFFSET 0 1 0\nCHANNELS 0\n" * depth
    text = TEXT.replace("  JOINT Left", joints + "  JOINT Left")
    assert len(parse(text.replace("MOTION", "}" * depth + "MOTION")).names) == depth + 2


@pytest.mark.parametrize(("claimed", "is_told"), [(1, True), (3, True), (2, False)])
def test_a_frame_count_that_is_off_is_a_warning(caplog, claimed, is_told):
    with caplog.at_level(logging.WARNING):
        found = parse(TEXT.replace("Frames: 2", f"Frames: {claimed}"))
    assert len(found.values) == 2
    assert (f"claims {claimed} frames and has 2" in caplog.text) == is_told


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("HIERARCHY", "HIER", "does not begin with HIERARCHY"),
        ("MOTION", "", "followed by 'FRAMES:'"),
        (TEXT[TEXT.index("MOTION") :], "", "has no MOTION section"),
        ("  }\n}\n", "", "joint 'Left Up Leg': is not closed with }"),
        ("}\nMOTION", "}\n}\nMOTION", "has a } outside all joints"),
        ("OFFSET 1 0 0", "", "joint 'Left Up Leg': has no OFFSET"),
        ("OFFSET 1 0 0", "OFFSET 1 0", "has OFFSET 'CHANNELS'; wanted three numbers"),
        ("CHANNELS 1 ", "CHANNELS 1000000000 ", "has CHANNELS '1000000000'"),
        ("CHANNELS 1 Xrotation", "CHANNELS 1 Wrotation", "has a channel 'Wrotation'"),
        ("JOINT Left", "ROOT Left", "followed by a ROOT in the wrong place"),
        ("JOINT Left Up Leg\n  {", "JOINT }", "followed by a name without {"),
        ("Frames: 2", "Frames: -1", "Frames: is '-1'; wanted a whole number above 0"),
        ("Frames: 2", "Frames: 0", "Frames: is '0'"),
        ("Frames: 2", "Frames: 1000000000000", "claims 1000000000000, the file has 2: it is cut"),
        ("Frame Time: 0.5", "", "MOTION: wanted Frames: and Frame Time: lines"),
        ("0.5", "0,5", "Frame Time: is '0,5'; wanted seconds"),
        ("5 6 7 8", "5 6 x 8", "frame 1: holds no number"),
        ("5 6 7 8", "5 6 7", "frame 1: has 3 numbers, wanted 4"),
        ("1 2 3 4\n5 6 7 8\n", "", "frame 0: has 0 numbers, wanted 4"),
    ],
)
def test_an_error_names_its_place(old, new, message):
    assert old in TEXT
    with pytest.raises(FormatError, match=message):
        parse(TEXT.replace(old, new, 1))


def test_nothing_that_moves_is_refused():
    still = TEXT.replace("3 Zrotation Xrotation Yrotation", "0").replace("1 Xrotation", "0")
    with pytest.raises(FormatError, match="has no CHANNELS, so nothing can move"):
        parse(still)
