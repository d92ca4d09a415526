"""Feed readers with damaged files until something but the declared error escapes.

    python -m tests.fuzz.run                          all formats, a minute each
    python -m tests.fuzz.run glb obj --count 100000   so many mutants of each
    python -m tests.fuzz.run ply --seconds 600 --atheris    one format, by coverage (needs atheris)

Whatever escapes is written to `fuzz-findings/`, and the run fails. A finding becomes a small file
in tests/corpus, with a row in its ROWS.csv that says what must happen.
"""

import argparse
import hashlib
import logging
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bunraku.formats import inspect, read_character, read_figure, read_motion
from bunraku.types import FormatError
from tests.fuzz.mutants import make_seeds, mutate

FINDINGS = Path("fuzz-findings")
SLOWEST = 5.0  # seconds that one small file may take
READERS = {"bvh": (read_motion,), "glb": (read_character, read_figure)}


def read_all(path: Path, kind: str) -> str:
    """Read a file in every way; give what inspection said of it.

    Raises:
        AssertionError: if a result holds what no result may hold, or took too long.
        Exception: whatever else escapes the readers.
    """
    started = time.perf_counter()
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
    assert time.perf_counter() - started < SLOWEST, "took too long"
    return outcome


def mutants(kind: str, seed: int) -> Iterator[bytes]:
    """Damage the seeds of a format for ever, sometimes what was damaged before."""
    rng, seeds = np.random.default_rng(seed), make_seeds()[kind]
    while True:
        yield mutate(seeds[int(rng.integers(len(seeds)))], rng)


def search(kind: str, *, seed: int, count: int, seconds: float) -> tuple[int, dict[str, int], int]:
    """Read mutants until enough are read or time is up: how many, what came of them, findings."""
    outcomes: dict[str, int] = {}
    done = found = 0
    end = time.monotonic() + seconds
    with tempfile.TemporaryDirectory(
        dir="/dev/shm" if Path("/dev/shm").is_dir() else None
    ) as folder:
        path = Path(folder) / f"mutant.{kind}"
        for content in mutants(kind, seed):
            if done >= count or time.monotonic() > end:
                break
            done += 1
            path.write_bytes(content)
            try:
                outcome = read_all(path, kind)
            except Exception:
                found += keep_finding(kind, content)
                outcome = "ESCAPED"
            outcomes[outcome] = outcomes.get(outcome, 0) + 1
    return done, outcomes, found


def keep_finding(kind: str, content: bytes) -> int:
    """Write down what escaped, and the file that made it; 1 to be counted."""
    FINDINGS.mkdir(exist_ok=True)
    name = FINDINGS / f"{hashlib.sha256(content).hexdigest()[:12]}.{kind}"
    name.write_bytes(content)
    trace = traceback.format_exc()
    name.with_suffix(f".{kind}.txt").write_text(trace)
    print(f"{name}: {trace.strip().splitlines()[-1][:200]}", flush=True)
    return 1


def search_by_coverage(kind: str, *, seconds: float) -> None:
    """Let atheris steer the mutations to code that none has reached; it ends the program itself."""
    import atheris

    folder = tempfile.mkdtemp(dir="/dev/shm" if Path("/dev/shm").is_dir() else None)
    path, seeds = Path(folder) / f"mutant.{kind}", Path(folder) / "seeds"
    seeds.mkdir()
    for number, content in enumerate(make_seeds()[kind]):
        (seeds / str(number)).write_bytes(content)

    def read_one(content: bytes) -> None:
        path.write_bytes(content)
        read_all(path, kind)

    def mutate_one(content: bytes, longest: int, seed: int) -> bytes:
        rng = np.random.default_rng(seed)
        if rng.random() < 0.3:
            return atheris.Mutate(content, longest)
        return mutate(content, rng)[:longest]

    for module in [m for name, m in sys.modules.items() if name.startswith("bunraku.formats")]:
        for name, item in vars(module).items():
            if callable(item) and getattr(item, "__module__", "") == module.__name__:
                setattr(
                    module,
                    name,
                    atheris.instrument_func(item) if hasattr(item, "__code__") else item,
                )
    FINDINGS.mkdir(exist_ok=True)
    options = [f"-max_total_time={int(seconds)}", "-max_len=100000", "-timeout=10", str(seeds)]
    options.append(f"-artifact_prefix={FINDINGS}/")
    atheris.Setup([sys.argv[0], *options], read_one, custom_mutator=mutate_one)
    atheris.Fuzz()


def main() -> int:
    """Run the command line; 1 if anything escaped."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="*", default=sorted(make_seeds()))
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--count", type=int, default=10**9)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--atheris", action="store_true")
    options = parser.parse_args()
    logging.getLogger("bunraku").addHandler(logging.NullHandler())  # warnings are no findings
    findings = 0
    for kind in options.kinds:
        if options.atheris:
            search_by_coverage(kind, seconds=options.seconds)
        done, outcomes, found = search(
            kind, seed=options.seed, count=options.count, seconds=options.seconds
        )
        findings += found
        told = ", ".join(f"{code} {n}" for code, n in sorted(outcomes.items(), key=lambda o: -o[1]))
        print(f"{kind}: {done} mutants, {found} escaped: {told}", flush=True)
    return int(findings > 0)


if __name__ == "__main__":
    sys.exit(main())
