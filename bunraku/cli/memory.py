"""Memory for one short command that makes large arrays, one after the other."""

import ctypes
import sys
from contextlib import suppress

TRIM_THRESHOLD, MMAP_MAX = -1, -4  # parameters of mallopt in glibc's malloc.h
MOST = 2**31 - 1


def keep_freed_memory() -> None:
    """Let the next array take the memory of the last one, instead of asking the system anew.

    Fresh pages are emptied by the system each time: a third of the time of `inspect` on a file of
    a million vertices (`bench/reading.py`). Only for processes that end soon: nothing is given
    back before. Does nothing where the C library is not glibc.
    """
    if not sys.platform.startswith("linux"):
        return
    with suppress(OSError, AttributeError):  # no C library of its own, or one without mallopt
        library = ctypes.CDLL(None)
        if hasattr(library, "gnu_get_libc_version"):
            library.mallopt(MMAP_MAX, 0)
            library.mallopt(TRIM_THRESHOLD, MOST)
