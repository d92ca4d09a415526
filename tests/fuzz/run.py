"""Feed readers with damaged files until something but the declared error escapes.

    python -m tests.fuzz.run                          all formats, a minute each
    python -m tests.fuzz.run glb obj --count 100000   so many mutants of each
    python -m tests.fuzz.run --count 100000 --workers 2    several processes; goes on if cut off

A mutant is known by its format, the seed and its number, so that any run makes it again. Whatever
escapes is written to `fuzz-findings/`, and the run fails. A finding becomes a small file in
tests/corpus, with a row in its ROWS.csv that says what must happen.
"""

import argparse
import hashlib
import json
import logging
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from functools import cache, lru_cache
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar

import numpy as np

from bunraku.formats import (
    fbx,
    inspect,
    inspection,
    meshes,
    read_character,
    read_figure,
    read_motion,
    reading,
)
from bunraku.formats.depth_video import read_depth
from bunraku.types import FormatError
from tests.fuzz.folders import make_folders, mutate_folder, unpack_into
from tests.fuzz.mutants import make_seeds, mutate

FINDINGS = Path("fuzz-findings")
SLOWEST = 5.0  # seconds of a processor that one small file may take
CROWDED = 10  # times as long may pass meanwhile on a busy machine
CHUNK = 500  # mutants that a worker reads at a time
READERS = {"bvh": (read_motion,), "glb": (read_character, read_figure)}
READERS["fbx"] = READERS["glb"]
READERS["depth"] = (read_depth,)
ESCAPED = "ESCAPED"
T = TypeVar("T")


class TooSlow(BaseException):
    """A reader took longer than any small file may; no reader's `except` catches it."""


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Interrupt what takes more of a processor, or many times longer, asleep or crowded out."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise TooSlow(f"took more than {seconds} s")

    timers = (
        (signal.SIGPROF, signal.ITIMER_PROF, seconds),
        (signal.SIGALRM, signal.ITIMER_REAL, CROWDED * seconds),
    )
    previous = [signal.signal(number, stop) for number, _, _ in timers]
    for _, timer, limit in timers:
        signal.setitimer(timer, limit)
    try:
        yield
    finally:
        for _, timer, _ in timers:
            signal.setitimer(timer, 0.0)
        for (number, _, _), handler in zip(timers, previous, strict=True):
            signal.signal(number, handler)


def read_all(path: Path, kind: str) -> str:
    """Read a file in every way; give what inspection said of it.

    Raises:
        AssertionError: if a result holds what no result may hold.
        Exception: whatever else escapes the readers.
    """
    try:
        found = inspect(path)
        outcome = found.faults[0].code if found.faults else "load"
        assert np.isfinite([*found.low, *found.high]).all(), "bounds are not finite"
    except FormatError as error:
        outcome = error.code.name
        assert "\n" not in error.where, "a message of several lines"
    for read in READERS.get(kind, (read_figure,)):
        try:
            read(path)
        except FormatError as error:
            assert str(error).startswith(str(path)), "names another file"
    return outcome


@cache
def seeds_of(kind: str) -> list[bytes]:
    """Give the sound files that mutants of a format are made from."""
    return make_folders() if kind == "depth" else make_seeds()[kind]


def kinds() -> list[str]:
    """List the formats that are searched."""
    return sorted([*make_seeds(), "depth"])


def make_mutant(kind: str, seed: int, number: int) -> bytes:
    """Damage one of the seeds of a format."""
    rng = np.random.default_rng([seed, number])
    seeds = seeds_of(kind)
    return damage(kind, seeds[int(rng.integers(len(seeds)))], rng)


def damage(kind: str, content: bytes, rng: np.random.Generator) -> bytes:
    """Damage a file of a format, or a folder of frames."""
    return mutate_folder(content, rng) if kind == "depth" else mutate(content, rng)


def store(path: Path, content: bytes) -> None:
    """Write a mutant where readers find it; a folder, if it is one of depth frames."""
    if path.suffix == ".depth":
        unpack_into(path, content)
    else:
        path.write_bytes(content)


def search(
    kind: str, numbers: Sequence[int], *, seed: int, seconds: float = float("inf")
) -> Counter[str]:
    """Read mutants until all are read or time is up: how often each outcome came."""
    outcomes: Counter[str] = Counter()
    end = time.monotonic() + seconds
    with tempfile.TemporaryDirectory(dir=memory()) as folder:
        path = Path(folder) / f"mutant.{kind}"
        for number in numbers:
            if time.monotonic() > end:
                break
            store(path, content := make_mutant(kind, seed, number))
            try:
                with limited(SLOWEST):
                    outcomes[read_all(path, kind)] += 1
            except (Exception, TooSlow):
                keep_finding(kind, content)
                outcomes[ESCAPED] += 1
    return outcomes


