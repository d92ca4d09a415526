"""The nodes of a document as a tree: parents, order, transforms; walked without recursion."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from bunraku import limits
from bunraku.errors import NOTE, Code
from bunraku.formats.gltf.document import Document
from bunraku.rotations import (
    compose_transforms,
    decompose_transforms,
    matrices_to_quaternions,
    quaternions_to_matrices,
)
from bunraku.types import NO_PARENT

SMALLEST_SCALE = 1e-6  # of a node, along an axis
LARGEST = 1e60  # number in a world transform: its cube still is one


@dataclass(frozen=True, eq=False)
class Tree:
    """Every node's place: among the others, and in space."""

    parents: Int[np.ndarray, " nodes"]  # NO_PARENT for a root
    order: tuple[int, ...]  # parents before children, otherwise as in the file
    translations: Float[np.ndarray, "nodes 3"]
    rotations: Float[np.ndarray, "nodes 4"]
    scales: Float[np.ndarray, "nodes 3"]
    local: Float[np.ndarray, "nodes 4 4"]  # parent_from_node
    world: Float[np.ndarray, "nodes 4 4"]  # world_from_node
    is_shown: Bool[np.ndarray, " nodes"]  # in the default scene, or in any way if there is none

    def ancestors(self, node: int) -> Iterator[int]:
        """Give a node, its parent, and so on up to its root."""
        while node != NO_PARENT:
            yield node
            node = int(self.parents[node])


def build_tree(document: Document) -> Tree:
    """Place every node of a document.

    Raises:
        FormatError: if a node has two parents, is its own ancestor or cannot be placed.
    """
    parents = _find_parents(document)
    order = _sort_nodes(document, parents)
    translations, rotations, scales, local = _read_transforms(document)
    world = local.copy()
    for node in order:
        if parents[node] != NO_PARENT:
            world[node] = world[parents[node]] @ local[node]
    far = ~(np.abs(world) < LARGEST).all(axis=(1, 2))
    if far.any():
        first = int(far.argmax())
        raise document.fault(
            f"/nodes/{first}", "transform is too large to compute with", code=Code.NODE_TRANSFORM
        )
    is_shown = _find_shown(document, parents, order)
    return Tree(parents, order, translations, rotations, scales, local, world, is_shown)


def _find_parents(document: Document) -> Int[np.ndarray, " nodes"]:
    parents = np.full(len(document.gltf.nodes), NO_PARENT)
    for index, node in enumerate(document.gltf.nodes):
        for position, child in enumerate(node.children):
            where = f"/nodes/{index}/children/{position}"
            if parents[child] != NO_PARENT:
                message = f"node {child} has two parents, {parents[child]} and {index}"
                raise document.fault(where, message, code=Code.NODE_TREE)
            parents[child] = index
    return parents


def _sort_nodes(document: Document, parents: Int[np.ndarray, " nodes"]) -> tuple[int, ...]:
    """Order the nodes depth first from the roots; whatever is never reached is in a circle."""
    waiting = [int(node) for node in np.flatnonzero(parents == NO_PARENT)[::-1]]
    order: list[int] = []
    while waiting:
        order.append(waiting.pop())
        waiting += reversed(document.gltf.nodes[order[-1]].children)
    if len(order) < len(parents):
        lost = min(set(range(len(parents))) - set(order))
        raise document.fault(
            f"/nodes/{lost}", "node is its own ancestor; break the circle", code=Code.NODE_TREE
        )
    return tuple(order)


def _find_shown(
    document: Document, parents: Int[np.ndarray, " nodes"], order: tuple[int, ...]
) -> Bool[np.ndarray, " nodes"]:
    gltf = document.gltf
    if not gltf.scenes:
        return np.ones(len(parents), bool)
    shown = np.zeros(len(parents), bool)
    shown[gltf.scenes[gltf.scene or 0].nodes] = True
    for node in order:
        if parents[node] != NO_PARENT:
            shown[node] |= shown[parents[node]]
    return shown


