"""How the whole command grows: time, CPU time and peak memory of `bunraku animate`, file to file.

    python bench/command.py [VERTICES ...]

The figure is the built-in human, resampled to each size and written as GLB; the performer is the
built-in human with one clip. Sizes must rise: the memory is the largest of all runs so far.
"""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console
from stages import resample

from bunraku import builtin
from bunraku.evaluate.results import make_table
from bunraku.formats import write_mesh

SIZES = (10_000, 100_000, 1_000_000)
RUN = "from bunraku.cli import main; main()"


def main() -> None:
    """Measure every size and print a table."""
    mesh, lines = builtin.human().mesh, []
    with tempfile.TemporaryDirectory() as folder:
        for count in sorted(map(int, sys.argv[1:] or SIZES)):
            paths = [str(Path(folder) / f"{name}{count}.glb") for name in ("figure", "out")]
            write_mesh(Path(paths[0]), resample(mesh, count))
            before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
            command = ["animate", paths[0], "--clip", "walk", "-o", paths[1]]
            subprocess.run([sys.executable, "-c", RUN, *command], check=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            waited = time.perf_counter() - began
            lines.append([str(count), waited, used, after.ru_maxrss / 1024])
    columns = ["vertices", "seconds", "CPU seconds", "peak MiB"]
    Console(width=100).print(make_table("The whole command", columns, lines))


if __name__ == "__main__":
    main()
