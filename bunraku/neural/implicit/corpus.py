"""What the paper's form learns from: bodies with parts, figures at rest with occupancy alone.

As many of each as in the paper [ZPT 4.1], from families that may be used: of people 40 bodies of
`anny`, and 600 stylised ones; of quadrupeds 34 sculpted cats, dogs and horses, and 81 others.
"""

import hashlib
import logging
from dataclasses import astuple, dataclass
from pathlib import Path

import igl
import numpy as np
from jaxtyping import Bool, Float32, Int

from bunraku.meshes import interpolate, sample_surface
from bunraku.neural.accessories import dress_up
from bunraku.neural.anatomy import PERSON
from bunraku.neural.bodies import Body, check_body, sample_cloud
from bunraku.neural.corpus import BUILD, anny_version, draw_sculpted, keep_arrays
from bunraku.neural.known_poses import FALL, known_turns, stance
from bunraku.neural.people import build_people
from bunraku.neural.sculpted_quadrupeds import HELD_OUT, SPECIES
from bunraku.neural.variation import arm_turns, chain_turns, scale_parts, vary_body
from bunraku.types import Character, Mesh

logger = logging.getLogger(__name__)
LABELLED_SPECIES = ("cat", "dog", "horse")
SURFACE, NEAR, FAR = 1536, 3000, 1000  # points of each shape: on it, about it, in its box
NOISE, MARGIN = 0.03, 0.05  # of points about it; of the box


@dataclass(frozen=True)
class Size:
    """How many shapes of a kind."""

    kind: str = "person"
    labelled: int = 40
    unlabelled: int = 600


SIZES = {"person": Size(), "quadruped": Size("quadruped", 34, 81)}


@dataclass(frozen=True, eq=False)
class ImplicitCorpus:
    """All shapes of one kind, those with parts first; each of size 1 about its middle."""

    queries: Float32[np.ndarray, "shapes queries 3"]
    inside: Bool[np.ndarray, "shapes queries"]
    surface: Float32[np.ndarray, "shapes surface 3"]
    weights: Float32[np.ndarray, "labelled surface parts"]
    joints: Float32[np.ndarray, "labelled parts 3"]
    stances: Float32[np.ndarray, "labelled parts 3 3"]  # from rest to the pose that codes refer to
    turns: Float32[np.ndarray, "known parts 3 3"]  # poses to learn from, relative to parents


def load_implicit_corpus(folder: Path, size: Size, seed: int, human: Character) -> ImplicitCorpus:
    """Read the corpus of these numbers from a folder, or build it and keep it there.

    Args:
        human: with clips to learn poses from.

    Raises:
        ModuleNotFoundError: if people are wanted and anny is not there.
    """
    arrays = keep_arrays(
        *(folder, "implicit", corpus_key(size, seed, human)),
        lambda: vars(build_implicit_corpus(size, seed, human)),
    )
    return ImplicitCorpus(**arrays)


def corpus_key(size: Size, seed: int, human: Character) -> str:
    """Tell all that a corpus depends on, the poses of the human's clips by their digest."""
    made_by: tuple[object, ...]
    if size.kind == PERSON.kind:
        turns = np.ascontiguousarray(known_turns(human))
        made_by = anny_version(), FALL, hashlib.sha256(turns.tobytes()).hexdigest()
    else:
        made_by = LABELLED_SPECIES, tuple(sorted(SPECIES)), tuple(sorted(HELD_OUT))
    drawn = SURFACE, NEAR, FAR, NOISE, MARGIN
    return repr((BUILD, astuple(size), seed, *drawn, np.__version__, *made_by))


