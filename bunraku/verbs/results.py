"""What a verb gives: the figure, the performer, and every stage between them."""

from dataclasses import dataclass
from functools import cached_property

from bunraku.evaluate.report import report_depth_transfer, report_transfer
from bunraku.routes.from_depth import DepthTransfer
from bunraku.routes.from_rig import RigTransfer
from bunraku.skinning import linear_blend_skinning
from bunraku.types import Character, Figure, Mesh
from bunraku.verbs.filming import Film


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
