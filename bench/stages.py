"""How the cost of each stage of `bunraku animate` grows with the figure.

    python bench/stages.py [VERTICES ...]

The figure is the built-in human, resampled to each size; the source is the built-in human with one
clip. Prints seconds of each stage and the peak memory of the process so far.
"""

import resource
import sys
import time

import fast_simplification
import igl
import numpy as np
from rich.console import Console

from bunraku import builtin
from bunraku.evaluate.results import make_table
from bunraku.routes.from_rig import animate_from_rig
from bunraku.types import Mesh

SIZES = (2_000, 7_000, 30_000, 100_000)


def resample(mesh: Mesh, count: int) -> Mesh:
    """Subdivide a mesh until it has enough vertices, then simplify it to about `count`."""
    vertices, faces = mesh.vertices, mesh.faces
    while len(vertices) < count:
        vertices, faces = igl.loop(vertices, faces)
    fewer = max(0.0, 1 - count / len(vertices))
    simple, few = fast_simplification.simplify(vertices.astype(np.float32), faces, fewer)
    return Mesh(simple.astype(np.float64), few.astype(np.int64))


def main() -> None:
    """Measure every size and print a table."""
    human = builtin.human()
    lines, stages = [], []
    for count in map(int, sys.argv[1:] or SIZES):
        figure = resample(human.mesh, count)
        began = time.perf_counter()
        transfer = animate_from_rig(human, figure, clips=human.clips[:1])
        total = time.perf_counter() - began
        stages = list(transfer.seconds)
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        lines.append([str(len(figure.vertices)), *transfer.seconds.values(), total, memory])
    columns = ["vertices", *stages, "total s", "peak MiB"]
    Console(width=140).print(make_table("Seconds of each stage", columns, lines))


if __name__ == "__main__":
    main()
