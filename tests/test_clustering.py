import numpy as np
import pytest

from bunraku.bones.clustering import cluster_motion, cluster_spectrally, join_clusters
from bunraku.rotations import vectors_to_matrices


@pytest.fixture
def finger():
    """A tube along X of 21 rings, of which the last third bends about the one before, and both."""
    along, around = np.repeat(np.linspace(0, 3, 31), 12), np.tile(np.arange(12) * np.pi / 6, 31)
    rest = np.column_stack([along, 0.2 * np.cos(around), 0.2 * np.sin(around)])
    paths = np.tile(rest, (8, 1, 1))
    for start, most in ((2.0, 1.2), (1.0, 0.9)):
        turns = vectors_to_matrices(np.linspace(0, most, 8)[:, None] * [0.0, 0.0, 1.0])
        far, middle = rest[:, 0] > start, np.array([start, 0.0, 0.0])
        paths[:, far] = np.einsum("fab,fvb->fva", turns, paths[:, far] - middle) + middle
    ring, side = np.divmod(np.arange(30 * 12), 12)
    corner = 12 * ring + side
    beside = 12 * ring + (side + 1) % 12
    faces = np.concatenate(
        [
            np.column_stack([corner, beside, corner + 12]),
            np.column_stack([beside, beside + 12, corner + 12]),
        ]
    )
    truth = (along > 1.0).astype(int) + (along > 2.0)
    return rest, paths, faces, truth


@pytest.mark.parametrize("cluster", [cluster_motion, cluster_spectrally])
def test_bones_of_a_finger_are_found_from_its_motion(finger, cluster):
    rest, paths, _, truth = finger
    owners = cluster(rest, paths, 3)
    assert owners.max() == 2
    table = np.stack([np.bincount(owners[truth == part], minlength=3) for part in range(3)])
    assert table.max(axis=1).sum() > 0.9 * len(rest)
    assert len(set(table.argmax(axis=1))) == 3


def test_one_rigid_body_is_one_cluster(finger):
    rest, _, _, _ = finger
    turned = np.einsum("fab,vb->fva", vectors_to_matrices(np.eye(3)), rest)
    assert cluster_motion(rest, turned, 1).max() == 0
    owners = np.zeros(len(rest), np.int64)
    bones = join_clusters(rest, np.array([[0, 1, 12]]), owners)
    np.testing.assert_array_equal(bones.parents, [-1])


def test_clusters_hang_on_each_other_where_they_touch(finger):
    rest, _, faces, truth = finger
    bones = join_clusters(rest, faces, truth)
    np.testing.assert_array_equal(bones.parents, [-1, 0, 0])  # the middle one is first
    assert sorted(np.round(bones.joints[1:, 0])) == [1.0, 2.0]
    np.testing.assert_allclose(bones.joints[:, 1:], 0.0, atol=1e-9)
    apart = join_clusters(rest, faces[:0], truth)  # no borders: by distance
    assert set(apart.parents.tolist()) == {-1, 0}
