"""The rigged performer that a depth video gives: its seen side, a skeleton and a clip."""

import numpy as np
from jaxtyping import Float, Int

from bunraku.bones.splitting import Bones
from bunraku.registration.tracking import Track
from bunraku.rotations import compose_transforms, matrices_to_quaternions
from bunraku.skinning import local_transforms
from bunraku.types import Character, Clip, Mesh, Skeleton, Skin

CLIP = "capture"
LOST = 0.33  # tracking error, as a share of standing still's, that is doubted
STILL = 0.004  # of the diagonal: a subject that moves less stands still
SEEN = 0.4  # share of its surface and time, below which a bone was not seen


def build_performer(
    rest: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    bones: Bones,
    weights: Float[np.ndarray, "vertices bones"],
    motion: tuple[Float[np.ndarray, "frames bones 3 3"], Float[np.ndarray, "frames bones 3"]],
    times: Float[np.ndarray, " frames"],
) -> Character:
    """Make a character of a tracked surface; joint frames lie as the world's at rest.

    Args:
        motion: world rotation of each bone since rest, and the place of its joint.
    """
    bind = compose_transforms(bones.joints, np.tile(np.eye(3), (len(bones.joints), 1, 1)))
    names = tuple(f"bone{index:02d}" for index in range(len(bones.joints)))
    skeleton = Skeleton(names, bones.parents, local_transforms(bones.parents, bind))
    clip = make_clip(motion, bones.parents, times)
    skin = Skin(weights, np.linalg.inv(bind))
    return Character(Mesh(rest, faces), skeleton, skin, (clip,))


def make_clip(
    motion: tuple[Float[np.ndarray, "frames bones 3 3"], Float[np.ndarray, "frames bones 3"]],
    parents: Int[np.ndarray, " bones"],
    times: Float[np.ndarray, " frames"],
) -> Clip:
    """Write the bones' motion as a clip, parent_from_joint."""
    rotations, joints = motion
    local = local_transforms(parents, compose_transforms(joints, rotations))
    quaternions = matrices_to_quaternions(local[..., :3, :3])
    same = np.einsum("fjc,fjc->fj", quaternions[1:], quaternions[:-1]) >= 0
    quaternions[1:] *= np.cumprod(np.where(same, 1.0, -1.0), axis=0)[:, :, None]
    translations = local[..., :3, 3].copy()
    return Clip(CLIP, times, translations, quaternions, np.ones_like(translations))


def standing_place(rest: Float[np.ndarray, "vertices 3"]) -> Float[np.ndarray, "3"]:
    """Give the point of the ground under the middle of a surface."""
    low, high = np.percentile(rest, [1, 99], axis=0)
    middle = (low + high) / 2
    return np.array([middle[0], float(rest[:, 1].min()), middle[2]])


def track_doubts(followed: Track, bones: Bones, diagonal: float) -> tuple[str, ...]:
    """Say what a person should look at: a subject that was lost, limbs that were hardly seen."""
    told = []
    error, still = float(followed.residuals.mean()), float(followed.still.mean())
    moved = still > STILL * diagonal
    if moved and error > LOST * still:
        told.append(
            f"the subject was followed poorly (depth {1e3 * error:.0f} mm from the surface, "
            f"{1e3 * still:.0f} mm if it stood still): the result may be worse than standing still"
        )
    seen = np.array(
        [followed.visible[:, bones.owners == b].mean() for b in np.unique(bones.owners)]
    )
    hidden = int((seen < SEEN).sum())
    if hidden:
        told.append(f"{hidden} of {len(seen)} bones were out of sight most of the time")
    return tuple(told)
