"""The BVH grammar read word by word, so that files that strict readers refuse are read too.

Position channels on any joint, joints without channels or end sites, several roots, names with
spaces, lines joined or split, keywords in any case, a frame count that is off.
"""

import re
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bunraku.errors import Code, announce
from bunraku.formats.files import Location
from bunraku.formats.text import decode_text
from bunraku.types import NO_PARENT, FormatError

MOST_CHANNELS = 9


@dataclass
class Recording:
    """What a BVH file says, in its own units and axes; parents come before children."""

    names: list[str]
    parents: list[int]
    offsets: Float[np.ndarray, "joints 3"]
    channels: list[list[str]]  # PX PY PZ RX RY RZ, in the order of the columns
    values: Float[np.ndarray, "frames columns"]  # degrees and units of length
    frame_time: float


def parse_recording(path: Location, content: bytes) -> Recording:
    """Read a BVH word by word.

    Raises:
        FormatError: naming the joint or frame at which the file stops making sense.
    """
    hierarchy, keyword, motion = _split_sections(decode_text(content))
    names, parents, offsets, channels = _Hierarchy(path, hierarchy).read()
    if not keyword:
        raise FormatError(
            path, "", "has no MOTION section; export it with its animation", code=Code.BVH_MOTION
        )
    columns = sum(map(len, channels))
    if not columns:
        raise FormatError(
            path, "HIERARCHY", "has no CHANNELS, so nothing can move", code=Code.BVH_CHANNELS
        )
    values, frame_time = _read_motion(path, motion, columns)
    return Recording(names, parents, np.array(offsets), channels, values, frame_time)


def _split_sections(text: str) -> tuple[str, str, str]:
    """Split at the MOTION keyword."""
    match = re.search(r"(?:^|(?<=[\s}]))MOTION(?=\s)", text, re.IGNORECASE)
    return (text[: match.start()], "MOTION", text[match.end() :]) if match else (text, "", "")


class _Hierarchy:
    """A walk over the words of the HIERARCHY section."""

    def __init__(self, path: Location, text: str) -> None:
        self.path = path
        self.words = text.replace("{", " { ").replace("}", " } ").split()
        self.place = 0
        self.names: list[str] = []
        self.parents: list[int] = []
        self.offsets: list[list[float]] = []
        self.channels: list[list[str]] = []
        self.open: list[int] = []

    def read(self) -> tuple[list[str], list[int], list[list[float]], list[list[str]]]:
        """Read all joints: names, parents, offsets, channels."""
        if self._next().upper() != "HIERARCHY":
            raise FormatError(
                self.path,
                "",
                "does not begin with HIERARCHY; it is no BVH file",
                code=Code.BVH_HIERARCHY,
            )
        while self.place < len(self.words):
            self._read_statement(self._next().upper())
        if self.open:
            raise self._trouble("is not closed with }: the file is cut; export it again")
        if not self.names:
            raise FormatError(
                self.path, "HIERARCHY", "has no ROOT; export it again", code=Code.BVH_HIERARCHY
            )
        for joint, offset in enumerate(self.offsets):
            if not offset:
                raise FormatError(
                    self.path, f"joint {self.names[joint]!r}", "has no OFFSET", code=Code.BVH_OFFSET
                )
        return self.names, self.parents, self.offsets, self.channels

    def _next(self) -> str:
        """Give the next word, and move on."""
        if self.place >= len(self.words):
            raise self._trouble("ends too early: the file is cut; export it again")
        self.place += 1
        return self.words[self.place - 1]

    def _trouble(self, message: str, *, code: Code = Code.BVH_HIERARCHY) -> FormatError:
        """Make the error that names the joint being read."""
        where = f"joint {self.names[-1]!r}" if self.names else "HIERARCHY"
        return FormatError(self.path, where, message, code=code)

    def _read_statement(self, keyword: str) -> None:
        """Read one statement of the grammar."""
        match keyword:
            case "ROOT" | "JOINT" | "END":
                self._open_joint(keyword)
            case "OFFSET":
                self._expect_open(keyword)
                self.offsets[self.open[-1]] = [self._number() for _ in range(3)]
            case "CHANNELS":
                self._expect_open(keyword)
                self.channels[self.open[-1]] = self._read_channels()
            case "}":
                self._expect_open(keyword)
                self.open.pop()
            case _:
                raise self._trouble(f"is followed by {keyword[:40]!r}, which is no BVH keyword")

    def _expect_open(self, keyword: str) -> None:
        if not self.open:
            raise self._trouble(f"has a {keyword} outside all joints; check the braces")

    def _open_joint(self, keyword: str) -> None:
        """Begin a joint or an end site."""
        words = []
        while (word := self._next()) != "{":
            words.append(word)
            if len(words) > 20 or word == "}":
                raise self._trouble("is followed by a name without {; check the braces")
        if (keyword == "ROOT") != (not self.open):
            raise self._trouble(f"is followed by a {keyword} in the wrong place; check the braces")
        parent = self.open[-1] if self.open else NO_PARENT
        is_end = keyword == "END"
        self.open.append(len(self.names))
        self.names.append(f"{self.names[parent]}_end" if is_end else " ".join(words))
        self.parents.append(parent)
        self.offsets.append([])
        self.channels.append([])

    def _number(self) -> float:
        word = self._next()
        try:
            return float(word)
        except ValueError:
            raise self._trouble(
                f"has OFFSET {word[:40]!r}; wanted three numbers", code=Code.BVH_OFFSET
            ) from None

    def _read_channels(self) -> list[str]:
        """Read the count and the names of a joint's channels."""
        word = self._next()
        if not word.isdecimal() or not word.isascii() or int(word[:9]) > MOST_CHANNELS:
            raise self._trouble(
                f"has CHANNELS {word[:40]!r}; wanted a number up to {MOST_CHANNELS}",
                code=Code.BVH_CHANNELS,
            )
        channels = []
        for _ in range(int(word)):
            name = self._next()
            match = re.fullmatch(r"([XYZ])(position|rotation)", name, re.IGNORECASE)
            if not match:
                raise self._trouble(
                    f"has a channel {name[:40]!r}; wanted Xposition ... Zrotation",
                    code=Code.BVH_CHANNELS,
                )
            channels.append(match[2][0].upper() + match[1].upper())
        if len(set(channels)) < len(channels):
            raise self._trouble(
                f"has a channel twice: {' '.join(channels)}", code=Code.BVH_CHANNELS
            )
        return channels


