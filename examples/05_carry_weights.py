"""Carry skinning weights through a known map in the three ways of the paper's Table 1.

python examples/05_carry_weights.py
"""

import numpy as np

from bunraku import builtin
from bunraku.evaluate.metrics import weight_error
from bunraku.meshes import closest_points
from bunraku.proxy import build_proxy
from bunraku.spectral import eigenbasis, project
from bunraku.weights import transfer_by_function, transfer_nearest, transfer_to_surface


def main() -> dict[str, float]:
    """Give the weight error of each way, from the human to a coarser mesh of itself."""
    human = builtin.human()
    source, weights = human.mesh, human.skin.weights
    target = build_proxy(source.vertices, source.faces, vertex_count=1500).mesh

    source_basis, target_basis = (
        eigenbasis(mesh.vertices, mesh.faces, count=60) for mesh in (source, target)
    )
    nearest = closest_points(target.vertices, source.vertices, source.faces)
    truth = np.einsum("vc,vcj->vj", nearest[1], weights[source.faces[nearest[0]]])
    seen = np.einsum("vc,vcf->vf", nearest[1], source_basis.functions[source.faces[nearest[0]]])
    matrix = project(target_basis, seen)  # Eq. 2
    carried = target_basis.functions @ (matrix @ project(source_basis, source.vertices))  # Eqs. 7-9

    found = {
        "function": transfer_by_function(weights, source_basis, target_basis, matrix),
        "IE nearest": transfer_nearest(weights, source.vertices, carried),
        "IE barycentric": transfer_to_surface(weights, source.vertices, source.faces, carried),
    }
    errors = {name: float(weight_error(found[name], truth).mean()) for name in found}
    for name, error in errors.items():
        print(f"{name}: {error:.4f}")
    return errors


if __name__ == "__main__":
    main()
