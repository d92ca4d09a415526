import io
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest

from bunraku.errors import Code
from bunraku.formats import read_depth
from bunraku.studio.unpacking import unpack_film
from bunraku.types import FormatError
from tests.depth_folders import write_folder


def pack(folder, *, above=""):
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(folder.rglob("*")):
            archive.write(path, above + str(path.relative_to(folder)))
    return content.getvalue()


@pytest.fixture
def recording(tmp_path):
    depths = 1000 + 100 * np.arange(3)[:, None, None] + np.zeros((3, 48, 64))
    folder = write_folder(tmp_path / "recording", depths)
    (folder / "mask").mkdir()
    for path in folder.glob("*.png"):
        (folder / "mask" / path.name).write_bytes(path.read_bytes())
    return folder


def test_a_packed_folder_is_read_as_it_was(recording, tmp_path):
    (recording / "._0000.png").write_bytes(b"macOS")
    (recording / "notes.txt").write_text("kept at home")
    for above in ("", "session/take 1/"):
        unpack_film("a.zip", pack(recording, above=above), tmp_path / "there", most=1 << 20)
        np.testing.assert_array_equal(
            read_depth(tmp_path / "there").depths, read_depth(recording).depths
        )
        names = sorted(path.name for path in (tmp_path / "there").iterdir())
        assert names == ["0000.png", "0001.png", "0002.png", "intrinsics.json", "mask"]


def zipped(names, method=zipfile.ZIP_DEFLATED, content=b"x"):
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", method) as archive:
        for name in names:
            archive.writestr(name, content)
    return packed.getvalue()


def files(folder):
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def test_names_that_climb_stay_inside(tmp_path):
    (tmp_path / "in").mkdir()
    content = zipped(["../../0000.png", "../../intrinsics.json", ".."])
    unpack_film("a.zip", content, tmp_path / "in" / "there", most=100)
    assert files(tmp_path) == {"in/there/0000.png", "in/there/intrinsics.json"}


@pytest.mark.parametrize(
    "others", [["b/color/0009.png"], ["b/color/mask/0009.png", "b/preview.png", "b/notes.json"]]
)
def test_the_folder_with_the_lens_is_the_film(tmp_path, others):
    names = ["b/depth/0009.png", "b/depth/camera.json", "b/depth/Mask/0009.PNG", *others]
    unpack_film("a.zip", zipped(names), tmp_path / "there", most=100)
    assert files(tmp_path / "there") == {"0009.png", "camera.json", "mask/0009.png"}


def test_a_lens_may_lie_above_its_frames(tmp_path):
    names = ["b/depth/0.png", "b/notes.json", "b/camera.json", "camera.json"]
    unpack_film("a.zip", zipped(names), tmp_path / "there", most=100)
    assert files(tmp_path / "there") == {"0.png", "camera.json"}


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["readme.txt"], "holds no NNNN.png depth frames"),
        (["mask/0000.png", "intrinsics.json"], "holds no NNNN.png depth frames"),
        (["depth/0.png", "color/0.png"], r"holds 2 folders of pictures \(color, depth\), wanted"),
        (["a/0.png", "a/camera.json", "b/0.png", "b/camera.json"], "holds 2 folders"),
        (["0.png", "0.PNG"], "holds 0.PNG more than once"),
        (["0.png", "mask/0.png", "Mask/0.png"], "holds 0.png more than once"),
    ],
)
def test_what_is_not_one_film_is_refused(tmp_path, names, message):
    with pytest.raises(FormatError, match=message) as caught:
        unpack_film("a.zip", zipped(names), tmp_path / "there", most=100)
    assert caught.value.code is Code.DEPTH_FRAMES
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_rare_methods_are_refused(tmp_path, method):
    with pytest.raises(FormatError, match="packed by a rare method"):
        unpack_film("a.zip", zipped(["0.png"], method), tmp_path / "there", most=100)


def test_a_size_that_lies_costs_no_memory(tmp_path):
    size = 64 << 20
    content = zipped(["0.png"], content=bytes(size)).replace(
        struct.pack("<I", size), struct.pack("<I", 10)
    )
    tracemalloc.start()
    with pytest.raises(FormatError, match="damaged or locked"):
        unpack_film("a.zip", content, tmp_path / "there", most=100)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 16 << 20
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_stream_leaves_the_earlier_film(tmp_path):
    good = zipped(["0.png"], content=bytes(range(256)) * 40)
    unpack_film("a.zip", good, tmp_path / "there", most=1 << 20)
    bad, first = bytearray(good), good.find(b"0.png") + 5
    bad[first : first + 8] = b"\xff" * 8
    with pytest.raises(FormatError, match=r"damaged or locked zip file \(.*invalid"):
        unpack_film("a.zip", bytes(bad), tmp_path / "there", most=1 << 20)
    assert files(tmp_path) == {"there/0.png"}


def test_what_unpacks_to_too_much_is_refused(recording, tmp_path):
    with pytest.raises(FormatError, match="unpacks to more than") as caught:
        unpack_film("a.zip", pack(recording), tmp_path / "there", most=100)
    assert caught.value.code is Code.LIMIT_BYTES
    assert not (tmp_path / "there").exists()


@pytest.mark.parametrize("cut", [40, -30])
def test_a_damaged_file_is_one_line(recording, tmp_path, cut):
    with pytest.raises(FormatError, match=r"a\.zip: is a damaged or locked zip file"):
        unpack_film("a.zip", pack(recording)[:cut], tmp_path / "there", most=1 << 20)
