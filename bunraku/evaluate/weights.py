"""Table: skinning weights carried to posed bodies with exact truth, as in the paper's Table 1.

Musoni et al. 2021 measure on FAUST with the SMPL rig, which can be neither shipped nor fetched
here; these bodies are other ones. Their numbers are printed for orientation only.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from rich.table import Table

from bunraku.errors import Code
from bunraku.evaluate import metrics
from bunraku.evaluate.results import make_table
from bunraku.graphs import children
from bunraku.matching import mapped_coordinates, match_surfaces
from bunraku.meshes import closest_points, interpolate
from bunraku.rotations import (
    compose_transforms,
    invert_rigid,
    vectors_to_matrices,
)
from bunraku.routes.from_rig import RigTransfer, animate_from_rig
from bunraku.skinning import (
    forward_kinematics,
    linear_blend_skinning,
    local_transforms,
    pose_joints,
)
from bunraku.spectral import Basis, project
from bunraku.types import Character, FormatError, Mesh, Skeleton, Skin
from bunraku.weights import (
    transfer_by_function,
    transfer_by_points,
    transfer_nearest,
    transfer_to_surface,
)

OURS_FROM_FILE = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])  # Z up, front -Y, left +X
PAPER = {"p2p": (3.63, 12.64), "function": (2.75, 6.46), "paper (IE nearest)": (0.615, 1.64)}
Weights = Float[np.ndarray, "vertices joints"]


@dataclass(frozen=True, eq=False)
class Target:
    """A posed body of which everything is known."""

    name: str
    mesh: Mesh
    weights: Float[np.ndarray, "vertices joints"]
    joints: Float[np.ndarray, "joints 3"]
    rest: Float[np.ndarray, "vertices 3"]  # its vertices at rest
    source_points: Float[np.ndarray, "vertices 3"]  # its vertices' places on the source
    turns: Float[np.ndarray, "joints 3 3"]  # of each joint from rest to pose, in the world

    def key(self) -> tuple[str]:
        """Tell this target from the others."""
        return (self.name,)


@dataclass(frozen=True)
class Row:
    """What was measured on one target."""

    target: str
    errors: dict[str, list[float]]  # of each joint, by method
    swapped: dict[str, bool] = field(default_factory=dict)  # left for right, by method
    turned_back: bool = False
    joints: float = 0.0  # per cent of height
    rest: float = 0.0  # per cent of height
    rest_before: float = 0.0  # of the pose as found
    twist: float = 0.0  # degrees, mean over joints
    seconds: float = 0.0

    def key(self) -> tuple[str]:
        """Tell this row from the others."""
        return (self.target,)


def read_source(folder: Path) -> Character:
    """Read the rigged source body.

    Raises:
        FormatError: if the folder holds none.
    """
    stored = _load(folder / "src.npz")
    joints, parents = stored["J"] @ OURS_FROM_FILE.T, stored["par"].astype(np.int64)
    bind = compose_transforms(joints, np.broadcast_to(np.eye(3), (len(joints), 3, 3)))
    names = tuple(map(str, stored["lab"]))
    skeleton = Skeleton(names, parents, local_transforms(parents, bind))
    mesh = Mesh(stored["V"] @ OURS_FROM_FILE.T, stored["F"].astype(np.int64))
    return Character(mesh, skeleton, Skin(stored["W"], invert_rigid(bind)))


def read_targets(folder: Path, source: Skeleton) -> Iterator[Target]:
    """Read the posed bodies, in the order of their names.

    Raises:
        FormatError: if the folder holds none.
    """
    paths = sorted(folder.glob("tgt*.npz"))
    if not paths:
        raise FormatError(
            folder, "", "holds no targets (tgt*.npz); give the folder of bodies", code=Code.DATA
        )
    for path in paths:
        stored = _load(path)
        turns = vectors_to_matrices(stored["th"] @ OURS_FROM_FILE.T)
        identity = np.tile(np.eye(4), (len(turns), 1, 1))
        world = forward_kinematics(source.parents, pose_joints(identity, turns))
        vertices, joints, rest, points = (
            stored[name] @ OURS_FROM_FILE.T for name in ("V", "J", "rest", "src")
        )
        mesh = Mesh(vertices, stored["F"].astype(np.int64))
        yield Target(path.stem, mesh, stored["W"], joints, rest, points, world[:, :3, :3])


def _load(path: Path) -> Mapping[str, np.ndarray]:
    """Read the arrays of one body."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            return dict(stored)
    except (OSError, ValueError) as error:
        raise FormatError(
            path, "", f"is no body of the weight table: {error}", code=Code.DATA
        ) from error


def measure(target: Target, source: Character, *, modes: int = 100, seed: int = 0) -> Row:
    """Carry the source's weights to one target in every way, and compare with the truth."""
    started = time.perf_counter()
    ours = animate_from_rig(source, target.mesh, clips=(), seed=seed, force=True)
    seconds = time.perf_counter() - started
    carried = transfer_through_map(source, target, modes=modes)
    carried |= {"ours": ours.character.skin.weights}
    height = metrics.figure_height(target.rest)
    pairs = left_right_pairs(source.skeleton.names)
    rested, turns = unpose(ours, target)
    found = np.linalg.inv(ours.character.skin.inverse_bind)[:, :3, 3]
    parents = source.skeleton.parents
    forward = target.turns[0] @ np.array([0.0, 0.0, 1.0])
    axes = bone_axes(target.joints, parents)
    return Row(
        target.name,
        {
            name: metrics.weight_error(weights, target.weights).tolist()
            for name, weights in carried.items()
        },
        swapped={
            name: metrics.swaps_sides(weights, target.weights, pairs)
            for name, weights in carried.items()
        },
        turned_back=metrics.is_turned_back(
            found[1:] - found[parents[1:]], target.joints[1:] - target.joints[parents[1:]], forward
        ),
        joints=metrics.joint_error(found, target.joints, height),
        rest=metrics.rest_pose_error(rested, target.rest, height),
        rest_before=metrics.rest_pose_error(target.mesh.vertices, target.rest, height),
        twist=float(metrics.twist_error(turns, target.turns, axes).mean()),
        seconds=seconds,
    )


