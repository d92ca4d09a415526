"""Register a puppet to a surface: many starts, the best kept, then freed from its rig.

No map is needed for bodies of the source's kind (docs/log.md); maps, clips and landmarks only add
starts. All in units of sqrt(area): source and figure are compared at equal surface area.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from bunraku.matching import match_surfaces
from bunraku.meshes import scale_to_unit_area
from bunraku.registration.articulated import (
    COARSE,
    FINE,
    FIRM,
    STIFF,
    Stage,
    fit,
    fit_error,
    gauss_newton_step,
)
from bunraku.registration.body import Body, posed_joints
from bunraku.registration.correspondence import Surface, make_surface, misfit, pin
from bunraku.registration.extremities import QUARTERS, pair_landmarks, reach_tips, surface_tips
from bunraku.registration.landmarks import hold_landmarks
from bunraku.registration.mirroring import swap_limbs
from bunraku.registration.nonrigid import refine
from bunraku.registration.puppet import Pose, Puppet, forget_stiffness, move_puppet, rest_pose
from bunraku.rotations import rotation_angles, vectors_to_matrices, vertical_turn
from bunraku.types import Mesh

STIFFNESS = 10.0 ** np.linspace(-5, -8.5, 8)  # of the non-rigid steps
GOOD_COARSE = 0.12  # misfit below which no further start is tried
POOR_COARSE = 0.2  # misfit above which the proportions themselves are doubted
DOUBTED = 0.17  # misfit above which limbs may be swapped
POOR_FINE = 0.25  # misfit above which the functional map is asked
AS_GOOD = 1.2  # times the best misfit, below which the source at rest explains as well
LOOSE = 0.31  # misfit above which a stretched puppet's turns are noise
MAPPED = Stage(10, 0, 0.0, 1.0, 1.0, 1e-4, 1e-2)  # to the map's points
REFIT = Stage(4, 0, 0.0, 1.0, 1.0, 1e-5, 1e-4)  # of the rig to a freed surface, half way
SETTLE = Stage(20, 0, 0.0, 1.0, 1.0, 0.05, 0.5)  # at last; costs times what the rig leaves over


@dataclass(frozen=True, eq=False)
class Registration:
    """The source's surface brought onto a figure's."""

    pose: Pose  # of the puppet, in units of sqrt(area)
    fitted: Float[np.ndarray, "vertices 3"]  # the source's proxy on the figure, in its metres
    joints: Float[np.ndarray, "joints 3"]  # where the posed rig has its joints, in the same
    error: float  # misfit of the articulated puppet, 0 perfect, 2 nowhere near
    others: tuple[float, ...]  # misfit of the other starts, best first
    at_rest: bool = False  # the figure stands as the source does at rest

    @property
    def strain(self) -> float:
        """Give the misfit, made worse by turns where the fit is poor."""
        return strain_of(self.pose, self.error)

    @property
    def confidence(self) -> float:
        """Turn the strain into a confidence: .98 at .1, one half at .28, .2 at .4."""
        return float(1.0 / (1.0 + (self.strain / 0.28) ** 4))

    @property
    def doubts(self) -> tuple[str, ...]:
        """Say what a person should look at."""
        if self.confidence >= 0.5:
            return ()
        return (
            f"the figure fits the performance poorly (strain {self.strain:.2f}, confidence "
            f"{self.confidence:.2f}): look at the result; a few --landmarks help",
        )


@dataclass(frozen=True, eq=False)
class Candidate:
    """A pose under trial, the pose that costs it nothing, and its misfit."""

    pose: Pose
    home: Pose | None  # the pose whose turns and scales cost nothing; None for rest
    error: float


def heading_starts(puppet: Puppet, count: int = 6) -> list[Pose]:
    """Give the rest pose turned about the vertical, in equal steps from straight ahead."""
    angles = np.arange(count) * (2 * np.pi / count)
    turns = vectors_to_matrices(angles[:, None] * np.array([[0.0, 1.0, 0.0]]))
    return [rest_pose(puppet, turn) for turn in turns]


def posed_start(
    puppet: Puppet, turns: Float[np.ndarray, "all_joints 3 3"], heading: Float[np.ndarray, "3 3"]
) -> Pose:
    """Pose the puppet as the source is at one moment, facing `heading`.

    Args:
        turns: world rotation of each of the source's joints since rest.
    """
    world = heading @ turns[puppet.joints]
    above = np.concatenate([np.eye(3)[None], world])[puppet.parents + 1]
    count = len(puppet.parents)
    return Pose(heading @ puppet.anchors[0], np.swapaxes(above, 1, 2) @ world, np.zeros((count, 2)))


def coarse_candidate(puppet: Puppet, surface: Surface, start: Pose) -> Candidate:
    """Fit a start coarsely, in the source's own proportions."""
    pose = fit(puppet, start, surface, COARSE)
    return Candidate(pose, None, fit_error(puppet, pose, surface))


