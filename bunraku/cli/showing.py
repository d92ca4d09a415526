"""bunraku demo: the main job on built-in figures, with a picture of the result."""

import io
from pathlib import Path
from typing import Any, cast

import numpy as np
import trimesh
import typer
from jaxtyping import Float
from rich.console import Console
from scipy.spatial import KDTree

from bunraku import builtin
from bunraku.cli.failures import about
from bunraku.cli.steps import working
from bunraku.evaluate.families import play_at
from bunraku.evaluate.pictures import CLAY, Picture, arrange, draw, look_at
from bunraku.evaluate.results import make_table
from bunraku.formats.files import write_atomically
from bunraku.types import Character
from bunraku.verbs.animating import animate
from bunraku.verbs.writing import write

PHASES = np.array([0.15, 0.45, 0.75])  # of each clip, in the picture
COLUMNS = ("figure", "vertices", "parts", "clips", "seconds", "confidence")
CLIP_COLUMNS = ("worst: stretch p99", "foot slide m/s", "penetration")


def run_demo(folder: Path, *, seed: int) -> None:
    """Animate both built-in figures; write GLBs, reports and a contact sheet; print a table."""
    with about(folder):
        folder.mkdir(parents=True, exist_ok=True)
    lines, strips = [], []
    for name, path in builtin.figure_paths().items():
        with working(path):
            result = animate(path, seed=seed, force=True)
            write(folder / f"{name}.glb", result)
            write(folder / f"{name}.json", result)
            strips.append(draw_clips(result.character, read_colours(path, result.character)))
        lines.append([name, *summarise(result.report)])
    rows = [[picture for strip in clip for picture in strip] for clip in zip(*strips, strict=True)]
    sheet = io.BytesIO()
    arrange(rows, [clip.name for clip in builtin.human().clips]).save(sheet, format="png")
    write_atomically(folder / "demo.png", sheet.getvalue())
    Console(width=140).print(make_table("", [*COLUMNS, *CLIP_COLUMNS], lines))
    typer.echo(f"Look at {folder / 'demo.png'}; open the GLBs beside it in any glTF viewer.")


def summarise(report: dict[str, object]) -> list[float | str]:
    """Choose a few numbers of a report for one line of a table."""
    figure = cast(dict[str, int], report["figure"])
    clips = cast(list[dict[str, float]], report["clips"])
    worst = [
        max(clip[name] for clip in clips)
        for name in ("stretch_p99", "foot_slide_m", "penetration_fraction")
    ]
    seconds = cast(dict[str, float], report["seconds"])["total"]
    counts = [str(figure["vertices"]), str(figure["parts"]), str(len(clips))]
    return [*counts, seconds, cast(float, report["confidence"]), *worst]


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
