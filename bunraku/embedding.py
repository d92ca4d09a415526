"""Put a performer that was seen from one side into a whole figure.

Paper (Transfer4D, Sec. 3.3, after Baran and Popovic 2007, "Pinocchio"): the skeleton is embedded in
a sphere graph of the figure. We: the seen surface itself is laid on the figure, first as a whole,
then bone by bone, because the surface tells limbs apart that a skeleton does not (docs/log.md).
What the figure has and the camera did not see stays with the body it hangs on.
"""

from dataclasses import dataclass, replace

import igl
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import diags
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from bunraku.bones.splitting import Bones
from bunraku.meshes import (
    closest_points,
    farthest_points,
    interpolate,
    scale_to_unit_area,
    surface_area,
    vertex_normals,
)
from bunraku.registration.articulated import Stage, gauss_newton_step
from bunraku.registration.correspondence import (
    Pairs,
    Surface,
    features,
    make_surface,
    robust_weights,
)
from bunraku.registration.puppet import Pose, Puppet, move_puppet, rest_pose
from bunraku.rotations import (
    nearest_rotation,
    quaternions_to_matrices,
    rotation_angles,
    vectors_to_matrices,
)
from bunraku.spectral import laplacian
from bunraku.types import Character, Mesh

HEADINGS, MOMENTS, KEPT = 8, 8, 3  # turns and frames that are tried; fits of them, bone by bone
WIDTHS = np.geomspace(0.3, 0.06, 24)  # of the robust weight, while aligning as a whole
SEEN_SHARE = 0.5  # of a body's surface, seen from one side
NEAR = 0.03  # distance at which surfaces count as one, in units of sqrt(area)
INSIDE = 0.95  # share of joints inside the figure, below which the embedding is doubted
MOST_MISFIT, DOUBTED = 1.0, 0.5  # refused; half believed
STAGES = (
    Stage(6, 500, 0.1, 0.2, 0.5, 1e-2, 3e-2),
    Stage(8, 700, 0.1, 0.12, 0.3, 2e-3, 1e-2),
    Stage(10, 900, 0.08, 0.08, 0.2, 5e-4, 3e-3),
)


@dataclass(frozen=True, eq=False)
class Similarity:
    """x -> scale * rotation x + shift."""

    rotation: Float[np.ndarray, "3 3"]
    shift: Float[np.ndarray, "3"]
    scale: float


@dataclass(frozen=True, eq=False)
class Embedding:
    """A performer's bones inside a figure, in the figure's metres."""

    heading: Float[np.ndarray, "3 3"]  # turn of the whole performer
    turns: Float[np.ndarray, "bones 3 3"]  # of each bone, before the heading: reference to figure
    joints: Float[np.ndarray, "bones 3"]  # in the figure as found
    fitted: Float[np.ndarray, "vertices 3"]  # the seen surface, laid on the figure
    scale: float  # figure to performer
    misfit: float  # 0 perfect, 2 nowhere near
    matched: Float[np.ndarray, " bones"]  # share of each bone's surface that met the figure
    inside: float  # share of joints inside the figure, or as good as
    linear: Float[np.ndarray, "bones 3 3"]  # turn and stretch of each bone: reference to figure
    frame: int  # of the performer's clip in which it stands as the figure does; -1 for its rest
    whole: Similarity  # figure from performer, before any bone turned: metres

    @property
    def confidence(self) -> float:
        """Turn the misfit into a confidence: one half at the misfit that is doubted."""
        return float(1.0 / (1.0 + (self.misfit / DOUBTED) ** 4))

    @property
    def doubts(self) -> tuple[str, ...]:
        """Say which bones found no place on the figure, and whether the whole fits poorly."""
        told = []
        lost = [f"bone{bone:02d}" for bone in np.flatnonzero(self.matched < 0.5)]
        if lost:
            told.append(f"no place on the figure was found for {', '.join(lost)}")
        if self.inside < INSIDE:
            outside = f"{1 - self.inside:.0%} of the joints lie outside the figure"
            told.append(f"{outside}: the result may be worse than standing still")
        if self.misfit > DOUBTED:
            fit = f"misfit {self.misfit:.2f}, confidence {self.confidence:.2f}"
            told.append(f"the figure fits the performer poorly ({fit}): look at the result")
        return tuple(told)


