"""What the camera saw, beside who was filmed: depth frames, and the points that were followed."""

from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from bunraku.batching.footage import Footage

VISIBLE, HIDDEN = np.array([60, 200, 90], np.uint8), np.array([230, 60, 30], np.uint8)
NEAR, FAR = np.array([250.0, 230.0, 120.0]), np.array([40.0, 60.0, 160.0])
SEEN_SIZE, FOLLOWED_SIZE = 1 / 250, 1 / 90  # of the performer's height
BLACK = np.zeros((4, 4, 3), np.uint8)


class Screen:
    """Controls and nodes that show a depth video; one frame at a time is sent."""

    def __init__(self, client: Any, redraw: Any) -> None:
        """Add the controls, to be used when there is a film.

        Args:
            client: of viser.
            redraw: called when other things are to be shown.
        """
        self.scene = client.scene
        self.footage: Footage | None = None
        self.place = (0.0, 0.0, 0.0)
        self.shown: tuple[int, bool, bool] | None = None
        self.clouds: list[Any] = []
        gui = client.gui
        self.folder = gui.add_folder("Depth video", visible=False)
        with self.folder:
            self.picture = gui.add_image(BLACK, label="Depth frame")
            self.depths = gui.add_checkbox("Depth points", True)
            self.points = gui.add_checkbox("Tracked points", True)
        self.depths.on_update(lambda _: redraw())
        self.points.on_update(lambda _: redraw())

    def take(self, footage: Footage | None, aside: float) -> None:
        """Show another film, or none, so many metres along x."""
        self.clear()
        self.footage, self.place = footage, (aside, 0.0, 0.0)
        self.folder.visible = footage is not None

    def clear(self) -> None:
        """Take the points off the stage."""
        for cloud in self.clouds:
            cloud.remove()
        self.clouds, self.shown = [], None

    def show(self, share: float) -> None:
        """Show the frame at a share, 0 to 1, of the film."""
        film = self.footage
        if film is None:
            return
        frame = film.frame(film.times[0] + share * (film.times[-1] - film.times[0]))
        wanted = frame, bool(self.depths.value), bool(self.points.value)
        if wanted == self.shown:
            return
        self.clear()
        self.shown = wanted
        self.picture.image = np.repeat(film.pictures[frame][..., None], 3, axis=-1)
        height = float(np.ptp(film.seen[..., 1]))
        if self.depths.value:
            self._add("seen", film.seen[frame], shade(film.seen[frame]), height * SEEN_SIZE)
        if self.points.value:
            colours = np.where(film.visible[frame][:, None], VISIBLE, HIDDEN)
            self._add("followed", film.followed[frame], colours, height * FOLLOWED_SIZE)

    def _add(self, name: str, points: np.ndarray, colours: np.ndarray, size: float) -> None:
        cloud = self.scene.add_point_cloud(
            f"/film/{name}", points, colours, point_size=size, position=self.place
        )
        self.clouds.append(cloud)


def shade(points: Float[np.ndarray, "points 3"]) -> UInt8[np.ndarray, "points 3"]:
    """Colour points by how near to the camera they are, which looks along -Z."""
    depth = points[:, 2].astype(np.float64)
    share = (depth - depth.min()) / max(float(np.ptp(depth)), 1e-9)
    return (share[:, None] * NEAR + (1 - share[:, None]) * FAR).astype(np.uint8)
