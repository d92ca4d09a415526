"""Wavefront MTL: names, diffuse colours and textures that lie inside the OBJ's folder."""

import re
from collections.abc import Sequence

import numpy as np

from bunraku import limits
from bunraku.errors import NOTE, WARNING, Code, announce
from bunraku.formats.files import Location, read_beside
from bunraku.formats.pictures import as_png_or_jpeg, count_pixels
from bunraku.formats.pieces import Material, linear_from_srgb
from bunraku.types import FormatError

LARGEST_LIBRARY, LARGEST_TEXTURE = 64 << 20, 256 << 20
_OPTION_LENGTHS = {"-o": 3, "-s": 3, "-t": 3, "-mm": 2}  # numbers after it; other options have one


def read_materials(path: Location, library_lines: Sequence[str]) -> list[Material]:
    """Read the material libraries that an OBJ names; one that cannot be read is a warning."""
    materials: dict[str, Material] = {}
    for line in library_lines:
        for name in _library_names(path, line.partition(" ")[2].strip()):
            try:
                content = read_beside(path, name, limit=LARGEST_LIBRARY)
            except FormatError as error:
                message = f"mtllib {error.message}; materials are left out"
                _announce_loss(path, message, error.code)
                continue
            for material in _parse_library(path, content.decode("utf-8", "replace")):
                materials.setdefault(material.name, material)
    return list(materials.values())


def _library_names(path: Location, words: str) -> list[str]:
    """Split the names after mtllib, unless they are one name with spaces in it."""
    try:
        read_beside(path, words, limit=LARGEST_LIBRARY)
    except FormatError:
        names = re.split(r"(?<!\\)\s+", words)  # some escape the spaces within a name
        return [name.replace("\\ ", " ") for name in names if name]
    return [words]


def _parse_library(path: Location, text: str) -> list[Material]:
    """Read the materials of a library, in order."""
    entries: list[dict[str, str]] = []
    for line in text.replace("\t", " ").splitlines():
        keyword, _, words = line.strip().partition(" ")
        if keyword == "newmtl":
            entries.append({"newmtl": words.strip()})
        elif entries and words:
            entries[-1][keyword.lower()] = words.strip()
    return [_material(path, entry) for entry in entries]


def _material(path: Location, entry: dict[str, str]) -> Material:
    """Build a material of its MTL lines; what makes no sense keeps its default."""
    image_name = _texture_name(entry.get("map_kd", ""))
    image = _read_texture(path, image_name) if image_name else b""
    default = [0.8, 0.8, 0.8] if not image else [1.0, 1.0, 1.0]
    colour = _fractions(entry.get("kd", "")) or default
    if image and not any(colour):
        colour = [1.0, 1.0, 1.0]  # exporters write black under a texture and mean the texture
    opacity = (_fractions(entry.get("d", "").removeprefix("-halo")) or [1.0])[0]
    transparency = (_fractions(entry.get("tr", "")) or [1.0 - opacity])[0]
    red, green, blue = linear_from_srgb(np.array((colour * 3)[:3])).tolist()
    return Material(entry["newmtl"], (red, green, blue, 1.0 - transparency), image, image_name)


def _fractions(words: str) -> list[float]:
    """Read numbers, kept within 0 and 1; an empty list if one of them is none."""
    try:
        return [min(max(float(word), 0.0), 1.0) for word in words.split()]
    except ValueError:
        return []


def _texture_name(words: str) -> str:
    """Give the file name after the options of a map line; the name may hold spaces."""
    left = words.split(" ")
    while left and left[0].startswith("-"):
        option = left.pop(0)
        for _ in range(_OPTION_LENGTHS.get(option, 1)):
            if left and (_OPTION_LENGTHS.get(option, 1) == 1 or _fractions(left[0])):
                left.pop(0)
    return " ".join(left).strip()


def _read_texture(path: Location, name: str) -> bytes:
    """Read a picture as PNG or JPEG bytes; nothing, announced, if that cannot be done."""
    try:
        content = read_beside(path, name.replace("\\", "/"), limit=LARGEST_TEXTURE)
        pixels = count_pixels(content)
        if not 0 < pixels <= limits.PIXELS:
            trouble = f"more than {limits.PIXELS} pixels" if pixels else "is no picture"
            code = Code.LIMIT_PIXELS if pixels else Code.MATERIAL_MISSING
            raise FormatError(path, "map_Kd", f"{name[:60]!r} {trouble}", code=code)
        return as_png_or_jpeg(content)
    except FormatError as error:
        _announce_loss(path, f"map_Kd {error.message}; the texture is left out", error.code)
    except (OSError, ValueError, SyntaxError, EOFError) as error:
        message = f"map_Kd {name[:60]!r}: {error}; the texture is left out"
        _announce_loss(path, message, Code.MATERIAL_MISSING)
    return b""


def _announce_loss(path: Location, message: str, code: Code) -> None:
    """Say what is left out: only noted if it is just not there, as in most files passed on."""
    announce(path, message, code=code, level=NOTE if code is Code.URI_MISSING else WARNING)
