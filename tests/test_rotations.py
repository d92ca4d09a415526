import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bunraku import rotations

QUARTER = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # a quarter turn about Z


def random_rotations(rng, *shape):
    return Rotation.random(int(np.prod(shape)), rng=rng).as_matrix().reshape(*shape, 3, 3)


def test_a_quarter_turn_by_hand():
    half = np.sqrt(0.5)
    np.testing.assert_allclose(
        rotations.quaternions_to_matrices(np.array([0, 0, half, half])), QUARTER, atol=1e-15
    )
    np.testing.assert_allclose(rotations.matrices_to_quaternions(QUARTER), [0, 0, half, half])
    vector = np.array([0, 0, np.pi / 2])
    np.testing.assert_allclose(rotations.vectors_to_matrices(vector), QUARTER, atol=1e-15)
    np.testing.assert_allclose(rotations.matrices_to_vectors(QUARTER), vector)
    assert np.isclose(rotations.rotation_angles(QUARTER), np.pi / 2)


def test_quaternions_come_back_on_the_side_of_positive_w(rng):
    quaternions = rotations.matrices_to_quaternions(random_rotations(rng, 4, 5))
    assert quaternions.shape == (4, 5, 4) and (quaternions[..., 3] >= 0).all()
    again = rotations.matrices_to_quaternions(rotations.quaternions_to_matrices(-quaternions))
    np.testing.assert_allclose(again, quaternions, atol=1e-12)


def test_vectors_survive_the_way_there_and_back(rng):
    vectors = rng.normal(size=(4, 5, 3))
    vectors *= rng.uniform(0, np.pi, (4, 5, 1)) / np.linalg.norm(vectors, axis=-1, keepdims=True)
    matrices = rotations.vectors_to_matrices(vectors)
    np.testing.assert_allclose(rotations.matrices_to_vectors(matrices), vectors, atol=1e-9)


def test_vectors_agree_with_the_exponential_series(rng):
    """Rodrigues' formula against sum K^n / n! of the cross-product matrix K."""
    x, y, z = vector = rng.normal(size=3)
    cross, term, series = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]), np.eye(3), np.eye(3)
    for n in range(1, 40):
        term = term @ cross / n
        series = series + term
    np.testing.assert_allclose(rotations.vectors_to_matrices(vector), series, atol=1e-12)


def test_nearest_rotation_of_a_stretched_rotation_is_the_rotation(rng):
    turned = random_rotations(rng, 6)
    square = rng.normal(size=(6, 3, 3))
    stretch = square @ np.swapaxes(square, 1, 2) + 0.1 * np.eye(3)
    np.testing.assert_allclose(rotations.nearest_rotation(turned @ stretch), turned, atol=1e-9)


def test_nearest_rotation_is_never_a_reflection_and_beats_all_others(rng):
    matrix = np.diag([2.0, 1.0, -0.5]) @ random_rotations(rng, 1)[0]
    nearest = rotations.nearest_rotation(matrix)
    assert np.isclose(np.linalg.det(nearest), 1.0)
    others = np.einsum("rij,ij->r", random_rotations(rng, 2000), matrix)
    assert np.einsum("ij,ij->", nearest, matrix) >= others.max()


def test_nearest_rotation_of_a_flat_matrix_is_still_a_rotation():
    for flat in (np.diag([1.0, 1.0, 0.0]), np.diag([1.0, 0.0, 0.0]), np.zeros((3, 3))):
        nearest = rotations.nearest_rotation(flat)
        np.testing.assert_allclose(nearest @ nearest.T, np.eye(3), atol=1e-12)
        assert np.isclose(np.linalg.det(nearest), 1.0)


def test_rotation_between_turns_each_direction_onto_the_other_the_short_way(rng):
    source, target = rng.normal(size=(2, 20, 3))
    turn = rotations.rotation_between(source, target)
    turned = np.einsum("bij,bj->bi", turn, source / np.linalg.norm(source, axis=1, keepdims=True))
    np.testing.assert_allclose(
        turned, target / np.linalg.norm(target, axis=1, keepdims=True), atol=1e-12
    )
    cosine = np.einsum("bi,bi->b", source, target)
    cosine /= np.linalg.norm(source, axis=1) * np.linalg.norm(target, axis=1)
    np.testing.assert_allclose(rotations.rotation_angles(turn), np.arccos(cosine), atol=1e-7)


@pytest.mark.parametrize("direction", [[1.0, 0, 0], [0, -2.0, 0], [1.0, 2.0, 3.0]])
def test_rotation_between_equal_and_opposite_directions(direction):
    direction = np.array(direction)
    np.testing.assert_allclose(
        rotations.rotation_between(direction, 3 * direction), np.eye(3), atol=1e-9
    )
    back = rotations.rotation_between(direction, -direction)
    np.testing.assert_allclose(back @ direction, -direction, atol=1e-9)
    assert np.isclose(np.linalg.det(back), 1.0)


def test_a_composed_transform_scales_then_turns_then_moves():
    transform = rotations.compose_transforms(
        np.array([10.0, 0, 0]), QUARTER, np.array([2.0, 3.0, 4.0])
    )
    np.testing.assert_allclose(transform @ [1, 1, 1, 1], [10 - 3, 2, 4, 1])


def test_transforms_survive_the_way_there_and_back(rng):
    parts = rng.normal(size=(4, 5, 3)), random_rotations(rng, 4, 5), rng.uniform(0.5, 2, (4, 5, 3))
    for part, back in zip(
        parts, rotations.decompose_transforms(rotations.compose_transforms(*parts)), strict=True
    ):
        np.testing.assert_allclose(back, part, atol=1e-9)


def test_a_mirrored_transform_keeps_a_proper_rotation():
    mirrored = np.diag([-1.0, 1.0, 1.0, 1.0])
    _, turn, scale = rotations.decompose_transforms(mirrored)
    assert np.isclose(np.linalg.det(turn), 1.0)
    np.testing.assert_allclose(turn * scale[None, :], mirrored[:3, :3], atol=1e-12)


def test_invert_rigid_agrees_with_a_general_solve(rng):
    transforms = rotations.compose_transforms(rng.normal(size=(6, 3)), random_rotations(rng, 6))
    np.testing.assert_allclose(
        rotations.invert_rigid(transforms), np.linalg.inv(transforms), atol=1e-12
    )


def test_the_part_of_a_turn_about_the_vertical():
    heading, lean = (
        Rotation.from_euler(axis, angle, degrees=True).as_matrix()
        for axis, angle in (("y", 130), ("x", 20))
    )
    np.testing.assert_allclose(rotations.vertical_turn(heading), heading, atol=1e-12)
    found = rotations.vertical_turn(heading @ lean)
    np.testing.assert_allclose(found[:, 1], [0, 1, 0], atol=1e-12)
    assert np.rad2deg(rotations.rotation_angles(heading.T @ found)) < 4