def keep_finding(kind: str, content: bytes) -> None:
    """Write down what escaped, and the file that made it."""
    FINDINGS.mkdir(exist_ok=True)
    name = FINDINGS / f"{hashlib.sha256(content).hexdigest()[:12]}.{kind}"
    name.write_bytes(content)
    trace = traceback.format_exc()
    name.with_suffix(f".{kind}.txt").write_text(trace)
    print(f"{name}: {trace.strip().splitlines()[-1][:200]}", flush=True)


def search_everywhere(
    kinds: Sequence[str], *, seed: int, count: int, workers: int, progress: Path
) -> dict[str, Counter[str]]:
    """Read so many mutants of each format in several processes; what `progress` holds is done."""
    done, totals = set(), {kind: Counter[str]() for kind in kinds}
    for line in progress.read_text().splitlines() if progress.exists() else []:
        chunk = json.loads(line)
        if chunk["seed"] == seed and chunk["kind"] in totals and chunk["stop"] <= count:
            done.add((chunk["kind"], chunk["start"], chunk["stop"]))
            totals[chunk["kind"]].update(chunk["outcomes"])
    starts = [(kind, start) for kind in kinds for start in range(0, count, CHUNK)]
    chunks = [(kind, start, min(start + CHUNK, count)) for kind, start in starts]
    with ProcessPoolExecutor(workers, initializer=prepare) as pool, progress.open("a") as notes:
        waiting = {
            pool.submit(search, kind, range(start, stop), seed=seed): (kind, start, stop)
            for kind, start, stop in chunks
            if (kind, start, stop) not in done
        }
        for future in as_completed(waiting):
            kind, start, stop = waiting[future]
            outcomes = future.result()
            totals[kind].update(outcomes)
            chunk = {"kind": kind, "seed": seed, "start": start, "stop": stop, "code": revision()}
            print(json.dumps({**chunk, "outcomes": outcomes}), file=notes, flush=True)
    return totals


@cache
def revision() -> str:
    """Name the commit whose readers are run, or nothing outside of a repository."""
    command = ["git", "describe", "--always", "--dirty"]
    try:
        found = subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parent)
    except OSError:
        return ""
    return found.stdout.strip()


def memory() -> str | None:
    """Give a folder in memory, where there is one."""
    return "/dev/shm" if Path("/dev/shm").is_dir() else None


def once(function: Callable[..., T]) -> Callable[..., T]:
    """Call a function once for the same arguments in a row, and raise the same error again."""

    @lru_cache(maxsize=1)
    def call(*arguments: Any) -> T | FormatError:
        try:
            return function(*arguments)
        except FormatError as error:
            return error

    def give(*arguments: Any) -> T:
        result = call(*arguments)
        if isinstance(result, FormatError):
            raise result
        return result

    return give


def prepare() -> None:
    """Print no warnings of readers: they are no findings, those of NumPy are.

    What several readers of a mutant do first, they do once: the same function, the same content.
    """
    reading.convert_to_glb = inspection.convert_to_glb = once(fbx.convert_to_glb)
    reading.read_pieces = inspection.read_pieces = once(meshes.read_pieces)
    warnings.simplefilter("error", RuntimeWarning)
    logging.getLogger("bunraku").addHandler(logging.NullHandler())


def main() -> int:
    """Run the command line; 1 if anything escaped."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="*", default=kinds())
    parser.add_argument("--seconds", type=float, default=60.0, help="a format, without --count")
    parser.add_argument("--count", type=int, help="mutants of each format, however long it takes")
    parser.add_argument("--workers", type=int, default=1, help="processes, with --count")
    parser.add_argument("--progress", type=Path, default=FINDINGS / "progress.jsonl")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    prepare()
    options.progress.parent.mkdir(exist_ok=True)
    if options.count:
        workers, progress = options.workers, options.progress
        totals = search_everywhere(
            options.kinds,
            seed=options.seed,
            count=options.count,
            workers=workers,
            progress=progress,
        )
    else:
        every = range(10**9)
        totals = {
            kind: search(kind, every, seed=options.seed, seconds=options.seconds)
            for kind in options.kinds
        }
    for kind, outcomes in totals.items():
        told = ", ".join(f"{code} {n}" for code, n in outcomes.most_common())
        print(f"{kind}: {outcomes.total()} mutants, {outcomes[ESCAPED]} escaped: {told}")
    return int(any(outcomes[ESCAPED] for outcomes in totals.values()))


if __name__ == "__main__":
    sys.exit(main())
