"""Memory for one short command that makes large arrays, one after the other."""

import ctypes
import sys

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
    library = ctypes.CDLL(None)
    if hasattr(library, "gnu_get_libc_version"):
        library.mallopt(MMAP_MAX, 0)
        library.mallopt(TRIM_THRESHOLD, MOST)
