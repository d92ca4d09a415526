"""What a verb gives: the figure, the performer, and every stage between them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from bunraku.evaluate.report import report_depth_transfer, report_transfer
from bunraku.proxy import lift
from bunraku.routes.from_depth import DepthTransfer
from bunraku.routes.from_rig import RigTransfer
from bunraku.skinning import linear_blend_skinning
from bunraku.types import Character, Figure, Mesh
from bunraku.verbs.filming import Film
from bunraku.weights import transfer_to_surface


@dataclass(frozen=True, eq=False)
class Result:
    """A figure that moves, and how it came about; `bunraku.write` puts it into files."""

    figure: Figure  # as it was found
    performer: Character
    performance: str  # the performer's name: its file as given, or "built-in human"
    transfer: (
        RigTransfer | DepthTransfer
    )  # every stage of the route: proxies, registration, joints, rest pose, ...
    total_seconds: float  # reading included
    film: Film | None = None  # of a depth video, which was captured first

    @property
    def character(self) -> Character:
        """The figure as found, bound to the performer's joints, with the clips carried over."""
        return self.transfer.character

    @property
    def confidence(self) -> float:
        """How far to trust the match, 0 to 1: docs/confidence.md says how it is computed."""
        return self.transfer.confidence

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the route found doubtful, in plain words."""
        return (*(self.film.warnings if self.film else ()), *self.transfer.warnings)

    @property
    def seconds(self) -> dict[str, float]:
        """How long each stage took, in order."""
        return {**(self.film.capture.seconds if self.film else {}), **self.transfer.seconds}

    @cached_property
    def at_rest(self) -> Mesh:
        """The figure in its performer's rest pose: the surface alone, in metres, Y up.

        Raises:
            ValueError: if the performer was filmed: it has the pose of a frame, and no other.
        """
        if not isinstance(self.transfer, RigTransfer):
            raise ValueError("a filmed performer has no rest pose; give a rigged character")
        mesh, skin = self.character.mesh, self.character.skin
        vertices = linear_blend_skinning(mesh.vertices, skin.weights, self.transfer.repose_motion)
        return Mesh(vertices, mesh.faces)

    @cached_property
    def counterparts(self) -> Float[np.ndarray, "vertices 3"]:
        """Where on the performer's surface at rest each vertex of the figure lies: the map.

        In the performer's own metres; read off the registered performer as the skin is.

        Raises:
            ValueError: if the performer was filmed: its surface is never laid onto the figure.
        """
        stages = self.transfer
        if not isinstance(stages, RigTransfer):
            raise ValueError("a filmed performer is not mapped; give a rigged character")
        performer, fitted = stages.source_proxy.mesh, stages.registration.fitted
        carried = transfer_to_surface(
            performer.vertices, fitted, performer.faces, stages.target_proxy.mesh.vertices
        )
        return lift(stages.target_proxy, carried)

    @cached_property
    def report(self) -> dict[str, object]:
        """How far to trust the result, in numbers: what `--report` writes."""
        if isinstance(self.transfer, DepthTransfer):
            assert self.film is not None
            return report_depth_transfer(
                self.figure.path,
                self.performance,
                self.film.capture,
                self.transfer,
                total_seconds=self.total_seconds,
            )
        return report_transfer(
            self.figure.path,
            {"path": self.performance},
            self.performer,
            self.transfer,
            total_seconds=self.total_seconds,
        )
