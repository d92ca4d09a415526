"""Batches: two workers against one, and what random kills lose, do twice or tear.

python bench/batching.py --figures 50 throughput [--state ROUNDS.jsonl]
python bench/batching.py --figures 12 kills --count 100

Figures are the built-in ones, stretched a little, so that no two are the same. Throughput is
measured in rounds of ten figures, each with one worker and with two, one after the other, so that
other work on the machine meets both alike. Other work spoils the clock all the same, so two more
things are counted (on Linux): seconds of the processor, and seconds in which the batch could have
run but waited for a core. The clock without this waiting, divided among the workers, is near what
an idle machine would show, if anything too slow: what a job waits in its last moments is not seen,
nor that in the end of a round one worker waits alone. With --state, a run that was cut off goes on
at the next round.
"""

import argparse
import csv
import hashlib
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

import bunraku
from bunraku import builtin
from bunraku.batching.records import find_record
from bunraku.types import Mesh

Stamps = dict[str, tuple[int, int]]
Round = dict[str, float]
ROUND = 10  # figures


def make_jobs(folder: Path, count: int, *, first: int = 0) -> Path:
    """Write so many different figures, and the CSV that animates each with one clip."""
    folder.mkdir(exist_ok=True)
    meshes = [bunraku.read(path).mesh for path in builtin.figure_paths().values()]
    rng = np.random.default_rng(first)
    with (folder / "jobs.csv").open("w", newline="") as file:
        lines = csv.writer(file)
        lines.writerow(["figure", "clips", "force"])
        for number in range(count):
            mesh = meshes[number % len(meshes)]
            stretched = Mesh(mesh.vertices * rng.uniform(0.9, 1.1, 3), mesh.faces)
            bunraku.write(folder / f"figure{number:02}.ply", stretched)
            lines.writerow([f"figure{number:02}.ply", "walk", "yes"])
    return folder / "jobs.csv"


def start(jobs: Path, out: Path, *options: str) -> "subprocess.Popen[bytes]":
    """Start a batch as a user would."""
    command = [sys.executable, "-m", "bunraku.cli", "batch", str(jobs), "-o", str(out), *options]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def measure_throughput(folder: Path, *, figures: int, state: Path | None) -> list[Round]:
    """Measure one worker and two on the same figures, round by round; give all rounds."""
    done = []
    if state and state.exists():
        done = [json.loads(line) for line in state.read_text().splitlines()]
    known = {(found["first"], found["workers"]) for found in done}
    for first in range(0, figures, ROUND):
        jobs = make_jobs(folder / f"from{first}", min(ROUND, figures - first), first=first)
        turns = (1, 2) if first // ROUND % 2 == 0 else (2, 1)
        for workers in turns:
            if (first, workers) in known:
                continue
            done.append({"first": first, **time_batch(jobs, folder, workers=workers)})
            print(json.dumps(done[-1]), flush=True)
            if state:
                with state.open("a") as file:
                    print(json.dumps(done[-1]), file=file)
    return done


def time_batch(jobs: Path, folder: Path, *, workers: int) -> Round:
    """Time a whole batch: by the clock, and by the processor with all its processes."""
    out = folder / f"{jobs.parent.name}-{workers}"
    load, used = os.getloadavg()[0], resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.perf_counter()
    process, waits = start(jobs, out, "--workers", str(workers)), dict[str, int]()
    while process.poll() is None:
        waits |= read_waits(process.pid)
        time.sleep(0.2)
    seconds, errors = time.perf_counter() - began, process.communicate()[1]
    waited = sum(waits.values()) / 1e9 / workers
    assert process.returncode == 0, errors.decode()[-300:]
    now = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = now.ru_utime - used.ru_utime + now.ru_stime - used.ru_stime
    return {
        "workers": workers,
        "seconds": round(seconds, 2),
        "unhindered": round(seconds - waited, 2),
        "processor": round(processor, 2),
        "load": round(load, 2),
    }


def read_waits(process: int) -> dict[str, int]:
    """Read how many nanoseconds each thread of a process and of those below it waited for a core.

    Keyed by process and thread: what has ended keeps its last value in the caller's hands.
    """
    waits = {}
    for thread in Path(f"/proc/{process}/task").glob("*"):
        with suppress(OSError, IndexError):  # it may just have ended
            waits[str(thread)] = int((thread / "schedstat").read_text().split()[1])
            for child in (thread / "children").read_text().split():
                waits |= read_waits(int(child))
    return waits


