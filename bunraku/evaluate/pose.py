"""Table: pose transfer after [ZPT] Tables 1 to 3, on bodies and characters that may be used.

PMD and ELS of a figure in an avatar's poses, with simple ways of doing it beside ours. Nobody is
aligned to the truth. Baselines marked * are given the avatar's true rig; ours sees its surface.
"""

import logging
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Int
from rich.table import Table

from bunraku.evaluate import metrics
from bunraku.evaluate.baselines import nearest_vertex
from bunraku.evaluate.deformation_transfer import Frames, nearest_offset, transfer_deformation
from bunraku.evaluate.families import play_at
from bunraku.evaluate.part_truth import merge_spine
from bunraku.evaluate.pose_tasks import GROUPS, Task
from bunraku.evaluate.results import make_table
from bunraku.neural.parts import Reader, Understanding
from bunraku.routes.from_avatar import AvatarTransfer, animate_from_avatar
from bunraku.skinning import play_clip
from bunraku.types import Character, MatchError, Mesh

logger = logging.getLogger(__name__)
BASELINES = ("static", "nearest offset", "nearest skin*", "nearest triangles")
PAPER = ("paper", "paper adapted", "paper no volume")  # its form, trained here
METHODS = (*BASELINES, *PAPER, "network", "registration", "ours")
_OF_PAPER = ("paper parts", "paper s")


@runtime_checkable
class Answer(Protocol):
    """What the paper's form makes of a task."""

    @property
    def frames(self) -> dict[str, Frames]:
        """Give the figure's vertices in each pose, by row of PAPER."""

    @property
    def labels(self) -> Int[np.ndarray, " vertices"]:
        """Give the part of each of the figure's vertices."""

    @property
    def seconds(self) -> float:
        """Give how long it took, test-time training included."""


Understood = tuple[Mesh, Understanding]
Paper = Callable[[Understood, Frames, Understood], Answer]


@dataclass(frozen=True)
class Scores:
    """How far a posed figure is from the truth, mean over poses."""

    pmd: float
    els: float


@dataclass(frozen=True)
class Row:
    """One avatar and one figure."""

    group: str
    name: str
    seed: int
    scores: dict[str, Scores] = field(default_factory=dict)  # by method
    kind: str = ""  # what the avatar was taken for
    chosen: str = ""  # who the route believed
    parts: float | None = None  # share of vertices in the right part, by the network
    confidence: float | None = None
    strain: float | None = None  # of the registration
    agreement: float | None = None  # of the network with itself
    seconds: float | None = None  # first pose, both surfaces included
    pose_ms: float | None = None  # each further pose
    paper_parts: float | None = None  # share of vertices in the right part, by the paper's form
    paper_seconds: float | None = None  # with test-time training, all poses
    failure: str = ""

    def key(self) -> tuple[str, str, int]:
        """Tell this row from every other one of the table."""
        return self.group, self.name, self.seed


def measure(task: Task, *, read: Reader, paper: Mapping[str, Paper] | None = None) -> Row:
    """Pose one figure in every way and compare it with the truth.

    Args:
        read: who understands figures.
        paper: the paper's form by kind, for its rows.
    """
    avatar, moved = task.avatar, baselines(task)
    row = Row(*task.key(), scores=score(moved, task))
    started = time.perf_counter()
    try:
        transfer = animate_from_avatar(read, avatar.mesh, task.poses, task.figure, force=True)
    except (MatchError, ValueError, np.linalg.LinAlgError) as error:
        return Row(*task.key(), scores=row.scores, failure=str(error))
    seconds = time.perf_counter() - started
    started = time.perf_counter()
    moved = {"ours": _play(transfer.character)}
    pose_ms = 1000 * (time.perf_counter() - started) / len(task.poses)
    moved["network"] = _play(transfer.learned)
    if transfer.registered is not None:
        moved["registration"] = _play(transfer.registered.character)
    if (answered := ask_paper(task, transfer, paper or {})) is not None:
        moved |= answered.frames
    return Row(
        *task.key(),
        scores=row.scores | score(moved, task),
        kind=transfer.avatar.kind,
        chosen=transfer.chosen,
        parts=part_accuracy(transfer.figure.labels, transfer, task),
        confidence=transfer.confidence,
        strain=transfer.registered.score if transfer.registered else None,
        agreement=transfer.figure.agreement,
        seconds=seconds,
        pose_ms=pose_ms,
        paper_parts=part_accuracy(answered.labels, transfer, task) if answered else None,
        paper_seconds=answered.seconds if answered else None,
    )


