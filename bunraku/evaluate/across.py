"""Table: the built-in human moves figures of other makes; do their own bones follow?

There is no clip to compare with, but the joints hidden in each figure are known by role. Moved
surfaces carry them along, and the bones between them should point as the human's do, turned to the
figure's front. The baseline plays its clips to the human's front, wherever the figure looks.
"""

import logging
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from rich.table import Table

from bunraku.evaluate import metrics
from bunraku.evaluate.baselines import nearest_vertex
from bunraku.evaluate.families import (
    Member,
    bind_joints,
    motion_at,
    play_at,
    read_members,
    rigged_files,
    strip,
)
from bunraku.evaluate.results import make_table
from bunraku.humanoids import name_joints
from bunraku.rotations import nearest_rotation, vectors_to_matrices
from bunraku.routes.from_rig import animate_from_rig
from bunraku.skinning import linear_blend_skinning
from bunraku.types import Character, Clip, MatchError

logger = logging.getLogger(__name__)
FOLDERS = ("humanoids", "stylised")
LIMBS = (
    ("UpperArm", "LowerArm"),
    ("LowerArm", "Hand"),
    ("UpperLeg", "LowerLeg"),
    ("LowerLeg", "Foot"),
    ("Foot", "Toes"),
)
TRUNK = (("hips", "neck"), ("neck", "head"))
BONES = (*TRUNK, *((side + a, side + b) for a, b in LIMBS for side in ("left", "right")))
METHODS = ("static", "nearest vertex", "ours")
Frames = Float[np.ndarray, "frames vertices 3"]


@dataclass(frozen=True, eq=False)
class Task:
    """A figure, and which of its hidden joints are the human's."""

    family: str
    member: Member
    source: Character
    clips: tuple[Clip, ...]
    joints: Mapping[str, int]  # of the figure, by VRM bone

    def key(self) -> tuple[str, str]:
        """Tell this figure from the others."""
        return self.family, self.member.name


@dataclass(frozen=True)
class Row:
    """How one figure followed the human."""

    family: str
    figure: str
    degrees: dict[str, float]  # bone direction error, by method
    mirrored: bool = False
    turned_back: bool = False
    joints: float | None = None  # per cent of height
    confidence: float | None = None
    seconds: float | None = None
    failure: str = ""

    def key(self) -> tuple[str, str]:
        """Tell this row from the others."""
        return self.family, self.figure


def find_tasks(
    folder: Path, source: Character, *, names: Sequence[str] = (), clip_count: int | None = 3
) -> Iterator[Task]:
    """Find the figures of a data folder whose hidden joints are those of a human.

    Args:
        source: the human; the clips are taken evenly from its own.
        names: parts of `folder/human>Figure` to keep, in any case; empty for all.
        clip_count: how many clips; None for all.
    """
    count = min(clip_count or len(source.clips), len(source.clips))
    chosen = np.linspace(0, len(source.clips) - 1, count).round().astype(np.int64)
    clips = tuple(source.clips[i] for i in chosen)
    groups = [group for kind in FOLDERS for group in rigged_files(folder / kind).values()]
    for path in (path for group in groups for path in group):
        family = path.parent.relative_to(folder).as_posix()
        full = f"{family}/human>{path.stem}".lower()
        if names and not any(part.lower() in full for part in names):
            continue
        for member in read_members([path]).values():
            joints = _known_joints(member)
            if joints:
                yield Task(family, member, source, clips, joints)


def _known_joints(member: Member) -> dict[str, int]:
    """Find the joints of a human; none if the character is no human or has no surface."""
    if not len(member.character.mesh.faces):
        return {}
    try:
        return name_joints(member.character.skeleton)
    except MatchError as error:
        logger.info("%s: %s", member.path, error)
        return {}


