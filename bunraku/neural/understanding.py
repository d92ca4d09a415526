"""Ask the shape network about a figure: its kind, the part weights of its vertices, its joints."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from bunraku.meshes import face_normals, interpolate, sample_surface, signed_volume, vertex_normals
from bunraku.neural.anatomy import ANATOMIES
from bunraku.neural.bodies import normalise
from bunraku.neural.corpus import KINDS
from bunraku.neural.network import ShapeNetwork
from bunraku.neural.parts import Reader, Understanding
from bunraku.neural.smoothing import diffuse
from bunraku.neural.training import load_network
from bunraku.types import Mesh

READ = 1024  # points that the network reads of a figure at a time
READINGS = 3  # samples of the surface, each read as it is and mirrored; answers are averaged
ASKED = 20_000  # vertices asked for themselves; of larger figures so many points, and their nearest
_MIRROR = np.array([-1.0, 1.0, 1.0])


@dataclass(frozen=True, eq=False)
class Reading:
    """What the network made of one sample of the surface."""

    mirrored: bool
    points: torch.Tensor  # 1, read, 3
    latents: torch.Tensor
    parts: torch.Tensor  # 1, kinds, parts, width
    features: torch.Tensor  # of the points read
    kinds: Float[np.ndarray, " kinds"]


@torch.no_grad()
def understand(
    network: ShapeNetwork, mesh: Mesh, *, kind: str | None = None, seed: int = 0
) -> Understanding:
    """Understand a figure at rest, Y up, facing +Z; a cloud without faces too.

    Args:
        kind: what the figure is, if that is known; else the likelier one.
        seed: of the samples that are read.
    """
    middle, size = normalise(mesh.vertices)
    small = Mesh((mesh.vertices - middle) / size, mesh.faces)
    readings = read_figure(network, small, np.random.default_rng(seed))
    chances = np.mean([reading.kinds for reading in readings], axis=0)
    kind = kind or KINDS[int(chances.argmax())]
    number, twins = KINDS.index(kind), ANATOMIES[kind].twins
    joints = np.mean([_locate(network, reading, number, twins) for reading in readings], axis=0)
    places, normals = small.vertices, _normals(small)
    asked = np.arange(len(places))
    if len(places) > ASKED:
        asked = np.random.default_rng(seed).choice(len(places), ASKED, replace=False)
    answers = [_weigh(network, r, places[asked], normals[asked], number) for r in readings]
    weights = np.mean(answers, axis=0)
    labels = weights.argmax(axis=1)
    agreement = np.mean([(answer.argmax(axis=1) == labels).mean() for answer in answers])
    if len(places) > ASKED:
        weights = spread(weights, places[asked], places)
    else:
        weights = diffuse(weights, small)
    found = joints * size + middle
    return Understanding(kind, float(chances[number]), weights, found, float(agreement))


def read_figure(network: ShapeNetwork, mesh: Mesh, rng: np.random.Generator) -> list[Reading]:
    """Read a few samples of a surface of size 1, each as it is and mirrored."""
    readings = []
    for _ in range(READINGS):
        points, normals = _sample(mesh, rng)
        for mirrored in (False, True):
            side = _MIRROR if mirrored else np.ones(3)
            seen, facing = _tensor(points * side), _tensor(normals * side)
            latents, parts, kinds = network.read(seen, facing)
            features = network.describe(seen, facing, latents)
            chances = kinds.softmax(-1)[0].double().numpy()
            readings.append(Reading(mirrored, seen, latents, parts, features, chances))
    return readings


def _sample(mesh: Mesh, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw points and outward normals; a cloud has no normals."""
    if not len(mesh.faces):
        chosen = rng.choice(len(mesh.vertices), READ, replace=len(mesh.vertices) < READ)
        return mesh.vertices[chosen], np.zeros((READ, 3))
    face, barycentric = sample_surface(mesh.vertices, mesh.faces, READ, rng)
    corners = mesh.faces[face]
    normals = face_normals(mesh.vertices, corners) * _outward(mesh)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return interpolate(mesh.vertices, corners, barycentric), normals


def _outward(mesh: Mesh) -> float:
    """Give -1 for a surface that is turned inside out."""
    return -1.0 if signed_volume(mesh.vertices, mesh.faces) < 0 else 1.0


def _normals(mesh: Mesh) -> np.ndarray:
    if not len(mesh.faces):
        return np.zeros_like(mesh.vertices)
    return vertex_normals(mesh.vertices, mesh.faces) * _outward(mesh)


def _tensor(points: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(points.astype(np.float32))[None]


def _locate(
    network: ShapeNetwork, reading: Reading, kind: int, twins: Int[np.ndarray, " parts"]
) -> Float[np.ndarray, "parts 3"]:
    """Give the joints that a reading sees."""
    parts = reading.parts[:, kind, : len(twins)]
    found = network.locate(reading.points, reading.features, parts)[0].double().numpy()
    return found[twins] * _MIRROR if reading.mirrored else found


def _weigh(
    network: ShapeNetwork,
    reading: Reading,
    places: np.ndarray,
    normals: np.ndarray,
    kind: int,
    *,
    at_once: int = 8192,
) -> Float[np.ndarray, "places parts"]:
    """Give the part weights that a reading sees at places."""
    side = _MIRROR if reading.mirrored else np.ones(3)
    twins = ANATOMIES[KINDS[kind]].twins
    parts = reading.parts[:, kind, : len(twins)]
    answers = []
    for first in range(0, len(places), at_once):
        some = slice(first, first + at_once)
        asked = _tensor(places[some] * side), _tensor(normals[some] * side)
        logits = network.weigh(network.describe(*asked, reading.latents), parts)
        answers.append(logits.softmax(-1)[0].double().numpy())
    weights = np.concatenate(answers)
    return weights[:, twins] if reading.mirrored else weights


def spread(
    values: Float[np.ndarray, "known values"],
    known: Float[np.ndarray, "known 3"],
    places: Float[np.ndarray, "places 3"],
) -> Float[np.ndarray, "places values"]:
    """Carry values to places from the three nearest where they are known, by distance."""
    distance, nearest = KDTree(known).query(places, k=3)
    share = 1.0 / np.maximum(distance, 1e-9)
    share /= share.sum(axis=1, keepdims=True)
    return np.einsum("pk,pkv->pv", share, values[nearest])


def load_reader(stored: bytes, *, seed: int = 0) -> Reader:
    """Give who understands figures, from the bytes of a file of weights."""
    network = load_network(stored)

    def read(mesh: Mesh, *, kind: str | None = None) -> Understanding:
        return understand(network, mesh, kind=kind, seed=seed)

    return read
