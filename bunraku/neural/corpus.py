"""The corpus that the shape network learns from: made from seeds, kept in the user's cache folder.

corpus = load_corpus(folder, size=DEFAULT_SIZE, seed=0)
cloud = draw_variant(corpus, rng)
"""

import hashlib
import logging
import os
from collections.abc import Callable
from dataclasses import astuple, dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float16, Float32, Int

from bunraku.neural.accessories import dress_up
from bunraku.neural.anatomy import ANATOMIES
from bunraku.neural.bodies import Body, Cloud, check_body, sample_cloud
from bunraku.neural.people import build_people
from bunraku.neural.sculpted_people import sculpt_person
from bunraku.neural.sculpted_quadrupeds import HELD_OUT, SPECIES, sculpt_quadruped
from bunraku.neural.variation import vary, vary_body

logger = logging.getLogger(__name__)
MOST_PARTS = max(len(anatomy.names) for anatomy in ANATOMIES.values())
KINDS = tuple(ANATOMIES)
BUILD = 3  # raised with every change of what is built
_STORED = 1536  # points of each body, of which variants draw


@dataclass(frozen=True)
class Size:
    """How many bodies of each family are made; people are dressed `outfits` times."""

    people: int = 300
    outfits: int = 4
    sculpted: int = 900
    quadrupeds: int = 1100


@dataclass(frozen=True, eq=False)
class Corpus:
    """Clouds of all bodies, in flat arrays."""

    kinds: Int[np.ndarray, " bodies"]  # index into KINDS
    points: Float32[np.ndarray, "bodies points 3"]
    normals: Float32[np.ndarray, "bodies points 3"]
    weights: Float16[np.ndarray, "bodies points parts"]  # MOST_PARTS columns
    joints: Float32[np.ndarray, "bodies parts 3"]


def default_folder() -> Path:
    """Give the user's cache folder for what training makes."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "bunraku"


def load_corpus(folder: Path, size: Size, seed: int) -> Corpus:
    """Read the corpus of these numbers from a folder, or build it and keep it there.

    Raises:
        ModuleNotFoundError: if people are wanted and anny is not there.
    """
    made_by = anny_version() if size.people else "none"
    key = repr((BUILD, astuple(size), seed, _STORED, np.__version__, made_by))
    return Corpus(**keep_arrays(folder, "corpus", key, lambda: vars(build_corpus(size, seed))))


def keep_arrays(
    folder: Path, name: str, key: str, build: Callable[[], dict[str, np.ndarray]]
) -> dict[str, np.ndarray]:
    """Read arrays from a folder, or build them and keep them there.

    Args:
        folder: made if it is not there.
        name: with which the file's name begins.
        key: all that the arrays depend on.
    """
    path = folder / f"{name}-{hashlib.sha256(key.encode()).hexdigest()[:16]}.npz"
    if path.is_file():
        with np.load(path, allow_pickle=False) as stored:
            return dict(stored)
    arrays = build()
    folder.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(f".{os.getpid()}.unfinished")
    with unfinished.open("wb") as stream:
        np.savez(stream, **arrays)  # type: ignore[arg-type]
    unfinished.replace(path)
    return arrays


def anny_version() -> str:
    """Give the version of anny, of which the bodies depend; "none" without it."""
    try:
        return version("anny")
    except PackageNotFoundError:
        return "none"


def build_corpus(size: Size, seed: int) -> Corpus:
    """Make all bodies, check them, and draw points from each.

    Raises:
        AssertionError: if a body is not what it claims to be.
    """
    rng = np.random.default_rng([seed, BUILD])
    bodies: list[Body] = []
    if size.people:
        people = build_people(size.people, rng)
        bodies += [dress_up(body, rng) for body in people for _ in range(size.outfits)]
    logger.info("sculpted bodies")
    bodies += [draw_sculpted("rounded", rng) for _ in range(size.sculpted)]
    species = sorted(set(SPECIES) - set(HELD_OUT))
    bodies += [draw_sculpted(species[i % len(species)], rng) for i in range(size.quadrupeds)]
    for body in bodies:
        check_body(body)
    logger.info("points of bodies")
    return pack([sample_cloud(body, _STORED, rng) for body in bodies])


def draw_sculpted(family: str, rng: np.random.Generator) -> Body:
    """Draw a dressed body of a sculpted family, of FAMILIES of people or a species, to size 1."""
    make = partial(sculpt_quadruped if family in SPECIES else sculpt_person, family)
    body = dress_up(make(rng), rng)
    return vary_body(body, np.tile(np.eye(3), (len(body.joints), 1, 1)))


def pack(clouds: list[Cloud]) -> Corpus:
    """Put clouds into flat arrays."""
    count = len(clouds)
    weights = np.zeros((count, len(clouds[0].points), MOST_PARTS), np.float16)
    joints = np.zeros((count, MOST_PARTS, 3), np.float32)
    for row, cloud in enumerate(clouds):
        weights[row, :, : cloud.weights.shape[1]] = cloud.weights
        joints[row, : len(cloud.joints)] = cloud.joints
    return Corpus(
        np.array([KINDS.index(cloud.kind) for cloud in clouds], np.int64),
        np.stack([cloud.points for cloud in clouds]).astype(np.float32),
        np.stack([cloud.normals for cloud in clouds]).astype(np.float32),
        weights,
        joints,
    )


def draw_variant(corpus: Corpus, count: int, rng: np.random.Generator) -> Cloud:
    """Draw a body, some of its points, and a variant of it; denser here than there."""
    row = int(rng.integers(len(corpus.kinds)))
    kind = KINDS[int(corpus.kinds[row])]
    parts = len(ANATOMIES[kind].names)
    chosen = rng.choice(len(corpus.points[row]), count, p=_density(corpus.points[row], rng))
    cloud = Cloud(
        kind,
        corpus.points[row, chosen].astype(np.float64),
        corpus.normals[row, chosen].astype(np.float64),
        corpus.weights[row, chosen, :parts].astype(np.float64),
        corpus.joints[row, :parts].astype(np.float64),
    )
    return vary(cloud, rng)


def _density(
    points: Float32[np.ndarray, "points 3"], rng: np.random.Generator
) -> Float[np.ndarray, " points"]:
    """Draw how likely each point is: alike, or up to a few times more along some direction."""
    slope = points.astype(np.float64) @ rng.normal(0, 0.8, 3)
    chance = np.exp(slope - slope.max())
    return chance / chance.sum()
