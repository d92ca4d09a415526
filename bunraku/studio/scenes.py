"""A character on a visitor's stage: surface, skeleton, and points in colours of their own."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int

from bunraku.rotations import matrices_to_quaternions, nearest_rotation
from bunraku.skinning import clip_transforms, forward_kinematics, linear_blend_skinning
from bunraku.types import NO_PARENT, Character, Clip

MOST_COLOURS = 10  # surfaces that a character is cut into, one a colour
LEVELS = 32  # of red, green and blue, that count as one colour
BONE = (250, 180, 40)
FADED = 0.5  # opacity of a surface with something inside to see


def split_by_colour(
    faces: Int[np.ndarray, "faces 3"], colours: Float[np.ndarray, "vertices 3"]
) -> list[tuple[tuple[int, int, int], Int[np.ndarray, "some 3"]]]:
    """Cut a surface into a few of one colour each: the viewer knows no colours of vertices."""
    shades = (colours[faces].mean(axis=1) // LEVELS).astype(np.int64)
    kinds, which, counts = np.unique(shades, axis=0, return_inverse=True, return_counts=True)
    kept = np.argsort(-counts, kind="stable")[:MOST_COLOURS]
    near = ((kinds[:, None] - kinds[kept]) ** 2).sum(axis=-1).argmin(axis=1)[which.reshape(-1)]
    parts = []
    for group in range(len(kept)):
        own = faces[near == group]
        red, green, blue = colours[own].mean(axis=(0, 1)).astype(int).tolist()
        parts.append(((red, green, blue), own))
    return parts


class Actor:
    """A character in a viewer; only its joints are sent for each pose."""

    def __init__(
        self,
        scene: Any,
        name: str,
        character: Character,
        colours: Float[np.ndarray, "vertices 3"],
        *,
        aside: float = 0.0,
    ) -> None:
        """Put a character on a stage.

        Args:
            scene: of viser: a visitor's own.
            name: of the node in it.
            character: what moves.
            colours: red, green and blue of each vertex, 0 to 255.
            aside: metres along x.
        """
        self.scene, self.name, self.character = scene, name, character
        self.place = (aside, 0.0, 0.0)
        self.motions: dict[str, Float[np.ndarray, "frames joints 4 4"]] = {}
        parts = split_by_colour(character.mesh.faces, colours)
        self.surfaces = [self._add_surface(number, *part) for number, part in enumerate(parts)]
        self.bones: Any = None
        self.cloud: Any = None

    def _add_surface(
        self, number: int, colour: tuple[int, int, int], faces: Int[np.ndarray, "some 3"]
    ) -> tuple[Any, Int[np.ndarray, " moving"]]:
        """Add a part of the surface with the joints that move it; give it and those."""
        used, corners = np.unique(faces, return_inverse=True)
        weights = self.character.skin.weights[used]
        moving = np.flatnonzero(weights.any(axis=0))
        turns, places = split_poses(np.linalg.inv(self.character.skin.inverse_bind[moving]))
        surface = self.scene.add_mesh_skinned(
            f"{self.name}/surface{number}",
            self.character.mesh.vertices[used],
            corners.reshape(-1, 3),
            bone_wxyzs=turns,
            bone_positions=places,
            skin_weights=weights[:, moving],
            color=colour,
            side="double",
            position=self.place,
        )
        return surface, moving

    def leave(self) -> None:
        """Take the character off the stage."""
        nodes = [surface for surface, _ in self.surfaces]
        for node in (*nodes, self.bones, self.cloud):
            if node is not None:
                node.remove()

    def world(self, clip: Clip, share: float) -> Float[np.ndarray, "joints 4 4"]:
        """Place the joints at a share, 0 to 1, of a clip."""
        if clip.name not in self.motions:
            local = clip_transforms(clip)
            self.motions[clip.name] = forward_kinematics(self.character.skeleton.parents, local)
        motion = self.motions[clip.name]
        time = clip.times[0] + share * (clip.times[-1] - clip.times[0])
        return motion[min(int(np.searchsorted(clip.times, time)), len(motion) - 1)]

    @property
    def bound(self) -> Float[np.ndarray, "joints 4 4"]:
        """Where the joints were when the skin was made: the character's own pose."""
        return np.linalg.inv(self.character.skin.inverse_bind)

    def fade(self, *, wanted: bool) -> None:
        """Let what is inside be seen through the surface, or no longer."""
        for surface, _ in self.surfaces:
            surface.opacity = FADED if wanted else None

    def pose(self, world: Float[np.ndarray, "joints 4 4"]) -> None:
        """Show the character with its joints in these places."""
        turns, places = split_poses(world)
        for surface, moving in self.surfaces:
            for bone, joint in zip(surface.bones, moving, strict=True):
                bone.wxyz, bone.position = turns[joint], places[joint]
        if self.bones is not None:
            self.bones.points = self._segments(world)
        if self.cloud is not None:
            self.cloud.points = self._posed(world).astype(np.float32)

    def show_skeleton(self, world: Float[np.ndarray, "joints 4 4"], *, wanted: bool) -> None:
        """Draw the bones, or no longer."""
        if self.bones is not None:
            self.bones.remove()
        self.bones = None
        if wanted:
            self.bones = self.scene.add_line_segments(
                f"{self.name}/skeleton",
                self._segments(world),
                BONE,
                line_width=4.0,
                position=self.place,
            )

    def show_points(
        self,
        world: Float[np.ndarray, "joints 4 4"],
        colours: Float[np.ndarray, "vertices 3"] | None,
    ) -> None:
        """Show coloured points at the vertices instead of the surface; None ends that.

        One node with a colour a point: as surfaces of one colour each, seventeen times as many
        bones would be sent for each pose, which the page does not bear (docs/log.md).
        """
        if self.cloud is not None:
            self.cloud.remove()
        self.cloud = None
        for surface, _ in self.surfaces:
            surface.visible = colours is None
        if colours is not None:
            size = float(np.ptp(self.character.mesh.vertices[:, 1]))
            self.cloud = self.scene.add_point_cloud(
                f"{self.name}/points",
                self._posed(world).astype(np.float32),
                colours.astype(np.uint8),
                point_size=size / 60,
                point_shape="circle",
                position=self.place,
            )

    def _segments(self, world: Float[np.ndarray, "joints 4 4"]) -> Float[np.ndarray, "bones 2 3"]:
        parents = self.character.skeleton.parents
        below = np.flatnonzero(parents != NO_PARENT)
        places = world[:, :3, 3]
        return np.stack([places[parents[below]], places[below]], axis=1).astype(np.float32)

    def _posed(self, world: Float[np.ndarray, "joints 4 4"]) -> Float[np.ndarray, "vertices 3"]:
        skin = self.character.skin
        motion = world @ skin.inverse_bind
        return linear_blend_skinning(self.character.mesh.vertices, skin.weights, motion)


def split_poses(
    world: Float[np.ndarray, "joints 4 4"],
) -> tuple[Float[np.ndarray, "joints 4"], Float[np.ndarray, "joints 3"]]:
    """Split rigid transforms into quaternions wxyz, which the viewer wants, and places."""
    turns = matrices_to_quaternions(nearest_rotation(world[:, :3, :3]))
    return turns[:, [3, 0, 1, 2]], world[:, :3, 3]