def _read_motion(
    path: Location, text: str, columns: int
) -> tuple[Float[np.ndarray, "frames columns"], float]:
    """Read frame count, frame time and all numbers."""
    match = re.match(r"\s*Frames\s*:\s*(\S+)\s+Frame\s+Time\s*:\s*(\S+)\s*", text, re.IGNORECASE)
    if not match:
        raise FormatError(
            path,
            "MOTION",
            "wanted Frames: and Frame Time: lines; export it again",
            code=Code.BVH_MOTION,
        )
    frames = _whole_number(path, match[1])
    try:
        frame_time = float(match[2])
    except ValueError:
        raise FormatError(
            path,
            "Frame Time",
            f"is {match[2][:40]!r}; wanted seconds such as 0.0333",
            code=Code.BVH_FRAME_TIME,
        ) from None
    words = text[match.end() :].split()
    try:
        values = np.fromiter(map(float, words), np.float64, len(words))
    except ValueError as error:
        frame = _first_wrong(words) // columns
        raise FormatError(
            path, f"frame {frame}", f"holds no number: {str(error)[-60:]}", code=Code.BVH_MOTION
        ) from None
    found, rest = divmod(len(values), columns)
    if rest or not found:
        raise FormatError(
            path,
            f"frame {found}",
            f"has {rest} numbers, wanted {columns}; export it again",
            code=Code.BVH_COUNT,
        )
    if found < frames - 1:
        raise FormatError(
            path,
            "Frames",
            f"claims {frames}, the file has {found}: it is cut; download it again",
            code=Code.BVH_COUNT,
        )
    if found != frames:
        message = f"claims {frames} frames and has {found}; all are used"
        announce(path, message, code=Code.BVH_COUNT, where="MOTION")
    return values.reshape(found, columns), frame_time


def _whole_number(path: Location, word: str) -> int:
    """Read the frame count."""
    if not word.isdecimal() or not word.isascii() or not int(word[:15]):
        raise FormatError(
            path, "Frames", f"is {word[:40]!r}; wanted a whole number above 0", code=Code.BVH_COUNT
        )
    return int(word[:15])


def _first_wrong(words: list[str]) -> int:
    """Find the first word that is no number."""
    for place, word in enumerate(words):
        try:
            float(word)
        except ValueError:
            return place
    return len(words)
