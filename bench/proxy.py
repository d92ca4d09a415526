"""Time and peak memory of build_proxy and lift_weights against the size of the figure.

    python bench/proxy.py [most vertices, default 1000000]

Each size runs in its own process, so that the peak is its own. The figures are open: a closed body
in two halves with loose buttons, split ever finer, so that the costly way (voxels) is taken.
"""

import json
import resource
import subprocess
import sys
import time

import igl
import numpy as np

from bunraku.proxy import build_proxy, lift_weights

SIZES = (5_000, 20_000, 100_000, 300_000, 1_000_000)


def figure(vertex_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Make an open figure: a torso, four limbs and a head of separate capsules without ends."""
    rings = int(np.sqrt(vertex_count / 6 / 2))
    around, along = np.meshgrid(np.linspace(0, 2 * np.pi, 2 * rings), np.linspace(0, 1, rings))
    tube = np.stack([np.cos(around), along, np.sin(around)], axis=-1).reshape(-1, 3)
    number = np.arange(len(tube)).reshape(rings, -1)
    corner, right, up, both = (
        number[a : rings - 1 + a, b : 2 * rings - 1 + b].ravel() for a, b in np.ndindex(2, 2)
    )
    faces = np.concatenate(
        [np.column_stack([corner, up, right]), np.column_stack([right, up, both])]
    )
    limbs = [((0.0, 0.8, 0.0), 0.18, 0.6), ((0.0, 1.4, 0.0), 0.12, 0.3)]
    limbs += [((side * 0.1, 0.0, 0.0), 0.08, 0.85) for side in (-1, 1)]
    limbs += [((side * 0.3, 0.7, 0.0), 0.05, 0.65) for side in (-1, 1)]
    vertices = [tube * [radius, height, radius] + place for place, radius, height in limbs]
    return np.concatenate(vertices), np.concatenate([faces + i * len(tube) for i in range(6)])


def measure(vertex_count: int) -> dict[str, float]:
    """Run once; give seconds of CPU and the peak of memory in MiB."""
    vertices, faces = figure(vertex_count)
    begin = time.process_time()
    proxy = build_proxy(vertices, faces)
    built, peak = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    weights = np.random.default_rng(0).dirichlet(np.ones(30), len(proxy.mesh.vertices))
    lift_weights(proxy, weights, vertices, faces)
    return {
        "vertices": len(vertices),
        "proxy": len(proxy.mesh.vertices),
        "genus": int(1 - igl.euler_characteristic(proxy.mesh.faces) / 2),
        "build_s": round(built - begin, 2),
        "lift_s": round(time.process_time() - built, 2),
        "peak_mib": round(peak),
    }


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        print(json.dumps(measure(int(sys.argv[2]))))
    else:
        most = int(sys.argv[1]) if len(sys.argv) > 1 else SIZES[-1]
        for size in (size for size in SIZES if size <= most):
            subprocess.run([sys.executable, __file__, "--one", str(size)], check=True)