def measure(task: Task, *, frame_count: int = 8, seed: int = 0) -> Row:
    """Move one figure by the human, and compare where their bones point."""
    source, target = task.source, task.member.character
    figure, phases = strip(target), np.linspace(0, 1, frame_count)
    naive = nearest_vertex(source, figure, task.clips)
    moved = {"nearest vertex": [play_at(naive, clip, phases) for clip in naive.clips]}
    moved["static"] = [np.broadcast_to(figure.vertices, f.shape) for f in moved["nearest vertex"]]
    started = time.perf_counter()
    try:
        result = animate_from_rig(source, figure, clips=task.clips, seed=seed, force=True)
    except (ValueError, np.linalg.LinAlgError) as error:
        logger.warning("%s: %s", task.member.path, error)
        return Row(*task.key(), _follow(task, moved, phases), failure=str(error))
    seconds = time.perf_counter() - started
    moved["ours"] = [play_at(result.character, clip, phases) for clip in result.character.clips]
    row = Row(*task.key(), _follow(task, moved, phases), seconds=seconds)
    return replace(_compare_joints(task, result.character, row), confidence=result.confidence)


def _follow(
    task: Task, moved: Mapping[str, list[Frames]], phases: Float[np.ndarray, " frames"]
) -> dict[str, float]:
    """Give the bone direction error of every way of moving the figure, mean over clips.

    A file may look another way than the human does; the human's bones are turned to its front.
    """
    own = {name: i for i, name in enumerate(task.source.skeleton.names)}
    bones = [(a, b) for a, b in BONES if {a, b} <= own.keys() & task.joints.keys()]
    ours = np.array([[own[a], own[b]] for a, b in bones])
    theirs = np.array([[task.joints[a], task.joints[b]] for a, b in bones])
    ahead = heading_of(task)
    errors: dict[str, list[float]] = {method: [] for method in METHODS if method in moved}
    for i, clip in enumerate(task.clips):
        motion = motion_at(task.source, clip, phases)
        human = linear_blend_skinning(bind_joints(task.source), np.eye(len(own)), motion)
        for method, found in errors.items():
            carried = carry_joints(task.member.character, moved[method][i])
            found.append(
                metrics.bone_direction_error(
                    carried[:, theirs[:, 1]] - carried[:, theirs[:, 0]],
                    (human[:, ours[:, 1]] - human[:, ours[:, 0]]) @ ahead.T,
                )
            )
    return {method: float(np.mean(found)) for method, found in errors.items()}


def heading_of(task: Task) -> Float[np.ndarray, "3 3"]:
    """Give the quarter turn about the vertical from the human's front to the figure's."""
    numbers = {name: i for i, name in enumerate(task.source.skeleton.names)}
    human, figure = front_of(task.source, numbers), front_of(task.member.character, task.joints)
    yaw = np.arctan2(figure[0], figure[2]) - np.arctan2(human[0], human[2])
    quarter = np.round(yaw / (np.pi / 2)) * (np.pi / 2)
    return vectors_to_matrices(np.array([0.0, quarter, 0.0]))


def front_of(character: Character, joints: Mapping[str, int]) -> Float[np.ndarray, "3"]:
    """Tell where a human in its bind pose looks.

    Args:
        joints: number of each joint by VRM bone.
    """
    sides = [(name, "right" + name[4:]) for name in joints if name.startswith("left")]
    pairs = np.array([[joints[a], joints[b]] for a, b in sides if b in joints])
    return forward_of(bind_joints(character), pairs)


