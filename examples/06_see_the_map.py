"""See which part of the performer lies where on a figure: the map that the skin was read from.

python examples/06_see_the_map.py
"""

import numpy as np
from scipy.spatial import KDTree

import bunraku
from bunraku import builtin


def main() -> float:
    """Name the realistic figure's parts after the human's; give the height of its head."""
    result = bunraku.rig(builtin.figure_paths()["realistic"])
    figure, human = result.character.mesh, result.performer.mesh
    labels, names = builtin.human_parts()
    nearest = KDTree(human.vertices).query(result.counterparts)[1]
    part = labels[nearest]

    heights = {}
    for number in np.unique(part):
        heights[names[number]] = float(figure.vertices[part == number, 1].mean())
        count = int((part == number).sum())
        print(f"{names[number]:<20}{count:5d} vertices, {heights[names[number]]:.2f} m up")
    return heights["head"] / float(np.ptp(figure.vertices[:, 1]))


if __name__ == "__main__":
    main()
