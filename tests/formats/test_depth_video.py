import json

import numpy as np
import pytest
from PIL import Image

from bunraku.errors import NOTE
from bunraku.formats import is_depth_folder, read_depth
from bunraku.types import FormatError
from tests.depth_folders import LENS, OURS, ball, write_folder


def test_depth_comes_in_metres_and_time_in_seconds(tmp_path):
    video = read_depth(write_folder(tmp_path / "a", ball()))
    assert video.depths.shape == (3, 48, 64)
    assert np.unique(video.depths).tolist() == [0.0, 1.5]
    np.testing.assert_allclose(video.times, [0, 1 / 30, 2 / 30])
    np.testing.assert_array_equal(video.intrinsics, [[60, 0, 31.5], [0, 60, 23.5], [0, 0, 1]])
    assert video.masks is None


def test_masks_of_any_kind_are_read(tmp_path):
    folder = write_folder(tmp_path / "a", ball())
    (folder / "mask").mkdir()
    for number, mode in enumerate(("L", "1", "RGBA")):
        image = Image.fromarray(np.uint8(ball()[number] > 0) * 255)
        image.convert(mode).save(folder / "mask" / f"{number:04d}.png")
    masks = read_depth(folder).masks
    np.testing.assert_array_equal(masks, ball() > 0)


def test_missing_numbers_are_pauses_and_every_second_frame_is_not(tmp_path, caplog):
    caplog.set_level(NOTE)
    video = read_depth(write_folder(tmp_path / "gap", ball(4), numbers=[3, 4, 7, 8]))
    np.testing.assert_allclose(video.times * 30, [0, 1, 4, 5])
    assert "frames are missing, first after 4" in caplog.text
    caplog.clear()
    video = read_depth(write_folder(tmp_path / "even", ball(3), numbers=[0, 2, 4]))
    np.testing.assert_allclose(video.times * 30, [0, 1, 2])
    assert "missing" not in caplog.text


@pytest.mark.parametrize(
    "lens",
    [
        {**LENS, "depth_scale": 0.001, "fps": 30},  # RealSense: metres a unit
        {"width": 64, "height": 48, "fx": 60, "fy": 60, "ppx": 31.5, "ppy": 23.5, "fps": 30},
        {"width": 64, "height": 48, "intrinsic_matrix": [60, 0, 0, 0, 60, 0, 31.5, 23.5, 1]},
        {"K": [60, 0, 31.5, 0, 60, 23.5, 0, 0, 1]},
        {"camera_matrix": [[60, 0, 31.5], [0, 60, 23.5], [0, 0, 1]]},
        {"color": {"fx": 99, "fy": 99, "cx": 9, "cy": 9}, "depth": LENS},
        {"width": 128, "height": 96, "fx": 120, "fy": 120, "cx": 63.5, "cy": 47.5},
        {
            "CalibrationInformation": {
                "Cameras": [
                    {"Purpose": "CAMERA_CALIBRATION_PurposePhotoVideo"},
                    {
                        "Purpose": "CAMERA_CALIBRATION_PurposeDepth",
                        "Intrinsics": {"ModelParameters": [0.5, 0.5, 60 / 64, 60 / 48, 0.1, 0.0]},
                        "SensorWidth": 64,
                        "SensorHeight": 48,
                    },
                ]
            }
        },
    ],
)
def test_lenses_of_common_recorders_are_the_same_lens(tmp_path, lens):
    video = read_depth(write_folder(tmp_path / "a", ball(), lens))
    np.testing.assert_allclose(video.intrinsics, [[60, 0, 31.5], [0, 60, 23.5], [0, 0, 1]])
    assert video.depths.max() == 1.5


def test_what_is_not_told_is_taken_aloud(tmp_path, caplog):
    read_depth(write_folder(tmp_path / "a", ball(), LENS))
    assert "tells no depth_scale; 1000 is taken" in caplog.text
    assert "tells no fps; 30 is taken" in caplog.text


@pytest.mark.parametrize(
    ("lens", "words"),
    [
        (None, "holds no intrinsics.json"),
        ({"fx": 60}, "tells no fy cx cy"),
        ({**OURS, "fx": 0}, "/fx: is 0; wanted a number above 0"),
        ({**OURS, "fps": -30}, "/fps: is -30"),
        ({**OURS, "depth_scale": 0}, "/depth_scale: is 0"),
        ({**OURS, "width": 64, "height": 64}, "/width: is for 64 x 64 pixels"),
        ({**OURS, "cx": 900}, "/cx: puts the middle of the view at 900"),
        ({**OURS, "fx": 1.2, "fy": 1.2}, "/fx: is 1.2, a view of 176 degrees"),
        ([60, 60], "holds no JSON object"),
    ],
)
def test_a_lens_that_cannot_be_is_refused(tmp_path, lens, words):
    with pytest.raises(FormatError, match=words):
        read_depth(write_folder(tmp_path / "a", ball(), lens))


def test_frames_that_are_no_depth_are_refused_by_name(tmp_path):
    for name, image in {
        "grey": Image.new("L", (64, 48)),
        "colour": Image.new("RGB", (64, 48)),
        "palette": Image.new("P", (64, 48)),
        "other size": Image.fromarray(np.zeros((24, 32), np.uint16)),
    }.items():
        folder = write_folder(tmp_path / name, ball())
        image.save(folder / "0001.png")
        with pytest.raises(FormatError, match=r"frame 0001\.png: has ") as caught:
            read_depth(folder)
        assert len(str(caught.value)) - len(str(folder)) < 200
    folder = write_folder(tmp_path / "torn", ball())
    (folder / "0002.png").write_bytes((folder / "0002.png").read_bytes()[:60])
    with pytest.raises(FormatError, match=r"frame 0002\.png: is damaged"):
        read_depth(folder)


def test_masks_that_do_not_fit_are_refused(tmp_path):
    folder = write_folder(tmp_path / "a", ball())
    (folder / "mask").mkdir()
    Image.new("L", (64, 48)).save(folder / "mask" / "0000.png")
    with pytest.raises(FormatError, match=r"has no mask for frame 0001\.png"):
        read_depth(folder)
    for number in range(3):
        Image.new("L", (32, 24)).save(folder / "mask" / f"{number:04d}.png")
    with pytest.raises(FormatError, match="has 32 x 24 pixels, unlike its depth frame"):
        read_depth(folder)


def test_other_folders_and_files_are_refused(tmp_path):
    assert not is_depth_folder(tmp_path)
    with pytest.raises(FormatError, match="holds no NNNN"):
        read_depth(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(FormatError, match="is no folder"):
        read_depth(tmp_path / "file")
    (tmp_path / "intrinsics.json").write_text(json.dumps(OURS))
    assert is_depth_folder(tmp_path)
    (tmp_path / "0000.png").write_bytes(b"x")
    (tmp_path / "intrinsics.json").write_text("{")
    with pytest.raises(FormatError, match="is no JSON"):
        read_depth(tmp_path)
