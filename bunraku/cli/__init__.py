"""The command line: parse, call, write. What a command needs is imported when it runs."""

import sys
from collections.abc import Sequence
from pathlib import Path

import typer

from bunraku.cli.evaluating import evaluate
from bunraku.cli.failures import INTERRUPTED, describe_failure
from bunraku.cli.learning import train
from bunraku.cli.memory import keep_freed_memory
from bunraku.cli.options import (
    BvhOption,
    CharacterOption,
    ClipOption,
    ClusterOption,
    ContactsOption,
    DepthArgument,
    EngineOption,
    FacingOption,
    FigureArgument,
    FileArgument,
    FolderOption,
    ForceOption,
    HostOption,
    InspectJsonOption,
    JobsArgument,
    LandmarksOption,
    MemoryOption,
    OfferedOption,
    OutOption,
    PortOption,
    ReportOption,
    ResultsOption,
    ResumeOption,
    SeedOption,
    TimeoutOption,
    UpOption,
    VersionOption,
    VrmOption,
    WithOption,
    WorkersOption,
)
from bunraku.cli.posing import pose, spread_values
from bunraku.limits import SUMMARY

app = typer.Typer(
    name="bunraku",
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog=f"Example: bunraku animate hero.obj -o hero.glb   |   {SUMMARY} "
    "What the codes in error lines mean: docs/errors.md.",
)
app.add_typer(evaluate, name="evaluate")
app.add_typer(train, name="train")


@app.callback()
def root(version: VersionOption = None) -> None:
    """Make any unrigged 3D figure move: a skeleton, a skin and clips, offline."""


@app.command(
    epilog="Examples: bunraku animate hero.obj -o hero.glb   |   "
    "bunraku animate hero.glb --with knight.glb --clip Walk --clip Idle -o moving.glb   |   "
    "bunraku animate hero.glb --with dance.bvh -o dancing.glb --report dancing.json   |   "
    "bunraku animate hero.glb --with recording/ -o hero-moves.usdz   |   "
    "bunraku animate hero.glb --with avatar/ -o hero-poses.glb"
)
def animate(
    figure: FigureArgument,
    out: OutOption,
    performance: WithOption = None,
    clip: ClipOption = None,
    report: ReportOption = None,
    bvh: BvhOption = None,
    vrm: VrmOption = False,
    engine: EngineOption = None,
    landmarks: LandmarksOption = None,
    contacts: ContactsOption = True,
    seed: SeedOption = 0,
    up: UpOption = None,
    facing: FacingOption = None,
    force: ForceOption = False,
) -> None:
    """Give a figure a skeleton, a skin and the clips of a performance."""
    import bunraku
    from bunraku.cli import steps

    inputs = [figure, performance, landmarks, *steps.files_within(performance)]
    steps.check_output(out, steps.list_suffixes(vrm=vrm), inputs=inputs)
    steps.check_output(report, [".json"], inputs=[*inputs, out])
    steps.check_output(bvh, [".bvh"], inputs=[*inputs, out])
    steps.check_engine(engine)
    with steps.working(figure):
        result = bunraku.animate(
            figure,
            performance,
            clip,
            landmarks=landmarks,
            contacts=contacts,
            seed=seed,
            up=up,
            facing=facing,
            force=force,
        )
        bunraku.write(out, result, vrm=vrm, engine=engine)
        if bvh:
            bunraku.write(bvh, result, engine=engine)
        if report:
            bunraku.write(report, result)