def ask_paper(task: Task, transfer: AvatarTransfer, paper: Mapping[str, Paper]) -> Answer | None:
    """Ask the paper's form of the avatar's kind, if it is there and takes these surfaces."""
    form = paper.get(transfer.avatar.kind)
    if form is None:
        return None
    avatar = task.avatar.mesh, transfer.avatar
    try:
        return form(avatar, task.poses, (task.figure, transfer.figure))
    except (ValueError, np.linalg.LinAlgError) as error:
        logger.warning("%s seed %d: no rows of the paper's form: %s", task.name, task.seed, error)
        return None


def baselines(task: Task) -> dict[str, Frames]:
    """Move the figure in the simple ways."""
    avatar, poses, figure = task.avatar.mesh, task.poses, task.figure
    rigged = nearest_vertex(task.avatar, figure, task.avatar.clips)
    phases = task.phases
    carried = [
        play_clip(rigged, clip) if phases is None else play_at(rigged, clip, phases)
        for clip in rigged.clips
    ]
    return {
        "static": np.broadcast_to(figure.vertices, task.truth.shape),
        "nearest offset": nearest_offset(avatar, poses, figure),
        "nearest skin*": np.concatenate(carried),
        "nearest triangles": transfer_deformation(avatar, poses, figure),
    }


def _play(character: Character) -> Frames:
    return play_clip(character, character.clips[0])


def score(moved: Mapping[str, Frames], task: Task) -> dict[str, Scores]:
    """Compare moved figures with the truth."""
    height = metrics.figure_height(task.figure.vertices)
    return {
        method: Scores(
            metrics.pose_distance(frames, task.truth, height),
            metrics.edge_length_score(frames, task.truth, task.figure.faces),
        )
        for method, frames in moved.items()
    }


def part_accuracy(
    labels: Int[np.ndarray, " vertices"], transfer: AvatarTransfer, task: Task
) -> float | None:
    """Give the share of vertices that are put into their true part."""
    if task.parts is None or transfer.figure.kind != transfer.avatar.kind:
        return None
    if task.group == "real people":
        labels = merge_spine(labels, task.present)
    return float((labels == task.parts).mean())


def describe(row: Row) -> str:
    """Put one row on one line."""
    numbers = ", ".join(f"{m} {s.pmd:.2f}/{s.els:.3f}" for m, s in row.scores.items())
    parts = "" if row.parts is None else f", parts {row.parts:.1%}"
    told = f", {row.kind} by {row.chosen}, {row.seconds:.1f} s" if row.chosen else ""
    failure = f", FAILED: {row.failure}" if row.failure else ""
    return f"{row.group} {row.name} seed {row.seed}: {numbers}{parts}{told}{failure}"


def tabulate(rows: Sequence[Row]) -> Table:
    """Set the mean of each group in a table: PMD / ELS of every method."""
    lines = []
    for group in GROUPS:
        some = [row for row in rows if row.group == group]
        if some:
            lines.append([group, str(len(some)), *_summary(some)])
    columns = ("group", "rows", *METHODS, "worst", "parts", "worst", "s", "ms/pose", *_OF_PAPER)
    title = "Pose transfer, mean over rows: PMD (cm at 1 m) / ELS; * is given the avatar's true rig"
    return make_table(title, columns, lines)


def _summary(rows: Sequence[Row]) -> list[str]:
    """Average the rows of a group."""
    cells = []
    for method in METHODS:
        scores = [row.scores[method] for row in rows if method in row.scores]
        pmd, els = _mean(s.pmd for s in scores), _mean(s.els for s in scores)
        cells.append(f"{pmd:.2f} / {els:.3f}" if scores else "-")
    ours = [row.scores["ours"].pmd for row in rows if "ours" in row.scores]
    parts = [row.parts for row in rows if row.parts is not None]
    failed = sum(bool(row.failure) for row in rows)
    cells.append(f"{max(ours, default=np.nan):.2f}" + (f" ({failed} failed)" if failed else ""))
    cells += [f"{_mean(parts):.1%}", f"{min(parts):.1%}"] if parts else ["-", "-"]
    seconds = _mean(row.seconds for row in rows if row.seconds is not None)
    cells += [f"{seconds:.1f}", f"{_mean(r.pose_ms for r in rows if r.pose_ms):.1f}"]
    parts = [row.paper_parts for row in rows if row.paper_parts is not None]
    cells.append(f"{_mean(parts):.1%}" if parts else "-")
    spent = [row.paper_seconds for row in rows if row.paper_seconds is not None]
    return [*cells, f"{_mean(spent):.1f}" if spent else "-"]


def _mean(values: Iterable[float]) -> float:
    known = list(values)
    return float(np.mean(known)) if known else float("nan")
