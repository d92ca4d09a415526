"""bunraku pose: a figure in the poses of an avatar."""

from collections.abc import Sequence

from bunraku.cli.options import (
    FacingOption,
    FigureArgument,
    ForceOption,
    NetworkOption,
    OutOption,
    PosedOption,
    RateOption,
    ReportOption,
    RestOption,
    SeedOption,
    UpOption,
)


def pose(
    figure: FigureArgument,
    rest: RestOption,
    posed: PosedOption,
    out: OutOption,
    report: ReportOption = None,
    rate: RateOption = 24.0,
    network: NetworkOption = None,
    seed: SeedOption = 0,
    up: UpOption = None,
    facing: FacingOption = None,
    force: ForceOption = False,
) -> None:
    """Put a figure into the poses of an avatar that has no rig: one mesh, at rest and posed."""
    import bunraku
    from bunraku.cli import steps
    from bunraku.formats.usd import USD_SUFFIXES
    from bunraku.verbs.writing import name_poses

    inputs = [figure, rest, *posed, network]
    steps.check_output(out, [".glb", *USD_SUFFIXES, ".obj"], inputs=inputs)
    for each in name_poses(out, len(posed)):
        steps.check_output(each, [], inputs=inputs)
    steps.check_output(report, [".json"], inputs=[*inputs, out])
    with steps.working(figure):
        result = bunraku.pose(
            figure,
            rest,
            posed,
            rate=rate,
            network=network,
            seed=seed,
            up=up,
            facing=facing,
            force=force,
        )
        bunraku.write(out, result)
        if report:
            bunraku.write(report, result)


def spread_values(arguments: Sequence[str]) -> list[str]:
    """Let `bunraku pose FIGURE --posed A B C` mean `--posed A --posed B --posed C`.

    Only what follows the first value belongs to it as well, and only if the figure has been named.
    """
    if not arguments or arguments[0] != "pose":
        return list(arguments)
    spread: list[str] = []
    named, option = False, ""
    for word in arguments[1:]:
        is_value = not word.startswith("-") or word == "-"
        if not is_value:
            option = "" if "=" in word or word == "--force" else word
        elif option == "--posed" and spread[-1] != "--posed" and named:
            spread.append("--posed")
        elif option and spread[-1] == option:
            pass
        else:
            named, option = True, ""
        spread.append(word)
    return ["pose", *spread]
