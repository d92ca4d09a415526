"""The realistic figure: another body, in mid-step, dressed, with a triangulation of its own."""

import numpy as np
import trimesh
from bake_human import MIRROR, build_body, posed
from choreography.body import STANDING, Arm, Posture, settle, world_turns
from choreography.curves import columns
from choreography.feet import planted
from jaxtyping import Float, Int
from sculpting import (
    Piece,
    Triangles,
    box,
    cut,
    decimated,
    ellipsoid,
    flipped,
    limb,
    part_of,
    sculpted,
    union,
    without,
)

from bunraku.meshes import closest_points, interpolate, sum_at_vertices, vertex_normals
from bunraku.types import NO_PARENT

PHENOTYPE = {
    "gender": 0.85,
    "age": 0.72,
    "muscle": 0.45,
    "weight": 0.66,
    "height": 0.36,
    "proportions": 0.5,
}
COARSE = 3400  # faces before subdivision, which makes four of each
CLOTHS = {  # colour, thickness in metres, rounds of smoothing, step back after each (Taubin)
    "skin": ((224, 172, 138), 0.0, 0, 0.0),
    "hair": ((66, 44, 34), 0.016, 6, 0.0),
    "shirt": ((190, 88, 74), 0.009, 30, 0.62),
    "trousers": ((58, 70, 98), 0.008, 12, 0.0),
    "shoes": ((70, 52, 46), 0.0, 0, 0.0),
}
EYE, EYE_RADIUS = (0.0302, 0.0857, 0.0924), 0.0142  # anny's, from the head joint of this body
Rows = Float[np.ndarray, "vertices columns"]


def step_pose() -> dict[str, Float[np.ndarray, "1 3 3"]]:
    """Turn the joints as in a slow step: weight on the left leg, arms down and slightly bent."""
    posture = Posture(
        hips=columns(np.array([0.045]), STANDING, 0.03),
        pelvis=columns(np.array([-7.0]), 3.0, 4.0),
        chest=columns(np.array([6.0]), 3.0, -3.0),
        head=columns(np.array([16.0]), 3.0, -3.0),
        left_foot=planted(np.array([[0.10, 0.0, 0.10]]), 8.0),
        right_foot=planted(np.array([[-0.13, 0.0, -0.15]]), -16.0),
        left_arm=Arm(swing=np.array([-10.0]), spread=24.0, elbow=22.0),
        right_arm=Arm(swing=np.array([16.0]), spread=25.0, elbow=42.0),
    )
    return world_turns(settle(posture))[0]


def step_body() -> dict[str, np.ndarray]:
    """Build the body and pose it; keep what it was at rest.

    Returns:
        as `build_body`, and local: each joint's turn; posed: the vertices, feet on the ground.
    """
    body, turns = build_body(PHENOTYPE), step_pose()
    world = np.concatenate([turns[str(name)] for name in body["names"]])
    child, local = body["parents"] != NO_PARENT, world.copy()
    local[child] = np.swapaxes(world[body["parents"][child]], -1, -2) @ world[child]
    body["local"], body["drop"] = local, np.zeros(3)
    moved = moved_with(body, body["vertices"], body["weights"])
    body["drop"] = np.array([0.0, moved[:, 1].min(), 0.0])
    return body | {"posed": moved - body["drop"]}


def moved_with(
    body: dict[str, np.ndarray],
    points: Float[np.ndarray, "points 3"],
    weights: Float[np.ndarray, "points joints"] | str,
) -> Float[np.ndarray, "points 3"]:
    """Take points from the rest pose to the pose, by weights or fixed to one joint."""
    if isinstance(weights, str):
        joint = list(body["names"]).index(weights)
        weights = np.tile(np.eye(len(body["names"]))[joint], (len(points), 1))
    moved = posed(points, weights, body["joints"], body["parents"], body["local"])
    return moved - body["drop"]


def shoe_parts(body: dict[str, np.ndarray]) -> list[Piece]:
    """Put the feet in shoes."""
    ankle = body["joints"][list(body["names"]).index("leftFoot")]
    ball = body["joints"][list(body["names"]).index("leftToes")]
    x, z, length = ankle[0], ankle[2], ball[2] - ankle[2]
    last = union(
        ellipsoid((x, 0.040, z - 0.010), (0.041, 0.046, 0.058)),
        ellipsoid((ball[0] + 0.002, 0.030, z + 0.92 * length), (0.055, 0.044, 0.088)),
        limb((x, 0.05, z), (x, 0.085, z - 0.002), (0.043, 0.042)),
        blend=0.05,
    )
    sole = box((x, -0.5, z), (1.0, 0.499, 1.0), 0.0)
    bounds = (x - 0.09, -0.02, z - 0.1), (x + 0.09, 0.17, z + 0.27)
    left = sculpted(
        "left_shoe", without(last, sole), 0.012, bounds=bounds, colour=CLOTHS["shoes"][0]
    )
    pair = (left, "leftFoot"), (flipped(left, "right_shoe"), "rightFoot")
    return [Piece(s.name, moved_with(body, s.vertices, j), s.faces, s.colour) for s, j in pair]


