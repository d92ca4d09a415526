"""Pose transfers whose truth is known: an avatar without rig, a figure it does not look like.

Generated bodies of seeds that training never used, and two families that it never saw (`blocks`,
hippos); real characters of the evaluation data, of which nothing was trained on either.
"""

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from bunraku import builtin
from bunraku.contacts import find_legs
from bunraku.evaluate.baselines import own_rig
from bunraku.evaluate.families import bind_joints, plain_names, play_at, strip
from bunraku.evaluate.part_truth import merge_spine, true_joints, true_parts
from bunraku.evaluate.retarget import find_tasks as find_relatives
from bunraku.neural.anatomy import PERSON, QUADRUPED
from bunraku.neural.avatars import as_character
from bunraku.neural.bodies import Body, pose_body, pose_motion
from bunraku.neural.corpus import draw_sculpted
from bunraku.neural.known_poses import clip_turns, stance
from bunraku.neural.parts import Understanding
from bunraku.neural.people import build_people
from bunraku.neural.variation import arm_turns, chain_turns, scale_parts, vary_body
from bunraku.registration.body import wrap_character
from bunraku.rotations import vectors_to_matrices
from bunraku.types import Character, MatchError, Mesh

logger = logging.getLogger(__name__)
POSES = 6
GROUPS = ("natural", "stylised", "blocks", "hippos", "real people", "real quadrupeds")


@dataclass(frozen=True, eq=False)
class Task:
    """One avatar, its poses, one figure, and where the figure's vertices should go."""

    group: str
    name: str
    seed: int
    avatar: Character  # its rig is for baselines that are given one; ours sees the surface alone
    poses: Float[np.ndarray, "frames vertices 3"]
    figure: Mesh
    truth: Float[np.ndarray, "frames figure 3"]
    parts: Int[np.ndarray, " figure"] | None  # true part of each vertex, where parts are comparable
    present: Int[np.ndarray, " present"]  # parts that the truth distinguishes
    phases: Float[np.ndarray, " phases"] | None = None  # of each clip; None for every frame

    def key(self) -> tuple[str, str, int]:
        """Tell this task from every other one of the table."""
        return self.group, self.name, self.seed


def generate_tasks(seed: int, *, count: int = 5) -> Iterator[Task]:
    """Make the tasks of generated bodies; those of people need anny, and are left out without."""
    rng = np.random.default_rng([seed, 77])
    if find_spec("anny") is None:
        logger.warning('natural and stylised people need anny: pip install "bunraku[train]"')
    else:
        bodies = build_people(3 * count, rng)
        for i in range(count):
            avatar, figure, other = bodies[3 * i : 3 * i + 3]
            still = np.tile(np.eye(3), (len(PERSON.names), 1, 1))
            yield people_task("natural", i, seed, avatar, vary_body(figure, still), rng)
            maps = scale_parts(other.joints, PERSON, rng)
            yield people_task("stylised", i, seed, avatar, vary_body(other, maps), rng)
            yield people_task("blocks", i, seed, avatar, draw_sculpted("blocks", rng), rng)
    for i in range(count):
        avatar, figure = draw_sculpted("dog", rng), draw_sculpted("hippo", rng)
        turns = quadruped_turns(rng)
        yield _task("hippos", f"dog>hippo {i}", seed, (avatar, figure), (turns, turns), None)


def people_task(
    group: str, number: int, seed: int, avatar: Body, figure: Body, rng: np.random.Generator
) -> Task:
    """Let both bodies stand alike, and take poses of the built-in human's clips."""
    fall = float(rng.choice([0.0, 45.0, 75.0]))
    bodies = stand(avatar, fall), stand(figure, fall)
    turns, travel = human_poses(rng)
    both = tuple(turns @ human_stance(body) for body in bodies)
    return _task(group, f"{avatar.family}>{figure.family} {number}", seed, bodies, both, travel)


def stand(body: Body, fall: float) -> Body:
    """Put a person's arms so many degrees below the horizontal: its rest pose."""
    return vary_body(body, chain_turns(PERSON, arm_turns(body.joints, PERSON, fall)))


def human_stance(body: Body) -> Float[np.ndarray, "parts 3 3"]:
    """Turn a body's arms from its rest pose into that of the built-in human."""
    human = builtin.human()
    places = dict(zip(human.skeleton.names, bind_joints(human), strict=True))
    bone = places["leftHand"] - places["leftUpperArm"]
    return stance(body.joints, PERSON, fall=float(np.degrees(np.arctan2(-bone[1], bone[0]))))


