"""Table: a filmed character moves another one of its kind; do that one's bones go its own way?

Both have a clip of the same name. The other stands as its own clip begins and is moved by the film
alone; its own clip is the truth. Counted are limbs that the camera saw on the performer.
"""

import logging
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from rich.table import Table

from bunraku.evaluate import metrics
from bunraku.evaluate.capture import CAMERAS, at_times, moves
from bunraku.evaluate.families import (
    Member,
    can_teach,
    common_clips,
    plain_names,
    play_at,
    read_members,
    rigged_files,
)
from bunraku.evaluate.rendering import (
    VIEWS,
    Film,
    film_character,
    filmed_phases,
    vertex_visibility,
    view_from,
)
from bunraku.evaluate.results import make_table
from bunraku.routes.from_depth import animate_from_depth, capture_performer
from bunraku.types import Character, Clip, Mesh

logger = logging.getLogger(__name__)
SEEN = 0.2  # share of a limb's surface and time in sight: one that faces the camera shows half
LEAST = 0.005  # of all vertices: a bone that moves less has no direction that shows
TOUCHING = 1e-3  # the same of the surface that it shares with its parent
UNSEEN = "no bone was seen"
Frames = Float[np.ndarray, "frames vertices 3"]


@dataclass(frozen=True)
class Row:
    """One performer filmed from one side, moving one figure; angles in degrees."""

    family: str
    performer: str
    figure: str
    clip: str
    camera: str
    frames: int = 0
    bones: int = 0  # that were seen, and that both have
    angle: float | None = None  # mean between where they point and where they should
    angle_static: float | None = None  # the same for a figure that stands still
    warned: bool = False
    seconds: float | None = None
    failure: str = ""

    def key(self) -> tuple[str, str, str, str, str]:
        """Tell this row from every other one of the table."""
        return self.family, self.performer, self.figure, self.clip, self.camera


@dataclass(frozen=True, eq=False)
class Task:
    """What one row measures."""

    family: str
    performer: Member
    figure: Member
    name: str
    camera: str

    def key(self) -> tuple[str, str, str, str, str]:
        """Tell this row from every other one of the table."""
        names = self.performer.name, self.figure.name
        return self.family, names[0], names[1], self.name, self.camera


def find_tasks(
    folder: Path, *, names: Sequence[str] = (), cameras: Sequence[str] = CAMERAS
) -> Iterator[Task]:
    """Pair each character with the next of its family that has a clip of the same name.

    Args:
        folder: characters, those of one family side by side.
        names: parts of `folder/Performer>Figure:clip:camera` to keep, in any case; empty for all.
    """
    for parent, paths in rigged_files(folder).items():
        family = parent.relative_to(folder).as_posix()
        if not any(may_perform(f"{family}/{path.stem}", names) for path in paths):
            continue
        members = list(read_members(paths).values())
        for place, performer in enumerate(members):
            others = members[place + 1 :] + members[:place]
            pairs = (other for other in others if performs_alike(performer, other))
            other = next(pairs, None)
            if other is None:
                continue
            clip = shared_clip(performer, other)
            for camera in cameras:
                full = f"{family}/{performer.name}>{other.name}:{clip}:{camera}".lower()
                if not names or any(part.lower() in full for part in names):
                    yield Task(family, performer, other, clip, camera)


def may_perform(name: str, parts: Sequence[str]) -> bool:
    """Tell whether a character may be the performer of a wanted pair, before files are read."""
    heads = [part.partition(">")[0].lower() for part in parts if ">" in part]
    alone = [part.partition(":") for part in parts if ">" not in part]  # a figure's, or a clip
    loose = any(not (colon and "/" in head) for head, colon, _ in alone)  # else of the other table
    return not parts or loose or any(head in name.lower() for head in heads)


def performs_alike(performer: Member, other: Member) -> bool:
    """Tell whether both have a moving clip of the same name on the same joints."""
    ours, theirs = performer.character, other.character
    return bool(theirs.clips) and can_teach(ours, theirs) and bool(shared_clip(performer, other))


def shared_clip(performer: Member, other: Member) -> str:
    """Name the clip that a pair is compared on, a walk if they have one; "" for none."""
    clips = plain_names(performer.character.clips)
    both = common_clips(performer.character, other.character)
    moving = [name for name in both if moves(clips[name])]
    return next((n for gait in ("walk", "run", "") for n in moving if gait in n), "")


