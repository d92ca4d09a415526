"""Follow a surface through a depth video with a deformation graph (Transfer4D, Sec. 3.1).

Paper: point to point, one way, 100 steps of gradient descent a frame. We: nearest points both ways
in position and normal, mostly to the plane, robust, Gauss-Newton, because limbs that the model does
not reach must pull too, and because it is a hundred times faster (docs/log.md).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from bunraku.depth.meshing import View
from bunraku.depth.projection import project_points
from bunraku.registration.correspondence import features, robust_weights
from bunraku.registration.deformation import (
    Graph,
    Motion,
    Wish,
    at_rest,
    build_graph,
    gauss_newton,
    turn_normals,
    warp,
)
from bunraku.registration.outline import find_nearest_shown, find_strays
from bunraku.rotations import matrices_to_vectors, vectors_to_matrices

Points = Float[np.ndarray, "points 3"]
FEWEST_FREE = 10  # vertices without depth of their own that unexplained depth may pull
FEWEST_TRIED = 8  # frames of a video in which another than the first may be better to start from
DOUBTFUL = 0.35  # share of standing still's error, from which on another start is tried
MUCH_NEARER = 0.7  # of the first frame's error: where another frame must get to be preferred
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Settings:
    """How frames are fitted; lengths in units of half the subject's diagonal."""

    radius: float = 0.07  # of the graph's nodes (sigma)
    steps: int = 6
    queries: int = 600  # samples of each side that ask for their nearest, in each step
    normals: float = 0.15  # of a unit of normal, in the search
    gate: float = 0.25  # pairs farther apart are dropped
    width: float = 0.1  # of the robust weight
    share: float = 0.1  # of point-to-point beside point-to-plane
    rigidity: float = 0.5  # of one edge, against 2500 samples
    damping: float = 1e-3
    momentum: float = 0.6  # of the last frame's motion, taken as the first guess
    unexplained: float = 0.08  # depth farther than this from the surface pulls free vertices
    reach: float = 0.35  # of that pull
    behind: bool = False  # vertices behind others wait for unexplained depth too
    outline: float = 0.0  # weight of what sticks out of the subject's outline, against a pair's
    both_ways: bool = True  # depth asks for its nearest on the surface too
    other_starts: bool = True  # frames other than the first may be the one to start from


@dataclass(frozen=True, eq=False)
class Track:
    """A surface followed through a video."""

    reference: int  # frame whose view it is
    graph: Graph
    motion: Motion  # of every frame
    places: Float[np.ndarray, "frames vertices 3"]
    visible: Bool[np.ndarray, "frames vertices"]
    residuals: Float[np.ndarray, " frames"]  # mean distance of depth to the surface, metres
    still: Float[np.ndarray, " frames"]  # the same for a surface that does not move

    @property
    def doubtful(self) -> bool:
        """Tell whether depth is so far from the surface that another start may do better."""
        return bool(self.residuals.mean() > DOUBTFUL * self.still.mean())


@dataclass(frozen=True, eq=False)
class Sight:
    """What a camera saw of a subject, frame by frame."""

    views: Sequence[View]
    intrinsics: Float[np.ndarray, "3 3"]  # pixels_from_camera
    unit: float  # half the subject's diagonal, metres


@dataclass(frozen=True, eq=False)
class Model:
    """The reference surface in units of half its diagonal, with its graph."""

    vertices: Points
    normals: Points
    graph: Graph
    unit: float  # metres


def track(
    views: Sequence[View],
    reference: int,
    intrinsics: Float[np.ndarray, "3 3"],
    diagonal: float,
    *,
    settings: Settings,
    progress: Progress = lambda done, count: None,
) -> Track:
    """Follow the surface seen in one frame through all others, forwards and backwards.

    Args:
        views: of every frame.
        reference: number of the frame to start from.
        intrinsics: pixels_from_camera.
        diagonal: of the subject's box, metres.
        progress: told how many frames of how many are done.
    """
    unit, start = diagonal / 2, views[reference]
    graph = build_graph(start.vertices / unit, start.faces, settings.radius)
    model = Model(start.vertices / unit, start.normals, graph, unit)
    begin = at_rest(graph)
    sight = Sight(views, intrinsics, unit)
    motions = follow(model, begin, sight, reference, settings=settings, progress=progress)
    return judge(model, motions, views, reference, intrinsics)


def follow(
    model: Model,
    begin: Motion,
    sight: Sight,
    reference: int,
    *,
    settings: Settings,
    progress: Progress = lambda done, count: None,
) -> list[Motion]:
    """Fit a model to every frame, forwards and backwards from the one it is known in.

    Args:
        begin: the motion in that frame.
    """
    motions: dict[int, Motion] = {reference: begin}
    done, views = 0, sight.views
    for order in (range(reference + 1, len(views)), range(reference - 1, -1, -1)):
        previous = current = begin
        for frame in order:
            guess = predict(previous, current, settings.momentum)
            previous, current = (
                current,
                fit_frame(model, guess, views[frame], sight.intrinsics, settings, seed=frame),
            )
            motions[frame] = current
            done += 1
            progress(done, len(views) - 1)
    return [motions[frame] for frame in range(len(views))]


