"""bunraku train: make the networks that come with the package, and those of the paper's form."""

import typer

from bunraku.cli.options import (
    BeginOption,
    KindOption,
    MinutesOption,
    ResumeTrainingOption,
    SeedOption,
    StepsOption,
    UntilOption,
    WeightsOption,
)

train = typer.Typer(name="train", help="Train the networks that bunraku pose uses.")


@train.callback()
def root() -> None:
    """Train the networks that bunraku pose uses, on bodies that are made here."""


@train.command(
    epilog="Examples: bunraku train shape -o shape.safetensors   |   "
    "bunraku train shape --minutes 30   |   bunraku train shape --resume"
)
def shape(
    out: WeightsOption = None,
    minutes: MinutesOption = None,
    resume: ResumeTrainingOption = False,
    steps: StepsOption = None,
    until: UntilOption = None,
    weights: BeginOption = None,
    seed: SeedOption = 0,
) -> None:
    """Train the shape network: which part of a body each point is of, and where joints are."""
    from bunraku.cli.steps import check_output, training_bar
    from bunraku.verbs.training import train_shape

    check_output(out, [".safetensors"], inputs=[weights])
    with training_bar() as show:
        written = train_shape(
            out,
            minutes=minutes,
            resume=resume,
            steps=steps,
            until=until,
            weights=weights,
            seed=seed,
            show=show,
        )
    typer.echo(written)


@train.command(
    epilog="Examples: bunraku train deform --minutes 30   |   "
    "bunraku train deform --kind quadruped -o quadruped.safetensors   |   "
    "bunraku train deform --resume"
)
def deform(
    out: WeightsOption = None,
    kind: KindOption = "person",
    minutes: MinutesOption = None,
    resume: ResumeTrainingOption = False,
    until: UntilOption = None,
    seed: SeedOption = 0,
) -> None:
    """Train the paper's form, a row of evaluate pose: pose space, shape codes, offsets."""
    from bunraku.cli.steps import check_output, training_bar
    from bunraku.verbs.training import train_deform

    check_output(out, [".safetensors"], inputs=[])
    with training_bar() as show:
        written = train_deform(
            out, kind=kind, minutes=minutes, resume=resume, until=until, seed=seed, show=show
        )
    typer.echo(written)
