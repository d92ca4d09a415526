"""The command line: parse, call, write. What a command needs is imported when it runs."""

import sys
import time
from collections.abc import Sequence
from pathlib import Path

import typer

from bunraku.cli.evaluating import evaluate
from bunraku.cli.failures import INTERRUPTED, describe_failure
from bunraku.cli.options import (
    CharacterOption,
    ClipOption,
    DepthArgument,
    FacingOption,
    FigureArgument,
    FileArgument,
    FolderOption,
    ForceOption,
    InspectJsonOption,
    LandmarksOption,
    OutOption,
    ReportOption,
    SeedOption,
    UpOption,
    VersionOption,
    WithOption,
)

app = typer.Typer(
    name="bunraku",
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Example: bunraku animate hero.obj -o hero.glb",
)
app.add_typer(evaluate, name="evaluate")


@app.callback()
def root(version: VersionOption = None) -> None:
    """Make any unrigged 3D figure move: a skeleton, a skin and clips, offline."""


@app.command(
    epilog="Examples: bunraku animate hero.obj -o hero.glb   |   "
    "bunraku animate hero.glb --with knight.glb --clip Walk --clip Idle -o moving.glb   |   "
    "bunraku animate hero.glb --with dance.bvh -o dancing.glb --report dancing.json   |   "
    "bunraku animate hero.glb --with recording/ -o hero-moves.glb"
)
def animate(
    figure: FigureArgument,
    out: OutOption,
    performance: WithOption = None,
    clip: ClipOption = None,
    report: ReportOption = None,
    landmarks: LandmarksOption = None,
    seed: SeedOption = 0,
    up: UpOption = None,
    facing: FacingOption = None,
    force: ForceOption = False,
) -> None:
    """Give a figure a skeleton, a skin and the clips of a performance."""
    from bunraku.cli import capturing, steps
    from bunraku.formats import read_figure, write_character

    started = time.perf_counter()
    inputs = [figure, performance, landmarks]
    steps.check_output(out, [".glb"], inputs=inputs)
    steps.check_output(report, [".json"], inputs=[*inputs, out])
    with steps.working(figure):
        found = read_figure(figure, up=up, facing=facing)
        if performance is not None and performance.is_dir():
            film = capturing.Film(performance, clip, landmarks)
            return capturing.animate(found, film, out, report, seed=seed, force=force)
        source = steps.read_performer(performance)
        clips = steps.choose_clips(source, clip, performance)
        marks = steps.read_landmarks(landmarks, source)
        transfer = steps.match(source, found, clips, seed=seed, force=force, landmarks=marks)
        write_character(out, found, transfer.character)
        if report:
            summary = steps.report_on(found, performance, source, transfer, started=started)
            steps.write_report(report, summary)


@app.command(epilog="Example: bunraku rig hero.obj -o hero-rigged.glb")
def rig(
    figure: FigureArgument,
    out: OutOption,
    performance: CharacterOption = None,
    report: ReportOption = None,
    landmarks: LandmarksOption = None,
    seed: SeedOption = 0,
    up: UpOption = None,
    facing: FacingOption = None,
    force: ForceOption = False,
) -> None:
    """Give a figure a skeleton and a skin in its own pose, without clips."""
    from bunraku.cli import steps
    from bunraku.formats import read_figure, write_character

    started = time.perf_counter()
    inputs = [figure, performance, landmarks]
    steps.check_output(out, [".glb"], inputs=inputs)
    steps.check_output(report, [".json"], inputs=[*inputs, out])
    with steps.working(figure):
        found = read_figure(figure, up=up, facing=facing)
        source = steps.read_performer(performance)
        marks = steps.read_landmarks(landmarks, source)
        transfer = steps.match(source, found, (), seed=seed, force=force, landmarks=marks)
        write_character(out, found, transfer.character)
        if report:
            summary = steps.report_on(found, performance, source, transfer, started=started)
            steps.write_report(report, summary)


@app.command(epilog="Example: bunraku repose hero.obj --with knight.glb -o hero-at-rest.obj")
def repose(
    figure: FigureArgument,
    out: OutOption,
    performance: CharacterOption = None,
    landmarks: LandmarksOption = None,
    seed: SeedOption = 0,
    up: UpOption = None,
    facing: FacingOption = None,
    force: ForceOption = False,
) -> None:
    """Put a figure in the rest pose of a character: the surface alone, Y up, no materials."""
    from bunraku.cli import steps
    from bunraku.formats import read_figure, write_mesh

    steps.check_output(out, [".glb", ".obj", ".ply"], inputs=[figure, performance, landmarks])
    with steps.working(figure):
        found = read_figure(figure, up=up, facing=facing)
        source = steps.read_performer(performance)
        marks = steps.read_landmarks(landmarks, source)
        transfer = steps.match(source, found, (), seed=seed, force=force, landmarks=marks)
        write_mesh(out, steps.at_rest(transfer))


@app.command(epilog="Example: bunraku capture recording/ -o performer.glb")
def capture(folder: DepthArgument, out: OutOption, report: ReportOption = None) -> None:
    """Turn a depth video into a rigged performer: what was seen of it, a skeleton, its motion."""
    from bunraku.cli import capturing, steps

    steps.check_output(out, [".glb"], inputs=[folder])
    steps.check_output(report, [".json"], inputs=[folder, out])
    with steps.working(folder):
        capturing.capture(folder, out, report)


@app.command("inspect", epilog="Example: bunraku inspect knight.glb --json")
def inspect_file(file: FileArgument, json: InspectJsonOption = False) -> None:
    """Say what a file holds, and what is wrong with it."""
    from bunraku.cli.inspecting import print_inspection

    print_inspection(file, as_json=json)


@app.command(epilog="Example: bunraku demo -o demo")
def demo(folder: FolderOption = Path("demo"), seed: SeedOption = 0) -> None:
    """Animate the built-in figures with every built-in clip, and draw a picture of it."""
    from bunraku.cli.showing import run_demo

    run_demo(folder, seed=seed)


def run(arguments: Sequence[str]) -> int:
    """Run the command line; give the exit code after printing at most one error line."""
    command = typer.main.get_command(app)
    try:
        code = command.main(list(arguments) or ["--help"], "bunraku", standalone_mode=False) or 0
        if code == INTERRUPTED:  # the parser's own word for it
            raise KeyboardInterrupt
        return int(code)
    except (Exception, KeyboardInterrupt) as error:
        code, line = describe_failure(error)
        if line:
            typer.echo(line, err=True)
        return code


def main() -> None:
    """Run the console script."""
    sys.exit(run(sys.argv[1:]))
