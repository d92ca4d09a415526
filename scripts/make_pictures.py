"""Make the pictures of docs/ from the built-in figures: a demo sheet, stages, a walk, depth frames.

python scripts/make_pictures.py [FOLDER]
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont

from bunraku import builtin
from bunraku.evaluate.families import bind_joints, play_at
from bunraku.evaluate.pictures import CLAY, Camera, Picture, arrange, draw, look_at
from bunraku.evaluate.rendering import film_character
from bunraku.studio.colouring import colour_places, colour_weights
from bunraku.studio.visits import clay
from bunraku.types import NO_PARENT, Character, Mesh
from bunraku.verbs.animating import animate
from bunraku.verbs.picturing import draw_clips, read_colours
from bunraku.verbs.results import Result

IMAGES = Path(__file__).parents[1] / "docs" / "images"
STAGES = ("as found", "proxy", "laid onto it", "weights", "skeleton", "walking")
ARM, MOMENT = "leftUpperArm", 0.3  # whose weights are shown, and a share of the walk
FRAMES = 24  # of a walk
NEAR, FAR = np.array([250.0, 200.0, 70.0]), np.array([60.0, 50.0, 120.0])
BONE, PAPER, INK = (230, 120, 20), (246, 244, 240), (90, 86, 80)
FILMED = (0, 12, 24)  # frames of the depth video


def clip_of(character: Character, name: str = "walk") -> Character:
    """Keep one clip."""
    return replace(character, clips=tuple(c for c in character.clips if c.name == name))


def draw_bones(picture: Picture, character: Character, camera: Camera) -> Picture:
    """Draw the skeleton over a figure in the pose of binding."""
    width, height = camera.size
    across = (bind_joints(character) - camera.centre) @ camera.world_from_camera
    pixels = across[:, :2] * [1, -1] * height / camera.height + [width / 2, height / 2]
    sheet = Image.fromarray(picture // 2 + 122)  # faded
    pen = ImageDraw.Draw(sheet)
    for joint, parent in enumerate(character.skeleton.parents):
        if parent != NO_PARENT:
            pen.line([*pixels[parent], *pixels[joint]], fill=BONE, width=2)
    return np.asarray(sheet)


def draw_stages(
    character: Character,
    colours: Float[np.ndarray, "vertices 3"],
    proxy: Mesh,
    laid: tuple[Mesh, Float[np.ndarray, "laid_vertices 3"]],
) -> list[Picture]:
    """Draw one character at every stage.

    Args:
        colours: of its file.
        proxy: its closed stand-in.
        laid: a surface to show in colours of its own.
    """
    mesh, walk = character.mesh, clip_of(character).clips[0]
    moved = play_at(character, walk, np.array([MOMENT]))[0]
    moved[:, [0, 2]] += (mesh.vertices.mean(axis=0) - moved.mean(axis=0))[[0, 2]]
    camera = look_at(np.stack([mesh.vertices, moved]), (140, 184))
    floor = float(mesh.vertices[:, 1].min())
    weights = character.skin.weights[:, character.skeleton.names.index(ARM)]
    plain = np.tile(CLAY, (len(proxy.vertices), 1))
    shown = [
        (mesh.vertices, mesh.faces, colours),
        (proxy.vertices, proxy.faces, plain),
        (laid[0].vertices, laid[0].faces, laid[1]),
        (mesh.vertices, mesh.faces, colour_weights(weights)),
        (mesh.vertices, mesh.faces, colours),
        (moved, mesh.faces, colours),
    ]
    pictures = [draw(*what, camera, floor=floor) for what in shown]
    pictures[4] = draw_bones(pictures[4], character, camera)
    return pictures


def show_stages(result: Result, colours: Float[np.ndarray, "vertices 3"]) -> Image.Image:
    """Show performer above and figure below, stage by stage."""
    stages, performer = result.transfer, result.performer
    source = stages.source_proxy.mesh
    shades = colour_places(source.vertices, source.vertices)
    fitted = Mesh(stages.registration.fitted, source.faces)
    rows = [
        draw_stages(performer, clay(performer), source, (source, shades)),
        draw_stages(result.character, colours, stages.target_proxy.mesh, (fitted, shades)),
    ]
    sheet = arrange(rows, ("performer", "figure"))
    height = 22
    titled = Image.new("RGB", (sheet.width, sheet.height + height), PAPER)
    titled.paste(sheet, (0, height))
    pen = ImageDraw.Draw(titled)
    for number, title in enumerate(STAGES):
        pen.text((140 * number + 8, 4), title, fill=INK, font=ImageFont.load_default(13))
    return titled


def show_walk(
    results: dict[str, Result], colours: dict[str, np.ndarray]
) -> tuple[list[Image.Image], int]:
    """Let both figures walk beside the human, on the spot; give the milliseconds of a frame too."""
    human = builtin.human()
    actors = [(human, clay(human))]
    actors += [(result.character, colours[name]) for name, result in results.items()]
    rows = []
    for character, shades in actors:
        walk = clip_of(character).clips[0]
        moved = play_at(character, walk, np.arange(FRAMES) / FRAMES)
        moved[..., [0, 2]] -= moved[..., [0, 2]].mean(axis=1, keepdims=True)
        camera, faces = look_at(moved, (160, 208)), character.mesh.faces
        floor = float(character.mesh.vertices[:, 1].min())
        rows.append([draw(frame, faces, shades, camera, floor=floor) for frame in moved])
    seconds = float(clip_of(human).clips[0].times[-1])
    frames = [Image.fromarray(np.hstack(row)) for row in zip(*rows, strict=True)]
    return frames, round(1000 * seconds / FRAMES)


def show_depth() -> Image.Image:
    """Show a few frames of what a depth camera sees of the walking human: near is bright."""
    human = builtin.human()
    most = max(FILMED) + 1
    film = film_character(human, clip_of(human).clips[0], turn=40.0, most_frames=most)
    depths = film.video.depths[list(FILMED)]
    seen = depths > 0
    low, high = np.percentile(depths[seen], (1, 99))
    far = np.clip((depths - low) / (high - low), 0, 1)[..., None]
    pictures = np.where(seen[..., None], (1 - far) * NEAR + far * FAR, PAPER).astype(np.uint8)
    columns = np.flatnonzero(seen.any(axis=(0, 1)))
    return arrange([[picture[:, columns[0] : columns[-1] + 1] for picture in pictures]])


def main(folder: Path) -> None:
    """Write all pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    show_depth().save(folder / "depth.png", optimize=True)
    results = {name: animate(path) for name, path in builtin.figure_paths().items()}
    colours = {
        name: read_colours(path, results[name].character)
        for name, path in builtin.figure_paths().items()
    }
    show_stages(results["stylised"], colours["stylised"]).save(folder / "stages.png", optimize=True)
    frames, duration = show_walk(results, colours)
    frames[0].save(
        folder / "walk.webp",
        save_all=True,
        append_images=frames[1:],
        duration=duration,
        loop=0,
        quality=80,
    )
    strips = [draw_clips(results[name].character, colours[name]) for name in results]
    rows = [[picture for strip in clip for picture in strip] for clip in zip(*strips, strict=True)]
    names = [clip.name for clip in builtin.human().clips]
    sheet = arrange(rows, names).quantize(256, dither=Image.Dither.NONE)
    sheet.save(folder / "demo.png", optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else IMAGES)