def eye_parts(body: dict[str, np.ndarray]) -> list[Piece]:
    """Put a white ball and an iris in each socket."""
    head = body["joints"][list(body["names"]).index("head")]
    left, right, ahead = np.array(EYE), EYE * MIRROR, np.array([0.0, 0.0, 1.0])
    points = moved_with(body, head + np.array([left, right, left + ahead]), "head")
    centres, gaze = points[:2], points[2] - points[0]
    pieces = []
    for side, centre in zip(("left", "right"), centres, strict=True):
        for name, ahead, radius, colour in (
            ("eye", 0.0, EYE_RADIUS, (246, 244, 240)),
            ("iris", 0.0088, 0.0068, (52, 36, 28)),
        ):
            middle = centre + ahead * gaze
            bounds = middle - 1.3 * radius, middle + 1.3 * radius
            ball = ellipsoid(middle, (radius,) * 3)
            pieces.append(
                sculpted(f"{side}_{name}", ball, radius / 3.2, bounds=bounds, colour=colour)
            )
    return pieces


def remeshed(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Triangles:
    """Triangulate a surface anew: simplify, subdivide, even out, lay back on the surface."""
    coarse, corners = decimated((vertices, faces), COARSE)
    fine, corners = trimesh.remesh.subdivide_loop(coarse, corners, iterations=1)
    corners = np.asarray(corners, np.int64)
    for _ in range(4):
        fine = (fine + neighbour_mean(fine, corners)) / 2
        face, shares, _ = closest_points(fine, vertices, faces)
        fine = interpolate(vertices, faces[face], shares)
    return fine, corners


def neighbour_mean(values: Rows, faces: Int[np.ndarray, "faces 3"]) -> Rows:
    """Average the values around each vertex."""
    count = len(values)
    sums = sum_at_vertices(values[faces].sum(axis=1), faces, count)
    degrees = np.bincount(faces.ravel(), minlength=count)[:, None]
    return (sums - degrees * values) / (2 * degrees)


def edges_of_cloth(
    rest: Float[np.ndarray, "points 3"],
    arm: Float[np.ndarray, " points"],
    joints: dict[str, Float[np.ndarray, "3"]],
) -> dict[str, Float[np.ndarray, " points"]]:
    """Say where each cloth is, as fields that are > 0 under it.

    Args:
        rest: points of the body at rest.
        arm: share of the arms in each point's skin.
        joints: positions at rest.
    """
    x, y, z = np.abs(rest[:, 0]), rest[:, 1], rest[:, 2]
    ankle, hips, neck, head = (joints[n] for n in ("leftFoot", "hips", "neck", "head"))
    elbow, shoulder = joints["leftLowerArm"], joints["leftUpperArm"]
    along = (np.stack([x, y], axis=1) - shoulder[:2]) @ (elbow - shoulder)[:2]
    along /= ((elbow - shoulder)[:2] ** 2).sum()
    sleeve = 0.12 * (0.62 - along)
    body = 0.15 * (0.5 - arm)
    waist = y - (hips[1] + 0.045)
    collar = np.linalg.norm(rest - neck - [0.0, 0.045, 0.03], axis=1) - 0.098
    collar = np.minimum(collar, neck[1] + 0.012 - y)
    hairline = (y - head[1] - 0.062) - 0.95 * (z - head[2] - 0.035)
    nape = y - neck[1] + 0.012
    return {
        "shoes": np.minimum(ankle[1] + 0.004 - y, body),
        "trousers": np.minimum(-waist, body),
        "shirt": np.minimum(np.minimum(waist, collar), np.maximum(sleeve, body)),
        "hair": np.minimum(np.minimum(hairline, nape), 0.5 - arm),
    }


def dress(
    values: Rows, faces: Int[np.ndarray, "faces 3"], joints: dict[str, Float[np.ndarray, "3"]]
) -> list[Piece]:
    """Lay cloth on a body and cut it where one cloth ends and the next begins.

    Args:
        values: position in the pose, position at rest, share of the arms.
        faces: triangles.
        joints: positions at rest.
    """
    for name, (_, thickness, rounds, back) in CLOTHS.items():
        if thickness > 0:
            under = edges_of_cloth(values[:, 3:6], values[:, 6], joints)[name]
            cover = np.clip(under / 0.012, 0.0, 1.0)[:, None]
            for share in rounds * (0.6, -back):
                mean = neighbour_mean(values[:, :3], faces)
                values[:, :3] += share * cover * (mean - values[:, :3])
            values[:, :3] += thickness * cover * vertex_normals(values[:, :3], faces)
    for name in ("shoes", "trousers", "shirt", "hair"):
        field = edges_of_cloth(values[:, 3:6], values[:, 6], joints)[name]
        values, faces = cut(values, faces, field)
    middles = values[faces].mean(axis=1)
    fields = edges_of_cloth(middles[:, 3:6], middles[:, 6], joints)
    worn = np.full(len(faces), "skin", dtype="U8")
    for name in ("hair", "shirt", "trousers", "shoes"):
        worn[fields[name] > 0] = name
    vertices = np.ascontiguousarray(values[:, :3])
    whole = Piece("body", vertices, faces, (0, 0, 0), vertex_normals(vertices, faces))
    return [part_of(whole, name, faces[worn == name], cloth[0]) for name, cloth in CLOTHS.items()]


def realistic() -> list[Piece]:
    """Make the whole figure."""
    body = step_body()
    names = [str(name) for name in body["names"]]
    vertices, faces = remeshed(body["posed"], body["faces"])
    arm = [name.endswith(("Arm", "Hand")) for name in names]
    shares = body["weights"][:, arm].sum(axis=1, keepdims=True)
    face, barycentric, _ = closest_points(vertices, body["posed"], body["faces"])
    carried = np.concatenate([body["vertices"], shares], axis=1)
    values = interpolate(carried, body["faces"][face], barycentric)
    joints = dict(zip(names, body["joints"], strict=True))
    clothed = dress(np.concatenate([vertices, values], axis=1), faces, joints)
    return [*clothed, *eye_parts(body), *shoe_parts(body)]
