"""Text: its encoding, its words line by line, and the numbers in it, all read at once."""

import warnings

import numpy as np
from jaxtyping import Int, Shaped

UTF8_MARK, UTF16_MARKS = b"\xef\xbb\xbf", (b"\xff\xfe", b"\xfe\xff")
SPACE, NEWLINE = 32, 10


def decode_text(content: bytes) -> str:
    """Decode UTF-16 with its mark, UTF-8, or else Latin-1, in which any bytes mean something."""
    if content[:2] in UTF16_MARKS:
        return content.decode("utf-16", "replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def find_words(text: bytes) -> tuple[Int[np.ndarray, " words"], Int[np.ndarray, " lines"]]:
    """Find the first byte of each word, and how many words each line has that ends."""
    letters = np.frombuffer(text, np.uint8)
    is_word = letters > SPACE
    begins = is_word.copy()
    np.greater(is_word[1:], is_word[:-1], out=begins[1:])
    starts = np.flatnonzero(begins)
    borders = np.searchsorted(starts, np.flatnonzero(letters == NEWLINE))
    return starts, np.diff(np.concatenate([[0], borders]))


def parse_numbers(text: bytes, count: int, kind: type) -> Shaped[np.ndarray, " numbers"] | None:
    """Read `count` numbers between spaces; nothing if there is anything else."""
    if not count:
        return np.zeros(0, kind)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # how NumPy says that it stopped
            found: np.ndarray = np.fromstring(text, kind, sep=" ")
    except (DeprecationWarning, ValueError):
        return None
    return found if len(found) == count else None
