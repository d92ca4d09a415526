"""Follow the figure itself through a depth video, where that explains the video better."""

import logging
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from bunraku.bones.splitting import Bones
from bunraku.curves import extract_curves
from bunraku.embedding import Embedding, best_similarity
from bunraku.registration.tracking import Sight
from bunraku.registration.whole import depth_errors, follow_whole
from bunraku.rotations import compose_transforms
from bunraku.routes.capturing import Capture, announce_frames, rig_surface
from bunraku.skinning import clip_transforms, forward_kinematics, linear_blend_skinning
from bunraku.types import Character, Mesh

logger = logging.getLogger(__name__)
DOUBTFUL = 0.2  # of what a standing figure misses: a result that leaves more is doubted
STANDS = 1.2  # times its least error: a figure that misses less when standing hardly moves
CLEARLY = 0.95  # of the carried figure's error: what is fitted to depth is always a little nearer
ALIKE = 1.15  # of the bone by bone fit's error: a figure that fits as it stands needs no turns
Paths = Float[np.ndarray, "frames vertices 3"]


@dataclass(frozen=True, eq=False)
class Followed:
    """Who moves the figure, with bones of that mover's own, laid into the figure."""

    performer: Character
    weights: Float[np.ndarray, "figure_vertices bones"]
    joints: Float[np.ndarray, "bones 3"]  # in the figure as found
    turns: Float[np.ndarray, "bones 3 3"]  # reference to figure, before the heading
    errors: Float[np.ndarray, " frames"]  # of depth against the moving figure, both ways, metres
    still: Float[np.ndarray, " frames"]  # the same of a figure that stands still
    whole: bool  # the figure itself was followed, not the side that was seen

    @property
    def doubts(self) -> tuple[str, ...]:
        """Say whether the moving figure leaves much of what a standing one would miss.

        Counted from the least error, which noise and the figure's own shape leave.
        """
        least, still = float(self.still.min()), float(self.still.mean())
        moving = float(self.errors.mean())
        if still < STANDS * least or moving - least <= DOUBTFUL * (still - least):
            return ()
        return (
            f"the moving figure misses the depth by {1e3 * moving:.0f} mm, standing still it would "
            f"by {1e3 * still:.0f} mm: the result may be worse than standing still",
        )


def follow_figure(
    capture: Capture,
    embedding: Embedding,
    figure: Mesh,
    weights: Float[np.ndarray, "figure_vertices bones"],
    *,
    whole: bool = True,
) -> Followed:
    """Choose who moves the figure: the seen side, or the figure followed as a whole.

    The figure takes the performer's shape, once carried by the bones of the seen side and once
    fitted to every frame anew; the latter is believed if it lies clearly nearer to the depth.

    Args:
        figure: its closed proxy.
        weights: of the seen side's bones on it.
        whole: whether the figure may be followed as a whole.
    """
    performer = capture.character
    carried = carry_figure(performer, capture.bones, embedding, figure, weights)
    sight = Sight(capture.views, capture.intrinsics, capture.diagonal / 2)
    theirs = depth_errors(carried - capture.eye, figure.faces, sight)
    frame = embedding.frame if embedding.frame >= 0 else capture.track.reference
    stands = np.broadcast_to(carried[frame] - capture.eye, carried.shape)
    still = depth_errors(stands, figure.faces, sight)
    own = embedding.joints, embedding.turns
    seen = Followed(performer, weights, *own, theirs, still, whole=False)
    if not whole:
        return seen
    surface, exact = lay_figure(carried[frame], embedding, figure, capture, frame)
    curves = extract_curves(surface, figure.faces)
    centred = replace(curves, nodes=curves.nodes - capture.eye)
    placed = Mesh(surface - capture.eye, figure.faces)
    paths = follow_whole(placed, centred, sight, frame, exact=exact, progress=announce_frames())
    ours = depth_errors(paths, figure.faces, sight)
    logger.info("depth error %.4f m followed, %.4f m carried", ours.mean(), theirs.mean())
    if not is_clearly_nearer(ours, theirs, frame):
        return seen
    bones, mover = rig_surface(curves, paths + capture.eye, figure.faces, frame, capture.times)
    joints, turned = lay_bones(mover, bones, figure)
    return Followed(
        *(mover, mover.skin.weights, joints, embedding.heading.T @ turned, ours, still), whole=True
    )


def lay_figure(
    carried: Float[np.ndarray, "vertices 3"],
    embedding: Embedding,
    figure: Mesh,
    capture: Capture,
    frame: int,
) -> tuple[Float[np.ndarray, "vertices 3"], bool]:
    """Lay a figure on the performer in one frame: as it stands, if it fits so, or bone by bone.

    A figure that stands as the performer does needs no turns, and those found for it are noise,
    most of all for limbs that the camera does not see.

    Returns:
        the figure's vertices in the performer's frame, and whether it lies there as it stands.
    """
    whole = embedding.whole
    standing = (figure.vertices - whole.shift) @ whole.rotation / whole.scale
    sight = Sight((capture.views[frame],) * 2, capture.intrinsics, capture.diagonal / 2)
    both = np.stack([standing, carried]) - capture.eye
    errors = depth_errors(both, figure.faces, sight)
    logger.info("depth error %.4f m as it stands, %.4f m bone by bone", errors[0], errors[1])
    stands = bool(errors[0] <= ALIKE * errors[1])
    return (standing if stands else carried), stands


def is_clearly_nearer(
    ours: Float[np.ndarray, " frames"], theirs: Float[np.ndarray, " frames"], frame: int
) -> bool:
    """Tell whether a figure fitted to every frame keeps to the depth better than a carried one.

    Nearer on the whole, and by what its worst frames have lost since the one it started from: a
    figure of another build is always nearer where it may take the performer's shape.
    """
    lost = [np.percentile(each, 90) / max(each[frame], 1e-12) for each in (ours, theirs)]
    return bool(ours.mean() <= CLEARLY * theirs.mean() and lost[0] <= CLEARLY * lost[1])


def carry_figure(
    performer: Character,
    bones: Bones,
    embedding: Embedding,
    figure: Mesh,
    weights: Float[np.ndarray, "figure_vertices bones"],
) -> Paths:
    """Give a figure the performer's shape, and move it with the bones of the seen side."""
    clip, skeleton = performer.clips[0], performer.skeleton
    world = forward_kinematics(skeleton.parents, clip_transforms(clip))
    motion = world @ performer.skin.inverse_bind
    shapes = np.linalg.inv(compose_transforms(embedding.joints, embedding.linear))
    home = compose_transforms(bones.joints, np.tile(np.eye(3), (len(bones.joints), 1, 1)))
    return linear_blend_skinning(figure.vertices, weights, motion @ (home @ shapes))


def lay_bones(
    mover: Character, bones: Bones, figure: Mesh
) -> tuple[Float[np.ndarray, "bones 3"], Float[np.ndarray, "bones 3 3"]]:
    """Lay bones of a figure in the performer's shape into the figure as found: joints and turns."""
    rest, weights = mover.mesh.vertices, mover.skin.weights
    joints, turns = bones.joints.copy(), np.tile(np.eye(3), (len(bones.joints), 1, 1))
    for bone, (joint, parent) in enumerate(zip(bones.joints, bones.parents, strict=True)):
        own = weights[:, bone] + 1e-9
        near = own if parent < 0 else own * (weights[:, parent] + 1e-9)  # the shared surface
        turns[bone] = best_similarity(rest, figure.vertices, own).rotation
        laid = best_similarity(rest, figure.vertices, near)
        joints[bone] = laid.scale * laid.rotation @ joint + laid.shift
    return joints, turns
