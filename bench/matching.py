"""Time of the Laplacian, the eigenbasis and a whole match against the number of vertices.

    python bench/matching.py [most vertices, default 100000]

The surface is the built-in human, decimated or subdivided. It is matched with itself at 4,000
vertices, turned by a quarter and scaled, up to 16,000 vertices: larger figures have a proxy.
`error` is the mean distance on the source between found and true place, as a share of its height.
"""

import sys
import time

import fast_simplification
import numpy as np
import trimesh

from bunraku.builtin import human
from bunraku.matching import match_surfaces
from bunraku.meshes import weld
from bunraku.spectral import eigenbasis, laplacian
from bunraku.types import Mesh

SIZES = (1_000, 2_000, 4_000, 8_000, 16_000, 50_000, 100_000)
MODES = 100
LARGEST_MATCH = 16_000
QUARTER = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])


def resized(mesh: Mesh, count: int) -> Mesh:
    """Subdivide until there are enough vertices, then decimate."""
    vertices, faces = mesh.vertices, mesh.faces
    while len(vertices) < count:
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    share = 1.0 - 2 * count / len(faces)
    vertices, faces = fast_simplification.simplify(
        np.asarray(vertices, np.float32), np.asarray(faces, np.int32), max(0.0, share)
    )
    return Mesh(vertices.astype(np.float64), faces.astype(np.int64))


def seconds(work, *arguments, **options) -> tuple[float, object]:
    """Run once; give the seconds of CPU it took, and its result."""
    begin = time.process_time()
    result = work(*arguments, **options)
    return time.process_time() - begin, result


def measure(body: Mesh, source: Mesh, count: int) -> str:
    """Time every stage at one size; give a line of the table."""
    mesh = resized(body, count)
    built, _ = seconds(laplacian, mesh.vertices, mesh.faces)
    solved, _ = seconds(eigenbasis, mesh.vertices, mesh.faces, count=MODES)
    line = f"{len(mesh.vertices):9d} {built:10.2f} {solved:11.2f}"
    if count > LARGEST_MATCH:
        return line
    turned = Mesh(1.5 * mesh.vertices @ QUARTER.T, mesh.faces)
    matched, found = seconds(match_surfaces, source, turned, modes=MODES)
    error = np.linalg.norm(source.vertices[found.point_map] - mesh.vertices, axis=1).mean()
    share = error / np.ptp(source.vertices[:, 1])
    return f"{line} {matched:8.2f} {share:8.3f} {found.score:8.3f}  {found.origin}"


if __name__ == "__main__":
    most = int(sys.argv[1]) if len(sys.argv) > 1 else SIZES[-1]
    found_body = human().mesh
    vertices, faces, _ = weld(found_body.vertices, found_body.faces)
    body = Mesh(vertices, faces)
    source = resized(body, 4_000)
    print(" vertices laplacian_s eigenbasis_s match_s    error    score  start")
    for size in SIZES:
        if size <= most:
            print(measure(body, source, size), flush=True)
