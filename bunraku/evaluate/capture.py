"""Table: film a character with a depth camera, capture it, let it move its own figure.

After Maheshwari et al. 2023, "Transfer4D", Table 1, on our own renderings: the figure is the whole
character as it stands in the first frame, before the same camera. Beside every number stands what
a frozen figure scores.
"""

import logging
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from rich.table import Table

from bunraku.evaluate import metrics
from bunraku.evaluate.capture_baselines import METHODS, OURS
from bunraku.evaluate.families import Member, choose_clips, plain_names, read_members, rigged_files
from bunraku.evaluate.rendering import VIEWS, Film, film_character, true_paths
from bunraku.evaluate.results import make_table
from bunraku.routes.from_depth import Capture, animate_from_depth
from bunraku.skinning import play_clip
from bunraku.types import Character, Clip, Mesh

logger = logging.getLogger(__name__)
CAMERAS = ("threequarter", "side")
PAPER = ("Transfer4D, 78 other clips: not comparable", 84, 0.37, 0.18)
Frames = Float[np.ndarray, "frames vertices 3"]


@dataclass(frozen=True)
class Row:
    """One clip before one camera; lengths at a bounding-box diagonal of 2."""

    family: str
    character: str
    clip: str
    camera: str
    frames: int = 0
    tracking: float | None = None  # mean distance of tracked vertices from the truth, all
    tracking_seen: float | None = None  # the same where they were seen
    tracking_static: float | None = None  # the same for a surface that stands still
    residual: float | None = None  # distance of depth to the tracked surface
    residual_static: float | None = None  # the same if it stood still
    embedded: float | None = None  # share of joints inside the figure
    error: float | None = None  # RE
    local: float | None = None  # LPE
    static: float | None = None  # RE of the frozen figure
    local_static: float | None = None
    warned: bool = False
    whole: bool = False  # the figure itself was followed, not the side that was seen
    tracking_seconds: float | None = None
    seconds: float | None = None
    failure: str = ""
    method: str = OURS

    def key(self) -> tuple[str, str, str, str, str]:
        """Tell this row from every other one of the table."""
        return self.family, self.character, self.clip, self.camera, self.method

    @property
    def ratio(self) -> float | None:
        """Give RE over that of a frozen figure; above 1 it were better not to move."""
        if self.error is None or not self.static:
            return None
        return self.error / self.static


@dataclass(frozen=True, eq=False)
class Task:
    """What one row measures."""

    family: str
    member: Member
    clip: Clip
    name: str
    camera: str
    frames: int
    method: str = OURS

    def key(self) -> tuple[str, str, str, str, str]:
        """Tell this row from every other one of the table."""
        return self.family, self.member.name, self.name, self.camera, self.method


def find_tasks(
    folder: Path,
    *,
    names: Sequence[str] = (),
    clip_count: int = 1,
    cameras: Sequence[str] = CAMERAS,
    frames: int = 45,
    methods: Sequence[str] = (OURS,),
) -> Iterator[Task]:
    """Find moving characters: for each, a few of its clips before a few cameras.

    Args:
        folder: characters, those of one family side by side.
        names: parts of `folder/Character:clip:camera` to keep, in any case; empty for all.
        clip_count: clips of each character, spread over the list; never its rest poses.
        methods: what is to be measured on each, of METHODS.
    """
    for parent, paths in rigged_files(folder).items():
        family = parent.relative_to(folder).as_posix()
        likely = [path for path in paths if may_hold(f"{family}/{path.stem}:", names)]
        for path, member in read_members(likely).items():
            if not len(member.character.mesh.faces):  # bones alone
                continue
            clips = {n: c for n, c in plain_names(member.character.clips).items() if moves(c)}
            chosen = sorted(clips) if names else spread(sorted(clips), clip_count)
            for name in chosen:
                for camera in VIEWS if names else cameras:
                    full = f"{family}/{path.stem}:{name}:{camera}".lower()
                    if not names or any(part.lower() in full for part in names):
                        task = Task(family, member, clips[name], name, camera, frames)
                        yield from (replace(task, method=method) for method in methods)


def may_hold(name: str, parts: Sequence[str]) -> bool:
    """Tell whether a character may have a wanted row, by what stands before the first colon."""
    heads = [part.partition(":")[0].lower() for part in parts if ":" in part]
    return len(heads) < len(parts) or not parts or any(head in name.lower() for head in heads)


def moves(clip: Clip) -> bool:
    """Tell whether a clip is a motion: three frames or more in which a joint turns visibly."""
    return len(clip.times) > 2 and float(np.ptp(clip.rotations, axis=0).max()) > 0.15


def spread(names: Sequence[str], count: int) -> list[str]:
    """Choose names evenly, a walk first: it is what most bodies do, and it crosses limbs."""
    gaits = [name for gait in ("walk", "run", "gallop") for name in names if gait in name]
    if len(names) < 2:
        return list(names)
    return (gaits[:1] + choose_clips(names, count)[0])[:count]


