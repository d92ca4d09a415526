"""Folders of depth frames as one string of bytes, and ways to damage them that respect PNG."""

import io
import json
import re
import shutil
import struct
import zlib
from pathlib import Path

import msgspec
import numpy as np
from PIL import Image

from tests.depth_folders import OURS, ball
from tests.fuzz.mutants import NUMBERS, Generator, mutate, mutate_json

SIGNATURE = b"\x89PNG\r\n\x1a\n"
LENS = OURS | {"width": 32, "height": 24, "fx": 30.0, "fy": 30.0, "cx": 15.5, "cy": 11.5}
NAMES = (
    *("0000.png", "0003.png", "7.PNG", "0001.jpg", "._0000.png", "x.png", "-1.png", "depth_1.png"),
    *("9" * 40 + ".png", "intrinsics.json", "camera.json", "mask/0000.png", "mask/9.png"),
)
HEADERS = (0, 1, 2, 3, 4, 6, 8, 16, 24, 32, 255, 8193, 2**31 - 1, 2**31, 2**32 - 1)
SAFE = re.compile(r"(mask/)?[\w.-]{0,100}\w[\w.-]{0,100}", re.ASCII)
Files = dict[str, bytes]


def pack(files: Files) -> bytes:
    """Give a folder as bytes."""
    return msgspec.msgpack.encode(files)


def unpack_into(folder: Path, content: bytes) -> None:
    """Make a folder anew from bytes; what is none, or has another name than ours, is left out."""
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "mask").mkdir(parents=True)
    try:
        files = msgspec.msgpack.decode(content, type=Files)
    except (msgspec.DecodeError, UnicodeDecodeError):
        return
    for name, inside in files.items():
        if SAFE.fullmatch(name) and not (folder / name).is_dir():
            (folder / name).write_bytes(inside)


def make_folders() -> list[bytes]:
    """Give a sound folder with masks and one without."""
    depths = ball(3)[:, 12:36, 12:44]
    frames = {f"{number:04d}.png": encode_png(depth) for number, depth in enumerate(depths)}
    frames["intrinsics.json"] = json.dumps(LENS).encode()
    masks = {
        f"mask/{number:04d}.png": encode_png((depth > 0).astype(np.uint16))
        for number, depth in enumerate(depths)
    }
    return [pack(frames), pack(frames | masks)]


def encode_png(depth: np.ndarray) -> bytes:
    """Write a picture of 16 bits."""
    stream = io.BytesIO()
    Image.fromarray(depth).save(stream, "PNG", compress_level=1)
    return stream.getvalue()


def mutate_folder(content: bytes, rng: Generator) -> bytes:
    """Damage a folder once to four times."""
    try:
        files = msgspec.msgpack.decode(content, type=Files)
    except (msgspec.DecodeError, UnicodeDecodeError):  # damaged without knowing what it is
        return mutate(content, rng)
    for _ in range(int(rng.integers(1, 5))):
        if not files:
            break
        name = list(files)[int(rng.integers(len(files)))]
        if rng.random() < 0.4:
            _move_file(files, name, rng)
        elif rng.random() < 0.3 and "intrinsics.json" in files:
            files["intrinsics.json"] = _mutate_lens(files["intrinsics.json"], rng)
        else:
            damage = mutate if rng.random() < 0.2 else _mutate_file
            files[name] = damage(files[name], rng)
    return pack(files)


def _move_file(files: Files, name: str, rng: Generator) -> None:
    """Delete, copy or rename a file of a folder, or put it in another one's place."""
    other = NAMES[int(rng.integers(len(NAMES)))]
    match int(rng.integers(4)):
        case 0:
            del files[name]
        case 1:
            files[other] = files[name]
        case 2:
            files[name] = files[list(files)[int(rng.integers(len(files)))]]
        case _:
            files[other] = files.pop(name)


def _mutate_file(content: bytes, rng: Generator) -> bytes:
    """Change a value of a lens, a field or the pixels of a picture."""
    if not content.startswith(SIGNATURE) or len(content) < 33:
        return _mutate_lens(content, rng)
    if rng.random() < 0.5:
        return _mutate_header(content, rng)
    return _mutate_pixels(content, rng)


def _mutate_lens(content: bytes, rng: Generator) -> bytes:
    """Change a value of a lens."""
    try:
        document = json.loads(content)
    except ValueError:
        return mutate(content, rng)
    if isinstance(document, dict | list) and document:
        mutate_json(document, rng)
    return json.dumps(document).encode()


def _mutate_header(content: bytes, rng: Generator) -> bytes:
    """Change a field of a PNG's header, mostly under a right checksum."""
    fields = list(struct.unpack(">IIBBBBB", content[16:29]))
    field, number = int(rng.integers(7)), HEADERS[int(rng.integers(len(HEADERS)))]
    fields[field] = number if field < 2 else number % 256
    header = b"IHDR" + struct.pack(">IIBBBBB", *fields)
    checksum = zlib.crc32(header) if rng.random() < 0.9 else 0
    return content[:12] + header + struct.pack(">I", checksum) + content[33:]


def _mutate_pixels(content: bytes, rng: Generator) -> bytes:
    """Change pixels, the size or the kind of a picture, if it still is one."""
    try:
        depth = np.asarray(Image.open(io.BytesIO(content))).astype(np.uint16)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return mutate(content, rng)
    number = NUMBERS[int(rng.integers(len(NUMBERS)))]
    value = int(number) % 65536 if abs(number) < 2**63 else 65535
    depth = np.atleast_2d(depth.copy())
    match int(rng.integers(6)):
        case 0:
            depth[:] = value
        case 1:
            depth[rng.random(depth.shape) < rng.random()] = value
        case 2:
            depth = rng.integers(0, 65536, depth.shape).astype(np.uint16)
        case 3:
            depth = depth[: int(rng.integers(1, len(depth) + 1))]
        case 4:
            depth = np.roll(depth, int(rng.integers(32)), axis=1)
        case _:
            depth = (depth >> 8).astype(np.uint8)
    return encode_png(depth)
