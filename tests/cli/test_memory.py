import ctypes
import platform
import subprocess
import sys

import pytest

from bunraku.cli.memory import keep_freed_memory

FAULTS = """
import resource, sys
import numpy as np
from bunraku.cli.memory import keep_freed_memory
if sys.argv[1] == "keep":
    keep_freed_memory()
for _ in range(30):
    np.ones(2_000_000)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt)
"""


def count_faults(how: str) -> int:
    command = [sys.executable, "-c", FAULTS, how]
    return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the C library is not glibc")
def test_memory_that_is_kept_is_not_asked_for_again():
    fresh, kept = count_faults("fresh"), count_faults("keep")
    assert kept < 1.3 * fresh  # with large pages there is little to win, and some noise
    if fresh > 2 * 60_000:  # small pages
        assert kept < 0.7 * fresh


@pytest.mark.parametrize("trouble", [OSError("no library"), AttributeError("no mallopt")])
def test_a_c_library_that_cannot_be_asked_is_left_alone(monkeypatch, trouble):
    def refuse(_name):
        raise trouble

    monkeypatch.setattr(ctypes, "CDLL", refuse)
    keep_freed_memory()
