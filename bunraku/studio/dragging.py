"""Drag joints of a figure to where they belong: skin and clips follow, each visitor's own."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from bunraku.adjusting import move_joint
from bunraku.formats import read_figure, write_character
from bunraku.types import Character
from bunraku.verbs.engines import name_bones

DOT, CHOSEN = (250, 180, 40), (230, 60, 30)
DOT_SIZE, HANDLE_SIZE = 1 / 120, 1 / 3  # of the figure's height
NOWHERE = 1e-6  # metres that count as no move at all


class JointMover:
    """Dots on the joints of a figure in its own pose, one of them with handles to drag it by."""

    def __init__(
        self,
        client: Any,
        show: Callable[[Character], None],
        pose: Callable[[], None],
    ) -> None:
        """Add the controls.

        Args:
            client: of viser.
            show: puts a figure with a moved joint on the stage.
            pose: shows the figure as it is wanted now: in its own pose while joints are moved.
        """
        self.client, self.show, self.pose = client, show, pose
        self.original: Character | None = None  # as it was animated
        self.character: Character | None = None  # with the joints where they were dragged
        self.nodes: list[Any] = []
        self.drawing = threading.RLock()  # who may change the figure; before that of the stage
        self.handles: Any = None
        gui = client.gui
        with gui.add_folder("Joints"):
            self.moving = gui.add_checkbox("Move joints", False, disabled=True)
            self.joint = gui.add_dropdown("Joint", ["none"], disabled=True)
            self.undo = gui.add_button("Undo all moves", disabled=True)
        self.moving.on_update(lambda _: self._begin_or_end())
        self.joint.on_update(lambda _: self._draw())
        self.undo.on_click(lambda _: self.undo_all())

    def take(self, character: Character) -> None:
        """Work on another figure."""
        with self.drawing:
            self.original = self.character = character
            self.undo.disabled = True
        self.moving.value = False
        self.joint.options = character.skeleton.names
        self.moving.disabled = self.joint.disabled = False
        self._draw()

    @property
    def moves(self) -> dict[str, list[float]]:
        """Where joints were dragged to, by name, in metres, in the figure's own pose."""
        if self.original is None or self.character is None:
            return {}
        before, after = joint_places(self.original), joint_places(self.character)
        apart = np.linalg.norm(after - before, axis=1) > NOWHERE
        names = self.character.skeleton.names
        return {names[joint]: after[joint].tolist() for joint in np.flatnonzero(apart)}

    def move(self, name: str, place: Float[np.ndarray, "3"]) -> None:
        """Put a joint elsewhere, and show the figure with its skin anew.

        Nothing happens if it is another figure by the time that earlier moves are done.
        """
        figure = self.original
        with self.drawing:
            if self.character is None or self.original is not figure:
                return
            joint = self.character.skeleton.names.index(name)
            self.character = move_joint(self.character, joint, place)
            self.undo.disabled = False
            self.show(self.character)
            self._draw()

    def write(self, path: Path) -> bytes:
        """Give a result's file, with the joints where they were dragged to.

        Args:
            path: the GLB as it was animated.
        """
        if self.character is None or not self.moves:
            return path.read_bytes()
        out = path.with_name(f"{path.stem}-moved{path.suffix}")
        bones = name_bones(self.character.skeleton)
        write_character(out, read_figure(path), self.character, bones=bones)
        return out.read_bytes()

    def undo_all(self) -> None:
        """Put all joints back."""
        with self.drawing:
            if self.original is None:
                return
            self.character = self.original
            self.undo.disabled = True
            self.show(self.character)
            self._draw()

    def _begin_or_end(self) -> None:
        self._draw()
        self.pose()

    def _draw(self) -> None:
        """Draw the dots and the handles, or take them away; callbacks come in threads."""
        with self.drawing:
            for node in self.nodes:
                node.remove()
            self.nodes, self.handles = [], None
            if self.character is None or not self.moving.value:
                return
            places, names = joint_places(self.character), self.character.skeleton.names
            size = float(np.ptp(self.character.mesh.vertices[:, 1]))
            for name, place in zip(names, places, strict=True):
                self._add_dot(name, place, size=size)
            if self.joint.value in names:
                self._add_handles(
                    self.joint.value, places[names.index(self.joint.value)], size=size
                )

    def _add_dot(self, name: str, place: Float[np.ndarray, "3"], *, size: float) -> None:
        """Add a dot that chooses its joint when it is clicked."""
        dot = self.client.scene.add_icosphere(
            f"/joints/{len(self.nodes)}",
            radius=DOT_SIZE * size,
            color=CHOSEN if name == self.joint.value else DOT,
            subdivisions=1,
            position=place,
        )
        dot.on_click(lambda _: self._choose(name))
        self.nodes.append(dot)

    def _add_handles(self, name: str, place: Float[np.ndarray, "3"], *, size: float) -> None:
        """Add three arrows to pull a joint by."""
        self.handles = self.client.scene.add_transform_controls(
            "/joints/handles",
            scale=HANDLE_SIZE * size,
            disable_rotations=True,
            depth_test=False,
            position=place,
        )
        self.handles.on_update(lambda event: self._drop(event, name))
        self.nodes.append(self.handles)

    def _choose(self, name: str) -> None:
        self.joint.value = name
        self._draw()

    def _drop(self, event: Any, name: str) -> None:
        """Take the place where the visitor let go of the handles."""
        if event.phase == "end" and self.handles is not None:
            self.move(name, np.asarray(self.handles.position, np.float64))


def joint_places(character: Character) -> Float[np.ndarray, "joints 3"]:
    """Give where the joints were when the skin was bound."""
    return np.linalg.inv(character.skin.inverse_bind)[:, :3, 3]
