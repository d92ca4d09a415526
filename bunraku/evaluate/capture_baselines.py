"""Rows of the capture table beside ours: the paper's own settings, and the methods it names.

None follows the figure as a whole. Both clusterings begin from our track and make as many bones as
we do, so that they differ from "seen side alone" in the bones only.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from bunraku.bones.clustering import (
    Owners,
    Paths,
    Points,
    cluster_motion,
    cluster_spectrally,
    join_clusters,
)
from bunraku.registration.tracking import Settings
from bunraku.routes.capturing import rig_bones
from bunraku.routes.from_depth import Capture, capture_performer
from bunraku.types import DepthVideo

# N-ICP of the paper (Sec. 3.1, supplement 2): from the first frame, one way, point to point, not
# robust, sigma .05, 5000 points a step, 1000 to 10 between the two terms. Paper: 100 steps of
# gradient descent. We: 10 of Gauss-Newton, the better solver.
PAPER = Settings(
    radius=0.05,
    steps=10,
    queries=5000,
    normals=0.0,
    gate=np.inf,
    width=1e3,
    share=100.0,
    rigidity=0.5,
    momentum=0.0,
    both_ways=False,
    other_starts=False,
)


def capture_as_paper(video: DepthVideo) -> Capture:
    """Capture with the paper's N-ICP, joints moving as their rings do (Eq. 14)."""
    capture = capture_performer(video, settings=PAPER)
    bones, reference = capture.bones, capture.track.reference
    surface = capture.track.places + capture.eye, capture.views[reference].faces
    rings = capture.curves.owners == bones.rings[:, None]
    character = rig_bones(bones, surface, reference, capture.times, rings=rings)
    return replace(capture, character=character)


def capture_by_clusters(
    capture: Capture, cluster: Callable[[Points, Paths, int], Owners]
) -> Capture:
    """Give a capture other bones: as many clusters of its trajectories as it had bones."""
    paths = capture.track.places + capture.eye
    reference = capture.track.reference
    faces = capture.views[reference].faces
    owners = cluster(paths[reference], paths, len(capture.bones.parents))
    bones = join_clusters(paths[reference], faces, owners)
    character = rig_bones(bones, (paths, faces), reference, capture.times)
    return replace(capture, bones=bones, character=character)


OURS = "ours"
METHODS: dict[str, Callable[[DepthVideo], Capture]] = {
    OURS: capture_performer,
    "seen side alone": capture_performer,
    "N-ICP of the paper": capture_as_paper,
    "motion clusters (Le-Deng)": lambda video: capture_by_clusters(
        capture_performer(video), cluster_motion
    ),
    "spectral clusters (Zhang)": lambda video: capture_by_clusters(
        capture_performer(video), cluster_spectrally
    ),
}
