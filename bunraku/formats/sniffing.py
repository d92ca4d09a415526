"""What a file is, told by its content; its name is only asked when the content leaves it open."""

import re
from pathlib import PurePath

from bunraku.errors import Code
from bunraku.formats.files import Location
from bunraku.types import FormatError

FIGURES = ("gltf", "fbx", "obj", "ply", "stl", "off")
WANTED = ".glb .gltf .vrm .fbx .obj .ply .stl .off"

_FOREIGN = (
    (rb"PK\x03\x04|PK\x05\x06", "a zip archive; unpack it and give the file inside"),
    (rb"\x1f\x8b", "a gzip archive; unpack it and give the file inside"),
    (rb"Rar!|7z\xbc\xaf|BZh|\xfd7zXZ|\x28\xb5\x2f\xfd", "an archive; unpack it first"),
    (rb"\x89PNG|\xff\xd8\xff|GIF8|RIFF....WEBP|BM....\x00\x00\x00\x00", "a picture"),
    (rb"%PDF", "a PDF document"),
    (rb"\x7fELF|MZ", "a program"),
    (rb"\x93NUMPY|\x80[\x02-\x05]", "Python data, which is never loaded; export a mesh file"),
    (rb"BLENDER", "a Blender file; export it as .glb"),
    (rb"PXR-USDC|#usda", "a USD file; export it as .glb"),
    (rb"version https://git-lfs", "a Git LFS pointer, not the file itself; run git lfs pull"),
    (rb"(?i)\s*<(!doctype|html|head|body)", "a web page: the download failed; fetch it again"),
    (rb"\s*<\?xml|\s*<[a-zA-Z]", "an XML file; export it as .glb"),
)
_OFF = re.compile(rb"(\s|#[^\n]*\n)*(ST)?C?N?4?n?OFF\b", re.IGNORECASE)
_OBJ_LINE = re.compile(
    rb"^[ \t]*(v|vn|vt|vp|f|l|p|o|g|s|mtllib|usemtl|cstype|curv|surf)[ \t]+\S", re.MULTILINE
)
_PROVEN = ("ply", "off", "stl", "glb", "gltf", "vrm", "bvh")  # these begin in their own way
_HEAD = 1 << 16


def sniff(path: Location, content: bytes) -> str:
    """Name the format of a file's bytes: gltf, obj, ply, stl, off or bvh.

    Raises:
        FormatError: if they are of another format, which is named where it is known.
    """
    head = content[:_HEAD].removeprefix(b"\xef\xbb\xbf")
    kind = _by_signature(content, head)
    if kind:
        return kind
    for pattern, what in _FOREIGN:
        if re.match(pattern, head, re.DOTALL):
            raise FormatError(path, "", f"holds {what}; wanted {WANTED}", code=Code.FILE_KIND)
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return _by_signature(b"", content.decode("utf-16", "replace").encode()[:_HEAD]) or "obj"
    suffix = PurePath(path).suffix.lower().lstrip(".")
    is_text = b"\0" not in head
    if is_text and (suffix == "obj" or (suffix not in _PROVEN and _OBJ_LINE.search(content))):
        return "obj"
    if suffix in ("stl", "off", "ply", "bvh"):
        return suffix
    raise FormatError(path, "", f"is of no known format; wanted {WANTED}", code=Code.FILE_KIND)


def _by_signature(content: bytes, head: bytes) -> str:
    """Name the format that the first bytes prove, or nothing."""
    start = head.lstrip()
    if head[:4] == b"glTF" or start[:1] in (b"{", b"["):
        return "gltf"
    if re.match(rb"Kaydara FBX Binary|; FBX", head):
        return "fbx"
    if re.match(rb"ply\s", start):
        return "ply"
    if re.match(rb"HIERARCHY\s", start, re.IGNORECASE):
        return "bvh"
    count = int.from_bytes(content[80:84], "little")
    if len(content) > 84 and len(content) == 84 + 50 * count:
        return "stl"
    if re.match(rb"solid\b", start, re.IGNORECASE):
        return "stl"
    return "off" if _OFF.match(head) else ""
