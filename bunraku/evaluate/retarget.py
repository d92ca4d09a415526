"""Table: strip one character of a family, animate it with another, compare with its own clip."""

import logging
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from rich.table import Table

from bunraku.evaluate import metrics
from bunraku.evaluate.baselines import nearest_vertex, own_rig
from bunraku.evaluate.families import (
    Member,
    bind_joints,
    can_teach,
    choose_clips,
    common_clips,
    freeze,
    motion_at,
    plain_names,
    play_at,
    read_members,
    rigged_files,
    strip,
)
from bunraku.evaluate.results import make_table
from bunraku.routes.from_rig import animate_from_rig
from bunraku.skinning import linear_blend_skinning
from bunraku.types import Character, Clip, Mesh

logger = logging.getLogger(__name__)
METHODS = ("static", "nearest vertex", "own rig", "ours")
IN_PLACE = ("in place: nearest", "ours", "ratio", "worst")
Frames = Float[np.ndarray, "frames vertices 3"]


@dataclass(frozen=True)
class Scores:
    """How far a moving figure is from its own clip, mean over clips."""

    pmd: float
    pmd_in_place: float  # without the mean displacement of each frame
    els: float


@dataclass(frozen=True)
class Row:
    """One pair of characters, the figure at rest or frozen in a clip."""

    family: str
    source: str
    target: str
    pose: str  # "rest", or the plain name of the clip in whose middle the figure is frozen
    clips: tuple[str, ...]
    scores: dict[str, Scores] = field(default_factory=dict)  # by method
    joints: float | None = None  # of ours, per cent of height
    weights: float | None = None  # of ours, mean over joints
    confidence: float | None = None
    seconds: float | None = None
    failure: str = ""

    def key(self) -> tuple[str, str, str, str, tuple[str, ...]]:
        """Tell this row from every other one of the table."""
        return self.family, self.source, self.target, self.pose, self.clips


@dataclass(frozen=True, eq=False)
class Task:
    """What one row measures."""

    source: Member
    target: Member
    family: str
    clips: tuple[str, ...]
    frozen: str | None  # plain name of the clip the figure is frozen in

    def key(self) -> tuple[str, str, str, str, tuple[str, ...]]:
        """Tell this row from every other one of the table."""
        pose = self.frozen or "rest"
        return self.family, self.source.name, self.target.name, pose, self.clips


def find_tasks(
    folder: Path, *, pairs: Sequence[str] = (), clip_count: int | None = 3
) -> Iterator[Task]:
    """Find the pairs of a data folder whose truth is known, at rest and frozen.

    Args:
        folder: characters, those of one family side by side.
        pairs: parts of `folder/Source>Target` to keep, in any case; empty for all.
        clip_count: clips to compare in each pair; None for all but the one frozen in.
    """
    for parent, paths in rigged_files(folder).items():
        family = parent.relative_to(folder).as_posix()
        wanted = [
            (source, target)
            for source in paths
            for target in paths
            if source != target and _is_wanted(f"{family}/{source.stem}>{target.stem}", pairs)
        ]
        members = read_members(sorted({path for pair in wanted for path in pair}))
        for source, target in wanted:
            if source in members and target in members:
                yield from _pair_tasks(members[source], members[target], family, clip_count)


def _is_wanted(name: str, pairs: Sequence[str]) -> bool:
    """Tell whether a pair's name holds one of the wanted parts."""
    return not pairs or any(part.lower() in name.lower() for part in pairs)


def _pair_tasks(
    source: Member, target: Member, family: str, clip_count: int | None
) -> Iterator[Task]:
    """Give the rows of one pair: the target at rest, and frozen in a clip not compared."""
    if not can_teach(source.character, target.character):
        return
    names = common_clips(source.character, target.character)
    compared, other = choose_clips(names, clip_count or len(names))
    if compared:
        yield Task(source, target, family, tuple(compared), None)
    if compared and other:
        yield Task(source, target, family, tuple(compared), other)