def measure(task: Task) -> Row:
    """Film one character, let the film move the other, compare bones."""
    source, target = task.performer.character, task.figure.character
    clip = plain_names(source.clips)[task.name]
    truth = true_motion(target, plain_names(target.clips)[task.name], clip, task.camera)
    film = film_character(source, clip, turn=VIEWS[task.camera])
    row = Row(*task.key(), frames=len(truth))
    started = time.perf_counter()
    try:
        capture = capture_performer(film.video)
        moved = animate_from_depth(capture, Mesh(truth[0], target.mesh.faces), force=True)
    except (ValueError, np.linalg.LinAlgError) as error:
        logger.warning("%s > %s: %s", task.performer.path, task.figure.path, error)
        return replace(row, failure=str(error))
    seconds = time.perf_counter() - started
    frames = at_times(moved.character, film.video.times)
    shown = seen_joints(source, film)
    kept = np.array([shown.get(name, False) for name in target.skeleton.names])
    ours, theirs, still = (
        bone_directions(places, target.skin.weights, target.skeleton.parents, kept)
        for places in (frames, truth, np.broadcast_to(truth[0], truth.shape))
    )
    if not theirs.shape[1]:
        return replace(row, failure=UNSEEN, seconds=seconds)
    return replace(
        row,
        bones=theirs.shape[1],
        angle=metrics.bone_direction_error(ours, theirs),
        angle_static=metrics.bone_direction_error(still, theirs),
        warned=bool(capture.warnings or moved.warnings),
        seconds=seconds,
    )


def true_motion(target: Character, clip: Clip, filmed: Clip, camera: str) -> Frames:
    """Move a figure by its own clip in step with a filmed one, before the same camera."""
    return view_from(play_at(target, clip, filmed_phases(filmed)), VIEWS[camera])[0]


def seen_joints(source: Character, film: Film) -> dict[str, bool]:
    """Tell which joints' surface the camera saw, by name."""
    seen = [
        vertex_visibility(places, depth.astype(np.float64), film.video.intrinsics)
        for places, depth in zip(film.places, film.video.depths, strict=True)
    ]
    weights = source.skin.weights
    share = np.mean(seen, axis=0) @ weights / np.maximum(weights.sum(axis=0), 1e-9)
    return dict(zip(source.skeleton.names, (share > SEEN).tolist(), strict=True))


def bone_directions(
    places: Frames,
    weights: Float[np.ndarray, "vertices joints"],
    parents: Int[np.ndarray, " joints"],
    kept: Bool[np.ndarray, " joints"],
) -> Float[np.ndarray, "frames bones 3"]:
    """Read off a moving surface where its bones point: from the border with the parent outwards.

    The joint is the middle of the surface that bone and parent share, the end the middle of its
    own; bones without a parent, or hardly any surface, are left out. So a figure is judged by how
    it looks, whatever skeleton moves it.
    """
    shared = np.sqrt(weights * weights[:, parents]) * (parents >= 0)
    large = weights.mean(axis=0) > LEAST
    chosen = np.flatnonzero(kept & large & (shared.mean(axis=0) > TOUCHING))
    border, own = (part[:, chosen] / part[:, chosen].sum(axis=0) for part in (shared, weights))
    return np.einsum("vb,fva->fba", own - border, places)


def describe(row: Row) -> str:
    """Put one row on one line."""
    name = f"{row.family}/{row.performer} > {row.figure} {row.clip} {row.camera}"
    if row.failure or row.angle is None:  # as rows of earlier versions, kept as null, may be
        return f"{name}: FAILED: {row.failure or UNSEEN}"
    angles = f"{row.angle:.1f} degrees (still {row.angle_static:.1f}) on {row.bones} seen bones"
    return f"{name}: {angles}, {row.seconds:.0f} s{', WARNED' * row.warned}"


def tabulate(rows: Sequence[Row]) -> Table:
    """Set the mean of each family and of all rows in a table."""
    groups = {
        family: [row for row in rows if row.family == family]
        for family in dict.fromkeys(row.family for row in rows)
    }
    groups["all"] = list(rows)
    return make_table(
        "Another character of the kind, moved by one depth camera: angle of bones that were seen",
        ["family", "pairs", "degrees", "worst", "standing still", "<= 15 %", "warned"],
        [[name, *_summary(group)] for name, group in groups.items()],
    )


def _summary(rows: Sequence[Row]) -> list[float | str]:
    """Average the rows of a group; those that failed are counted, and in no mean."""
    angles = np.array([row.angle for row in rows if row.angle is not None])
    still = [row.angle_static for row in rows if row.angle_static is not None]
    failed = len(rows) - len(angles)
    counted = f"{len(rows)}" + (f" ({failed} failed)" if failed else "")
    if not len(angles):
        return [counted, *[float("nan")] * 4, ""]
    within = 100 * float((angles <= 15).mean())
    warned = str(sum(row.warned for row in rows))
    return [counted, angles.mean(), angles.max(), float(np.mean(still)), within, warned]
