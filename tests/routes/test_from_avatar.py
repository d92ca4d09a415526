from dataclasses import replace

import numpy as np
import pytest

from bunraku.evaluate.metrics import edge_length_score, pose_distance
from bunraku.neural.anatomy import PERSON
from bunraku.neural.bodies import Body, pose_body
from bunraku.neural.corpus import draw_sculpted
from bunraku.neural.parts import Understanding
from bunraku.neural.variation import chain_turns
from bunraku.rotations import vectors_to_matrices
from bunraku.routes import from_avatar
from bunraku.routes.from_avatar import NETWORK, REGISTRATION, animate_from_avatar, sureness
from bunraku.routes.from_rig import animate_from_rig
from bunraku.skinning import play_clip
from bunraku.types import MatchError, Mesh


class Oracle:
    """Understands the bodies it was told of, by their number of vertices."""

    def __init__(self, *bodies: Body, agreement: float = 1.0, chance: float = 1.0) -> None:
        self.bodies, self.agreement, self.chance = bodies, agreement, chance

    def __call__(self, mesh: Mesh, *, kind: str | None = None) -> Understanding:
        body = next(b for b in self.bodies if len(b.mesh.vertices) == len(mesh.vertices))
        return Understanding(body.kind, self.chance, body.weights, body.joints, self.agreement)


@pytest.fixture(scope="module")
def bodies() -> tuple[Body, Body]:
    """Two people of very different proportions, with different numbers of vertices."""
    rng = np.random.default_rng(3)
    avatar = draw_sculpted("rounded", rng)
    figure = draw_sculpted("rounded", rng)
    while len(figure.mesh.vertices) == len(avatar.mesh.vertices):
        figure = draw_sculpted("rounded", rng)
    return avatar, figure


def random_turns(frames: int) -> np.ndarray:
    own = vectors_to_matrices(
        np.random.default_rng(5).normal(0, 0.35, (frames, len(PERSON.names), 3))
    )
    return chain_turns(PERSON, own)


def test_a_figure_of_known_parts_takes_the_poses(bodies):
    avatar, figure = bodies
    turns = random_turns(3)
    poses, truth = pose_body(avatar, turns), pose_body(figure, turns)
    oracle = Oracle(avatar, figure)
    transfer = animate_from_avatar(oracle, avatar.mesh, poses, figure.mesh, rate=10.0, force=True)
    moved = play_clip(transfer.learned, transfer.learned.clips[0])
    height = float(np.ptp(figure.mesh.vertices[:, 1]))
    error = pose_distance(moved, truth, height)
    static = pose_distance(np.broadcast_to(figure.mesh.vertices, truth.shape), truth, height)
    assert error < 0.08 * static and edge_length_score(moved, truth, figure.mesh.faces) > 0.95
    assert transfer.character.clips[0].times.tolist() == [0.0, 0.1, 0.2]
    assert set(transfer.seconds) == {"avatar", "figure", "second opinion"}


def test_a_figure_that_is_not_understood_is_refused(bodies):
    avatar, figure = bodies
    poses = avatar.mesh.vertices[None]
    read = Oracle(avatar, squat(figure), agreement=0.49)
    with pytest.raises(MatchError, match="hardly understood as a person"):
        animate_from_avatar(read, avatar.mesh, poses, figure.mesh)


def test_a_figure_of_the_avatars_build_is_registered_to_it(bodies, monkeypatch):
    """The second opinion is asked, and believed, where the surface fits; its doubts are told."""

    def register(*given, **options):
        return replace(animate_from_rig(*given, **options), warnings=("left may be right",))

    monkeypatch.setattr(from_avatar, "animate_from_rig", register)
    avatar = bodies[0]
    larger = Mesh(2 * avatar.mesh.vertices, avatar.mesh.faces)
    figure = replace(avatar, mesh=larger, joints=2 * avatar.joints)
    turns = random_turns(1)
    transfer = animate_from_avatar(
        Oracle(avatar), avatar.mesh, pose_body(avatar, turns), larger, force=True
    )
    assert transfer.chosen == REGISTRATION and transfer.confidence > 0.9
    assert transfer.warnings == ("left may be right",)
    moved = play_clip(transfer.character, transfer.character.clips[0])
    assert pose_distance(moved, pose_body(figure, turns), 2.0) < 2.0


def test_bodies_of_other_proportions_are_left_to_the_network(bodies):
    avatar, figure = bodies
    squat = replace(figure, joints=figure.joints * [3.0, 0.3, 1.0])
    transfer = animate_from_avatar(
        Oracle(avatar, squat), avatar.mesh, avatar.mesh.vertices[None], figure.mesh, force=True
    )
    assert transfer.chosen == NETWORK and transfer.registered is None


def squat(figure: Body) -> Body:
    """Put joints so that nothing is registered, which takes long."""
    return replace(figure, joints=figure.joints * [3.0, 0.3, 1.0])


def test_a_figure_of_another_kind_is_refused_unless_forced(bodies):
    """A horse is a person by a chance of 1 in 10,000."""
    avatar, figure = bodies
    poses, body = avatar.mesh.vertices[None], squat(figure)
    sure, unsure = Oracle(avatar, body), Oracle(body, chance=1e-4)

    def read(mesh: Mesh, *, kind: str | None = None) -> Understanding:
        return (unsure if kind else sure)(mesh)

    with pytest.raises(MatchError, match="hardly understood as a person"):
        animate_from_avatar(read, avatar.mesh, poses, figure.mesh)
    forced = animate_from_avatar(read, avatar.mesh, poses, figure.mesh, force=True)
    assert forced.confidence < 1e-3 and "hardly understood" in forced.warnings[0]


def test_an_avatar_of_few_parts_is_refused_whatever_the_network_says(bodies):
    avatar, figure = bodies
    triangle = Mesh(avatar.mesh.vertices[:3], np.array([[0, 1, 2]]))
    few = replace(avatar, mesh=triangle, weights=np.eye(len(PERSON.names))[:3])
    read = Oracle(few, figure)
    assert sureness(read(triangle)) == pytest.approx(3 / 20)
    with pytest.raises(MatchError, match=r"the avatar 0\.15 of 1"):
        animate_from_avatar(read, triangle, triangle.vertices[None], figure.mesh)


def test_doubts_about_the_avatar_count_and_are_told(bodies):
    avatar, figure = bodies
    read = Oracle(avatar, squat(figure), agreement=0.65)
    transfer = animate_from_avatar(read, avatar.mesh, avatar.mesh.vertices[None], figure.mesh)
    assert transfer.confidence == pytest.approx(0.65**2, abs=0.1) and len(transfer.warnings) == 1