def describe_throughput(rounds: list[Round]) -> str:
    """Say how many times faster two workers are than one."""
    total = {
        (what, workers): sum(found[what] for found in rounds if found["workers"] == workers)
        for what in ("seconds", "unhindered", "processor")
        for workers in (1, 2)
    }
    ratio = total["seconds", 1] / total["seconds", 2]
    alone = total["unhindered", 1] / total["unhindered", 2]
    cost = total["processor", 2] / total["processor", 1]
    loads = [found["load"] for found in rounds]
    return (
        f"two workers: {ratio:.2f} times as fast as one ({total['seconds', 1]:.0f} and "
        f"{total['seconds', 2]:.0f} s), {alone:.2f} times without waiting for cores "
        f"({total['unhindered', 1]:.0f} and {total['unhindered', 2]:.0f} s), "
        f"for {cost:.2f} times the seconds of the processor; "
        f"load when rounds began {min(loads):.1f} to {max(loads):.1f}"
    )


def kill_often(
    jobs: Path, folder: Path, *, count: int, longest: float, rng: random.Random
) -> dict[str, int]:
    """Kill batches after random times, with or without their workers; resume until all is done.

    Returns:
        kills, batches that came to their end, finished jobs that outlived a kill (each counted at
        every kill), and what was lost, redone, torn or came out other than in the first batch that
        ended.
    """
    found = {"kills": 0, "ended": 0, "survived": 0, "lost": 0, "redone": 0, "torn": 0, "other": 0}
    expected: dict[str, str] = {}
    while found["kills"] < count or not found["ended"]:
        out = folder / f"round{found['ended']}"
        before = stamp(out)
        process = start(jobs, out, "--workers", "2", "--resume")
        try:
            patience = None if found["kills"] >= count else rng.uniform(0.3, longest)
            process.communicate(timeout=patience)
        except subprocess.TimeoutExpired:
            strike(process, with_workers=rng.random() < 0.5)
            found["kills"] += 1
            found["survived"] += len(list((out / "results").glob("[!.]*.json")))
        after = stamp(out)
        found["lost"] += len(before.keys() - after.keys())
        found["redone"] += sum(after.get(name) not in (None, was) for name, was in before.items())
        found["torn"] += count_torn(out)
        if process.returncode == 0:
            found["ended"] += 1
            hashes = hash_results(out)
            expected = expected or hashes
            found["other"] += hashes != expected
    return found


def strike(process: "subprocess.Popen[bytes]", *, with_workers: bool) -> None:
    """Kill a batch, and at the same moment its workers or not."""
    threads = Path(f"/proc/{process.pid}/task").glob("*/children") if with_workers else ()
    workers = [number for thread in threads for number in thread.read_text().split()]
    for number in [process.pid, *map(int, workers)]:
        with suppress(ProcessLookupError):
            os.kill(number, signal.SIGKILL)
    process.communicate()


def stamp(out: Path) -> Stamps:
    """Give inode and time of the results of every finished job."""
    stamps = {}
    for path in (out / "results").glob("[!.]*.json"):
        record = find_record(path.parent, path.stem)
        for file in [path.name, *(record.files if record else ())]:
            status = (path.parent / file).stat()
            stamps[file] = status.st_ino, status.st_mtime_ns
    return stamps


def count_torn(out: Path) -> int:
    """Count results that are not whole; names with a dot in front are still being written."""
    torn = 0
    for path in (out / "results").glob("[!.]*"):
        content = path.read_bytes()
        match path.suffix:
            case ".glb":
                torn += int.from_bytes(content[8:12], "little") != len(content)
            case ".png":
                torn += b"IEND" not in content[-12:]
            case ".json":
                torn += find_record(path.parent, path.stem) is None
    return torn


def hash_results(out: Path) -> dict[str, str]:
    """Hash what must be the same whoever made it."""
    files = [path for kind in ("glb", "png") for path in (out / "results").glob(f"*.{kind}")]
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(files)}


def main() -> None:
    """Measure what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--figures", type=int, default=12)
    parser.add_argument("what", choices=["throughput", "kills"])
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--state", type=Path)
    parser.add_argument("--longest", type=float, default=8.0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if given.what == "throughput":
            rounds = measure_throughput(folder, figures=given.figures, state=given.state)
            print(f"{given.figures} figures, {describe_throughput(rounds)}")
        else:
            jobs, rng = make_jobs(folder / "jobs", given.figures), random.Random(0)
            print(kill_often(jobs, folder, count=given.count, longest=given.longest, rng=rng))


if __name__ == "__main__":
    main()
