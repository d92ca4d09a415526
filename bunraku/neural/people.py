"""Realistic people from the parametric body `anny` (code Apache-2.0, data CC0), over all builds.

The only importer of anny, which the extra `train` brings.
"""

import logging

import numpy as np

from bunraku.neural.anatomy import PERSON
from bunraku.neural.bodies import Body, normalise
from bunraku.types import Mesh

logger = logging.getLogger(__name__)
_TRUNK = {"Hips": "hips", "Spine": "spine", "Spine1": "chest", "Spine2": "upperChest"}
_HEAD = {"Neck": "neck", "Head": "head"}
_LIMBS = {
    **{"Shoulder": "Shoulder", "Arm": "UpperArm", "ForeArm": "LowerArm", "Hand": "Hand"},
    **{"UpLeg": "UpperLeg", "Leg": "LowerLeg", "Foot": "Foot", "ToeBase": "Foot"},
}
PHENOTYPES = ("gender", "age", "muscle", "weight", "height", "proportions")


def part_of_bone(label: str) -> str:
    """Give the part that a bone of anny's `mixamo` rig belongs to; fingers belong to hands."""
    label = label.split(":")[-1]
    if label in _TRUNK or label in _HEAD:
        return (_TRUNK | _HEAD)[label]
    side = "Left" if label.startswith("Left") else "Right"
    rest = label.removeprefix(side)
    return side.lower() + ("Hand" if rest.startswith("Hand") else _LIMBS[rest])


def build_people(count: int, rng: np.random.Generator) -> list[Body]:
    """Draw people from babies to the old, thin to heavy, in anny's A pose, all sides symmetric.

    Raises:
        ModuleNotFoundError: if anny is not there.
    """
    import anny  # building its model takes half a minute, once a process
    import torch

    logger.info("people")
    model = anny.Anny(rig="mixamo", topology="anny-noeyes-notongue")
    parts = np.array([PERSON.index(part_of_bone(label)) for label in model.bone_labels])
    first = np.array([int((parts == part).argmax()) for part in range(len(PERSON.names))])
    indices, shares = model.vertex_bone_indices.numpy(), model.vertex_bone_weights.numpy()
    weights = np.zeros((len(indices), len(PERSON.names)))
    np.add.at(weights, (np.arange(len(indices))[:, None], parts[indices]), shares)
    weights /= weights.sum(axis=1, keepdims=True)
    faces = model.get_triangular_faces().numpy().astype(np.int64)
    bodies = []
    for _ in range(count):
        build = dict(zip(PHENOTYPES, rng.uniform(0, 1, len(PHENOTYPES)).tolist(), strict=True))
        with torch.no_grad():
            answer = model(phenotype_kwargs=build)
        vertices, heads = (
            answer[key][0].numpy().astype(np.float64)[:, [0, 2, 1]] * [1.0, 1.0, -1.0]
            for key in ("rest_vertices", "rest_bone_heads")  # of one frame, unlike `vertices`
        )
        middle, size = normalise(vertices)
        mesh = Mesh((vertices - middle) / size, faces)
        bodies.append(Body("anny", "person", mesh, weights, (heads[first] - middle) / size))
    return bodies
