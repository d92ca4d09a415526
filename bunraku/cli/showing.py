"""bunraku demo: the main job on built-in figures, with a picture of the result."""

import io
from pathlib import Path
from typing import cast

import typer
from rich.console import Console

from bunraku import builtin
from bunraku.cli.failures import about
from bunraku.cli.steps import working
from bunraku.evaluate.pictures import arrange
from bunraku.evaluate.results import make_table
from bunraku.formats.files import write_atomically
from bunraku.verbs.animating import animate
from bunraku.verbs.picturing import draw_clips, read_colours
from bunraku.verbs.writing import write

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
