"""The measures of every table, one definition each.

Lengths are divided by the height of the figure at rest, so that a figure of any size counts as 1 m
tall. A metric takes arrays and knows nothing of files, rigs or routes.
"""

import igl
import numpy as np
from jaxtyping import Bool, Float, Int

from bunraku.graphs import mesh_edges
from bunraku.meshes import vertex_normals
from bunraku.rotations import matrices_to_quaternions, nearest_rotation

Points = Float[np.ndarray, "*frames vertices 3"]


def figure_height(vertices: Float[np.ndarray, "vertices 3"]) -> float:
    """Give the extent along Y of a figure at rest: the unit of every length below."""
    return float(np.ptp(vertices[:, 1]))


def weight_error(
    weights: Float[np.ndarray, "vertices joints"], truth: Float[np.ndarray, "vertices joints"]
) -> Float[np.ndarray, " joints"]:
    """Give 100 x the mean squared error of each joint's weights (Musoni et al. 2021, Table 1)."""
    return 100 * ((weights - truth) ** 2).mean(axis=0)


def pose_distance(vertices: Points, truth: Points, height: float) -> float:
    """Give PMD: 100 x the mean distance of vertices from the truth (centimetres at 1 m).

    Reference:
        Wang et al. 2023, Sec. 4.3, which prints neither formula nor unit: compare only with
        methods run on the same figures.
    """
    return float(100 * np.linalg.norm(vertices - truth, axis=-1).mean() / height)


def pose_distance_in_place(vertices: Points, truth: Points, height: float) -> float:
    """Give PMD after the mean displacement of each frame has been taken out."""
    offset = (vertices - truth).mean(axis=-2, keepdims=True)
    return pose_distance(vertices - offset, truth, height)


def edge_ratios(
    vertices: Points, reference: Points, ends: Int[np.ndarray, "edges 2"]
) -> Float[np.ndarray, "*frames real"]:
    """Divide the length of each edge by its length in the reference; edges without length go."""
    lengths, expected = (
        np.linalg.norm(points[..., ends[:, 0], :] - points[..., ends[:, 1], :], axis=-1)
        for points in (vertices, reference)
    )
    longest = expected.max(initial=0.0)
    real = (expected > 1e-6 * longest).all(axis=tuple(range(expected.ndim - 1)))
    return lengths[..., real] / expected[..., real]


def edge_length_score(vertices: Points, truth: Points, faces: Int[np.ndarray, "faces 3"]) -> float:
    """Give ELS, 1 minus the mean relative error of edge lengths; 1 is best (Eq. 7).

    A figure that does not move scores about .97: print PMD beside it.

    Reference:
        Wang et al. 2023, Sec. 4.3.
    """
    return float(1 - np.abs(edge_ratios(vertices, truth, mesh_edges(faces)) - 1).mean())


def stretch(
    vertices: Points, rest: Float[np.ndarray, "vertices 3"], ends: Int[np.ndarray, "edges 2"]
) -> float:
    """Give the 99th percentile of edge lengths over their lengths at rest; 1 is no stretch.

    Args:
        ends: the edges that count, all or a sample.
    """
    ratios = edge_ratios(vertices, np.broadcast_to(rest, vertices.shape), ends)
    return float(np.percentile(ratios, 99)) if ratios.size else 1.0


def bone_direction_error(
    bones: Float[np.ndarray, "*frames bones 3"], truth: Float[np.ndarray, "*frames bones 3"]
) -> float:
    """Give the mean angle between corresponding bones, in degrees, over all frames.

    Args:
        bones: from each bone's joint to its end; any length but zero.
        truth: the same bones of the other character.
    """
    sine = np.linalg.norm(np.cross(bones, truth), axis=-1)
    cosine = np.einsum("...c,...c->...", bones, truth)
    return float(np.degrees(np.arctan2(sine, cosine)).mean())