def measure(task: Task, *, frame_count: int = 8, seed: int = 0) -> Row:
    """Animate one stripped figure in every way and compare it with its own clips.

    A figure whose match the route doubts is forced; one on which it fails has no row "ours".
    """
    source, target = task.source.character, task.target.character
    clips = tuple(plain_names(source.clips)[name] for name in task.clips)
    copied = own_rig(source, target, clips)
    own_clips = plain_names(target.clips) or dict(zip(task.clips, copied.clips, strict=True))
    frozen = _frozen_clip(task, own_clips)
    figure = freeze(target, frozen) if frozen else strip(target)
    phases = np.linspace(0, 1, frame_count)
    truth = [play_at(target, own_clips[name], phases) for name in task.clips]
    moved = {
        "static": [np.broadcast_to(figure.vertices, frames.shape) for frames in truth],
        "nearest vertex": _play(nearest_vertex(source, figure, clips), phases),
        "own rig": _play(copied, phases),
    }
    # the clip that the figure is frozen in must not suggest its pose
    others = {name: clip for name, clip in plain_names(source.clips).items() if name != task.frozen}
    teacher = replace(source, clips=tuple(others.values()))
    started = time.perf_counter()
    try:
        result = animate_from_rig(teacher, figure, clips=clips, seed=seed, force=True)
    except (ValueError, np.linalg.LinAlgError) as error:
        logger.warning("%s: %s", " ".join(task.key()[:3]), error)
        return _row(task, _score_all(moved, truth, target.mesh), failure=str(error))
    seconds = time.perf_counter() - started
    moved["ours"] = _play(result.character, phases)
    return replace(
        _row(task, _score_all(moved, truth, target.mesh)),
        joints=_joint_error(result.character, target, frozen),
        weights=_weight_error(result.character, target),
        confidence=result.confidence,
        seconds=seconds,
    )


def _row(task: Task, scores: dict[str, Scores], *, failure: str = "") -> Row:
    """Write down what was measured of a task."""
    return Row(*task.key(), scores=scores, failure=failure)


def _frozen_clip(task: Task, own_clips: Mapping[str, Clip]) -> Clip | None:
    """Give the target's clip to freeze it in, if any; by joint name if it has none of its own."""
    if not task.frozen or task.frozen in own_clips:
        return own_clips.get(task.frozen or "")
    source, target = task.source.character, task.target.character
    return own_rig(source, target, (plain_names(source.clips)[task.frozen],)).clips[0]


def _play(character: Character, phases: Float[np.ndarray, " frames"]) -> list[Frames]:
    """Give the vertices of each clip at the sampled moments."""
    return [play_at(character, clip, phases) for clip in character.clips]


def _score_all(
    moved: Mapping[str, list[Frames]], truth: list[Frames], rest: Mesh
) -> dict[str, Scores]:
    """Score every way of moving the figure, mean over clips."""
    height = metrics.figure_height(rest.vertices)
    scores = {}
    for method, clips in moved.items():
        each = [
            (
                metrics.pose_distance(frames, goal, height),
                metrics.pose_distance_in_place(frames, goal, height),
                metrics.edge_length_score(frames, goal, rest.faces),
            )
            for frames, goal in zip(clips, truth, strict=True)
        ]
        scores[method] = Scores(*(float(value) for value in np.mean(each, axis=0)))
    return scores


def _joint_error(found: Character, target: Character, frozen: Clip | None) -> float:
    """Compare joint positions in the figure's own pose, by name, where the target has skin."""
    truth = bind_joints(target)
    if frozen:
        motion = motion_at(target, frozen, np.array([0.5]))[0]
        truth = linear_blend_skinning(truth, np.eye(len(truth)), motion)
    ours, theirs = _common_joints(found, target)
    heavy = target.skin.weights.sum(axis=0)[theirs] > 2e-4 * len(target.mesh.vertices)
    height = metrics.figure_height(target.mesh.vertices)
    return metrics.joint_error(bind_joints(found)[ours[heavy]], truth[theirs[heavy]], height)


