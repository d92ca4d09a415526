import pytest

from bunraku.formats.sniffing import sniff
from bunraku.types import FormatError

STL = b"solid, or not" + b"\0" * 67 + (1).to_bytes(4, "little") + b"\0" * 50


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        (b"glTF\x02\0\0\0", "gltf"),
        (b'\xef\xbb\xbf  {"asset": {}}', "gltf"),
        (b"Kaydara FBX Binary  \0", "fbx"),
        (b"; FBX 7.4.0 project file", "fbx"),
        (b"ply\r\nformat ascii 1.0\r\n", "ply"),
        (b"\nHierarchy\nROOT Hips", "bvh"),
        (STL, "stl"),
        (b"  SOLID a\n facet", "stl"),
        (b"# made by hand\n\nCOFF\n8 6 12", "off"),
        (b"NOFF 8 6 12", "off"),
        (b"# Blender\nmtllib a.mtl\n", "obj"),
        (b"v 0 0 0\n", "obj"),
        ("v 0 0 0\n".encode("utf-16"), "obj"),
    ],
)
def test_content_tells_the_format_whatever_the_name(content, kind):
    assert sniff("a.bin", content) == kind


@pytest.mark.parametrize("name", ["a.stl", "a.off", "a.ply", "a.bvh"])
def test_the_name_decides_when_the_content_does_not(name):
    assert sniff(name, b"\0\1\2\3") == name[2:]


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"PK\x03\x04....", "a zip archive; unpack it"),
        (b"\x1f\x8b....", "a gzip archive"),
        (b"\x89PNG....", "a picture"),
        (b"\n<!DOCTYPE html>", "a web page: the download failed"),
        (b"\x7fELF", "a program"),
        (b"\x93NUMPY", "Python data, which is never loaded"),
        (b"version https://git-lfs.github.com", "a Git LFS pointer"),
    ],
)
def test_foreign_files_are_named(content, what):
    with pytest.raises(FormatError, match=f"a.glb: holds {what}"):
        sniff("a.glb", content)


def test_what_is_unknown_is_refused():
    with pytest.raises(FormatError, match=r"is of no known format; wanted \.glb"):
        sniff("a.glb", b"\0\1\2\3")


def test_obj_lines_do_not_pass_for_formats_that_begin_in_their_own_way():
    with pytest.raises(FormatError, match="is of no known format"):
        sniff("a.glb", b"v 0 0 0\nv 1 0 0\n")