def build_implicit_corpus(size: Size, seed: int, human: Character) -> ImplicitCorpus:
    """Make all shapes, check them, and ask which points about them are inside.

    Raises:
        AssertionError: if a body is not what it claims to be.
    """
    rng = np.random.default_rng([seed, BUILD, 4])
    make = _people if size.kind == PERSON.kind else _quadrupeds
    labelled, unlabelled = make(size, rng)
    for body in labelled:
        check_body(body)
    logger.info("occupancy")
    clouds = [sample_cloud(body, SURFACE, rng) for body in labelled]
    other = [_draw_surface(mesh, rng) for mesh in unlabelled]
    turns = (
        known_turns(human)
        if size.kind == PERSON.kind
        else np.empty((0, len(labelled[0].joints), 3, 3))
    )
    meshes = [*(body.mesh for body in labelled), *unlabelled]
    asked = [draw_queries(mesh, rng) for mesh in meshes]
    return ImplicitCorpus(
        np.stack([points for points, _ in asked]).astype(np.float32),
        np.stack([inside for _, inside in asked]),
        np.stack([*(cloud.points for cloud in clouds), *other]).astype(np.float32),
        np.stack([cloud.weights for cloud in clouds]).astype(np.float32),
        np.stack([body.joints for body in labelled]).astype(np.float32),
        np.stack([stance(body.joints, body.anatomy) for body in labelled]).astype(np.float32),
        turns.astype(np.float32),
    )


def _people(size: Size, rng: np.random.Generator) -> tuple[list[Body], list[Mesh]]:
    """Make natural people with parts, arms as they may be at rest; stylised ones without parts."""
    dressed = size.unlabelled // 2
    bodies = build_people(size.labelled + dressed, rng)
    labelled = [_stand(body, rng) for body in bodies[: size.labelled]]
    scaled = [
        vary_body(_stand(dress_up(body, rng), rng), scale_parts(body.joints, PERSON, rng))
        for body in bodies[size.labelled :]
    ]
    made = [draw_sculpted("rounded", rng) for _ in range(size.unlabelled - dressed)]
    return labelled, [body.mesh for body in (*scaled, *made)]


def _stand(body: Body, rng: np.random.Generator) -> Body:
    fall = float(rng.choice([0.0, 45.0, 75.0])) + float(rng.normal(0, 8))
    return vary_body(body, chain_turns(PERSON, arm_turns(body.joints, PERSON, fall)))


def _quadrupeds(size: Size, rng: np.random.Generator) -> tuple[list[Body], list[Mesh]]:
    """Make bare animals of three species with parts, and others without."""
    others = sorted(set(SPECIES) - set(HELD_OUT) - set(LABELLED_SPECIES))
    labelled, unlabelled = (
        [draw_sculpted(species[i % len(species)], rng) for i in range(count)]
        for species, count in ((LABELLED_SPECIES, size.labelled), (others, size.unlabelled))
    )
    return labelled, [body.mesh for body in unlabelled]


def _draw_surface(mesh: Mesh, rng: np.random.Generator) -> Float32[np.ndarray, "surface 3"]:
    face, barycentric = sample_surface(mesh.vertices, mesh.faces, SURFACE, rng)
    return interpolate(mesh.vertices, mesh.faces[face], barycentric).astype(np.float32)


def draw_queries(
    mesh: Mesh, rng: np.random.Generator
) -> tuple[Float32[np.ndarray, "queries 3"], Bool[np.ndarray, " queries"]]:
    """Draw points about a shape of size 1 and in its box; tell which are inside.

    By generalised winding number, |w| > 1/2, so that open and inside-out surfaces have an inside.
    """
    near = _draw_surface(mesh, rng)[rng.integers(0, SURFACE, NEAR)]
    near = near + rng.normal(0, NOISE, near.shape)
    low, high = mesh.vertices.min(axis=0) - MARGIN, mesh.vertices.max(axis=0) + MARGIN
    points = np.concatenate([near, rng.uniform(low, high, (FAR, 3))])
    winding = igl.fast_winding_number(
        np.ascontiguousarray(mesh.vertices), np.ascontiguousarray(mesh.faces), points
    )
    return points.astype(np.float32), np.abs(winding) > 0.5


def labels_of(corpus: ImplicitCorpus) -> Int[np.ndarray, "labelled surface"]:
    """Give the strongest part of each surface point of the shapes with parts."""
    return np.asarray(corpus.weights.argmax(axis=-1))