def joint_error(
    joints: Float[np.ndarray, "joints 3"], truth: Float[np.ndarray, "joints 3"], height: float
) -> float:
    """Give the mean distance of joints from the truth, in per cent of the figure's height."""
    return float(100 * np.linalg.norm(joints - truth, axis=-1).mean() / height)


def best_turn(vertices: Points, truth: Points) -> Float[np.ndarray, "*frames 3 3"]:
    """Give the rotation that fits vertices, about their mean, to the truth best (Kabsch)."""
    centred, goal = (points - points.mean(axis=-2, keepdims=True) for points in (vertices, truth))
    return nearest_rotation(np.swapaxes(goal, -1, -2) @ centred)


def align_rigidly(vertices: Points, truth: Points) -> Points:
    """Turn and move each frame as a whole so that it fits the truth best."""
    turned = vertices @ np.swapaxes(best_turn(vertices, truth), -1, -2)
    return turned + (truth - turned).mean(axis=-2, keepdims=True)


def reconstruction_error(vertices: Points, truth: Points) -> float:
    """Give RE, the root mean square distance of vertices from the truth, over all frames.

    Scale figures to a bounding-box diagonal of 2, and print the error of a frozen figure beside it.

    Reference:
        Maheshwari et al. 2023, supplement, Eq. 14.
    """
    return float(np.sqrt(((vertices - truth) ** 2).sum(axis=-1).mean()))


def local_pose_error(vertices: Points, truth: Points) -> float:
    """Give LPE: the same after each frame is turned and moved as a whole to fit the truth (Eq. 15).

    Reference:
        Maheshwari et al. 2023, supplement, Eq. 15.
    """
    return reconstruction_error(align_rigidly(vertices, truth), truth)


def rest_pose_error(
    vertices: Float[np.ndarray, "vertices 3"],
    truth: Float[np.ndarray, "vertices 3"],
    height: float,
) -> float:
    """Give the mean distance of a rest pose from the true one, in per cent of height.

    Where the figure stands and which way it looks does not count: both are aligned rigidly.
    """
    return pose_distance(align_rigidly(vertices, truth), truth, height)


def twist_error(
    rotations: Float[np.ndarray, "joints 3 3"],
    truth: Float[np.ndarray, "joints 3 3"],
    axes: Float[np.ndarray, "joints 3"],
) -> Float[np.ndarray, " joints"]:
    """Give how far each joint is turned about its bone beyond the truth, in degrees, 0 to 180.

    Args:
        rotations: how each joint turns between two poses, in world axes.
        truth: how it should turn.
        axes: direction of each joint's bone where the turn ends, unit length.
    """
    excess = matrices_to_quaternions(rotations @ np.swapaxes(truth, -1, -2))
    along = np.abs(np.einsum("jc,jc->j", excess[:, :3], axes))
    return np.degrees(2 * np.arctan2(along, excess[:, 3]))


def foot_contacts(
    feet: Float[np.ndarray, "frames feet 3"],
    times: Float[np.ndarray, " frames"],
    height: float,
    *,
    low: float = 0.03,
    slow: float = 0.3,
) -> Bool[np.ndarray, "steps feet"]:
    """Tell in which steps between frames a foot is planted: low and slow at both ends.

    Args:
        feet: positions in the source's clip; later frames in the order of `times`.
        height: of the source at rest.
        low: how far above its own lowest point a planted foot may be, in heights.
        slow: how fast it may move, in heights per second.
    """
    above = (feet[..., 1] - feet[..., 1].min(axis=0, initial=np.inf)) / height
    speed = np.linalg.norm(np.diff(feet, axis=0), axis=-1) / np.diff(times)[:, None] / height
    return (above[:-1] < low) & (above[1:] < low) & (speed < slow)


