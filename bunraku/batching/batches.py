"""Run many jobs, on this machine or on a cluster, and sum up what became of them.

records = batch("jobs.csv", "results", workers=4, resume=True)
"""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from bunraku.batching.cluster import run_on_cluster
from bunraku.batching.jobs import Job, read_jobs
from bunraku.batching.records import Record
from bunraku.batching.running import MEMORY, SECONDS, Crew, Watch, ignore, run_apart
from bunraku.batching.summary import write_page, write_table
from bunraku.errors import Code
from bunraku.formats.files import Location
from bunraku.types import FormatError


def batch(
    jobs: Location | Sequence[Job],
    folder: Location,
    *,
    workers: int | None = None,
    cluster: str | None = None,
    resume: bool = False,
    memory: int = MEMORY,
    seconds: float = SECONDS,
    watch: Watch = ignore,
) -> list[Record]:
    """Animate many figures; one that fails stops no other.

    Every job has a process, memory and time of its own. Results (GLB, picture) and then a record
    are written in one step each, so whatever ends the batch, finished jobs stay finished, and
    the next run with `resume` does the others.

    Args:
        jobs: a CSV file, or its lines.
        folder: for `results/`, the table `results.csv` and the page `index.html`.
        workers: jobs at a time on this machine; one a core, if not given.
        cluster: address of a Dask scheduler, such as tcp://host:8786, which does the jobs instead;
            its workers must see the same files by the same names.
        resume: go on with what `folder` holds; without, it must hold no results.
        memory: bytes that a job may use.
        seconds: that a job may take.
        watch: is called with a job and the stage that begins, and at last with its record; from
            several threads.

    Returns:
        what became of each job, in their order.

    Raises:
        FormatError: if the CSV is wrong, the folder cannot be used, or another batch uses it.
    """
    wanted = list(jobs) if not isinstance(jobs, str | os.PathLike) else read_jobs(jobs)
    place = Path(os.path.abspath(folder))
    with _own(place, resume=resume) as results:
        once = list(dict.fromkeys(wanted))
        crew = Crew()
        run = partial(
            run_apart, folder=results, memory=memory, seconds=seconds, watch=watch, crew=crew
        )
        if cluster is None:
            ended = _run_here(once, run, crew, workers or count_cores())
        else:
            ended = run_on_cluster(
                once, cluster, watch, folder=results, memory=memory, seconds=seconds
            )
        known = dict(zip(once, ended, strict=True))
        records = [known[job] for job in wanted]
        write_table(place / "results.csv", records)
        write_page(place / "index.html", records)
    return records


def count_cores() -> int:
    """Count the cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _run_here(
    jobs: Sequence[Job], run: "partial[Record]", crew: Crew, workers: int
) -> list[Record]:
    """Let threads start and watch the processes; an error of the batch itself ends all."""
    with ThreadPoolExecutor(workers) as pool:
        try:
            futures = [pool.submit(run, job) for job in jobs]
            wait(futures, return_when=FIRST_EXCEPTION)
            for future in futures:
                if future.done():
                    future.result()
            return [future.result() for future in futures]
        finally:
            crew.end()
            pool.shutdown(wait=False, cancel_futures=True)


@contextmanager
def _own(folder: Path, *, resume: bool) -> Iterator[Path]:
    """Make the folder ours alone while the batch runs, and clear what a killed one left behind."""
    results = folder / "results"
    try:
        results.mkdir(parents=True, exist_ok=True)
        lock = open(folder / ".lock", "w")  # noqa: SIM115  # closed below, after our own errors
    except OSError as error:
        reason = f"cannot be used ({error.strerror}); name a folder that can be written"
        raise FormatError(folder, "", reason, code=Code.OUT_PLACE) from error
    with lock:
        _lock(folder, lock.fileno())
        if not resume and next(results.glob("*.json"), None):
            message = "holds results of an earlier batch; add --resume, or name another folder"
            raise FormatError(folder, "", message, code=Code.OUT_PLACE)
        for torn in results.glob(".*"):
            with suppress(OSError):
                torn.unlink()
        yield results


def _lock(folder: Path, handle: int) -> None:
    """Take the lock of a folder, which ends with the process, however that ends."""
    try:
        import fcntl  # not on Windows
    except ImportError:
        return
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        message = "is in use by another batch; wait for its end, or name another folder"
        raise FormatError(folder, "", message, code=Code.OUT_PLACE) from None
