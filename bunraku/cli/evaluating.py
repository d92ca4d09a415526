"""bunraku evaluate: one command a table."""

import os
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from bunraku.cli.options import (
    DataOption,
    JsonOption,
    LimitOption,
    PairsOption,
    SeedOption,
    StateOption,
    ThoroughOption,
)

if TYPE_CHECKING:
    from rich.table import Table

evaluate = typer.Typer(
    name="evaluate",
    help="Measure on evaluation data: the papers' tables, beside the papers' numbers.",
)


@evaluate.command(
    "retarget",
    epilog="Examples: bunraku evaluate retarget --data shared/data --limit 10   |   "
    "bunraku evaluate retarget --pairs 'Horse>Fox' --state rows.jsonl --json table.json",
)
def retarget_table(
    data: DataOption = None,
    pairs: PairsOption = None,
    limit: LimitOption = None,
    thorough: ThoroughOption = False,
    state: StateOption = None,
    json: JsonOption = None,
    seed: SeedOption = 0,
) -> None:
    """Strip characters, animate them with their relatives, compare with their own clips."""
    from bunraku import builtin
    from bunraku.cli.steps import check_output
    from bunraku.evaluate import across, retarget
    from bunraku.evaluate.results import group_by_family, measure_all, sample

    check_output(json, [".json"], inputs=[])
    folder, names = find_data(data), pairs or ()
    clips, frames = (None, 30) if thorough else (3, 8)
    within = sample(
        group_by_family(retarget.find_tasks(folder, pairs=names, clip_count=clips)), limit
    )
    rows: list[retarget.Row] = []
    judge = partial(retarget.measure, frame_count=frames, seed=seed)
    for row in measure_all(within, judge, retarget.Row, state=state):
        rows.append(row)
        typer.echo(f"{len(rows)}/{len(within)} {retarget.describe(row)}")
    others = sample(
        group_by_family(across.find_tasks(folder, builtin.human(), names=names, clip_count=clips)),
        limit,
    )
    strangers: list[across.Row] = []
    compare = partial(across.measure, frame_count=frames, seed=seed)
    beside = state and state.with_suffix(".across" + state.suffix)
    for stranger in measure_all(others, compare, across.Row, state=beside):
        strangers.append(stranger)
        typer.echo(f"{len(strangers)}/{len(others)} {across.describe(stranger)}")
    tables = [retarget.tabulate(rows)] * bool(rows) + [across.tabulate(strangers)] * bool(strangers)
    finish(tables, [*rows, *strangers], json)


@evaluate.command("weights", epilog="Example: bunraku evaluate weights --data shared/data/weights")
def weights_table(
    data: DataOption = None,
    limit: LimitOption = None,
    state: StateOption = None,
    json: JsonOption = None,
    seed: SeedOption = 0,
) -> None:
    """Carry weights to posed bodies with exact truth, after the paper's Table 1."""
    from itertools import islice

    from bunraku.cli.steps import check_output
    from bunraku.evaluate.results import measure_all
    from bunraku.evaluate.weights import Row, measure, read_source, read_targets, tabulate

    check_output(json, [".json"], inputs=[])
    folder = find_data(data, within="weights")
    source = read_source(folder)
    targets = list(islice(read_targets(folder, source.skeleton), limit))
    rows: list[Row] = []
    for row in measure_all(targets, partial(measure, source=source, seed=seed), Row, state=state):
        rows.append(row)
        typer.echo(f"{len(rows)}/{len(targets)} {row.target}, {row.seconds:.0f} s")
    finish(tabulate(rows), rows, json)


def find_data(folder: Path | None, *, within: str = "") -> Path:
    """Find the folder of evaluation data: as given, as BUNRAKU_DATA says, or beside us.

    Raises:
        FormatError: if it does not exist.
    """
    from bunraku.types import FormatError

    found = folder or Path(os.environ.get("BUNRAKU_DATA", "../shared/data")) / within
    if not found.is_dir():
        raise FormatError(found, "", "is no folder of evaluation data; give one with --data")
    return found


def finish(tables: Iterable["Table"], rows: Iterable[object], json: Path | None) -> None:
    """Print tables, whole however narrow the terminal, and write the rows if asked."""
    import msgspec
    from rich.console import Console
    from rich.measure import Measurement

    from bunraku.formats.files import write_atomically

    for table in tables:
        console = Console(width=10_000)
        console.width = Measurement.get(console, console.options, table).maximum
        console.print(table)
    if json is not None:
        write_atomically(json, msgspec.json.format(msgspec.json.encode(list(rows))) + b"\n")
