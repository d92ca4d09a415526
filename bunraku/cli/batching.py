"""bunraku batch: many figures, with a table of what is at work."""

import sys
import threading
import time
from pathlib import Path

import typer
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table

from bunraku.batching.batches import batch
from bunraku.batching.jobs import Job, read_jobs
from bunraku.batching.records import Record
from bunraku.cli.failures import about, shorten
from bunraku.errors import Code
from bunraku.types import FormatError, MatchError

GIGABYTE = 1 << 30


def run_batch(
    path: Path,
    folder: Path,
    *,
    workers: int | None,
    cluster: str | None,
    resume: bool,
    limits: tuple[float, float],
) -> None:
    """Run the jobs of a CSV; print what becomes of them as it happens.

    Args:
        path: the CSV.
        folder: for the results.
        workers: jobs at a time.
        cluster: address of a scheduler, which does the jobs instead.
        resume: do only what is missing.
        limits: gigabytes and seconds of a job.

    Raises:
        FormatError: at the end, if a job failed; MatchError, if none failed but for its match.
    """
    memory, seconds = limits
    with about(path):
        jobs = read_jobs(path)
        board = Board(len(set(jobs)))
        with board.live:
            records = batch(
                jobs,
                folder,
                workers=workers,
                cluster=cluster,
                resume=resume,
                memory=int(memory * GIGABYTE),
                seconds=seconds,
                watch=board.watch,
            )
    typer.echo(f"Look at {folder / 'index.html'}, worst first; numbers in results.csv beside it.")
    poor = sum(record.state == "no match" for record in records)
    failed = sum(record.state != "done" for record in records) - poor
    advice = f"see {folder / 'index.html'}, mend them, and run again with --resume"
    if failed:
        message = f"{failed + poor} of {len(records)} jobs failed; {advice}"
        raise FormatError(path, "", message, code=Code.JOBS)
    if poor:
        raise MatchError(f"{path}: {poor} of {len(records)} figures fit no performance; {advice}")


class Board:
    """What is at work: a live table on a terminal, and a line for each job that ended."""

    def __init__(self, count: int) -> None:
        self.count, self.ended, self.failed = count, 0, 0
        self.working: dict[Job, tuple[str, float]] = {}
        self.lock, self.began = threading.Lock(), time.monotonic()
        console = Console(stderr=True)
        self.live = Live(get_renderable=self.draw, console=console, transient=True)
        self.live.auto_refresh = sys.stderr.isatty()

    def watch(self, job: Job, news: str | Record) -> None:
        """Note a stage that begins, or a job that ended."""
        with self.lock:
            if isinstance(news, str):
                began = self.working.get(job, ("", time.monotonic()))[1]
                self.working[job] = news, began
                return
            self.working.pop(job, None)
            self.ended += 1
            self.failed += news.state != "done"
            line = f"{self.ended}/{self.count} {Path(job.figure).name}: {describe(news)}"
        self.live.console.print(shorten(line), markup=False, highlight=False, soft_wrap=True)

    def draw(self) -> Group:
        """Draw the table of now."""
        now = time.monotonic()
        with self.lock:
            rows = list(self.working.items())
            ended, failed = self.ended, self.failed
        table = Table("figure", "stage", "seconds", box=None)
        for job, (stage, began) in rows:
            table.add_row(Path(job.figure).name, stage, f"{now - began:.0f}")
        left = (now - self.began) / ended * (self.count - ended) if ended else 0.0
        words = f"{ended} of {self.count} ended, {failed} failed, about {left / 60:.0f} min left"
        return Group(table, words)


def describe(record: Record) -> str:
    """Say how a job ended, on one line."""
    if record.state != "done":
        return f"{record.state}: {record.error.removeprefix('error: ')}"
    return f"done, confidence {record.confidence:.2f}, {record.seconds:.1f} s"
