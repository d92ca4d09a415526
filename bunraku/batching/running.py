"""Run jobs, each in a process of its own with limits, and keep what became of them.

Every job has a process started afresh (spawned, not forked): what breaks in it, breaks alone.
"""

import os
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, cast

import msgspec

from bunraku.batching.jobs import Job, name_result
from bunraku.batching.records import Message, Record, Request, find_record, write_record

MEMORY = 4 << 30  # bytes a job may use
SECONDS = 900.0  # a job may take
Watch = Callable[[Job, str | Record], None]
THREADS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def ignore(job: Job, news: str | Record) -> None:
    """Watch nothing."""


def run_apart(
    job: Job,
    folder: Path,
    *,
    memory: int = MEMORY,
    seconds: float = SECONDS,
    watch: Watch = ignore,
    crew: "Crew | None" = None,
) -> Record:
    """Do a job in a process of its own, unless it is done already.

    Args:
        job: what to do.
        folder: where results and records go.
        memory: bytes that the process may use.
        seconds: that it may take, its start included.
        watch: is told every stage as it begins, and the record.
        crew: which can end the process.
    """
    name = name_result(job)
    record = find_record(folder, name)
    if record is None:
        request = Request(job, name, str(folder), memory)
        record = supervise(request, seconds, lambda stage: watch(job, stage), crew or Crew())
    record = msgspec.structs.replace(record, job=job)  # of equal files, the one that was named
    watch(job, record)
    return record


def supervise(
    request: Request, seconds: float, announce: Callable[[str], None], crew: "Crew"
) -> Record:
    """Start the process, listen to it, and write the record that it could not write itself.

    Args:
        request: what to do.
        seconds: that it may take, its start included.
        announce: is told every stage as it begins.
        crew: which can end the process.
    """
    command = [sys.executable, "-P", "-m", "bunraku.batching.working"]
    late = threading.Event()
    record = None
    with subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | THREADS,
        start_new_session=True,  # an interrupt from the keyboard is the parent's affair
    ) as process:
        crew.add(process)
        clock = threading.Timer(seconds, _stop, (late, process))
        clock.start()
        try:
            record = _listen(process, request, announce)
        finally:
            clock.cancel()
            process.kill()
            crew.drop(process)
    record = record or find_record(Path(request.folder), request.name)  # killed at the very end
    return record or _bury(request, late.is_set(), seconds, process.returncode, crew)


def _stop(late: threading.Event, process: "subprocess.Popen[bytes]") -> None:
    late.set()
    process.kill()


def _listen(
    process: "subprocess.Popen[bytes]", request: Request, announce: Callable[[str], None]
) -> Record | None:
    """Pass the stages on until the record comes; nothing if the process ends without."""
    speaker, listener = cast(IO[bytes], process.stdin), cast(IO[bytes], process.stdout)
    with suppress(BrokenPipeError):
        speaker.write(msgspec.json.encode(request) + b"\n")
        speaker.flush()
    for line in listener:
        with suppress(msgspec.DecodeError):  # a line torn by a kill
            message = msgspec.json.decode(line, type=Message)
            if message.record is not None:
                return message.record
            announce(message.stage)
    return None


def _bury(request: Request, was_late: bool, seconds: float, code: int, crew: "Crew") -> Record:
    """Record the end of a process that could not do so itself."""
    figure = request.job.figure
    if crew.is_over:
        raise KeyboardInterrupt
    if was_late:
        reason = f"took more than {seconds:g} s; simplify it, or allow more with --timeout"
        record = Record(name=request.name, job=request.job, state="out of time", error=reason)
    else:
        reason = f"its process died ({_name_death(code)}); simplify it, or allow more --memory"
        record = Record(name=request.name, job=request.job, state="crashed", error=reason)
    record = msgspec.structs.replace(record, error=f"error: {figure}: {record.error}")
    write_record(Path(request.folder), record)
    return record


def _name_death(code: int) -> str:
    return f"signal {-code}" if code < 0 else f"exit code {code}"


@dataclass
class Crew:
    """The processes at work, so that all can be sent home at once."""

    processes: set["subprocess.Popen[bytes]"] = field(default_factory=set)
    lock: threading.Lock = field(default_factory=threading.Lock)
    is_over: bool = False

    def add(self, process: "subprocess.Popen[bytes]") -> None:
        """Count a process in, or end it if all is over."""
        with self.lock:
            self.processes.add(process)
            if self.is_over:
                process.kill()

    def drop(self, process: "subprocess.Popen[bytes]") -> None:
        """Count a process out."""
        with self.lock:
            self.processes.discard(process)

    def end(self) -> None:
        """End all processes."""
        with self.lock:
            self.is_over = True
            for process in self.processes:
                process.kill()