def _read_transforms(document: Document) -> tuple[np.ndarray, ...]:
    """Stack translation, rotation, scale and parent_from_node of every node."""
    nodes = document.gltf.nodes
    translations = np.array([n.translation or (0, 0, 0) for n in nodes], float).reshape(-1, 3)
    rotations = np.array([n.rotation or (0, 0, 0, 1) for n in nodes], float).reshape(-1, 4)
    scales = np.array([n.scale or (1, 1, 1) for n in nodes], float).reshape(-1, 3)
    for name, values in (("translation", translations), ("rotation", rotations), ("scale", scales)):
        far = ~(np.abs(values) < limits.COORDINATE).all(axis=1)
        if far.any():
            where = f"/nodes/{int(far.argmax())}/{name}"
            raise document.fault(
                where, "is too large to compute with; scale it down", code=Code.NODE_TRANSFORM
            )
    rotations = _repair_rotations(document, rotations)
    scales = _repair_scales(document, scales)
    local = compose_transforms(translations, quaternions_to_matrices(rotations), scales)
    for index, node in enumerate(nodes):
        if node.matrix is None:
            continue
        local[index] = _read_matrix(document, index, node.matrix)
        parts = decompose_transforms(local[index])
        translations[index], scales[index] = parts[0], parts[2]
        rotations[index] = matrices_to_quaternions(parts[1])
    return translations, rotations, scales, local


def _read_matrix(document: Document, index: int, numbers: list[float]) -> Float[np.ndarray, "4 4"]:
    node, where = document.gltf.nodes[index], f"/nodes/{index}/matrix"
    if node.translation or node.rotation or node.scale:
        document.warn(
            where,
            "translation, rotation or scale beside a matrix are ignored",
            code=Code.NODE_TRANSFORM,
        )
    matrix = np.array(numbers, float).reshape(4, 4).T
    if not np.abs(matrix).max() < limits.COORDINATE:
        raise document.fault(
            where, "is too large to compute with; scale it down", code=Code.NODE_TRANSFORM
        )
    if abs(np.linalg.det(matrix[:3, :3])) < 1e-30:
        raise document.fault(
            where, "matrix flattens everything below it; give it a volume", code=Code.NODE_TRANSFORM
        )
    if not np.allclose(matrix[3], (0, 0, 0, 1), atol=1e-5):
        raise document.fault(
            where,
            "last row must be 0 0 0 1; matrices are stored by columns",
            code=Code.NODE_TRANSFORM,
        )
    matrix[3] = 0, 0, 0, 1
    return matrix


def _repair_scales(
    document: Document, scales: Float[np.ndarray, "nodes 3"]
) -> Float[np.ndarray, "nodes 3"]:
    """Make scales of 0, by which programs hide things, small, so that they can be undone."""
    hidden = np.abs(scales) < SMALLEST_SCALE
    if hidden.any():
        count = hidden.any(axis=1).sum()
        message = f"scales of {count} nodes are 0; taken as {SMALLEST_SCALE:g}"
        document.warn("/nodes", message, code=Code.NODE_TRANSFORM, level=NOTE)
    return np.where(hidden, SMALLEST_SCALE, scales)


def _repair_rotations(
    document: Document, rotations: Float[np.ndarray, "nodes 4"]
) -> Float[np.ndarray, "nodes 4"]:
    lengths = np.linalg.norm(rotations, axis=1)
    if (lengths < 1e-6).any():
        where = f"/nodes/{int((lengths < 1e-6).argmax())}/rotation"
        raise document.fault(
            where, "rotation is a zero quaternion; use 0 0 0 1 for none", code=Code.NODE_TRANSFORM
        )
    odd = np.abs(lengths - 1) > 1e-2
    if odd.any():
        document.warn(
            "/nodes",
            f"{odd.sum()} node rotations were not unit quaternions and were normalised",
            code=Code.NODE_TRANSFORM,
        )
    return rotations / lengths[:, None]