def embed(performer: Character, bones: Bones, figure: Mesh) -> Embedding:
    """Lay a performer on a figure: best heading, then bone by bone.

    Args:
        performer: the seen side of a subject, with its skin.
        bones: its bones.
        figure: closed, whole, in any pose like one of the performer's.
    """
    vertices, centre, unit = scale_to_unit_area(figure.vertices, figure.faces)
    surface = make_surface(vertices, figure.faces)
    puppet, own_unit = make_seen_puppet(performer, bones)
    fits = [fit_bones(puppet, start, surface) for start in find_starts(performer, puppet, surface)]
    best = min(fits, key=lambda fit: doubt(puppet, fit, surface))
    turns, linear, anchors = best.pose.world(puppet)
    moved, normals = move_puppet(puppet, best.pose)
    met = nearness(moved, normals, surface) > 0.5
    owned = np.bincount(bones.owners, minlength=len(turns))
    scale = best.whole.scale * unit / own_unit
    middle = scale * best.whole.rotation @ performer.mesh.vertices.mean(axis=0)
    whole = Similarity(best.whole.rotation, best.whole.shift * unit + centre - middle, scale)
    hits = np.bincount(bones.owners, met, minlength=len(turns))
    return Embedding(
        best.whole.rotation,
        best.whole.rotation.T @ turns,
        anchors * unit + centre,
        moved * unit + centre,
        scale,
        seen_misfit(puppet, best, surface),
        hits / np.maximum(owned, 1),
        share_inside(anchors, surface),
        linear * unit / own_unit,
        best.frame,
        whole,
    )


def share_inside(
    joints: Float[np.ndarray, "joints 3"], surface: Surface, *, near: float = 0.02
) -> float:
    """Give the share of joints inside a closed surface, or nearer to it than `near`."""
    joints = np.ascontiguousarray(joints)
    winding = igl.fast_winding_number(surface.vertices, surface.faces, joints)
    _, _, away = closest_points(joints, surface.vertices, surface.faces)
    return float(((winding > 0.5) | (away < near)).mean())


@dataclass(frozen=True, eq=False)
class Start:
    """A performer laid on a figure as a whole, as it was at one moment, and then bone by bone."""

    moment: Pose  # of the performer, in its own frame
    whole: Similarity
    pose: Pose  # on the figure
    frame: int  # of the performer's clip; -1 for its rest


def find_starts(performer: Character, puppet: Puppet, surface: Surface) -> list[Start]:
    """Try every heading with several moments of the performer, roughly; align the best finely.

    A figure may stand as the performer did in any frame.
    """
    rough = []
    for frame, moment in moments_of(performer, puppet):
        for turn in heading_turns(HEADINGS):
            whole = Similarity(turn, middle_of(surface) - turn @ middle_of(puppet), 1.0)
            start = place(moment, whole, frame)
            start = align(puppet, start, surface, WIDTHS[::4], 250)
            rough.append((seen_misfit(puppet, start, surface, count=300), start))
    rough.sort(key=lambda entry: entry[0])
    return [align(puppet, start, surface, WIDTHS[4:], 500) for _, start in rough[:KEPT]]


def moments_of(performer: Character, puppet: Puppet) -> list[tuple[int, Pose]]:
    """Give the puppet's pose at rest (-1) and in frames spread over the performer's clip."""
    clip = performer.clips[0]
    vertices = performer.mesh.vertices
    unit = float(np.sqrt(surface_area(vertices, performer.mesh.faces) / SEEN_SHARE))
    count = min(MOMENTS, len(clip.times))
    frames = np.unique(np.linspace(0, len(clip.times) - 1, count).round().astype(np.int64))
    roots = (clip.translations[frames, 0] - vertices.mean(axis=0)) / unit
    still = np.zeros((len(puppet.parents), 2))
    turned = quaternions_to_matrices(clip.rotations[frames])
    moving = [Pose(root, turn, still) for root, turn in zip(roots, turned, strict=True)]
    return [(-1, rest_pose(puppet)), *zip(frames.tolist(), moving, strict=True)]


def middle_of(surface: Surface | Puppet) -> Float[np.ndarray, "3"]:
    """Give the middle of a surface's box."""
    middle: np.ndarray = (surface.vertices.max(axis=0) + surface.vertices.min(axis=0)) / 2
    return middle


def place(moment: Pose, whole: Similarity, frame: int) -> Start:
    """Lay a pose on a figure as a whole."""
    rotations = moment.rotations.copy()
    rotations[0] = whole.rotation @ rotations[0]
    root = whole.scale * whole.rotation @ moment.root + whole.shift
    scales = np.full_like(moment.scales, np.log(whole.scale))
    return Start(moment, whole, Pose(root, rotations, scales), frame)