def _weight_error(found: Character, target: Character) -> float:
    """Compare skinning weights by joint name, mean over the joints both have."""
    ours, theirs = _common_joints(found, target)
    error = metrics.weight_error(found.skin.weights[:, ours], target.skin.weights[:, theirs])
    return float(error.mean())


def _common_joints(
    found: Character, target: Character
) -> tuple[Int[np.ndarray, " common"], Int[np.ndarray, " common"]]:
    """Number the joints that two characters share by name, in each."""
    place = {name: i for i, name in enumerate(found.skeleton.names)}
    theirs = [i for i, name in enumerate(target.skeleton.names) if name in place]
    ours = [place[target.skeleton.names[i]] for i in theirs]
    return np.array(ours, np.int64), np.array(theirs, np.int64)


def describe(row: Row) -> str:
    """Put one row on one line."""
    numbers = ", ".join(
        f"{method} {scores.pmd:.2f}/{scores.pmd_in_place:.2f}/{scores.els:.2f}"
        for method, scores in row.scores.items()
    )
    joints = "" if row.joints is None else f", joints {row.joints:.1f} %h, {row.seconds:.0f} s"
    failure = f", FAILED: {row.failure}" if row.failure else ""
    return f"{row.family} {row.source}>{row.target} {row.pose}: {numbers}{joints}{failure}"


def tabulate(rows: Sequence[Row]) -> Table:
    """Set the means of each family, at rest and frozen, and of all rows, in a table.

    Rows in which source and target play about the same motion are averaged once more apart.
    """
    groups = {
        f"{family} {kind}": [
            row for row in rows if row.family == family and (row.pose == "rest") == (kind == "rest")
        ]
        for family in dict.fromkeys(row.family for row in rows)
        for kind in ("rest", "frozen")
    }
    for kind in ("rest", "frozen"):
        of_kind = [row for row in rows if (row.pose == "rest") == (kind == "rest")]
        groups[f"all {kind}"] = of_kind
        groups[f"of these, clips alike: {kind}"] = [row for row in of_kind if clips_are_alike(row)]
    groups["all"] = list(rows)
    lines = [[name, *_summary(group)] for name, group in groups.items() if group]
    return make_table(
        "PMD (cm at 1 m), the same with each frame's mean displacement out, ELS; means over rows",
        ("family", "rows", *METHODS, "ratio", *IN_PLACE, "ELS nearest", "ours", "joints %h", "s"),
        lines,
    )


def clips_are_alike(row: Row, *, share: float = 0.25) -> bool:
    """Tell whether source and target play about the same motion, so that a score means something.

    They do if the source's clip on the target's own rig errs at most this share of the baseline.
    """
    return row.scores["own rig"].pmd <= share * row.scores["nearest vertex"].pmd


def _summary(rows: Sequence[Row]) -> list[float | str]:
    """Average the rows of a group; rows that failed count for the baselines alone."""

    def mean(values: Iterable[float | None]) -> float:
        known = [value for value in values if value is not None]
        return float(np.mean(known)) if known else float("nan")

    def score(method: str, name: str) -> list[float]:
        return [getattr(row.scores[method], name) for row in rows if method in row.scores]

    failed = sum(bool(row.failure) for row in rows)
    ours, nearest = score("ours", "pmd_in_place"), score("nearest vertex", "pmd_in_place")
    return [
        f"{len(rows)}" + (f" ({failed} failed)" if failed else ""),
        *(mean(score(method, "pmd")) for method in METHODS),
        mean(score("ours", "pmd")) / mean(score("nearest vertex", "pmd")),
        mean(nearest),
        mean(ours),
        mean(ours) / mean(nearest),
        max(ours, default=float("nan")),
        mean(score("nearest vertex", "els")),
        mean(score("ours", "els")),
        mean(row.joints for row in rows),
        mean(row.seconds for row in rows),
    ]