def foot_slide(
    feet: Float[np.ndarray, "frames feet 3"],
    planted: Bool[np.ndarray, "steps feet"],
    times: Float[np.ndarray, " frames"],
) -> float:
    """Give how far planted feet travel over the ground, in metres per second of contact.

    Args:
        feet: positions in the retargeted clip.
        planted: what `foot_contacts` found in the source's clip.
    """
    travelled = np.linalg.norm(np.diff(feet[..., [0, 2]], axis=0), axis=-1)
    contact = (np.diff(times)[:, None] * planted).sum()
    return float((travelled * planted).sum() / contact) if contact > 0 else 0.0


def inside_body(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    chosen: Int[np.ndarray, " chosen"],
    *,
    offset: float = 2e-3,
) -> Bool[np.ndarray, " chosen"]:
    """Tell which vertices have the body on their outer side: winding number there above a half.

    Args:
        offset: how far along its normal each vertex is moved before asking, in longest extents.
    """
    step = offset * float(np.ptp(vertices, axis=0).max())
    outside = vertices[chosen] + step * vertex_normals(vertices, faces)[chosen]
    winding = igl.fast_winding_number(
        np.ascontiguousarray(vertices), np.ascontiguousarray(faces), np.ascontiguousarray(outside)
    )
    return np.asarray(winding > 0.5)


def penetration_fractions(
    posed: Float[np.ndarray, "frames vertices 3"],
    rest: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    *,
    sample_count: int = 500,
) -> Float[np.ndarray, " frames"]:
    """Give the share of vertices, in each frame, inside the body though they are not at rest.

    A cheap stand-in for penetration: creases at bent joints count, cloth inside cloth at rest
    does not.
    """
    if not len(faces):
        return np.zeros(len(posed))
    used = np.unique(faces)
    chosen = used[np.linspace(0, len(used) - 1, min(sample_count, len(used))).astype(np.int64)]
    free = ~inside_body(rest, faces, chosen)
    return np.array([(inside_body(frame, faces, chosen) & free).mean() for frame in posed])


def is_mirrored(
    joints: Float[np.ndarray, "joints 3"],
    truth: Float[np.ndarray, "joints 3"],
    pairs: Int[np.ndarray, "pairs 2"],
) -> bool:
    """Tell whether left and right joints are nearer to their true places once swapped.

    Args:
        pairs: the left and the right joint of each symmetric pair.
    """
    as_is, swapped = pairs.ravel(), pairs[:, ::-1].ravel()
    straight = np.linalg.norm(joints[as_is] - truth[as_is], axis=-1).sum()
    crossed = np.linalg.norm(joints[swapped] - truth[as_is], axis=-1).sum()
    return bool(crossed < straight)


def swaps_sides(
    weights: Float[np.ndarray, "vertices joints"],
    truth: Float[np.ndarray, "vertices joints"],
    pairs: Int[np.ndarray, "pairs 2"],
) -> bool:
    """Tell whether weights agree better with the truth once left and right joints are swapped."""
    as_is, swapped = pairs.ravel(), pairs[:, ::-1].ravel()
    straight = ((weights[:, as_is] - truth[:, as_is]) ** 2).sum()
    crossed = ((weights[:, swapped] - truth[:, as_is]) ** 2).sum()
    return bool(crossed < straight)


def is_turned_back(
    bones: Float[np.ndarray, "bones 3"],
    truth: Float[np.ndarray, "bones 3"],
    forward: Float[np.ndarray, "3"],
) -> bool:
    """Tell whether bones that truly point forwards or backwards point the other way instead.

    Args:
        bones: from each bone's joint to its end.
        truth: the same bones of the true skeleton; those within 45 degrees of the line forwards
            vote, by their length along it (feet, tails, muzzles).
        forward: where the true figure looks, unit length.
    """
    depth = truth @ forward
    votes = np.abs(depth) > np.linalg.norm(truth, axis=-1) * np.sqrt(0.5)
    return bool((np.sign(depth[votes]) * (bones[votes] @ forward)).sum() < 0)