def make_seen_puppet(performer: Character, bones: Bones) -> tuple[Puppet, float]:
    """Make a puppet of a seen surface as if its body had area 1; give its unit, in metres."""
    vertices, faces = performer.mesh.vertices, performer.mesh.faces
    unit = float(np.sqrt(surface_area(vertices, faces) / SEEN_SHARE))
    centre = vertices.mean(axis=0)
    axes = bones.tips - bones.joints
    lengths = np.linalg.norm(axes, axis=1, keepdims=True)
    axes = np.where(lengths > 1e-6 * unit, axes / np.maximum(lengths, 1e-12), 0.0)
    puppet = Puppet(
        (vertices - centre) / unit,
        faces,
        performer.skin.weights,
        (bones.joints - centre) / unit,
        bones.parents,
        axes,
        np.arange(len(bones.parents)),
        farthest_points(vertices, 2000),
        np.tile(np.eye(3), (len(bones.parents), 1, 1)),
        np.arange(len(bones.parents)),
    )
    return puppet, unit


def heading_turns(count: int) -> Float[np.ndarray, "headings 3 3"]:
    """Give turns about the vertical, in equal steps from none."""
    angles = np.arange(count) * (2 * np.pi / count)
    return vectors_to_matrices(angles[:, None] * np.array([[0.0, 1.0, 0.0]]))


def seen_pairs(
    moved: tuple[Float[np.ndarray, "samples 3"], Float[np.ndarray, "samples 3"]],
    samples: Int[np.ndarray, " samples"],
    towards: Float[np.ndarray, "3"],
    surface: Surface,
    stage: Stage,
) -> Pairs:
    """Pair the seen surface with the figure, and the figure's side to the camera with it.

    Args:
        moved: places and normals of samples of the seen surface.
        samples: their vertex numbers.
        towards: direction of the camera, in the figure's frame.
        stage: how many ask, and how much normals count.
    """
    own = features(*moved, stage.normals)
    tree = surface.tree(stage.normals, len(surface.samples))
    forward, nearest = tree.query(own[: stage.queries])
    facing = np.flatnonzero(surface.normals[surface.samples] @ towards > 0.2)[: stage.queries]
    backward, asked = cKDTree(own).query(tree.data[facing])
    weights = np.concatenate([np.ones(len(forward)), np.full(len(backward), 0.5)])
    return Pairs(
        np.concatenate([samples[: stage.queries], samples[asked]]),
        np.concatenate([surface.samples[nearest], surface.samples[facing]]),
        np.concatenate([forward, backward]) ** 2,
        weights,
    )


def align(
    puppet: Puppet,
    start: Start,
    surface: Surface,
    widths: Float[np.ndarray, " steps"],
    count: int,
) -> Start:
    """Lay the seen surface on a figure as a whole: iterated closest points with scale.

    Args:
        start: the moment, and where to begin.
        widths: of the robust weight, step by step.
        count: samples of each side that ask.
    """
    samples, found = puppet.samples[:count], start.whole
    own, normals = unit_normals(move_puppet(puppet, start.moment, samples))
    order = np.empty(len(puppet.vertices), np.int64)
    order[samples] = np.arange(count if count < len(samples) else len(samples))
    for width in widths:
        stage = Stage(1, count, 0.15, width, 1.0, 0.0, 0.0)
        places = found.scale * own @ found.rotation.T + found.shift
        turned = normals @ found.rotation.T
        pairs = seen_pairs((places, turned), samples, found.rotation[:, 2], surface, stage)
        weights = pairs.weight * robust_weights(pairs.squared, width)
        goals = surface.vertices[pairs.still]
        found = best_similarity(own[order[pairs.moving]], goals, weights)
    return place(start.moment, found, start.frame)


def best_similarity(
    points: Float[np.ndarray, "pairs 3"],
    goals: Float[np.ndarray, "pairs 3"],
    weights: Float[np.ndarray, " pairs"],
) -> Similarity:
    """Fit a similarity to weighted pairs (Umeyama 1991), its scale within a factor of two."""
    share = weights / weights.sum()
    centre, goal = share @ points, share @ goals
    arms = points - centre
    covariance = (share[:, None] * (goals - goal)).T @ arms
    rotation = nearest_rotation(covariance)
    scale = np.einsum("ab,ab->", rotation, covariance) / (share @ (arms**2).sum(axis=1))
    scale = float(np.clip(scale, 0.5, 2.0))
    return Similarity(rotation, goal - scale * rotation @ centre, scale)