def likely_moments(
    body: Body, surface: Surface, headings: list[Float[np.ndarray, "3 3"]], *, keep: int = 4
) -> list[Pose]:
    """Choose the moments of the source's clips that already look most like the figure.

    Each is turned to the headings, centred on the figure and judged as it is, without a fit.
    """
    puppet = body.puppet
    samples = puppet.samples[:400]
    middle = surface.vertices[surface.samples].mean(axis=0)
    judged = []
    for heading in headings:
        for moment in body.moments.turns[body.moments.unlike]:
            pose = posed_start(puppet, moment, heading)
            moved, normals = move_puppet(puppet, pose, samples)
            shift = middle - moved.mean(axis=0)
            error = misfit((moved + shift, normals), samples, surface, width=0.2)
            judged.append((error, replace(pose, root=pose.root + shift)))
    return [pose for _, pose in sorted(judged, key=lambda entry: entry[0])[:keep]]


def stretched_candidates(puppet: Puppet, surface: Surface) -> list[Candidate]:
    """Give starts for other proportions: ahead, and the quarter turn whose tips pair best."""
    tips = surface_tips(puppet, surface)
    paired = [pair_landmarks(puppet, surface, tips, heading) for heading in QUARTERS]
    aside = 1 + int(np.argmin([cost for _, cost in paired[1:]]))
    likely = (0, aside)
    poses = [reach_tips(puppet, surface, paired[k][0], QUARTERS[k]) for k in likely]
    return [Candidate(p, p, fit_error(puppet, p, surface)) for p in poses]


def mapped_candidate(body: Body, figure: Mesh, surface: Surface) -> Candidate:
    """Give the start of the functional map: the source posed as the map sends its surface.

    The only start that knows lying and upside-down figures.
    """
    found = match_surfaces(body.proxy.mesh, figure)
    pose = rest_pose(body.puppet, found.source_from_target.T)
    pairs = pin(found.point_map[surface.samples], surface.samples, 1.0)
    for _ in range(MAPPED.steps):
        pose = gauss_newton_step(body.puppet, pose, surface, pairs, MAPPED)
    pose = fit(body.puppet, pose, surface, COARSE[-1:])
    return Candidate(pose, None, fit_error(body.puppet, pose, surface))


