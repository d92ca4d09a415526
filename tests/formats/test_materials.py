import io
import logging

import pytest
from PIL import Image

from bunraku.errors import NOTE
from bunraku.formats.materials import read_materials


def picture(form):
    stream = io.BytesIO()
    Image.new("RGB", (2, 2), (255, 0, 0)).save(stream, form)
    return stream.getvalue()


def read(folder, text, line="mtllib a.mtl"):
    (folder / "a.mtl").write_text(text)
    return read_materials(folder / "a.obj", [line])


def test_colours_turn_linear_and_opacity_has_two_names(tmp_path):
    clear, cloudy = read(tmp_path, "newmtl a\nKd .5 0 1\nd .25\nnewmtl b\nTr .25\n")
    assert clear.colour == pytest.approx((0.21404, 0.0, 1.0, 0.25), abs=1e-5)
    assert cloudy.colour[3] == 0.75


@pytest.mark.parametrize("form", ["PNG", "JPEG"])
def test_textures_are_kept_as_they_are(tmp_path, form):
    (tmp_path / "my map.img").write_bytes(picture(form))
    (material,) = read(tmp_path, "newmtl a\nKd 0 0 0\nmap_Kd -bm 1 -o 1 2 -clamp on my map.img\n")
    assert material.image == picture(form)
    assert material.image_name == "my map.img"
    assert material.colour == (1.0, 1.0, 1.0, 1.0)  # black under a texture means the texture


def test_other_pictures_become_png(tmp_path):
    (tmp_path / "a.bmp").write_bytes(picture("BMP"))
    (material,) = read(tmp_path, "newmtl a\nmap_Kd a.bmp\n")
    assert Image.open(io.BytesIO(material.image)).format == "PNG"


@pytest.mark.parametrize("name", ["none.png", "../outside.png", "a.mtl", "/etc/hostname"])
def test_a_texture_that_cannot_be_read_is_a_warning(tmp_path, caplog, name):
    with caplog.at_level(NOTE):
        (material,) = read(tmp_path, f"newmtl a\nmap_Kd {name}\n")
    assert material.image == b""
    assert "the texture is left out" in caplog.text


def test_a_library_with_spaces_in_its_name_and_one_that_is_missing(tmp_path, caplog):
    (tmp_path / "my mats.mtl").write_text("newmtl a\n")
    (found,) = read_materials(tmp_path / "a.obj", ["mtllib my mats.mtl"])
    assert found.name == "a"
    (tmp_path / "b.mtl").write_text("newmtl b\n")
    escaped = read_materials(tmp_path / "a.obj", [r"mtllib my\ mats.mtl  b.mtl"])
    assert [material.name for material in escaped] == ["a", "b"]
    with caplog.at_level(logging.WARNING):
        assert read_materials(tmp_path / "a.obj", ["mtllib ../secret.mtl"]) == []
    assert "only a relative path inside its folder is read" in caplog.text


def test_a_library_line_without_a_name_is_no_library(tmp_path, caplog):
    with caplog.at_level(NOTE):
        assert read_materials(str(tmp_path / "a.obj"), ["mtllib ", "mtllib  "]) == []
    assert not caplog.records
