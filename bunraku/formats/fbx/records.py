"""The records of a binary FBX file: names, values and what is nested in them.

Each record says where it ends; all of that is checked in plain integers before anything is sliced,
and arrays stay packed until somebody needs them. Nothing here knows what a record means.
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bunraku import limits
from bunraku.errors import Code
from bunraku.formats.files import Location
from bunraku.types import FormatError

MAGIC = b"Kaydara FBX Binary  \0\x1a\0"
OLDEST, WIDE = 7000, 7500  # versions: with numbered objects; with offsets of 64 bits
MOST_RECORDS, MOST_VALUES, DEEPEST = 1_000_000, 1000, 32  # in a file, in a record, in each other
LARGEST_ARRAY = 1 << 29  # bytes
NUMBERS = {"Y": "<h", "C": "<?", "I": "<i", "F": "<f", "D": "<d", "L": "<q"}
ARRAYS = {"f": "<f4", "d": "<f8", "l": "<i8", "i": "<i4", "b": "<i1", "c": "<i1"}


@dataclass(frozen=True, eq=False)
class Packed:
    """An array as it lies in the file."""

    kind: str
    count: int
    is_packed: bool
    content: memoryview


@dataclass(frozen=True, eq=False)
class Record:
    """A name, values (numbers, texts, bytes, arrays) and the records inside."""

    name: str
    values: tuple[Any, ...]
    inside: list["Record"] = field(default_factory=list)

    def all(self, name: str) -> Iterator["Record"]:
        """Give the records of a name inside, in order."""
        return (record for record in self.inside if record.name == name)

    def first(self, name: str) -> "Record | None":
        """Give the first record of a name inside."""
        return next(self.all(name), None)

    def text(self, name: str, default: str = "") -> str:
        """Give the first value of a record inside, if it is a text."""
        found = self.first(name)
        value = found.values[0] if found is not None and found.values else default
        return value if isinstance(value, str) else default


def read_records(path: Location, content: bytes) -> Record:
    """Read all records of a binary FBX file below a nameless one.

    Raises:
        FormatError: if records do not fit together, or it is of a version before 7.0.
    """
    if len(content) < len(MAGIC) + 4:
        raise damaged(path, "", "ends within its header")
    version = struct.unpack_from("<I", content, len(MAGIC))[0]
    if version < OLDEST:
        message = f"is FBX of version {version / 1000:g}; save it as FBX 2014 or newer, or as .glb"
        raise FormatError(path, "", message, code=Code.FBX_VERSION)
    return _Reader(path, content, is_wide=version >= WIDE).read()


def damaged(path: Location, where: str, message: str) -> FormatError:
    """Make the error about records that do not fit together."""
    return FormatError(path, where, f"{message}; export it again", code=Code.FBX_RECORDS)


class _Reader:
    """Walks along the bytes once."""

    def __init__(self, path: Location, content: bytes, *, is_wide: bool) -> None:
        self.path, self.content = path, memoryview(content)
        self.claimed = 0  # bytes of all arrays when they are unpacked
        self.head = struct.Struct("<QQQB" if is_wide else "<IIIB")

    def read(self) -> Record:
        """Read records into the one that is open, until the empty one that ends the file."""
        root = Record("", ())
        place, count = len(MAGIC) + 4, 0
        opened = [(root, len(self.content))]
        while opened:
            outer, limit = opened[-1]
            if place == limit:
                opened.pop()
                continue
            end, values, length, name = self._read_head(place, limit)
            place += self.head.size + len(name)
            if not end:
                if len(opened) == 1:
                    break
                place = limit
                continue
            count += 1
            if count > MOST_RECORDS or values > MOST_VALUES or len(opened) > DEEPEST:
                message = "too many records or values, or records too deep in each other"
                raise damaged(self.path, self._where(place), message)
            if not place + length <= end <= limit:
                raise damaged(self.path, self._where(place), f"record {name!r} ends elsewhere")
            record = Record(name, self._read_values(place, place + length, values))
            outer.inside.append(record)
            place += length
            if place < end:
                opened.append((record, end))
        return root

    def _where(self, place: int) -> str:
        return f"byte {place}"

    def _read_head(self, place: int, limit: int) -> tuple[int, int, int, str]:
        """Read where a record ends, how many values it has, in how many bytes, and its name."""
        if place + self.head.size > limit:
            raise damaged(self.path, self._where(place), "the file breaks off")
        end, values, length, letters = self.head.unpack_from(self.content, place)
        start = place + self.head.size
        if start + letters > limit:
            raise damaged(self.path, self._where(place), "the file breaks off")
        return end, values, length, bytes(self.content[start : start + letters]).decode("latin-1")

    def _read_values(self, place: int, end: int, count: int) -> tuple[Any, ...]:
        """Read the values of a record, which must fill its bytes."""
        values = []
        while place < end:
            kind = chr(self.content[place])
            value, place = self._read_value(kind, place + 1, end)
            values.append(value)
        if len(values) != count or place != end:
            raise damaged(self.path, self._where(place), f"{count} values do not fit their bytes")
        return tuple(values)

    def _read_value(self, kind: str, place: int, end: int) -> tuple[Any, int]:
        """Read one value; give also where the next one starts."""
        if kind in NUMBERS:
            stop = place + struct.calcsize(NUMBERS[kind])
            if stop > end:
                raise damaged(self.path, self._where(place), "a number breaks off")
            return struct.unpack_from(NUMBERS[kind], self.content, place)[0], stop
        head = struct.Struct("<III" if kind in ARRAYS else "<I")
        if kind not in (*ARRAYS, "S", "R") or place + head.size > end:
            raise damaged(self.path, self._where(place), f"a value of the unknown kind {kind!r}")
        *shape, size = head.unpack_from(self.content, place)
        start = place + head.size
        if kind in ARRAYS:
            plain_size = shape[0] * np.dtype(ARRAYS[kind]).itemsize
            size = size if shape[1] else plain_size
            self.claimed += plain_size
            if self.claimed > limits.BYTES:
                message = f"all arrays together unpack to more than {limits.BYTES} bytes"
                raise FormatError(self.path, "", f"{message}; simplify it", code=Code.LIMIT_TOTAL)
        if start + size > end:
            raise damaged(self.path, self._where(place), "an array or text breaks off")
        content = self.content[start : start + size]
        if kind in ARRAYS:
            return Packed(kind, shape[0], bool(shape[1]), content), start + size
        plain = bytes(content)
        return (plain if kind == "R" else plain.decode("utf-8", "replace")), start + size


def unpack(path: Location, where: str, value: object) -> np.ndarray:
    """Give an array of a record: numbers of its own kind.

    Raises:
        FormatError: if it is no array, damaged, or larger than any mesh or clip that is read.
    """
    if not isinstance(value, Packed):
        raise damaged(path, where, "wanted an array")
    kind = np.dtype(ARRAYS[value.kind])
    size = value.count * kind.itemsize
    if size > LARGEST_ARRAY:
        message = f"an array of {value.count} numbers; decimate the mesh, or cut the motion"
        raise FormatError(path, where, message, code=Code.LIMIT_VERTICES)
    if not value.is_packed:
        return np.frombuffer(value.content, kind, value.count)
    try:
        content = zlib.decompressobj().decompress(value.content, size + 1)
    except zlib.error:
        content = b""
    if len(content) != size:
        raise damaged(path, where, f"an array unpacks to other than {value.count} numbers")
    return np.frombuffer(content, kind)