def find_candidates(body: Body, figure: Mesh, surface: Surface) -> list[Candidate]:
    """Fit starts, more of them the worse they fit; best first.

    At rest under every heading; as in the source's clips, facing as the best of those; stretched
    to the figure's limb tips; as the functional map has it; the best of all with limbs swapped.
    """
    puppet = body.puppet
    found = [coarse_candidate(puppet, surface, start) for start in heading_starts(puppet)]
    found.sort(key=doubt)
    if found[0].error > GOOD_COARSE:
        faced = [vertical_turn(candidate.pose.rotations[0]) for candidate in found[:2]]
        moments = likely_moments(body, surface, faced)
        found += [coarse_candidate(puppet, surface, start) for start in moments]
    best = distinct(puppet, sorted(found, key=doubt))
    fine = [refine_candidate(puppet, surface, one) for one in best]
    plain = min(map(doubt, fine))
    if best[0].error > POOR_COARSE:
        free = forget_stiffness(puppet)
        stretched = stretched_candidates(free, surface)
        fine += [refine_candidate(free, surface, one) for one in stretched]
    explained = min(map(doubt, fine)) < 0.92 * plain  # by other proportions alone
    if plain > POOR_FINE and not explained:
        mapped = mapped_candidate(body, figure, surface)
        fine.append(refine_candidate(puppet, surface, mapped))
    leader = min(fine, key=doubt)
    if doubt(leader) > DOUBTED:
        fine += swapped_candidates(fitting_puppet(puppet, leader), surface, leader)
    return sorted(fine, key=doubt)


def fitting_puppet(puppet: Puppet, candidate: Candidate) -> Puppet:
    """Give the puppet that a candidate is fitted with.

    Stretched to other proportions, limbs turn as the stretch demands, not as the clips tell.
    """
    return puppet if candidate.home is None else forget_stiffness(puppet)


def distinct(
    puppet: Puppet, candidates: list[Candidate], *, keep: int = 2, apart: float = np.deg2rad(3.0)
) -> list[Candidate]:
    """Keep the first candidates that differ from each other, in mean turn, by more than `apart`."""
    kept: list[Candidate] = []
    worlds: list[Float[np.ndarray, "joints 3 3"]] = []
    for candidate in candidates:
        world = candidate.pose.world(puppet)[0]
        turns = [rotation_angles(world @ np.swapaxes(other, 1, 2)).mean() for other in worlds]
        if len(kept) < keep and min(turns, default=np.inf) > apart:
            kept.append(candidate)
            worlds.append(world)
    return kept


def swapped_candidates(puppet: Puppet, surface: Surface, best: Candidate) -> list[Candidate]:
    """Give the best candidate with twin limbs swapped, pair by pair."""
    found = []
    for start in swap_limbs(puppet, best.pose):
        pose = fit(puppet, start, surface, COARSE[-1:], home=best.home)
        found.append(refine_candidate(puppet, surface, replace(best, pose=pose)))
    return found


def refine_candidate(puppet: Puppet, surface: Surface, candidate: Candidate) -> Candidate:
    """Fit a candidate finely; one stretched to other proportions stays stiff if that fits badly.

    Its misfit is that of the free fit in either case, so that all candidates compare.
    """
    pose = fit(puppet, candidate.pose, surface, FINE, home=candidate.home)
    error = fit_error(puppet, pose, surface)
    if candidate.home is not None and error > LOOSE:
        pose = fit(puppet, candidate.pose, surface, STIFF, home=candidate.home)
    return Candidate(pose, candidate.home, error)


def unposed_candidate(puppet: Puppet, surface: Surface, best: Candidate) -> Candidate:
    """Fit the source at rest, faced as the best candidate, with hardly a turn.

    If that is nearly as good it is the better explanation: free limbs slide along each other.
    """
    start = rest_pose(puppet, vertical_turn(best.pose.rotations[0]))
    pose = fit(puppet, start, surface, FIRM)
    return Candidate(pose, None, fit_error(puppet, pose, surface))


def strain_of(pose: Pose, error: float) -> float:
    """Make a poor misfit worse by mean turns beyond 20 degrees.

    A body bends into a torus as well as it stretches onto a chibi; but it must bend more.
    """
    joints = max(1, len(pose.rotations) - 1)  # all but the root
    turn = np.rad2deg(rotation_angles(pose.rotations[1:]).sum()) / joints
    poor = float(np.clip((error - 0.2) / 0.1, 0.0, 1.0))
    return float(error * (1.0 + poor * 0.02 * max(0.0, turn - 20.0)))