def fit_bones(puppet: Puppet, start: Start, surface: Surface) -> Start:
    """Turn and stretch bones until the seen surface lies on the figure."""
    pose, samples = start.pose, puppet.samples[:1200]
    towards = start.whole.rotation[:, 2]
    for stage in STAGES:
        for _ in range(stage.steps):
            moved = unit_normals(move_puppet(puppet, pose, samples))
            pairs = seen_pairs(moved, samples, towards, surface, stage)
            pose = gauss_newton_step(puppet, pose, surface, pairs, stage, home=start.pose)
    return replace(start, pose=pose)


def unit_normals(
    moved: tuple[Float[np.ndarray, "samples 3"], Float[np.ndarray, "samples 3"]],
) -> tuple[Float[np.ndarray, "samples 3"], Float[np.ndarray, "samples 3"]]:
    """Bring blended normals to length 1."""
    places, normals = moved
    return places, normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def seen_misfit(
    puppet: Puppet, fit: Start, surface: Surface, *, width: float = 0.1, count: int = 1000
) -> float:
    """Judge a fit: mean of d^2 / (d^2 + width^2), both ways added; 0 perfect, 2 nowhere near."""
    samples = puppet.samples[:count]
    moved = unit_normals(move_puppet(puppet, fit.pose, samples))
    stage = Stage(1, count, 0.1, width, 1.0, 0.0, 0.0)
    pairs = seen_pairs(moved, samples, fit.whole.rotation[:, 2], surface, stage)
    far = pairs.squared / (pairs.squared + width**2)
    return float(far[: len(samples)].mean() + far[len(samples) :].mean())


def doubt(puppet: Puppet, fit: Start, surface: Surface) -> float:
    """Rank fits by misfit, made worse by what bones turned and stretched beyond their moment."""
    start = place(fit.moment, fit.whole, fit.frame).pose
    turned = np.swapaxes(start.rotations, 1, 2) @ fit.pose.rotations
    stretch = float(np.abs(fit.pose.scales - start.scales).mean())
    turn = float(rotation_angles(turned).mean())
    return seen_misfit(puppet, fit, surface) + 0.05 * turn + 0.1 * stretch


def nearness(
    places: Float[np.ndarray, "vertices 3"],
    normals: Float[np.ndarray, "vertices 3"],
    surface: Surface,
) -> Float[np.ndarray, " vertices"]:
    """Tell how surely each vertex lies on a surface that faces as it does; 1 sure, 0 not."""
    face, _, distance = closest_points(places, surface.vertices, surface.faces)
    theirs = surface.normals[surface.faces[face]].mean(axis=1)
    agree = np.einsum("va,va->v", normals, theirs) > 0.0
    return np.exp(-((distance / (2 * NEAR)) ** 2)) * agree


def spread_weights(
    performer: Character, embedding: Embedding, figure: Mesh
) -> tuple[Float[np.ndarray, "figure_vertices bones"], Bool[np.ndarray, " figure_vertices"]]:
    """Read the skin off the seen surface where it lies on the figure, and spread it to the rest.

    The rest is a harmonic function of what is known: a limb that was not seen gets the weights of
    the body it hangs on, never those of the limb beside it.

    Returns:
        weights at the figure's vertices, and which of them met the seen surface.
    """
    unit = float(np.sqrt(surface_area(figure.vertices, figure.faces)))
    faces = performer.mesh.faces
    face, shares, distance = closest_points(figure.vertices, embedding.fitted, faces)
    known = interpolate(performer.skin.weights, faces[face], shares)
    normals = vertex_normals(embedding.fitted, faces)[faces[face]].mean(axis=1)
    agree = np.einsum("va,va->v", normals, vertex_normals(figure.vertices, figure.faces)) > 0.0
    trust = np.exp(-((distance / (NEAR * unit)) ** 2)) * agree
    trust[trust < 0.05] = 0.0
    stiffness, mass = laplacian(figure.vertices, figure.faces)
    pull = 4.0 / (NEAR * unit) ** 2 * mass * trust + 1e-6 * mass / unit**2
    solved = splu((stiffness + diags(pull)).tocsc()).solve(pull[:, None] * known)
    weights = np.clip(solved, 0.0, None)
    weights /= np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)
    return weights, trust > 0.3