@app.command(epilog="Example: bunraku rig hero.obj -o hero-rigged.glb")
def rig(
    figure: FigureArgument,
    out: OutOption,
    performance: CharacterOption = None,
    report: ReportOption = None,
    vrm: VrmOption = False,
    engine: EngineOption = None,
    landmarks: LandmarksOption = None,
    seed: SeedOption = 0,
    up: UpOption = None,
    facing: FacingOption = None,
    force: ForceOption = False,
) -> None:
    """Give a figure a skeleton and a skin in its own pose, without clips."""
    import bunraku
    from bunraku.cli import steps

    inputs = [figure, performance, landmarks]
    steps.check_output(out, steps.list_suffixes(vrm=vrm), inputs=inputs)
    steps.check_output(report, [".json"], inputs=[*inputs, out])
    steps.check_engine(engine)
    with steps.working(figure):
        result = bunraku.rig(
            figure,
            performance,
            landmarks=landmarks,
            seed=seed,
            up=up,
            facing=facing,
            force=force,
        )
        bunraku.write(out, result, vrm=vrm, engine=engine)
        if report:
            bunraku.write(report, result)


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
    import bunraku
    from bunraku.cli import steps

    steps.check_output(out, [".glb", ".obj", ".ply"], inputs=[figure, performance, landmarks])
    with steps.working(figure):
        rested = bunraku.repose(
            figure,
            performance,
            landmarks=landmarks,
            seed=seed,
            up=up,
            facing=facing,
            force=force,
        )
        bunraku.write(out, rested)


app.command(
    epilog="Examples: bunraku pose hero.obj --rest body.obj --posed sits.obj -o sits.glb   |   "
    "bunraku pose hero.glb --rest body.obj --posed frame-*.obj --rate 30 -o hero-dances.glb"
)(pose)


@app.command(epilog="Example: bunraku capture recording/ -o performer.glb")
def capture(folder: DepthArgument, out: OutOption, report: ReportOption = None) -> None:
    """Turn a depth video into a rigged performer: what was seen of it, a skeleton, its motion."""
    import bunraku
    from bunraku.cli import steps
    from bunraku.formats.usd import USD_SUFFIXES

    steps.check_output(out, [".glb", *USD_SUFFIXES], inputs=[folder])
    steps.check_output(report, [".json"], inputs=[folder, out])
    with steps.working(folder):
        captured = bunraku.capture(folder)
        bunraku.write(out, captured)
        if report:
            bunraku.write(report, captured)


@app.command("inspect", epilog=f"Example: bunraku inspect knight.glb --json   |   {SUMMARY}")
def inspect_file(file: FileArgument, json: InspectJsonOption = False) -> None:
    """Say what a file holds, and what is wrong with it."""
    from bunraku.cli.inspecting import print_inspection

    print_inspection(file, as_json=json)


@app.command(epilog="Example: bunraku demo -o demo")
def demo(folder: FolderOption = Path("demo"), seed: SeedOption = 0) -> None:
    """Animate the built-in figures with every built-in clip, and draw a picture of it."""
    from bunraku.cli.showing import run_demo

    run_demo(folder, seed=seed)


@app.command(
    epilog="Examples: bunraku batch jobs.csv -o moved --workers 4   |   "
    "bunraku batch jobs.csv -o moved --resume   |   "
    "bunraku batch jobs.csv -o moved --cluster tcp://host:8786"
)
def batch(
    jobs: JobsArgument,
    folder: ResultsOption,
    workers: WorkersOption = None,
    cluster: ClusterOption = None,
    resume: ResumeOption = False,
    memory: MemoryOption = 4.0,
    timeout: TimeoutOption = 900.0,
) -> None:
    """Animate many figures, a process each; a second run does only what is missing."""
    from bunraku.cli.batching import run_batch

    limits = memory, timeout
    run_batch(jobs, folder, workers=workers, cluster=cluster, resume=resume, limits=limits)


@app.command(epilog="Example: bunraku studio hero.glb --with knight.glb")
def studio(
    figure: OfferedOption = None,
    performance: WithOption = None,
    port: PortOption = 8080,
    host: HostOption = "127.0.0.1",
) -> None:
    """Open a page in the browser: upload, animate, look at every clip, download."""
    from bunraku.cli.visiting import run_studio

    run_studio(figure, performance, host=host, port=port)


def run(arguments: Sequence[str]) -> int:
    """Run the command line; give the exit code after printing at most one error line."""
    command = typer.main.get_command(app)
    try:
        code = (
            command.main(spread_values(arguments) or ["--help"], "bunraku", standalone_mode=False)
            or 0
        )
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
    if sys.argv[1:2] == ["inspect"]:
        keep_freed_memory()
    sys.exit(run(sys.argv[1:]))