def doubt(candidate: Candidate) -> float:
    """Rank candidates by strain; files face +Z, so one facing back must fit a tenth better."""
    turned = candidate.pose.rotations[0]
    forward = (turned[0, 0] + turned[2, 2]) / 2
    strain = strain_of(candidate.pose, candidate.error)
    return strain * (1.0 + 0.05 * (1.0 - float(np.clip(forward, -1.0, 1.0))))


def refit(puppet: Puppet, pose: Pose, vertices: Float[np.ndarray, "vertices 3"]) -> Pose:
    """Pose the rig as the freed surface lies, vertex by vertex."""
    freed = make_surface(vertices, puppet.faces)
    samples = puppet.samples[:1200]
    pairs = pin(samples, samples, 1.0)
    for _ in range(REFIT.steps):
        pose = gauss_newton_step(puppet, pose, freed, pairs, REFIT)
    return pose


def settle(puppet: Puppet, pose: Pose, vertices: Float[np.ndarray, "vertices 3"]) -> Pose:
    """Pose the rig as the finished surface lies: what it then says of turns is least blended.

    Turns and scales cost in proportion to the mean squared distance that the rig leaves over: a
    body of another shape must not be explained by a pose. What they cost, they fall short by; so
    once more from there, where the pose found costs nothing (Bregman iteration).
    """
    finished = make_surface(vertices, puppet.faces)
    samples = puppet.samples[:2000]
    pairs = pin(samples, samples, 1.0)
    home: Pose | None = None
    for step in range(SETTLE.steps):
        if step % (SETTLE.steps // 4) == 0:
            left = move_puppet(puppet, pose, samples)[0] - vertices[samples]
            over = float((left**2).sum(axis=1).mean())
            stage = replace(SETTLE, turns=SETTLE.turns * over, scales=SETTLE.scales * over)
        if step == SETTLE.steps // 2:
            home = pose
        pose = gauss_newton_step(puppet, pose, finished, pairs, stage, home=home)
    return pose


def free_from_rig(
    puppet: Puppet, pose: Pose, surface: Surface
) -> tuple[Pose, Float[np.ndarray, "vertices 3"]]:
    """Let the posed surface meet the figure, refit the rig to it half way, and finish."""
    posed, _ = move_puppet(puppet, pose)
    freed = refine(posed, posed, puppet.faces, surface, stiffness=STIFFNESS[:4])
    pose = refit(puppet, pose, freed)
    posed, _ = move_puppet(puppet, pose)
    return pose, refine(freed, posed, puppet.faces, surface, stiffness=STIFFNESS)


def register_body(
    body: Body,
    figure: Mesh,
    *,
    landmarks: Mapping[str, Sequence[float]] | None = None,
    names: Sequence[str] = (),
) -> Registration:
    """Bring a character's proxy onto a figure's from the best of many starts.

    Args:
        landmarks: places on the figure, in its metres, of joints called `names`.
    """
    vertices, centre, scale = scale_to_unit_area(figure.vertices, figure.faces)
    surface = make_surface(vertices, figure.faces)
    held = hold_landmarks(body, figure, surface, landmarks or {}, names)
    best, *others = find_candidates(held[0], figure, held[1])
    plain = unposed_candidate(held[0].puppet, held[1], best)
    at_rest = doubt(plain) < AS_GOOD * doubt(best)
    chosen = plain if at_rest else best
    pose, freed = free_from_rig(fitting_puppet(body.puppet, chosen), chosen.pose, surface)
    if chosen is best and best.home is None:  # elsewhere the surface tells no more of turns
        pose = settle(body.puppet, pose, freed)
    misses = tuple(other.error for other in others)
    fitted, joints = freed * scale + centre, posed_joints(body, pose) * scale + centre
    return Registration(pose, fitted, joints, chosen.error, misses, at_rest)
