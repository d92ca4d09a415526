import pytest

from bunraku.humanoids.names import read_name


@pytest.mark.parametrize(
    ("name", "side", "role"),
    [
        ("mixamorig:LeftUpLeg", "left", "UpperLeg"),
        ("LeftLeg", "left", "LowerLeg"),
        ("Bip01 R Thigh", "right", "UpperLeg"),
        ("thigh_l", "left", "UpperLeg"),
        ("DEF-upper_arm.L.001", "left", "UpperArm"),
        ("J_Bip_R_LowerArm", "right", "LowerArm"),
        ("leftUpperArm", "left", "UpperArm"),
        ("lShldr", "left", "UpperArm"),
        ("CC_Base_L_Calf", "left", "LowerLeg"),
        ("lowerleg01.R", "right", "LowerLeg"),
        ("LoLeg_L", "left", "LowerLeg"),
        ("LHipJoint", "left", "UpperLeg"),
        ("RightCollar", "right", "Shoulder"),
        ("rthigh", "right", "UpperLeg"),
        ("leftforearm", "left", "LowerArm"),
        ("hand_r", "right", "Hand"),
        ("HandLeft", "left", "Hand"),
        ("b_LeftFoot01_017", "left", "Foot"),
        ("Armature|Hips", "", "hips"),
        ("ball_r", "right", "Toes"),
    ],
)
def test_dialects(name, side, role):
    found = read_name(name)
    assert found.side == side
    assert found.may_be(role)


@pytest.mark.parametrize("name", ["IK_Foot.L", "LeftUpLegTwist", "foot_ctrl_l", "Foot.L_end", "42"])
def test_helpers_are_no_part_of_the_body(name):
    assert read_name(name).stem == ""


@pytest.mark.parametrize(
    ("name", "finger"),
    [
        ("LeftHandIndex1", "Index"),
        ("thumb_02_r", "Thumb"),
        ("J_Bip_L_Little3", "Little"),
        ("RightHandPinky2", "Little"),
        ("middle_01_l", "Middle"),
        ("LeftHand", ""),
        ("LeftToeBase", ""),
    ],
)
def test_fingers(name, finger):
    assert read_name(name).finger == finger


def test_numbers_are_kept():
    assert read_name("upperleg02.L").number == 2
    assert read_name("upperleg01.L") != read_name("upperleg02.L")