def measure(task: Task) -> Row:
    """Film, capture, move the figure, compare."""
    character = task.member.character
    film = film_character(character, task.clip, turn=VIEWS[task.camera], most_frames=task.frames)
    named = task.family, task.member.name, task.name, task.camera
    row = Row(*named, len(film.places), method=task.method)
    row = replace(
        row, **compare(np.broadcast_to(film.places[0], film.places.shape), film, "static")
    )
    started = time.perf_counter()
    try:
        capture = METHODS[task.method](film.video)
        row = replace(row, **judge_track(capture, film))
        figure = Mesh(film.places[0], film.faces)
        moved = animate_from_depth(capture, figure, force=True, whole=task.method == OURS)
    except (ValueError, np.linalg.LinAlgError) as error:
        logger.warning("%s %s: %s", task.member.path, task.name, error)
        return replace(row, failure=str(error))
    seconds = time.perf_counter() - started
    frames = at_times(moved.character, film.video.times)
    row = replace(row, **compare(frames, film, ""))
    warned = bool(capture.warnings or moved.warnings)
    found = moved.embedding.inside, moved.followed.whole
    return replace(row, embedded=found[0], whole=found[1], seconds=seconds, warned=warned)


def compare(frames: Frames, film: Film, kind: str) -> dict[str, Any]:
    """Give RE and LPE; the first frame's mean is put where it truly is."""
    frames = frames - (frames[0] - film.places[0]).mean(axis=0)
    error = metrics.reconstruction_error(frames, film.places)
    local = metrics.local_pose_error(frames, film.places)
    return {"static": error, "local_static": local} if kind else {"error": error, "local": local}


def at_times(character: Character, times: Float[np.ndarray, " frames"]) -> Frames:
    """Give the vertices at each time; a clip's nearest frame stands for it."""
    clip = character.clips[0]
    nearest = np.abs(clip.times[None] - times[:, None]).argmin(axis=1)
    return play_clip(character, clip, nearest)


def judge_track(capture: Capture, film: Film) -> dict[str, Any]:
    """Say how far the tracked surface is from where it truly went."""
    track = capture.track
    shown = np.abs(film.video.times[None] - capture.times[:, None]).argmin(axis=1)
    truth = true_paths(film, int(shown[track.reference]), capture.views[track.reference].pixels)
    truth = truth[shown]
    off = np.linalg.norm(track.places - truth, axis=-1)
    still = np.linalg.norm(truth - truth[track.reference], axis=-1)
    return {
        "tracking": float(off.mean()),
        "tracking_seen": float(off[track.visible].mean()),
        "tracking_static": float(still.mean()),
        "residual": float(track.residuals.mean()),
        "residual_static": float(track.still.mean()),
        "tracking_seconds": capture.seconds["tracking"] / max(1, len(capture.times)),
    }


def describe(row: Row) -> str:
    """Put one row on one line."""
    name = f"{row.family}/{row.character} {row.clip} {row.camera}"
    name += f", {row.method}" * (row.method != OURS)
    if row.failure:
        return f"{name}: FAILED: {row.failure}"
    track = f"tracking {row.tracking:.3f} (seen {row.tracking_seen:.3f}, still "
    track += f"{row.tracking_static:.3f})"
    figure = f"RE {row.error:.3f} LPE {row.local:.3f} (frozen {row.static:.3f} "
    figure += f"{row.local_static:.3f}), ratio {row.ratio:.2f}, embedded {row.embedded:.0%}"
    told = ", followed as a whole" * row.whole + ", WARNED" * row.warned
    return f"{name}: {track}, {figure}, {row.seconds:.0f} s{told}"


def tabulate(rows: Sequence[Row]) -> Table:
    """Set the means of each family, of all rows and of other methods beside the paper's."""
    ours = [row for row in rows if row.method == OURS]
    groups = {
        family: [row for row in ours if row.family == family]
        for family in dict.fromkeys(row.family for row in ours)
    }
    groups["all"] = ours
    for method in dict.fromkeys(row.method for row in rows if row.method != OURS):
        groups[f"all, {method}"] = [row for row in rows if row.method == method]
    lines: list[list[float | str]] = [[name, *_summary(group)] for name, group in groups.items()]
    paper, embedded, error, local = PAPER
    lines.append([paper, "", embedded, error, local])
    return make_table(
        "Self-transfer from one depth camera, diagonal 2; means over clips",
        [
            *("family", "clips", "joints embedded %", "RE", "LPE", "RE frozen", "LPE frozen"),
            *("RE/frozen", "worst", "<= .6 %", "> 1", "of these warned", "tracking", "seen"),
            *("tracking still", "s a frame", "s"),
        ],
        lines,
    )


def _summary(rows: Sequence[Row]) -> list[float | str]:
    """Average the rows of a group; a row that failed counts as one that moves nothing."""

    def mean(name: str) -> float:
        known = [value for row in rows if (value := getattr(row, name)) is not None]
        return float(np.mean(known)) if known else float("nan")

    ratios = np.array([1.0 if row.ratio is None else row.ratio for row in rows])
    failed = sum(bool(row.failure) for row in rows)
    worse = [row for row in rows if (row.ratio or 0.0) > 1]
    return [
        f"{len(rows)}" + (f" ({failed} failed)" if failed else ""),
        100 * mean("embedded"),
        *(mean(name) for name in ("error", "local", "static", "local_static")),
        float(ratios.mean()),
        float(ratios.max()),
        float(100 * (ratios <= 0.6).mean()),
        str(len(worse)),
        str(sum(row.warned for row in worse)),
        *(mean(name) for name in ("tracking", "tracking_seen", "tracking_static")),
        *(mean(name) for name in ("tracking_seconds", "seconds")),
    ]
