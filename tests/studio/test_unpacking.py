import io
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


def test_names_that_climb_stay_inside(tmp_path):
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr("../../0000.png", b"x")
        archive.writestr("/etc/intrinsics.json", b"{}")
        archive.writestr("..", b"x")
    unpack_film("a.zip", content.getvalue(), tmp_path / "in" / "there", most=100)
    found = {str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*") if p.is_file()}
    assert found == {"in/there/0000.png", "in/there/intrinsics.json"}


def test_what_unpacks_to_too_much_is_refused(recording, tmp_path):
    with pytest.raises(FormatError, match="unpacks to more than") as caught:
        unpack_film("a.zip", pack(recording), tmp_path / "there", most=100)
    assert caught.value.code is Code.LIMIT_BYTES
    assert not (tmp_path / "there").exists()


@pytest.mark.parametrize("cut", [40, -30])
def test_a_damaged_file_is_one_line(recording, tmp_path, cut):
    with pytest.raises(FormatError, match=r"a\.zip: is a damaged or locked zip file"):
        unpack_film("a.zip", pack(recording)[:cut], tmp_path / "there", most=1 << 20)
