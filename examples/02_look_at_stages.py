"""Look at what every stage of the route found, and how long it took.

python examples/02_look_at_stages.py
"""

import numpy as np

import bunraku
from bunraku import builtin


def main() -> float:
    """Rig the realistic figure; give the mean way to its rest pose, in metres."""
    result = bunraku.rig(builtin.figure_paths()["realistic"])
    stages = result.transfer
    for stage, seconds in result.seconds.items():
        print(f"{stage:<20}{seconds:5.2f} s")
    print(f"proxy: {len(stages.target_proxy.mesh.vertices)} vertices, closed")
    print(f"registration: strain {stages.registration.strain:.2f}, 0 is perfect")

    names = result.character.skeleton.names
    heights = dict(zip(names, stages.reposed.found[:, 1], strict=True))
    print(f"head {heights['head']:.2f} m, hips {heights['hips']:.2f} m above the ground")
    strongest = result.character.skin.weights.argmax(axis=1)
    for joint, count in zip(*np.unique(strongest, return_counts=True), strict=True):
        print(f"{names[joint]:<20}{count:5d} vertices follow it most")

    moved = np.linalg.norm(result.at_rest.vertices - result.figure.mesh.vertices, axis=1).mean()
    print(f"in the human's rest pose the figure is {moved:.2f} m away, on average")
    return float(moved)


if __name__ == "__main__":
    main()
