"""Batches: two workers against one, and what random kills lose, do twice or tear.

python bench/batching.py --figures 50 throughput
python bench/batching.py --figures 12 kills --count 100

Figures are the built-in ones, stretched a little, so that no two are the same.
"""

import argparse
import csv
import hashlib
import os
import random
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


def make_jobs(folder: Path, count: int) -> Path:
    """Write so many different figures, and the CSV that animates each with one clip."""
    meshes = [bunraku.read(path).mesh for path in builtin.figure_paths().values()]
    rng = np.random.default_rng(0)
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


def measure_throughput(jobs: Path, folder: Path) -> float:
    """Give how many times faster two workers are than one."""
    seconds = []
    for workers in ("1", "2"):
        began = time.perf_counter()
        process = start(jobs, folder / workers, "--workers", workers)
        errors = process.communicate()[1]
        assert process.returncode == 0, errors.decode()[-300:]
        seconds.append(time.perf_counter() - began)
        print(f"{workers} workers: {seconds[-1]:.1f} s", flush=True)
    return seconds[0] / seconds[1]


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
    parser.add_argument("--longest", type=float, default=8.0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        jobs = make_jobs(folder, given.figures)
        if given.what == "throughput":
            print(f"{given.figures} figures: {measure_throughput(jobs, folder):.2f} times faster")
        else:
            rng = random.Random(0)
            print(kill_often(jobs, folder, count=given.count, longest=given.longest, rng=rng))


if __name__ == "__main__":
    main()
