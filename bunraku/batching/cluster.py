"""Run jobs on the machines of a Dask cluster; the extra `cluster` brings the package."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from bunraku.batching.jobs import Job
from bunraku.batching.records import Record
from bunraku.batching.running import Watch, run_apart
from bunraku.types import FormatError

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
        raise FormatError(f"--cluster {address}", "", message) from error
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        reason = f"no scheduler answers ({error}); start one with `dask scheduler`"
        raise FormatError(f"--cluster {address}", "", reason) from error
    with client:
        limits = {"folder": folder, "memory": memory, "seconds": seconds}
        futures = {client.submit(run_apart, job, **limits, pure=False): job for job in jobs}
        records = {}
        for future in distributed.as_completed(futures):
            record = future.result()
            records[futures[future]] = record
            watch(record.job, record)
    return [records[job] for job in jobs]