def choose_reference(
    views: Sequence[View],
    intrinsics: Float[np.ndarray, "3 3"],
    diagonal: float,
    *,
    settings: Settings,
    tried: int = 3,
) -> int:
    """Choose the frame to start from: one with limbs well apart, that others can be reached from.

    Paper: always the first frame. We: that and the frames with the longest outlines are tried on
    every second frame, roughly; one from which depth stays much nearer to the surface is taken.

    Args:
        tried: how many frames.
    """
    if len(views) < FEWEST_TRIED:
        return 0
    lengths = np.array([outline_length(view, intrinsics) for view in views])
    candidates = [0]
    apart = max(1, len(views) // 8)
    for frame in np.argsort(-lengths, kind="stable"):
        if all(abs(frame - other) >= apart for other in candidates):
            candidates.append(int(frame))
    rough = replace(settings, steps=3, queries=settings.queries // 2)
    errors = []
    for frame in candidates[:tried]:
        few = list(range(frame % 2, len(views), 2))
        sparse = [views[index] for index in few]
        found = track(sparse, few.index(frame), intrinsics, diagonal, settings=rough)
        errors.append(float(found.residuals.mean()))
    best = int(np.argmin(errors))
    return candidates[best] if errors[best] < MUCH_NEARER * errors[0] else 0


def outline_length(view: View, intrinsics: Float[np.ndarray, "3 3"]) -> float:
    """Measure how long the subject's outline is, in metres, about."""
    shown = np.pad(view.depth > 0, 1)
    edges = sum(int(np.diff(shown, axis=axis).sum()) for axis in (0, 1))
    return edges * float(np.median(view.depth[view.depth > 0])) / float(intrinsics[0, 0])


def predict(previous: Motion, current: Motion, momentum: float) -> Motion:
    """Guess the next frame's motion: on as before, but less."""
    turn = current.rotations @ np.swapaxes(previous.rotations, 1, 2)
    ahead = vectors_to_matrices(momentum * matrices_to_vectors(turn)) @ current.rotations
    shift = current.translations - previous.translations
    return Motion(ahead, current.translations + momentum * shift)


def fit_frame(
    model: Model,
    motion: Motion,
    view: View,
    intrinsics: Float[np.ndarray, "3 3"],
    settings: Settings,
    *,
    seed: int,
) -> Motion:
    """Fit the surface to one frame by Gauss-Newton steps from a first guess."""
    rng = np.random.default_rng(seed)
    goal, normals = view.vertices / model.unit, view.normals
    tree = cKDTree(features(goal, normals, settings.normals))
    nearest = find_nearest_shown(view.depth) if settings.outline else None
    for _ in range(settings.steps):
        rows = draw(len(model.vertices), 2 * settings.queries, rng)
        moved = warp(model.graph, motion, model.vertices[rows], rows)
        turned = turn_normals(model.graph, motion, model.normals[rows], rows)
        places = features(moved, turned, settings.normals)
        facing, shown = are_seen(
            model.unit * moved, turned, view, intrinsics, slack=0.05 * model.unit
        )
        seen, hidden = facing & shown, facing & ~shown & settings.behind
        if not seen.any():
            return motion
        asked = draw(len(goal), settings.queries, rng)
        before, behind = ((rows[part], places[part]) for part in (seen, hidden))
        matched = find_matches(model.graph, before, tree, asked, settings, hidden=behind)
        weights = matched.weights * (2500 / max(len(matched.weights), 1))
        towards = goal[matched.still], normals[matched.still]
        wish = Wish(matched.moving, *towards, weights, settings.share)
        if nearest is not None:
            stray, ways = find_strays(model.unit * moved, nearest, intrinsics)
            back = moved[stray], ways / model.unit
            wish = draw_back(wish, rows[stray], *back, settings, len(matched.weights))
        motion = gauss_newton(
            model.graph,
            motion,
            model.vertices,
            wish,
            rigidity=settings.rigidity,
            damping=settings.damping,
        )
    return motion


def draw_back(
    wish: Wish,
    rows: Int[np.ndarray, " strays"],
    places: Float[np.ndarray, "strays 3"],
    ways: Float[np.ndarray, "strays 3"],
    settings: Settings,
    pairs: int,
) -> Wish:
    """Add the wish that vertices which stick out of the outline go back, each along its way.

    Args:
        pairs: how many of the surface and the depth there are; a stray counts beside them.
    """
    far = np.linalg.norm(ways, axis=1)
    weights = settings.outline * robust_weights(far**2, settings.reach) * (2500 / max(pairs, 1))
    return Wish(
        np.concatenate([wish.rows, rows]),
        np.concatenate([wish.places, places + ways]),
        np.concatenate([wish.normals, ways / np.maximum(far, 1e-12)[:, None]]),
        np.concatenate([wish.weights, weights]),
        wish.share,
    )


@dataclass(frozen=True, eq=False)
class Matches:
    """Vertices of the surface, points of a frame's depth that they belong to, and how surely."""

    moving: Int[np.ndarray, " pairs"]
    still: Int[np.ndarray, " pairs"]
    weights: Float[np.ndarray, " pairs"]


def find_matches(
    graph: Graph,
    shown: tuple[Int[np.ndarray, " samples"], Float[np.ndarray, "samples 6"]],
    tree: cKDTree,
    asked: Int[np.ndarray, " asked"],
    settings: Settings,
    *,
    hidden: tuple[Int[np.ndarray, " others"], Float[np.ndarray, "others 6"]],
) -> Matches:
    """Match a surface with a frame's depth, both ways.

    A vertex believes its nearest depth only if that depth's own nearest vertex is of the same
    part of the surface: else a leg would lie down on the other one when they cross. Depth that no
    vertex explains pulls such free vertices, from afar.

    Args:
        shown: vertices of the surface that should be seen, with their places and normals.
        tree: places and normals of the depth's points.
        asked: which of these ask for their nearest vertex.
        hidden: vertices that face the camera behind others; they wait for unexplained depth too.
    """
    rows, asking = shown
    own = cKDTree(asking)
    few = slice(0, settings.queries)
    forward, nearest = tree.query(asking[few])
    if not settings.both_ways:
        kept = forward < settings.gate
        weights = robust_weights(forward**2, settings.width) * kept
        return Matches(rows[few], nearest, weights)
    _, back = own.query(tree.data[nearest])
    alike = graph.same_part(rows[few], rows[back])
    first = Matches(
        rows[few],
        nearest,
        robust_weights(forward**2, settings.width) * (alike & (forward < settings.gate)),
    )
    distance, answer = own.query(tree.data[asked])
    weights = robust_weights(distance**2, settings.width) * (distance < settings.gate)
    answering, far = rows[answer], distance > settings.unexplained
    free = np.concatenate([rows[few][~alike], hidden[0]])
    if far.any() and len(free) >= FEWEST_FREE:
        waiting = np.concatenate([asking[few][~alike], hidden[1]])
        reach, chosen = cKDTree(waiting).query(tree.data[asked[far]])
        answering[far] = free[chosen]
        weights[far] = robust_weights(reach**2, settings.reach) * (reach < 2 * settings.reach)
    return Matches(
        np.concatenate([first.moving, answering]),
        np.concatenate([first.still, asked]),
        np.concatenate([first.weights, weights]),
    )


def draw(count: int, wanted: int, rng: np.random.Generator) -> Int[np.ndarray, " drawn"]:
    """Draw different numbers below a count, in random order."""
    return rng.permutation(count)[:wanted]


def are_seen(
    points: Points,
    normals: Points,
    view: View,
    intrinsics: Float[np.ndarray, "3 3"],
    *,
    slack: float,
) -> tuple[Bool[np.ndarray, " points"], Bool[np.ndarray, " points"]]:
    """Tell which points face the camera, and which have nothing of the subject before them."""
    facing = np.einsum("pc,pc->p", points, normals) < 0.0
    pixels = np.rint(project_points(points, intrinsics)).astype(np.int64)
    rows = np.clip(pixels[:, 1], 0, view.depth.shape[0] - 1)
    columns = np.clip(pixels[:, 0], 0, view.depth.shape[1] - 1)
    before = view.depth[rows, columns]
    hidden = (before > 0) & (-points[:, 2] > before + slack)
    return np.asarray(facing), np.asarray(~hidden)


def judge(
    model: Model,
    motions: Sequence[Motion],
    views: Sequence[View],
    reference: int,
    intrinsics: Float[np.ndarray, "3 3"],
) -> Track:
    """Gather a track, with what was seen of it and how far depth is from it in every frame."""
    places, visible, residuals, still = [], [], [], []
    frozen = cKDTree(views[reference].vertices)
    for motion, view in zip(motions, views, strict=True):
        moved = model.unit * warp(model.graph, motion, model.vertices, slice(None))
        turned = turn_normals(model.graph, motion, model.normals, slice(None))
        facing, shown = are_seen(moved, turned, view, intrinsics, slack=0.05 * model.unit)
        step = max(1, len(view.vertices) // 2000)
        apart = cKDTree(moved).query(view.vertices[::step])[0]
        still.append(float(frozen.query(view.vertices[::step])[0].mean()))
        places.append(moved)
        visible.append(facing & shown)
        residuals.append(float(apart.mean()))
    rotations = np.stack([motion.rotations for motion in motions])
    translations = np.stack([motion.translations for motion in motions])
    return Track(
        reference,
        model.graph,
        Motion(rotations, translations),
        np.stack(places),
        np.stack(visible),
        np.array(residuals),
        np.array(still),
    )
