"""Run jobs on the machines of a Dask cluster; the extra `cluster` brings the package."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from bunraku.batching.jobs import Job, name_result
from bunraku.batching.records import Record, write_record
from bunraku.batching.running import Watch, run_apart
from bunraku.errors import Code
from bunraku.types import FormatError
from bunraku.verbs.failing import shorten

PATIENCE = 15.0  # seconds to find the scheduler


def run_on_cluster(
    jobs: Sequence[Job],
    address: str,
    watch: Watch,
    *,
    folder: Path,
    memory: int,
    seconds: float,
) -> list[Record]:
    """Let a scheduler's workers do the jobs, each in a process of its own there.

    Args:
        jobs: what to do.
        address: of the scheduler.
        watch: is told the records as they come; stages stay on the other machines.
        folder: for the results, which all machines see by this name.
        memory: bytes that a job may use.
        seconds: that it may take.

    Raises:
        FormatError: if the extra is missing, or no scheduler answers.
    """
    try:
        distributed = import_module("distributed")
    except ImportError as error:
        message = "needs the extra: pip install 'bunraku[cluster]'"
        raise FormatError(f"--cluster {address}", "", message, code=Code.EXTRA_MISSING) from error
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        reason = f"no scheduler answers ({error}); start one with `dask scheduler`"
        raise FormatError(f"--cluster {address}", "", reason, code=Code.OPTION) from error
    with client, client.as_current():
        limits = {"folder": folder, "memory": memory, "seconds": seconds}
        futures = {client.submit(run_apart, job, **limits, pure=False): job for job in jobs}
        records = {}
        for future in distributed.as_completed(futures):
            job = futures[future]
            failure = future.exception()
            records[job] = future.result() if failure is None else _mourn(job, folder, failure)
            watch(job, records[job])
    return [records[job] for job in jobs]


def _mourn(job: Job, folder: Path, error: BaseException) -> Record:
    """Record a job whose machine was lost, after the scheduler tried others."""
    reason = f"error: {job.figure}: lost on the cluster ({type(error).__name__}: {error})"
    record = Record(name=name_result(job), job=job, state="crashed", error=shorten(reason))
    write_record(folder, record)
    return record
