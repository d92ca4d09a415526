import numpy as np
import pytest

from bunraku.curves import extract_curves
from bunraku.proxy import build_proxy
from bunraku.registration.tracking import Sight
from bunraku.registration.whole import depth_errors, follow_whole


@pytest.fixture(scope="module")
def sight(capture):
    return Sight(capture.views, capture.intrinsics, capture.diagonal / 2)


@pytest.fixture(scope="module")
def proxy(film):
    return build_proxy(film.places[0], film.faces)


def test_a_whole_creature_is_followed_with_its_far_side(film, sight, proxy):
    mesh = proxy.mesh
    curves = extract_curves(mesh.vertices, mesh.faces)
    told = []
    paths = follow_whole(
        *(mesh, curves, sight, 0),
        progress=lambda done, count: told.append((done, count)),
    )
    nearest = np.linalg.norm(film.places[0][:, None] - mesh.vertices, axis=-1).argmin(axis=1)
    off = np.linalg.norm(paths[:, nearest] - film.places, axis=-1)
    still = np.linalg.norm(film.places - film.places[0], axis=-1)
    assert off.mean() < 0.3 * still.mean()
    assert told[-1] == (len(sight.views) - 1, len(sight.views) - 1)
    errors = depth_errors(paths, mesh.faces, sight)
    frozen = depth_errors(np.broadcast_to(paths[0], paths.shape), mesh.faces, sight)
    assert errors.mean() < 0.5 * frozen.mean()


def test_an_error_counts_depth_that_is_missed_and_surface_that_is_not_there(sight, proxy):
    mesh = proxy.mesh
    few = Sight(sight.views[:1], sight.intrinsics, sight.unit)
    right = depth_errors(mesh.vertices[None], mesh.faces, few)[0]
    moved = depth_errors(mesh.vertices[None] + [0.3, 0.0, 0.0], mesh.faces, few)[0]
    assert right < 0.05 < moved
