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
    no_args_is_help=True,
    help="Measure on evaluation data: the papers' tables, beside the papers' numbers.",
)


@evaluate.command(
    epilog="Examples: bunraku evaluate retarget --data shared/data --limit 10   |   "
    "bunraku evaluate retarget --pairs 'Horse>Fox' --state rows.jsonl --json table.json"
)
def retarget(
    data: DataOption = None,
    pairs: PairsOption = None,
    limit: LimitOption = None,
    thorough: ThoroughOption = False,
    state: StateOption = None,
    json: JsonOption = None,
    seed: SeedOption = 0,
) -> None:
    """Strip characters, animate them with their relatives, compare with their own clips."""
    from bunraku.cli.steps import check_output
    from bunraku.evaluate.results import group_by_family, measure_all, sample
    from bunraku.evaluate.retarget import Row, describe, find_tasks, measure, tabulate

    check_output(json, [".json"], inputs=[])
    tasks = find_tasks(find_data(data), pairs=pairs or (), clip_count=None if thorough else 3)
    chosen = sample(group_by_family(tasks), limit)
    measure_row = partial(measure, frame_count=30 if thorough else 8, seed=seed)
    rows: list[Row] = []
    for row in measure_all(chosen, measure_row, Row, state=state):
        typer.echo(f"{len(rows) + 1}/{len(chosen)} {describe(row)}")
        rows.append(row)
    finish([tabulate(rows)], rows, json)


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
