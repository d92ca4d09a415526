"""What became of a job: a file beside its results, written last, which makes the job finished.

Also what a batch and the process of a job say to each other.
"""

from pathlib import Path
from typing import Literal

import msgspec

from bunraku.batching.jobs import Job
from bunraku.formats.files import write_atomically

State = Literal["done", "bad input", "no match", "out of memory", "out of time", "crashed"]
FINAL = ("done", "bad input", "no match")  # the same input would end in the same way


class Record(msgspec.Struct, frozen=True, kw_only=True):
    """A job's end; the numbers of a moved figure are in its report."""

    name: str  # of the results, without suffix
    job: Job
    state: State
    error: str = ""  # the one line that the command line would have printed
    details: str = ""  # where our own code broke
    seconds: float = 0.0
    files: dict[str, int] = {}  # written beside this one: name and bytes
    report: dict[str, msgspec.Raw] = {}

    @property
    def confidence(self) -> float:
        """How far to trust the result; 0 if there is none."""
        return msgspec.json.decode(self.report.get("confidence", b"0"), type=float)

    @property
    def warnings(self) -> list[str]:
        """What the route found doubtful."""
        return msgspec.json.decode(self.report.get("warnings", b"[]"), type=list[str])

    def worst(self, measure: str) -> float | None:
        """Give the largest value of a measure among the clips, such as stretch_p99."""
        kind = list[dict[str, float | str | None]]
        clips = msgspec.json.decode(self.report.get("clips", b"[]"), type=kind)
        told = [value for clip in clips if (value := clip.get(measure)) is not None]
        return max(map(float, told), default=None)


class Request(msgspec.Struct, frozen=True):
    """What a process is to do, and what it may use."""

    job: Job
    name: str  # of the results
    folder: str
    memory: int  # bytes
    keep_map: bool = False  # beside the results: the map onto the performer, or the film of it


class Message(msgspec.Struct, frozen=True):
    """The stage that begins, or the record of the finished job."""

    stage: str = ""
    record: Record | None = None


def write_record(folder: Path, record: Record) -> None:
    """Finish a job: from now on no batch does it again."""
    content = msgspec.json.format(msgspec.json.encode(record), indent=1)
    write_atomically(folder / f"{record.name}.json", content + b"\n")


def find_record(folder: Path, name: str) -> Record | None:
    """Read how a job ended, if it has: nothing, if its results are gone or it deserves another try.

    A job that ran out of time or memory, or whose process died, may end otherwise next time.
    """
    try:
        record = msgspec.json.decode((folder / f"{name}.json").read_bytes(), type=Record)
        whole = all((folder / file).stat().st_size == size for file, size in record.files.items())
    except (OSError, msgspec.DecodeError):
        return None
    return record if whole and record.state in FINAL else None
