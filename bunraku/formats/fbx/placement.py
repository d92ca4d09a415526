"""Where a node of an FBX file is below its parent: pivots, offsets, pre- and post-rotations.

Reference:
    Autodesk 2020, "FBX SDK Programmer's Guide", Computing transformation matrices:
    world_from_node = world_from_parent T Roff Rp Rpre R Rpost^-1 Rp^-1 Soff Sp S Sp^-1.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from bunraku import limits
from bunraku.errors import Code
from bunraku.formats.fbx.scene import Scene, Thing
from bunraku.rotations import compose_transforms
from bunraku.types import FormatError

ORDERS = ("xyz", "xzy", "yzx", "yxz", "zxy", "zyx", "xyz")
Vectors = Float[np.ndarray, "frames 3"]
Parts = tuple[Vectors, Float[np.ndarray, "frames 3 3"], Vectors]


def turn(degrees: Vectors, order: str = "xyz") -> Float[np.ndarray, "frames 3 3"]:
    """Turn about fixed axes, one after the other as `order` says; angles come as x, y, z."""
    if not degrees.any():  # most nodes, and of them there may be many
        return np.tile(np.eye(3), (len(degrees), 1, 1))
    columns = ["xyz".index(axis) for axis in order]
    return Rotation.from_euler(order, degrees[:, columns], degrees=True).as_matrix()


@np.errstate(all="ignore")  # whoever asks refuses what is not finite
def place_node(node: Thing, translations: Vectors, degrees: Vectors, scales: Vectors) -> Parts:
    """Give translation, rotation and scale below the parent, for each frame; finite or not."""
    order = ORDERS[min(max(int(node.number_of("RotationOrder")), 0), len(ORDERS) - 1)]
    before, after = (turn(node.vector(name)[None])[0] for name in ("PreRotation", "PostRotation"))
    rotations = before @ turn(degrees, order) @ after.T
    pivot, offset = node.vector("RotationPivot"), node.vector("RotationOffset")
    scale_pivot = node.vector("ScalingPivot")
    inner = node.vector("ScalingOffset") - pivot + scale_pivot - scales * scale_pivot
    moved = translations + offset + pivot + np.einsum("fij,fj->fi", rotations, inner)
    return moved, rotations, scales


def place_still(node: Thing) -> Parts:
    """Give translation, rotation and scale of a node that no clip moves; one frame."""
    return place_node(
        node,
        node.vector("Lcl Translation")[None],
        node.vector("Lcl Rotation")[None],
        node.vector("Lcl Scaling", 1.0)[None],
    )


def node_from_geometry(scene: Scene, node: Thing) -> Float[np.ndarray, "4 4"]:
    """Give the transform that a node applies to its own geometry, and to nothing below.

    Raises:
        FormatError: if its numbers are not finite, or too large.
    """
    moved, degrees = node.vector("GeometricTranslation"), node.vector("GeometricRotation")
    scales = node.vector("GeometricScaling", 1.0)
    if not (np.abs([moved, degrees, scales]) < limits.COORDINATE).all():
        message = "places its mesh by numbers that are not finite or too large; apply transforms"
        raise FormatError(scene.path, node.where, message, code=Code.NODE_TRANSFORM)
    placed = compose_transforms(moved, turn(degrees[None])[0])
    placed[:3, :3] *= scales
    return placed


def parent_of(scene: Scene, node: Thing) -> int | None:
    """Give the number of the node above; none for a root."""
    for number, name in scene.above.get(node.number, ()):
        above = scene.things.get(number)
        if not name and above is not None and above.kind == "Model":
            return number
    return None
