"""bunraku evaluate: one command a table."""

import os
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from bunraku.cli.failures import printing_warnings
from bunraku.cli.options import (
    BaselinesOption,
    ClipsOption,
    DataOption,
    DeformOption,
    JsonOption,
    LimitOption,
    NetworkOption,
    PairsOption,
    SeedOption,
    SeedsOption,
    StateOption,
    ThoroughOption,
)
from bunraku.errors import Code

if TYPE_CHECKING:
    from rich.table import Table

    from bunraku.evaluate.results import RowT, TaskT

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
    from bunraku.evaluate.results import group_by_family, sample
    from bunraku.types import FormatError

    check_output(json, [".json"], inputs=[])
    check_output(state, [], inputs=[json])
    folder, names = find_data(data), pairs or ()
    clips, frames = (None, 30) if thorough else (3, 8)
    with printing_warnings(folder):
        relatives = retarget.find_tasks(folder, pairs=names, clip_count=clips)
        rows = print_rows(
            sample(group_by_family(relatives), limit),
            partial(retarget.measure, frame_count=frames, seed=seed),
            retarget.describe,
            kind=retarget.Row,
            state=state,
        )
        strangers = across.find_tasks(folder, builtin.human(), names=names, clip_count=clips)
        others = print_rows(
            sample(group_by_family(strangers), limit),
            partial(across.measure, frame_count=frames, seed=seed),
            across.describe,
            kind=across.Row,
            state=state and state.with_suffix(".across" + state.suffix),
        )
    if not rows and not others:
        wanted = "such pairs" if names else "characters that share a clip, and no humans"
        raise FormatError(
            folder, "", f"holds no {wanted}; give another folder or other --pairs", code=Code.DATA
        )
    tables = [retarget.tabulate(rows)] * bool(rows) + [across.tabulate(others)] * bool(others)
    finish(tables, [*rows, *others], json)


@evaluate.command(
    "capture",
    epilog="Examples: bunraku evaluate capture --data shared/data --limit 12   |   "
    "bunraku evaluate capture --pairs Fox:walk --state rows.jsonl --json table.json",
)
def capture_table(
    data: DataOption = None,
    pairs: ClipsOption = None,
    limit: LimitOption = None,
    thorough: ThoroughOption = False,
    baselines: BaselinesOption = False,
    state: StateOption = None,
    json: JsonOption = None,
) -> None:
    """Film characters with a depth camera, capture them, and let them move themselves."""
    from bunraku.cli.steps import check_output
    from bunraku.evaluate import capture, capture_across
    from bunraku.evaluate.capture_baselines import METHODS, OURS
    from bunraku.evaluate.results import group_by_family, sample
    from bunraku.types import FormatError

    check_output(json, [".json"], inputs=[])
    check_output(state, [], inputs=[json])
    folder, names = find_data(data), pairs or ()
    methods = tuple(METHODS) if baselines else (OURS,)
    clips = 3 if thorough else 1
    tasks = capture.find_tasks(folder, names=names, clip_count=clips, methods=methods)
    with printing_warnings(folder):
        chosen = sample(group_by_family(tasks), limit)
        rows = print_rows(chosen, capture.measure, capture.describe, kind=capture.Row, state=state)
        across = group_by_family(capture_across.find_tasks(folder, names=names))
        others = print_rows(
            sample(across, limit),
            *(capture_across.measure, capture_across.describe),
            kind=capture_across.Row,
            state=state and state.with_suffix(".across" + state.suffix),
        )
    if not rows and not others:
        wanted = "such clips" if names else "characters that move"
        raise FormatError(folder, "", f"holds no {wanted}; give another folder or other --pairs")
    tables = [capture.tabulate(rows)] * bool(rows)
    finish([*tables, *[capture_across.tabulate(others)] * bool(others)], [*rows, *others], json)


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
    from bunraku.evaluate.weights import (
        Row,
        describe,
        measure,
        read_source,
        read_targets,
        tabulate,
    )

    check_output(json, [".json"], inputs=[])
    check_output(state, [], inputs=[json])
    folder = find_data(data, within="weights")
    source = read_source(folder)
    targets = list(islice(read_targets(folder, source.skeleton), limit))
    judge = partial(measure, source=source, seed=seed)
    with printing_warnings(folder):
        rows = print_rows(targets, judge, describe, kind=Row, state=state)
    finish(tabulate(rows), rows, json)


@evaluate.command(
    "pose",
    epilog="Examples: bunraku evaluate pose --data shared/data --limit 12   |   "
    "bunraku evaluate pose --pairs 'Horse>Fox' --state rows.jsonl --json table.json",
)
def pose_table(
    data: DataOption = None,
    pairs: PairsOption = None,
    limit: LimitOption = None,
    seeds: SeedsOption = 1,
    network: NetworkOption = None,
    deform: DeformOption = None,
    state: StateOption = None,
    json: JsonOption = None,
) -> None:
    """Put figures into the poses of avatars: generated bodies, and real characters if there are."""
    from itertools import chain

    from bunraku.cli.steps import check_output
    from bunraku.evaluate import pose, pose_tasks
    from bunraku.evaluate.results import group_by_family, sample
    from bunraku.types import FormatError
    from bunraku.verbs.posing import load_paper, load_reader

    inputs = [network, *(deform or ())]
    check_output(json, [".json"], inputs=inputs)
    check_output(state, [], inputs=[json, *inputs])
    read = load_reader(network, 0, purpose="bunraku evaluate pose")
    paper = load_paper(deform or (), purpose="bunraku evaluate pose")
    folder, names = find_data(data), pairs or ()
    with printing_warnings(folder):
        made = chain.from_iterable(map(pose_tasks.generate_tasks, range(0 if names else seeds)))
        tasks = [*made, *pose_tasks.find_tasks(folder, names=names)]
        judge = partial(pose.measure, read=read, paper=paper)
        chosen = sample(group_by_family(tasks), limit)
        rows = print_rows(chosen, judge, pose.describe, kind=pose.Row, state=state)
    if not rows:
        message = "holds no such pairs; give another folder or other --pairs"
        raise FormatError(folder, "", message, code=Code.DATA)
    finish([pose.tabulate(rows)], rows, json)


def print_rows(
    tasks: Sequence["TaskT"],
    judge: Callable[["TaskT"], "RowT"],
    describe: Callable[["RowT"], str],
    *,
    kind: type["RowT"],
    state: Path | None,
) -> list["RowT"]:
    """Measure tasks, or take their rows from the state file; print each row as it is done."""
    from bunraku.evaluate.results import measure_all

    rows = []
    for row in measure_all(tasks, judge, kind, state=state):
        rows.append(row)
        typer.echo(f"{len(rows)}/{len(tasks)} {describe(row)}")
    return rows


def find_data(folder: Path | None, *, within: str = "") -> Path:
    """Find the folder of evaluation data: as given, as BUNRAKU_DATA says, or beside us.

    Raises:
        FormatError: if it does not exist.
    """
    from bunraku.types import FormatError

    found = folder or Path(os.environ.get("BUNRAKU_DATA", "../shared/data")) / within
    if not found.is_dir():
        raise FormatError(
            found, "", "is no folder of evaluation data; give one with --data", code=Code.DATA
        )
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
