"""The source as a puppet: its proxy surface, moved by the joints that really move it.

A rig may hold joints that no vertex follows, feet that hang off the root (IK rigs) or dozens of
fingers. The puppet keeps the joints that carry surface and joins each to the neighbour it shares
surface with, at an anchor: the joint itself, or the middle of the shared surface.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree, shortest_path

from bunraku.graphs import ancestors, descendants
from bunraku.meshes import farthest_points, vertex_areas, vertex_normals
from bunraku.registration.pose_prior import joint_stiffness, turns_at_moments
from bunraku.rotations import matrices_to_vectors, nearest_rotation, vectors_to_matrices
from bunraku.types import NO_PARENT

SMALL_ROOT, MOST = 0.015, 0.8  # shares of surface: a floor root that holds one hoof, and its body


@dataclass(frozen=True, eq=False)
class Puppet:
    """A surface of area 1 and the tree of joints that moves it, parents before children."""

    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    weights: Float[np.ndarray, "vertices joints"]
    anchors: Float[np.ndarray, "joints 3"]  # about which each joint turns
    parents: Int[np.ndarray, " joints"]
    axes: Float[np.ndarray, "joints 3"]  # unit, along the bone; zero where it has no direction
    joints: Int[np.ndarray, " joints"]  # which joint of the source's skeleton each one is
    samples: Int[np.ndarray, " samples"]  # vertices, farthest first
    stiffness: Float[np.ndarray, "joints 3 3"]  # cost of each joint's turn, in its parent's frame

    @cached_property
    def normals(self) -> Float[np.ndarray, "vertices 3"]:
        """Unit normals of the surface at rest."""
        return vertex_normals(self.vertices, self.faces)

    @cached_property
    def areas(self) -> Float[np.ndarray, " vertices"]:
        """Area of each vertex; they sum to 1."""
        return vertex_areas(self.vertices, self.faces)

    @cached_property
    def below(self) -> Float[np.ndarray, "joints joints"]:
        """1 where the column's joint hangs below the row's, or is it."""
        return descendants(self.parents).astype(np.float64)

    @cached_property
    def children(self) -> Float[np.ndarray, "joints joints"]:
        """1 where the column's joint is a child of the row's."""
        matrix = np.zeros((len(self.parents), len(self.parents)))
        child = np.flatnonzero(self.parents != NO_PARENT)
        matrix[self.parents[child], child] = 1.0
        return matrix


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a puppet's joints are: turns in the parent's frame, and scales along and across."""

    root: Float[np.ndarray, "3"]
    rotations: Float[np.ndarray, "joints 3 3"]  # the joint's turn in its parent's frame
    scales: Float[np.ndarray, "joints 2"]  # logarithms: along the bone, across it

    def world(
        self, puppet: Puppet
    ) -> tuple[
        Float[np.ndarray, "joints 3 3"],
        Float[np.ndarray, "joints 3 3"],
        Float[np.ndarray, "joints 3"],
    ]:
        """Chain the tree: world rotation, world stretch-and-turn and anchor of each joint."""
        turns = np.empty_like(self.rotations)
        linear = np.empty_like(self.rotations)
        anchors = np.empty_like(puppet.anchors)
        stretch = stretches(puppet.axes, self.scales)
        for joint, parent in enumerate(puppet.parents):
            if parent == NO_PARENT:
                turns[joint], anchors[joint] = self.rotations[joint], self.root
            else:
                turns[joint] = turns[parent] @ self.rotations[joint]
                offset = puppet.anchors[joint] - puppet.anchors[parent]
                anchors[joint] = anchors[parent] + linear[parent] @ offset
            linear[joint] = turns[joint] @ stretch[joint]
        return turns, linear, anchors


def stretches(
    axes: Float[np.ndarray, "joints 3"], scales: Float[np.ndarray, "joints 2"]
) -> Float[np.ndarray, "joints 3 3"]:
    """Build the matrix that scales along each axis and across it."""
    along, across = np.exp(scales[:, 0, None, None]), np.exp(scales[:, 1, None, None])
    on_axis = axes[:, :, None] * axes[:, None, :]
    return along * on_axis + across * (np.eye(3) - on_axis)


def rest_pose(puppet: Puppet, heading: Float[np.ndarray, "3 3"] | None = None) -> Pose:
    """Give the pose that leaves the puppet as it is, or turns it whole about the origin."""
    count = len(puppet.parents)
    rotations = np.tile(np.eye(3), (count, 1, 1))
    root = puppet.anchors[0]
    if heading is not None:
        rotations[0], root = heading, heading @ root
    return Pose(root.copy(), rotations, np.zeros((count, 2)))


