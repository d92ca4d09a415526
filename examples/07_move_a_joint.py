"""Move a joint that was put in the wrong place; skin and clips follow, as in the studio.

python examples/07_move_a_joint.py
"""

from dataclasses import replace

import numpy as np

import bunraku
from bunraku import builtin
from bunraku.adjusting import move_joint
from bunraku.skinning import play_clip

HIGHER = 0.06  # metres


def main() -> float:
    """Raise the realistic figure's left elbow; give how far that moves its hand in a clip."""
    result = bunraku.animate(builtin.figure_paths()["realistic"], clips=["wave"])
    before = replace(result.character, clips=result.character.clips[:1])
    joint = before.skeleton.names.index("leftLowerArm")
    place = np.linalg.inv(before.skin.inverse_bind[joint])[:3, 3]
    after = move_joint(before, joint, np.add(place, (0.0, HIGHER, 0.0)))

    changed = np.abs(after.skin.weights - before.skin.weights).max(axis=1) > 0.01
    print(f"{changed.sum()} of {len(changed)} vertices have other weights")
    middle = np.array([len(before.clips[0].times) // 2])
    moved = [play_clip(who, who.clips[0], middle)[0] for who in (before, after)]
    apart = np.linalg.norm(moved[1] - moved[0], axis=1)
    print(f"in the middle of the clip, vertices lie up to {apart.max():.3f} m elsewhere")
    return float(apart.max())


if __name__ == "__main__":
    main()
