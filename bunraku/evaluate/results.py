"""Rows of a table: kept one a line as they are measured, so that a long run can be resumed."""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice, zip_longest
from pathlib import Path
from typing import Protocol, TypeVar, runtime_checkable

import msgspec
import numpy as np
from rich.table import Table

from bunraku.errors import Code
from bunraku.types import FormatError


@runtime_checkable
class Keyed(Protocol):
    """A row or a task that knows which one of the table it is."""

    def key(self) -> tuple[object, ...]:
        """Tell this row from every other one of the table."""
        ...


TaskT = TypeVar("TaskT", bound=Keyed)
RowT = TypeVar("RowT", bound=Keyed)


def read_rows(state: Path | None, kind: type[RowT]) -> dict[tuple[object, ...], RowT]:
    """Read the rows measured so far; a half-written last line is left out.

    Raises:
        FormatError: if the file holds something else.
    """
    if state is None or not state.exists():
        return {}
    whole = [line for line in state.read_bytes().splitlines(keepends=True) if line.endswith(b"\n")]
    try:
        rows = [msgspec.json.decode(line, type=kind) for line in whole]
    except msgspec.DecodeError as error:
        message = f"holds other rows than this table's ({error}); name another file"
        raise FormatError(state, "", message, code=Code.DATA) from error
    return {row.key(): row for row in rows}


def measure_all(
    tasks: Iterable[TaskT],
    measure: Callable[[TaskT], RowT],
    kind: type[RowT],
    *,
    state: Path | None = None,
) -> Iterator[RowT]:
    """Measure each task that the state file does not hold yet; write every row as it is done.

    Args:
        measure: makes the row of a task, with the task's key.
        kind: type of a row.
        state: JSON lines, a row each; made if missing. None measures everything and keeps nothing.
    """
    known = read_rows(state, kind)
    for task in tasks:
        if task.key() in known:
            yield known[task.key()]
            continue
        row = measure(task)
        if state is not None:
            append_row(state, row)
        yield row


def append_row(state: Path, row: object) -> None:
    """Add a row to a state file, in place of a half-written last one, and see it on the disk."""
    with state.open("a+b") as file:
        file.seek(0)
        file.truncate(file.read().rfind(b"\n") + 1)
        file.write(msgspec.json.encode(row) + b"\n")
        file.flush()
        os.fsync(file.fileno())


def group_by_family(tasks: Iterable[TaskT]) -> list[list[TaskT]]:
    """Gather the tasks whose keys begin alike."""
    groups: dict[object, list[TaskT]] = {}
    for task in tasks:
        groups.setdefault(task.key()[0], []).append(task)
    return list(groups.values())


def sample(groups: Iterable[Sequence[TaskT]], limit: int | None) -> list[TaskT]:
    """Take every task; or, up to a limit, tasks of each group in turn, the same ones each time."""
    if limit is None:
        return [task for group in groups for task in group]
    rng = np.random.default_rng(0)
    shuffled = [[group[i] for i in rng.permutation(len(group))] for group in groups]
    turns = (task for turn in zip_longest(*shuffled) for task in turn if task is not None)
    return list(islice(turns, limit))


def make_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> Table:
    """Set rows in columns, the first one to the left, numbers to the right."""
    table = Table(title=title, title_justify="left")
    for i, column in enumerate(columns):
        table.add_column(column, justify="left" if i == 0 else "right", no_wrap=True)
    for row in rows:
        table.add_row(*(cell if isinstance(cell, str) else f"{cell:.3g}" for cell in row))
    return table
