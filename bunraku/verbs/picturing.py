"""Pictures of moved figures in the colours of their files."""

from pathlib import Path
from typing import Any, cast

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial import KDTree

from bunraku.evaluate.families import play_at
from bunraku.evaluate.pictures import CLAY, Picture, draw, look_at
from bunraku.types import Character

PHASES = np.array([0.15, 0.45, 0.75])  # of each clip, in the picture


def draw_clips(
    character: Character, colours: Float[np.ndarray, "vertices 3"]
) -> list[list[Picture]]:
    """Draw a few moments of every clip, the figure kept in the middle."""
    floor = float(character.mesh.vertices[:, 1].min())
    moved = [play_at(character, clip, PHASES) for clip in character.clips]
    for frames in moved:
        frames[..., [0, 2]] -= frames[..., [0, 2]].mean(axis=1, keepdims=True)
    camera = look_at(np.concatenate(moved), (140, 184))
    return [
        [draw(frame, character.mesh.faces, colours, camera, floor=floor) for frame in frames]
        for frames in moved
    ]


def read_colours(path: Path, character: Character) -> Float[np.ndarray, "vertices 3"]:
    """Find each vertex's colour in the materials of a mesh file; clay where it has none."""
    places, shades = [], []
    for part in cast(list[trimesh.Trimesh], trimesh.load_scene(path, process=False).dump()):
        visual: Any = part.visual
        plain = visual.to_color() if visual.kind == "texture" else visual
        colours = np.atleast_2d(plain.vertex_colors)[:, :3] if visual.kind else CLAY
        if visual.kind == "texture" and getattr(visual.material, "baseColorTexture", "") is None:
            colours = 255 * (colours / 255) ** (1 / 2.2)  # factors are linear, pictures are not
        places.append(part.vertices)
        shades.append(np.broadcast_to(colours, part.vertices.shape))
    nearest = KDTree(np.vstack(places)).query(character.mesh.vertices)[1]
    return np.vstack(shades)[nearest].astype(np.float64)