def transfer_through_map(source: Character, target: Target, *, modes: int) -> dict[str, Weights]:
    """Carry weights by a functional map found without landmarks, and by the exact one."""
    weights, vertices, faces = source.skin.weights, source.mesh.vertices, source.mesh.faces
    found = match_surfaces(source.mesh, target.mesh, modes=modes)
    bases = found.source_basis, found.target_basis
    carried = mapped_coordinates(*bases, found.matrix, vertices)
    exact = exact_map(source.mesh, target, *bases)
    ideal = mapped_coordinates(*bases, exact, vertices)
    return {
        "p2p": transfer_by_points(weights, found.point_map),
        "function": transfer_by_function(weights, *bases, found.matrix),
        "paper (IE nearest)": transfer_nearest(weights, vertices, carried),
        "IE barycentric": transfer_to_surface(weights, vertices, faces, carried),
        "exact map, IE nearest": transfer_nearest(weights, vertices, ideal),
    }


def exact_map(
    source: Mesh, target: Target, source_basis: Basis, target_basis: Basis
) -> Float[np.ndarray, "functions functions"]:
    """Build the functional map of the true correspondence (Eq. 2)."""
    face, shares, _ = closest_points(target.source_points, source.vertices, source.faces)
    functions = interpolate(source_basis.functions, source.faces[face], shares)
    return project(target_basis, functions)


def left_right_pairs(names: Sequence[str]) -> Int[np.ndarray, "pairs 2"]:
    """Pair joints whose names differ only in left and right."""
    place = {name: i for i, name in enumerate(names)}
    pairs = [
        (i, place[name.replace("Left", "Right")])
        for name, i in place.items()
        if "Left" in name and name.replace("Left", "Right") in place
    ]
    return np.array(pairs, np.int64).reshape(-1, 2)


def bone_axes(
    joints: Float[np.ndarray, "joints 3"], parents: Int[np.ndarray, " joints"]
) -> Float[np.ndarray, "joints 3"]:
    """Give the direction from each joint to the middle of its children; at an end, as it came."""
    axes = np.zeros(joints.shape)
    for joint, below in enumerate(children(parents)):
        end = joints[below].mean(axis=0) if below else 2 * joints[joint] - joints[parents[joint]]
        axes[joint] = end - joints[joint]
    return axes / np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-12)


def unpose(
    ours: RigTransfer, target: Target
) -> tuple[Float[np.ndarray, "vertices 3"], Float[np.ndarray, "joints 3 3"]]:
    """Give the figure in the rest pose found, and how each joint turns from there to the pose.

    The rest pose faces where the true one does, so that the heading does not count as twist.
    """
    motion = ours.repose_motion
    rested = linear_blend_skinning(target.mesh.vertices, ours.character.skin.weights, motion)
    turn = metrics.best_turn(rested, target.rest)
    return rested, np.swapaxes(turn @ motion[:, :3, :3], -1, -2)


def describe(row: Row) -> str:
    """Put one row on one line."""
    errors = ", ".join(f"{name} {np.mean(errors):.3f}" for name, errors in row.errors.items())
    return f"{row.target}: {errors}; joints {row.joints:.2f} %h, {row.seconds:.0f} s"


def tabulate(rows: Sequence[Row]) -> list[Table]:
    """Set mean and worst joint of every method, and what else is known of ours, in tables."""
    methods = list(rows[0].errors)
    errors = {name: np.array([row.errors[name] for row in rows]) for name in methods}
    names = [row.target for row in rows]
    note = "the paper's numbers are from other bodies (FAUST, SMPL rig): for orientation only"
    means = make_table(
        f"Weight error (MSE x 100), mean over joints; {note}",
        ["method", *names, "mean", "worst target", "swapped", "paper"],
        [
            [
                *(name, *errors[name].mean(axis=1), errors[name].mean()),
                errors[name].mean(axis=1).max(),
                str(sum(row.swapped[name] for row in rows)),
                PAPER.get(name, ("", ""))[0],
            ]
            for name in methods
        ],
    )
    worst = make_table(
        "Weight error, worst joint; last but one: worst joint of the mean over targets",
        ["method", *names, "of mean", "paper"],
        [
            [
                name,
                *errors[name].max(axis=1),
                errors[name].mean(axis=0).max(),
                PAPER.get(name, ("", ""))[1],
            ]
            for name in methods
        ],
    )
    measures = {
        "joints, % of height": [row.joints for row in rows],
        "rest pose, % of height": [row.rest for row in rows],
        "  as found": [row.rest_before for row in rows],
        "twist, degrees": [row.twist for row in rows],
        "turned back": [float(row.turned_back) for row in rows],
        "seconds": [row.seconds for row in rows],
    }
    own = make_table(
        "Ours",
        ["", *names, "mean", "worst"],
        [[name, *values, float(np.mean(values)), max(values)] for name, values in measures.items()],
    )
    return [means, worst, own]
