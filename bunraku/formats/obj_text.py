"""The text of an OBJ as one array of bytes: its lines, their keywords, and the numbers in them.

Whole columns of text are read at once; single words are only looked at where a file is damaged or
written unevenly.
"""

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Int, Int8, Shaped, UInt8

from bunraku.errors import Code
from bunraku.formats.files import Location
from bunraku.formats.text import (
    NEWLINE,
    SPACE,
    UTF16_MARKS,
    decode_text,
    find_words,
    parse_numbers,
)
from bunraku.types import FormatError

POSITION, UV, NORMAL, FACE, GROUP, USE, LIBRARY = range(1, 8)
LONGEST_SHOWN = 50
_SLASH = 47
_BLANKS = bytes(SPACE if byte < SPACE else byte for byte in range(256))  # split() knows six


@dataclass(frozen=True, eq=False)
class Lines:
    """The lines of a file, and what each one is."""

    path: Location
    text: UInt8[np.ndarray, " bytes"]
    starts: Int[np.ndarray, " lines"]  # the line's first byte
    bodies: Int[np.ndarray, " lines"]  # the first byte after its keyword
    ends: Int[np.ndarray, " lines"]  # its line end
    kinds: Int8[np.ndarray, " lines"]

    def of(self, kind: int) -> Int[np.ndarray, " found"]:
        """Number the lines of a kind."""
        return np.flatnonzero(self.kinds == kind)

    def show(self, line: int) -> str:
        """Give a line as text."""
        return decode_text(self.text[self.starts[line] : self.ends[line]].tobytes()).strip()

    def trouble(self, line: int, message: str, *, code: Code) -> FormatError:
        """Make the error that names a line and shows it."""
        shown = self.show(line)
        if len(shown) > LONGEST_SHOWN:
            shown = shown[: LONGEST_SHOWN - 3] + "..."
        return FormatError(self.path, f"line {line + 1}", f"{message}, got {shown!r}", code=code)


@dataclass(frozen=True, eq=False)
class Words:
    """What stands behind the keyword in all lines of one kind."""

    lines: Int[np.ndarray, " found"]
    text: bytes  # comments cut, a line end after each line
    starts: Int[np.ndarray, " words"]  # the first byte of each word in `text`
    counts: Int[np.ndarray, " found"]  # words in each line

    @property
    def line_of(self) -> Int[np.ndarray, " words"]:
        """Give the line of each word."""
        return np.repeat(self.lines, self.counts)

    def split(self) -> list[bytes]:
        """Give every word by itself."""
        return self.text.translate(_BLANKS).split()

    def numbers(self, kind: type) -> Shaped[np.ndarray, " numbers"] | None:
        """Read every word as one number; nothing if that cannot be."""
        return parse_numbers(self.text, len(self.starts), kind)


def split_lines(path: Location, content: bytes) -> Lines:
    """Find the lines and their keywords; those that are continued become one, and blank ones."""
    if content[:2] in UTF16_MARKS:
        content = decode_text(content).encode()
    content = content.removeprefix(b"\xef\xbb\xbf")
    content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if b"\\\n" in content:  # the joined line comes first, blank ones keep the numbering
        content = re.sub(rb"(?:[^\n]*\\\n)+[^\n]*", _join, content)
    text = np.frombuffer(content or b"\n", np.uint8)
    ends = np.concatenate([np.flatnonzero(text == NEWLINE), [len(text)]])
    starts = np.concatenate([[0], ends[:-1] + 1])
    for line in np.flatnonzero((_letters(text, starts) <= SPACE) & (starts < ends)):
        indented = content[starts[line] : ends[line]]
        starts[line] += len(indented) - len(indented.lstrip())
    kinds, lengths = _find_keywords(content, text, starts, ends)
    return Lines(path, text, starts, starts + lengths, ends, kinds)


def _letters(
    text: UInt8[np.ndarray, " bytes"], places: Int[np.ndarray, " lines"]
) -> UInt8[np.ndarray, " lines"]:
    """Look letters up; behind the end, give the last one, which ends no keyword."""
    return text[np.minimum(places, len(text) - 1)]


def _join(run: re.Match[bytes]) -> bytes:
    """Put a continued line into one."""
    return run[0].replace(b"\\\n", b" ") + b"\n" * run[0].count(b"\n")


def _find_keywords(
    content: bytes,
    text: UInt8[np.ndarray, " bytes"],
    starts: Int[np.ndarray, " lines"],
    ends: Int[np.ndarray, " lines"],
) -> tuple[Int8[np.ndarray, " lines"], Int8[np.ndarray, " lines"]]:
    """Give the kind of each line, 0 for none that is read, and the length of its keyword."""
    kinds, lengths = np.zeros(len(starts), np.int8), np.zeros(len(starts), np.int8)
    first, second, third = (_letters(text, starts + i) for i in range(3))
    for letter, kind in (("v", POSITION), ("f", FACE), ("o", GROUP), ("g", GROUP)):
        here = (first == ord(letter)) & (second <= SPACE)
        kinds[here], lengths[here] = kind, 1
    for letter, kind in (("t", UV), ("n", NORMAL)):
        here = (first == ord("v")) & (second == ord(letter)) & (third <= SPACE)
        kinds[here], lengths[here] = kind, 2
    for word, kind in ((b"usemtl", USE), (b"mtllib", LIBRARY)):
        for line in np.flatnonzero((first == word[0]) & (second == word[1])):
            if content[starts[line] : ends[line]].split(None, 1)[0] == word:
                kinds[line], lengths[line] = kind, len(word)
    return kinds, lengths


def gather_words(lines: Lines, kind: int) -> Words:
    """Take the text behind the keyword of all lines of a kind."""
    found = lines.of(kind)
    first, last = (lines.bodies[found[0]], lines.ends[found[-1]] + 1) if len(found) else (0, 0)
    block = lines.text[first:last]  # most writers put lines of a kind together
    border = np.zeros(len(block) + 2, np.int8)
    border[lines.bodies[found] - first] += 1
    border[lines.ends[found] + 1 - first] -= 1
    inside = np.cumsum(border, dtype=np.int8, out=border)[: len(block)].view(bool)
    text = block[inside].tobytes()
    if text and not text.endswith(b"\n"):
        text += b"\n"
    if b"#" in text:
        text = re.sub(rb"#[^\n]*", b"", text)
    return Words(found, text, *find_words(text))


def count_slashes(words: Words) -> Int[np.ndarray, " words"]:
    """Count the slashes in each word."""
    slashes = np.flatnonzero(np.frombuffer(words.text, np.uint8) == _SLASH)
    borders = np.searchsorted(slashes, words.starts)
    return np.diff(np.concatenate([borders, [len(slashes)]]))


def read_damaged(words: Words) -> tuple[Shaped[np.ndarray, " words"], Any]:
    """Read words one by one; those that are no number become NaN, and are marked."""
    values = np.full(len(words.starts), np.nan)
    damaged = np.zeros(len(values), bool)
    for place, word in enumerate(words.split()):
        try:
            values[place] = float(word)
        except ValueError:
            damaged[place] = True
    return values, damaged
