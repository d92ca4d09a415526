"""Which joints of a rig move its surface, and how they hang together.

A rig may hold joints that no vertex follows, feet that hang off the root (IK rigs) or dozens of
fingers. What is left is joined as the skeleton has it, where the surface bears that out.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree, shortest_path

from bunraku.graphs import descendants
from bunraku.types import NO_PARENT

SMALL_ROOT, MOST = 0.015, 0.8  # shares of surface: a floor root that holds one hoof, and its body
RIVAL = 4.0  # times the surface shared with the parent: from there another joint has more right
LARGE = 0.15  # share of the surface from which a limb is half a body


def merge_small_joints(
    mass: Float[np.ndarray, " joints"],
    parents: Int[np.ndarray, " joints"],
    least: float,
    shared: Float[np.ndarray, "joints joints"] | None = None,
) -> Int[np.ndarray, " joints"]:
    """Give each joint the joint that carries its surface: itself, or another if it is small.

    That is its parent, but for strays (feet that an IK rig hangs off the root) the joint whose
    surface they share. Leaves are merged first, so that a hand collects its fingers before it is
    judged itself; a small root (a rig's origin on the floor, even one that holds a hoof) goes to
    the child under which most of the body hangs, a small root without children (an exporter's
    neutral bone) where it shares surface, else to the heaviest joint of all.

    Args:
        mass: surface that each joint moves.
        parents: the skeleton's tree, parents before children.
        least: mass from which a joint is kept.
        shared: surface that two joints move together; None if it is not known.
    """
    under = descendants(parents) @ mass
    owner, mass = np.arange(len(mass)), mass.copy()
    above = parents if shared is None else carried_by(shared, parents, under < LARGE * mass.sum())
    for joint in range(len(mass) - 1, -1, -1):
        if mass[joint] < least and parents[joint] != NO_PARENT:
            heir = last_owner(owner, int(above[joint]))
            heir = heir if heir != joint else last_owner(owner, int(parents[joint]))
            owner[joint] = heir
            mass[heir] += mass[joint] if heir != joint else 0.0
    owner = np.array([last_owner(owner, joint) for joint in range(len(mass))])
    owner = merge_small_roots(owner, mass, parents, least, under)
    for lone in np.flatnonzero((owner == np.arange(len(mass))) & (mass < least)):
        by = last_owner(owner, int(above[lone])) if above[lone] != NO_PARENT else lone
        owner[lone] = by if by != lone else last_owner(owner, int(mass.argmax()))
    return np.array([last_owner(owner, joint) for joint in range(len(mass))])


def merge_small_roots(
    owner: Int[np.ndarray, " joints"],
    mass: Float[np.ndarray, " joints"],
    parents: Int[np.ndarray, " joints"],
    least: float,
    under: Float[np.ndarray, " joints"],
) -> Int[np.ndarray, " joints"]:
    """Merge each small root, and each origin on the floor, into the child with most of the body.

    Args:
        owner: of each joint so far.
        mass: surface that each owner moves.
        parents: the skeleton's tree.
        least: mass from which a root is kept.
        under: surface that each joint's subtree moves.
    """
    owner = owner.copy()
    kept = owner == np.arange(len(mass))
    above = np.where(parents == NO_PARENT, NO_PARENT, owner[parents])
    for root in np.flatnonzero(kept & (parents == NO_PARENT)):
        children = np.flatnonzero(kept & (above == root))
        if not len(children):
            continue
        heir = children[under[children].argmax()]
        on_floor = mass[root] < SMALL_ROOT * mass.sum() and under[heir] > MOST * under[root]
        if mass[root] < least or on_floor:
            owner[owner == root] = heir
    return owner


def last_owner(owner: Int[np.ndarray, " joints"], joint: int) -> int:
    """Follow owners from a joint to one that owns itself."""
    while owner[joint] != joint:
        joint = int(owner[joint])
    return joint


def carried_by(
    shared: Float[np.ndarray, "joints joints"],
    parents: Int[np.ndarray, " joints"],
    limb: Bool[np.ndarray, " joints"],
) -> Int[np.ndarray, " joints"]:
    """Say which joint each one moves with: its parent, or a joint it shares far more surface with.

    Args:
        shared: surface that two joints move together.
        parents: the skeleton's tree; a root that shares no surface keeps NO_PARENT.
        limb: under which no large part of the body hangs; others stay with their parent.
    """
    outside = np.where(descendants(parents), 0.0, shared)  # of each joint's own subtree
    each = np.arange(len(parents))
    own = np.where(parents == NO_PARENT, 0.0, shared[each, parents])
    rival = outside.argmax(axis=1)
    return np.where(limb & (outside[each, rival] > RIVAL * own), rival, parents)


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
    """Join the joints into one tree: the skeleton's own pairs that hold, then shared surface.

    Returns:
        the old number of each joint in the new order, parents first, and the new parents.
    """
    mass = areas @ weights
    shared = np.sqrt(weights).T @ (areas[:, None] * np.sqrt(weights))
    np.fill_diagonal(shared, 0.0)
    holds = pairs_that_hold(shared, mass, hierarchy)
    first = np.where(holds | holds.T, 1.0 + shared.max(), 0.0)
    affinity = shared + first + 1e-6 * (hierarchy | hierarchy.T) + 1e-12
    cost = affinity.max() * 2 - affinity
    np.fill_diagonal(cost, 0.0)
    tree = minimum_spanning_tree(cost)
    start = main_joint(mass / areas.sum(), hierarchy)
    order, above = breadth_first_order(tree, start, directed=False)
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    parents = np.array([NO_PARENT if above[j] < 0 else place[above[j]] for j in order])
    return order.astype(np.int64), parents.astype(np.int64)


def pairs_that_hold(
    shared: Float[np.ndarray, "joints joints"],
    mass: Float[np.ndarray, " joints"],
    hierarchy: Bool[np.ndarray, "joints joints"],
) -> Bool[np.ndarray, "joints joints"]:
    """Tell which of the skeleton's pairs, parent above child, the surface bears out.

    A small limb that shares four times as much surface with a joint outside of it as with its
    parent is a stray: a foot that an IK rig hangs off the root goes with its leg. Half a body
    is none, however little it shares with the other half; a limb that shares nothing is.

    Args:
        shared: surface that two joints move together.
        mass: surface that each moves.
        hierarchy: which joint, of the row, is the parent of which, of the column.
    """
    below = np.isfinite(shortest_path(hierarchy, unweighted=True))  # the column hangs below the row
    parent, child = np.nonzero(hierarchy)
    rivals = np.where(below[child], 0.0, shared[child])
    rivals[np.arange(len(child)), parent] = 0.0
    own = shared[parent, child]
    at_home = RIVAL * own >= rivals.max(axis=1, initial=0.0)
    large = below[child] @ mass > LARGE * mass.sum()
    holds = np.zeros_like(hierarchy)
    holds[parent, child] = (at_home | large) & (own > 1e-6 * mass.sum())
    return holds


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
