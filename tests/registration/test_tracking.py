import numpy as np
import pytest
from scipy.spatial import cKDTree

from bunraku.registration.correspondence import features
from bunraku.registration.deformation import build_graph
from bunraku.registration.tracking import Settings, find_matches
from tests.registration.test_deformation import sheet


@pytest.mark.parametrize("waits", [True, False])
def test_unexplained_depth_pulls_what_others_hide(waits):
    """Depth lies on the left half of a strip, and where a hidden right half might have gone."""
    vertices, faces = sheet()
    graph = build_graph(vertices, faces, 0.1)
    facing = np.tile([0.0, 0.0, 1.0], (len(vertices), 1))
    places = features(vertices, facing, 0.15)
    left, right = np.flatnonzero(vertices[:, 0] < -0.2), np.flatnonzero(vertices[:, 0] > 0.2)
    gone = vertices[right] + [0.0, 0.0, 0.3]
    depth = np.concatenate([places[left], features(gone, facing[right], 0.15)])
    asked = np.arange(len(depth))
    hidden = right if waits else right[:0]
    found = find_matches(
        *(graph, (left, places[left]), cKDTree(depth), asked, Settings()),
        hidden=(hidden, places[hidden]),
    )
    far = found.still >= len(left)
    assert far.sum() == len(right)
    assert np.isin(found.moving[far], right).all() == waits
    if waits:
        np.testing.assert_array_equal(found.moving[far], right)
        assert (found.weights[far] > 0.1).all()
    else:
        assert np.isin(found.moving, left).all()
        assert (found.weights[far & (vertices[found.moving, 0] < -0.5)] == 0).all()