def human_poses(
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "frames parts 3 3"], Float[np.ndarray, "frames 3"]]:
    """Draw poses of built-in clips that nothing was trained on.

    Returns:
        turns since the human's rest, and the hips' displacement over the height of the hips.
    """
    clips = clip_turns(builtin.human(), kept_for_tests=True)
    turns, travel = [], []
    for clip in rng.choice(np.arange(len(clips)), POSES):
        frame = int(rng.integers(len(clips[clip][0])))
        turns.append(clips[clip][0][frame])
        travel.append(clips[clip][1][frame])
    return np.stack(turns), np.stack(travel)


def quadruped_turns(rng: np.random.Generator) -> Float[np.ndarray, "frames parts 3 3"]:
    """Draw turns of a quadruped's parts: legs swing, neck and tail bend, the trunk a little."""
    swing = np.array([0.35 if "Leg" in n or "Foot" in n else 0.2 for n in QUADRUPED.names])
    vectors = rng.normal(0, 1, (POSES, len(swing), 3)) * swing[:, None] * [1.0, 0.4, 0.4]
    return chain_turns(QUADRUPED, vectors_to_matrices(vectors))


def _task(
    group: str,
    name: str,
    seed: int,
    bodies: tuple[Body, ...],
    turns: tuple[Float[np.ndarray, "frames parts 3 3"], ...],
    travel: Float[np.ndarray, "frames 3"] | None,
) -> Task:
    """Pose avatar and figure."""
    avatar, figure = bodies
    shifts = [
        None if travel is None else travel * (b.joints[0, 1] - b.mesh.vertices[:, 1].min())
        for b in bodies
    ]
    poses, truth = (pose_body(b, t, s) for b, t, s in zip(bodies, turns, shifts, strict=True))
    motion = pose_motion(avatar.joints, avatar.anatomy.parents, turns[0], shifts[0])
    known = Understanding(avatar.kind, 1.0, avatar.weights, avatar.joints, 1.0)
    times = np.arange(len(poses)) / 24.0
    rigged = as_character(avatar.mesh, known, turns[0], motion[..., :3, 3], times)
    parts = figure.weights.argmax(axis=1)
    present = np.arange(len(figure.joints))
    return Task(group, name, seed, rigged, poses, figure.mesh, truth, parts, present)


def find_tasks(folder: Path, *, names: Sequence[str] = ()) -> Iterator[Task]:
    """Find real characters with relatives: the relative is the avatar, truth the figure's own rig.

    Truth is the relative's motion by joint name on the figure's own skeleton and skin.

    Args:
        folder: of evaluation data.
        names: parts of `folder/Source>Target` to keep; empty for all.
    """
    groups: dict[Path, str | None] = {}
    for pair in find_relatives(folder, pairs=names, clip_count=3):
        if pair.frozen:
            continue
        source, target = pair.source.character, pair.target.character
        if pair.target.path not in groups:
            groups[pair.target.path] = group_of(target, pair.family)
        group = groups[pair.target.path]
        if group is None:
            continue
        clips = tuple(plain_names(source.clips)[name] for name in pair.clips)
        copied, phases = own_rig(source, target, clips), np.array([0.25, 0.6])
        poses = np.concatenate([play_at(source, clip, phases) for clip in clips])
        truth = np.concatenate([play_at(copied, clip, phases) for clip in copied.clips])
        name = f"{pair.family}/{pair.source.name}>{pair.target.name}"
        parts, present = _known_parts(target) if group == GROUPS[4] else (None, np.arange(0))
        figure = strip(target)
        rigged = replace(source, clips=clips)
        yield Task(group, name, 0, rigged, poses, figure, truth, parts, present, phases)


def group_of(character: Character, family: str) -> str | None:
    """Tell people and quadrupeds from everything else: by folder, and by four legs."""
    if family.startswith(("humanoids", "stylised")):
        return "real people"
    body = wrap_character(character)  # whose carriers know legs that hang on the root
    legs = find_legs(body.proxy.mesh.vertices, body.weights, body.joints, body.carriers)
    return "real quadrupeds" if len(legs) == 4 else None


def _known_parts(
    character: Character,
) -> tuple[Int[np.ndarray, " vertices"] | None, Int[np.ndarray, " present"]]:
    """Give the true parts of a rigged person, if its joints can be named."""
    try:
        present = np.flatnonzero(np.isfinite(true_joints(character)[:, 0]))
        return merge_spine(true_parts(character), present), present
    except MatchError:
        return None, np.arange(0)