def move_puppet(
    puppet: Puppet, pose: Pose, chosen: Int[np.ndarray, " chosen"] | slice = slice(None)
) -> tuple[Float[np.ndarray, "chosen 3"], Float[np.ndarray, "chosen 3"]]:
    """Give the posed positions and (approximate, not unit) normals of the chosen vertices."""
    turns, linear, anchors = pose.world(puppet)
    offsets = anchors - np.einsum("jab,jb->ja", linear, puppet.anchors)
    weights = puppet.weights[chosen]
    blended = (weights @ linear.reshape(-1, 9)).reshape(-1, 3, 3)
    turned = (weights @ turns.reshape(-1, 9)).reshape(-1, 3, 3)
    moved = np.einsum("vab,vb->va", blended, puppet.vertices[chosen]) + weights @ offsets
    return moved, np.einsum("vab,vb->va", turned, puppet.normals[chosen])


def step_pose(
    puppet: Puppet,
    pose: Pose,
    turns: Float[np.ndarray, "joints 3"],
    scales: Float[np.ndarray, "joints 2"],
    shift: Float[np.ndarray, "3"],
) -> Pose:
    """Turn each joint by a world rotation vector, add to the log-scales, move the root."""
    world, _, _ = pose.world(puppet)
    above = np.concatenate([np.eye(3)[None], world])[puppet.parents + 1]
    change = np.swapaxes(above, 1, 2) @ vectors_to_matrices(turns) @ above
    turned = nearest_rotation(change @ pose.rotations)  # or errors grow with every step
    return Pose(pose.root + shift, turned, pose.scales + scales)


def make_puppet(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    weights: Float[np.ndarray, "vertices all_joints"],
    joints: Float[np.ndarray, "all_joints 3"],
    parents: Int[np.ndarray, " all_joints"],
    *,
    least_share: float = 4e-3,
) -> Puppet:
    """Cut a rigged surface down to the joints that move it, joined where they share surface.

    Args:
        vertices: closed proxy of the source at rest, scaled to area 1 and centred.
        weights: its skin over all joints of the skeleton.
        joints: rest positions of all joints, in the same frame.
        parents: the skeleton's own tree.
        least_share: share of the surface below which a joint is merged into another one.
    """
    areas = vertex_areas(vertices, faces)
    owner = merge_small_joints(areas @ weights, parents, least_share * areas.sum())
    kept = np.flatnonzero(owner == np.arange(len(owner)))
    merged = np.zeros((len(vertices), len(kept)))
    np.add.at(merged.T, np.searchsorted(kept, owner), weights.T)
    hierarchy = is_parent_of(kept, parents, owner)
    order, tree = join_by_shared_surface(areas, merged, hierarchy)
    kept, merged, hierarchy = kept[order], merged[:, order], hierarchy[np.ix_(order, order)]
    anchors = place_anchors(vertices, areas, merged, joints[kept], tree, hierarchy)
    axes = bone_axes(vertices, areas, merged, anchors, tree)
    return Puppet(
        *(vertices, faces, merged, anchors, tree, axes, kept),
        samples=farthest_points(vertices, 2500),
        stiffness=np.tile(np.eye(3), (len(kept), 1, 1)),
    )


def learn_stiffness(puppet: Puppet, moments: Float[np.ndarray, "moments all_joints 3 3"]) -> Puppet:
    """Let turns cost what a character's clips tell of its joints.

    Args:
        moments: world turns of all its joints since rest.
    """
    own = turns_at_moments(moments[:, puppet.joints], puppet.parents)
    return replace(puppet, stiffness=joint_stiffness(matrices_to_vectors(own)))


def merge_small_joints(
    mass: Float[np.ndarray, " joints"], parents: Int[np.ndarray, " joints"], least: float
) -> Int[np.ndarray, " joints"]:
    """Give each joint the joint that carries its surface: itself, or an ancestor if it is small.

    Leaves are merged first, so that a hand collects its fingers before it is judged itself; a
    small root (a rig's origin on the floor, even one that holds a hoof) goes to the child under
    which most of the body hangs, a small root without children (an exporter's neutral bone) to the
    heaviest joint of all.
    """
    under = descendants(parents) @ mass
    owner, mass = np.arange(len(mass)), mass.copy()
    for joint in range(len(mass) - 1, -1, -1):
        if mass[joint] < least and parents[joint] != NO_PARENT:
            owner[joint] = parents[joint]
            mass[parents[joint]] += mass[joint]
    for joint in range(len(mass)):  # parents come first, so chains resolve in one pass
        owner[joint] = owner[owner[joint]]
    kept = owner == np.arange(len(mass))
    above = np.where(parents == NO_PARENT, NO_PARENT, owner[parents])
    for root in np.flatnonzero(kept & (above == NO_PARENT)):
        children = np.flatnonzero(kept & (above == root))
        if not len(children):
            continue
        heir = children[under[children].argmax()]
        on_floor = mass[root] < SMALL_ROOT * mass.sum() and under[heir] > MOST * under[root]
        if mass[root] < least or on_floor:
            owner[owner == root] = heir
    owner[(owner == np.arange(len(mass))) & (mass < least)] = mass.argmax()
    return owner[owner]


