"""Register a puppet to a surface: many starts, the best kept, then freed from its rig.

No map is needed for bodies of the source's kind (docs/log.md); maps, clips and landmarks only add
starts. All in units of sqrt(area): source and figure are compared at equal surface area.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from bunraku.meshes import scale_to_unit_area
from bunraku.registration.articulated import COARSE, FINE, Stage, fit, fit_error, gauss_newton_step
from bunraku.registration.body import Body
from bunraku.registration.correspondence import Pairs, Surface, make_surface, misfit
from bunraku.registration.nonrigid import refine
from bunraku.registration.puppet import Pose, Puppet, move_puppet, rest_pose
from bunraku.rotations import vectors_to_matrices
from bunraku.types import Mesh

STIFFNESS = 10.0 ** np.linspace(-5, -8.5, 8)  # of the non-rigid steps
REFIT = Stage(4, 0, 0.0, 1.0, 1.0, 1e-5, 1e-4)  # of the rig to a freed surface


@dataclass(frozen=True, eq=False)
class Registration:
    """The source's surface brought onto a figure's."""

    pose: Pose  # of the puppet, in units of sqrt(area)
    fitted: Float[np.ndarray, "vertices 3"]  # the source's proxy on the figure, in its metres
    error: float  # misfit of the articulated puppet, 0 perfect, 2 nowhere near
    others: tuple[float, ...]  # misfit of the other starts, best first


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


def likely_moments(
    puppet: Puppet,
    moments: Float[np.ndarray, "moments all_joints 3 3"],
    surface: Surface,
    *,
    keep: int = 4,
) -> list[Pose]:
    """Choose the moments of the source's clips that already look most like the figure.

    Each is turned to every heading, centred on the figure and judged as it is, without a fit.
    """
    samples = puppet.samples[:400]
    middle = surface.vertices[surface.samples].mean(axis=0)
    judged = []
    for heading in heading_starts(puppet):
        for moment in moments:
            pose = posed_start(puppet, moment, heading.rotations[0])
            moved, normals = move_puppet(puppet, pose, samples)
            shift = middle - moved.mean(axis=0)
            error = misfit((moved + shift, normals), samples, surface, width=0.2)
            judged.append((error, replace(pose, root=pose.root + shift)))
    return [pose for _, pose in sorted(judged, key=misfit_of)[:keep]]


def choose_start(
    puppet: Puppet,
    surface: Surface,
    starts: Iterable[Pose],
    *,
    keep: int = 2,
    schedule: tuple[Stage, ...] = COARSE,
) -> list[tuple[float, Pose]]:
    """Fit every start coarsely, the best few finely; give them with their misfits, best first."""
    coarse = [fit(puppet, start, surface, schedule) for start in starts]
    ranked = sorted(((fit_error(puppet, pose, surface), pose) for pose in coarse), key=misfit_of)
    fine = [fit(puppet, pose, surface, FINE) for _, pose in ranked[:keep]]
    judged = [(fit_error(puppet, pose, surface), pose) for pose in fine]
    return sorted(judged, key=misfit_of) + ranked[keep:]


def misfit_of(judged: tuple[float, Pose]) -> float:
    """Give the misfit of a judged pose."""
    return judged[0]


def refit(puppet: Puppet, pose: Pose, vertices: Float[np.ndarray, "vertices 3"]) -> Pose:
    """Pose the rig as the freed surface lies, vertex by vertex."""
    freed = make_surface(vertices, puppet.faces)
    samples = puppet.samples[:1200]
    pairs = Pairs(samples, samples, np.zeros(len(samples)))
    for _ in range(REFIT.steps):
        pose = gauss_newton_step(puppet, pose, freed, pairs, REFIT)
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


def register_body(body: Body, figure: Mesh) -> Registration:
    """Bring a character's proxy onto a figure's from the best of many starts."""
    vertices, centre, scale = scale_to_unit_area(figure.vertices, figure.faces)
    surface, puppet = make_surface(vertices, figure.faces), body.puppet
    starts = heading_starts(puppet) + likely_moments(puppet, body.moments, surface)
    (error, pose), *others = choose_start(puppet, surface, starts)
    pose, freed = free_from_rig(puppet, pose, surface)
    return Registration(pose, freed * scale + centre, error, tuple(e for e, _ in others))