def carry_joints(character: Character, moved: Frames) -> Float[np.ndarray, "frames joints 3"]:
    """Carry a character's own joints along with its vertices, however these were moved.

    Each joint moves rigidly with the vertices around it: those that it and its parent share, or,
    where parts do not blend, its own.
    """
    weights, parents = character.skin.weights, character.skeleton.parents
    ring = weights * weights[:, np.maximum(parents, 0)]
    ring = np.where(ring.sum(axis=0) > 1e-2, ring, weights)
    share = ring / np.maximum(ring.sum(axis=0), 1e-12)
    rest, joints = character.mesh.vertices, bind_joints(character)
    centre, goal = share.T @ rest, np.swapaxes(moved, -1, -2) @ share
    products = np.einsum("fva,vb->fvab", moved, rest).reshape(*moved.shape[:2], 9)
    turned = (share.T @ products).reshape(len(moved), -1, 3, 3)
    turned -= np.einsum("faj,jb->fjab", goal, centre)
    return np.swapaxes(goal, -1, -2) + np.einsum(
        "fjab,jb->fja", nearest_rotation(turned), joints - centre
    )


def _compare_joints(task: Task, found: Character, row: Row) -> Row:
    """Add to a row how far the joints are from the figure's own, and whether they are swapped."""
    own = {name: i for i, name in enumerate(found.skeleton.names)}
    names = [name for name in dict.fromkeys(sum(BONES, ())) if name in own and name in task.joints]
    place = {name: i for i, name in enumerate(names)}
    joints = bind_joints(found)[[own[name] for name in names]]
    truth = bind_joints(task.member.character)[[task.joints[name] for name in names]]
    bones = np.array([[place[a], place[b]] for a, b in BONES if a in place and b in place])
    pairs = np.array([[place[n], place["right" + n[4:]]] for n in names if n.startswith("left")])
    return replace(
        row,
        mirrored=metrics.is_mirrored(joints, truth, pairs),
        turned_back=metrics.is_turned_back(
            joints[bones[:, 1]] - joints[bones[:, 0]],
            truth[bones[:, 1]] - truth[bones[:, 0]],
            front_of(task.member.character, task.joints),
        ),
        joints=metrics.joint_error(
            joints, truth, metrics.figure_height(task.member.character.mesh.vertices)
        ),
    )


def forward_of(
    joints: Float[np.ndarray, "joints 3"], pairs: Int[np.ndarray, "pairs 2"]
) -> Float[np.ndarray, "3"]:
    """Tell where a standing human looks, from its left and right joints: left x up."""
    left = (joints[pairs[:, 0]] - joints[pairs[:, 1]]).mean(axis=0)
    forward = np.cross(left, [0.0, 1.0, 0.0])
    return forward / np.linalg.norm(forward)


def describe(row: Row) -> str:
    """Put one row on one line."""
    degrees = ", ".join(f"{method} {value:.1f}" for method, value in row.degrees.items())
    flips = " MIRRORED" * row.mirrored + " TURNED BACK" * row.turned_back
    joints = "" if row.joints is None else f", joints {row.joints:.1f} %h, {row.seconds:.0f} s"
    failure = f", FAILED: {row.failure}" if row.failure else ""
    return f"{row.family} human>{row.figure}: {degrees} degrees{joints}{flips}{failure}"


def tabulate(rows: Sequence[Row]) -> Table:
    """Set the figures and their mean in a table."""

    def cells(row: Row) -> list[float | str]:
        own = [row.joints, row.confidence, row.seconds]
        flips = ["yes" if flip else "no" for flip in (row.mirrored, row.turned_back)]
        return [
            *(row.degrees.get(method, "failed") for method in METHODS),
            *flips,
            *("" if value is None else value for value in own),
        ]

    lines: list[list[float | str]] = [[f"{r.family}/{r.figure}", *cells(r)] for r in rows]
    means = [np.mean([r.degrees[m] for r in rows if m in r.degrees] or [np.nan]) for m in METHODS]
    flips = [str(sum(row.mirrored for row in rows)), str(sum(row.turned_back for row in rows))]
    lines.append([f"mean of {len(rows)}", *map(float, means), *flips])
    return make_table(
        "Built-in human to other figures: mean angle between their bones, degrees; flips of ours",
        ["figure", *METHODS, "mirrored", "turned back", "joints %h", "confidence", "s"],
        lines,
    )