def is_parent_of(
    kept: Int[np.ndarray, " kept"],
    parents: Int[np.ndarray, " joints"],
    owner: Int[np.ndarray, " joints"],
) -> Bool[np.ndarray, "kept kept"]:
    """Tell for which pairs of kept joints the row is the column's parent in the skeleton."""
    above = np.where(parents[kept] == NO_PARENT, NO_PARENT, owner[parents[kept]])
    return np.asarray((kept[:, None] == above[None, :]) & ~np.eye(len(kept), dtype=bool))


def join_by_shared_surface(
    areas: Float[np.ndarray, " vertices"],
    weights: Float[np.ndarray, "vertices joints"],
    hierarchy: Bool[np.ndarray, "joints joints"],
) -> tuple[Int[np.ndarray, " joints"], Int[np.ndarray, " joints"]]:
    """Join the joints into one tree along the largest shared surfaces, parents first.

    Pairs that the skeleton joins count four times, and always a little, so that an ordinary rig
    keeps its own tree and only strays (IK feet on the root) change parents.

    Returns:
        the old number of each joint in the new order, and the new parents.
    """
    shared = np.sqrt(weights).T @ (areas[:, None] * np.sqrt(weights))
    joined = hierarchy | hierarchy.T
    affinity = np.where(joined, 4.0 * shared, shared) + 1e-6 * joined + 1e-12
    cost = affinity.max() * 2 - affinity
    np.fill_diagonal(cost, 0.0)
    tree = minimum_spanning_tree(cost)
    start = main_joint(areas @ weights / areas.sum(), hierarchy)
    order, above = breadth_first_order(tree, start, directed=False)
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    parents = np.array([NO_PARENT if above[j] < 0 else place[above[j]] for j in order])
    return order.astype(np.int64), parents.astype(np.int64)


def main_joint(
    mass: Float[np.ndarray, " joints"],
    hierarchy: Bool[np.ndarray, "joints joints"],
    *,
    least: float = 0.015,
) -> int:
    """Find the joint from which the body hangs: the top of the heaviest branch.

    A root that itself moves less than `least` of the surface (an origin on the floor that holds
    one hoof) gives way to the child under which most of the body hangs.
    """
    below = np.isfinite(shortest_path(hierarchy, unweighted=True)) @ mass
    chosen = int(np.argmax(np.where(hierarchy.any(axis=0), -1.0, below)))
    for _ in range(len(mass)):  # merged trees may hold cycles: never more steps than joints
        children = np.flatnonzero(hierarchy[chosen])
        if mass[chosen] >= least or not len(children):
            break
        chosen = int(children[below[children].argmax()])
    return chosen


def place_anchors(
    vertices: Float[np.ndarray, "vertices 3"],
    areas: Float[np.ndarray, " vertices"],
    weights: Float[np.ndarray, "vertices joints"],
    joints: Float[np.ndarray, "joints 3"],
    tree: Int[np.ndarray, " joints"],
    hierarchy: Bool[np.ndarray, "joints joints"],
) -> Float[np.ndarray, "joints 3"]:
    """Let each joint turn about itself, its former child, or the surface shared with its parent."""
    anchors = joints.copy()
    for joint, parent in enumerate(tree):
        if parent == NO_PARENT or hierarchy[parent, joint]:
            continue
        if hierarchy[joint, parent]:
            anchors[joint] = joints[parent]
            continue
        shared = areas * weights[:, joint] * weights[:, parent]
        if shared.sum() > 1e-9:
            anchors[joint] = shared @ vertices / shared.sum()
    return anchors


def bone_axes(
    vertices: Float[np.ndarray, "vertices 3"],
    areas: Float[np.ndarray, " vertices"],
    weights: Float[np.ndarray, "vertices joints"],
    anchors: Float[np.ndarray, "joints 3"],
    tree: Int[np.ndarray, " joints"],
) -> Float[np.ndarray, "joints 3"]:
    """Point each bone at its only child, a leaf at its surface; branching joints have no axis."""
    axes = np.zeros_like(anchors)
    for joint in range(len(tree)):
        children = np.flatnonzero(tree == joint)
        if len(children) > 1:
            continue
        surface = areas * weights[:, joint]
        end = anchors[children[0]] if len(children) else surface @ vertices / surface.sum()
        direction = end - anchors[joint]
        length = np.linalg.norm(direction)
        if length > 1e-6:
            axes[joint] = direction / length
    return axes


def tree_of_places(
    puppet: Puppet, parents: Int[np.ndarray, " all_joints"]
) -> Int[np.ndarray, " all_joints"]:
    """Say whose motion carries each joint of the full skeleton.

    Its parent, except where the puppet found that a joint shares its surface with a joint that
    is no ancestor (a foot that an IK rig hangs off the root goes with its leg).
    """
    carriers = parents.copy()
    above = puppet.joints[puppet.parents[1:]]
    for joint, parent in zip(puppet.joints[1:].tolist(), above.tolist(), strict=True):
        if parent not in ancestors(parents, joint) and joint not in ancestors(carriers, parent):
            carriers[joint] = parent
    return carriers
