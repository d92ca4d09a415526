"""How long `bunraku inspect` takes, and how much memory, for every format at one size.

    python bench/reading.py [VERTICES] [FORMAT ...]

The figure is a closed sphere of a million vertices, two million faces, a little rough so that no
two numbers are alike. `obj+` has UVs and normals on every corner; `ply` is binary, `ply-ascii`
text. Each file is inspected by a process of its own.
"""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import Console

from bunraku.evaluate.results import make_table
from bunraku.formats import write_mesh
from bunraku.types import Mesh

FORMATS = ("obj", "obj+", "ply", "ply-ascii", "stl", "stl-ascii", "off", "glb")
RUN = """
import sys
from bunraku.cli import run
from bunraku.cli.memory import keep_freed_memory
keep_freed_memory()
code = run(sys.argv[1:])
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
print(peak.split()[1], file=sys.stderr)
sys.exit(code)
"""


def rough_sphere(count: int) -> Mesh:
    """Make a closed sphere of about so many vertices."""
    rows = max(int(np.sqrt(count / 2)), 3)
    columns = 2 * rows
    heights, turns = np.meshgrid(
        np.linspace(0, np.pi, rows + 2)[1:-1],
        np.arange(columns) * 2 * np.pi / columns,
        indexing="ij",
    )
    ring = np.stack(
        [np.sin(heights) * np.cos(turns), np.cos(heights), np.sin(heights) * np.sin(turns)], axis=-1
    )
    rough = 1 + 1e-3 * np.random.default_rng(0).standard_normal((rows, columns, 1))
    points = np.concatenate([(ring * rough).reshape(-1, 3), [[0, 1, 0], [0, -1, 0]]])
    number = np.arange(rows * columns).reshape(rows, columns)
    beside = np.roll(number, -1, axis=1)
    top, bottom = np.full(columns, rows * columns), np.full(columns, rows * columns + 1)
    triangles = [
        (number[:-1], beside[:-1], number[1:]),
        (beside[:-1], beside[1:], number[1:]),
        (top, beside[0], number[0]),
        (bottom, number[-1], beside[-1]),
    ]
    faces = [np.stack(corners, axis=-1).reshape(-1, 3) for corners in triangles]
    return Mesh(points * [0.5, 1.0, 0.4], np.concatenate(faces))


def write(folder: Path, mesh: Mesh, kind: str) -> Path:
    """Write a mesh in one of the formats."""
    name = kind.replace("+", "").split("-")[0]
    path = folder / f"figure.{name}"
    points = [f"{x:.7g} {y:.7g} {z:.7g}" for x, y, z in mesh.vertices.tolist()]
    faces = mesh.faces.tolist()
    match kind:
        case "obj+":
            lines = [
                f"v {point}\nvt {i % 997} {i % 991}\nvn {point}" for i, point in enumerate(points)
            ]
            lines += [
                f"f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}" for a, b, c in (mesh.faces + 1).tolist()
            ]
        case "off":
            lines = ["OFF", f"{len(points)} {len(faces)} 0", *points]
            lines += [f"3 {a} {b} {c}" for a, b, c in faces]
        case "ply-ascii":
            lines = ["ply", "format ascii 1.0", f"element vertex {len(points)}"]
            lines += [f"property float {axis}" for axis in "xyz"]
            lines += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
            lines += ["end_header", *points, *(f"3 {a} {b} {c}" for a, b, c in faces)]
        case "stl-ascii":
            lines = ["solid figure"]
            for a, b, c in faces:
                lines.append("facet normal 0 0 0\nouter loop")
                lines += [f"vertex {points[corner]}" for corner in (a, b, c)]
                lines.append("endloop\nendfacet")
            lines.append("endsolid figure")
        case "stl":
            kinds = [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
            records = np.zeros(len(faces), kinds)
            records["corners"] = mesh.vertices[mesh.faces]
            path.write_bytes(bytes(80) + np.uint32(len(faces)).tobytes() + records.tobytes())
            return path
        case _:
            write_mesh(path, mesh)
            return path
    path.write_text("\n".join([*lines, ""]))
    return path


def main() -> None:
    """Measure every format and print a table."""
    words = sys.argv[1:]
    count = int(words.pop(0)) if words and words[0].isdigit() else 1_000_000
    mesh, rows = rough_sphere(count), []
    for kind in words or FORMATS:
        with tempfile.TemporaryDirectory() as folder:
            path = write(Path(folder), mesh, kind)
            before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
            command = [sys.executable, "-c", RUN, "inspect", str(path)]
            child = subprocess.run(command, check=True, capture_output=True, text=True)
            waited, size = time.perf_counter() - began, path.stat().st_size / 2**20
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
        used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        rows.append([kind, size, waited, used, int(child.stderr.splitlines()[-1]) / 1024])
    columns = ["format", "MiB", "seconds", "CPU seconds", "peak MiB"]
    title = f"bunraku inspect, {len(mesh.vertices)} vertices, {len(mesh.faces)} faces"
    Console(width=100).print(make_table(title, columns, rows))


if __name__ == "__main__":
    main()
