"""The source as a puppet: its proxy surface, moved by the joints that really move it.

A rig may hold joints that no vertex follows, feet that hang off the root (IK rigs) or dozens of
fingers. The puppet keeps the joints that carry surface and joins each to the neighbour it shares
surface with, at an anchor: the joint itself, or the middle of the shared surface.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from bunraku.graphs import ancestors, descendants
from bunraku.meshes import farthest_points, vertex_areas, vertex_normals
from bunraku.registration.joint_tree import (
    is_parent_of,
    join_by_shared_surface,
    merge_small_joints,
)
from bunraku.registration.pose_prior import joint_stiffness, turns_at_moments
from bunraku.rotations import matrices_to_vectors, nearest_rotation, vectors_to_matrices
from bunraku.types import NO_PARENT


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
    owners: Int[np.ndarray, " all_joints"]  # which of the joints carries each of the skeleton's

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
    shared = np.sqrt(weights).T @ (areas[:, None] * np.sqrt(weights))
    np.fill_diagonal(shared, 0.0)
    owner = merge_small_joints(areas @ weights, parents, least_share * areas.sum(), shared)
    kept = np.flatnonzero(owner == np.arange(len(owner)))
    merged = np.zeros((len(vertices), len(kept)))
    np.add.at(merged.T, np.searchsorted(kept, owner), weights.T)
    hierarchy = is_parent_of(kept, parents, owner)
    order, tree = join_by_shared_surface(areas, merged, hierarchy)
    kept, merged, hierarchy = kept[order], merged[:, order], hierarchy[np.ix_(order, order)]
    anchors = place_anchors(vertices, areas, merged, joints[kept], tree, hierarchy)
    axes = bone_axes(vertices, areas, merged, anchors, tree)
    place = np.empty(len(parents), np.int64)
    place[kept] = np.arange(len(kept))
    return Puppet(
        *(vertices, faces, merged, anchors, tree, axes, kept),
        samples=farthest_points(vertices, 2500),
        stiffness=np.tile(np.eye(3), (len(kept), 1, 1)),
        owners=place[owner],
    )


def forget_stiffness(puppet: Puppet) -> Puppet:
    """Let every joint turn as easily as any other."""
    return replace(puppet, stiffness=np.tile(np.eye(3), (len(puppet.parents), 1, 1)))


def learn_stiffness(puppet: Puppet, moments: Float[np.ndarray, "moments all_joints 3 3"]) -> Puppet:
    """Let turns cost what a character's clips tell of its joints.

    Args:
        moments: world turns of all its joints since rest.
    """
    own = turns_at_moments(moments[:, puppet.joints], puppet.parents)
    return replace(puppet, stiffness=joint_stiffness(matrices_to_vectors(own)))


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
    is no ancestor (a foot that an IK rig hangs off the root goes with its leg), and except for
    small joints that were merged into another branch, which their parent has nothing to do with.
    """
    carriers = parents.copy()
    above = puppet.joints[puppet.parents[1:]]
    pairs = [*zip(puppet.joints[1:].tolist(), above.tolist(), strict=True)]
    owned = puppet.joints[puppet.owners]
    for joint in np.flatnonzero(owned != np.arange(len(parents))).tolist():
        if parents[joint] == NO_PARENT or owned[parents[joint]] != owned[joint]:
            pairs.append((joint, int(owned[joint])))
    for joint, parent in pairs:
        if parent not in ancestors(parents, joint) and joint not in ancestors(carriers, parent):
            carriers[joint] = parent
    return carriers
