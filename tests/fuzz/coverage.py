"""Damage files so that they reach code that none has reached yet; needs the extra `fuzz`.

    python -m tests.fuzz.coverage ply --seconds 600

The same mutations and the same judge as in `run`; atheris steers by which branches of the readers
a mutant took, and ends the program itself. Whatever escapes is printed, and kept in
`fuzz-findings/`; the exit code is not 0 then. A search that hangs longer than any mutant may says
where, and ends with code 1.
"""

import argparse
import faulthandler
import itertools
import os
import resource
import shutil
import sys
import tempfile
import time
from pathlib import Path

import atheris
import numpy as np

with atheris.instrument_imports(include=["bunraku.formats"], enable_loader_override=False):
    from tests.fuzz import run

MIXED = 0.3  # share of mutations that are atheris's own, which know no structure
LONGEST = 100_000  # bytes of a mutant
PATIENCE = 30.0  # seconds after its time in which a search must have ended
MEMORY = 2048  # MiB that the search may hold; a reader that wants more fails


def search(kind: str, *, seconds: float, seed: int) -> None:
    """Read mutants of a format until time is up, or something escapes."""
    folder = Path(tempfile.mkdtemp(dir=run.memory()))
    path, seeds = folder / f"mutant.{kind}", folder / "seeds"
    seeds.mkdir()
    for number, content in enumerate(run.seeds_of(kind)):
        (seeds / str(number)).write_bytes(content)

    faulthandler.dump_traceback_later(seconds + PATIENCE, exit=True)
    until, done = time.monotonic() + seconds, itertools.count(1)

    def read_one(content: bytes) -> None:
        if time.monotonic() > until:  # libFuzzer's own end may wait for a lock for ever
            print(f"stat::number_of_executed_units: {next(done) - 1}", file=sys.stderr, flush=True)
            shutil.rmtree(folder, ignore_errors=True)
            os._exit(0)
        next(done)
        run.store(path, content)
        try:
            with run.limited(run.SLOWEST):
                run.read_all(path, kind)
        except (Exception, run.TooSlow):
            run.keep_finding(kind, content)
            raise

    def mutate_one(content: bytes, longest: int, seed: int) -> bytes:
        rng = np.random.default_rng(seed)
        if rng.random() < MIXED:
            return atheris.Mutate(content, longest)
        try:
            return run.damage(kind, content, rng)[:longest]
        except Exception as error:  # an error in a mutator leaves libFuzzer waiting for ever
            print(f"no mutant made: {type(error).__name__}: {error}", file=sys.stderr, flush=True)
            return content[:longest]

    options = [f"-seed={seed + 1}", f"-max_len={LONGEST}"]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10  # of whoever started this, too
    options += [f"-rss_limit_mb={peak + MEMORY}"]
    options += [f"-artifact_prefix={folder}/", "-verbosity=0", "-print_final_stats=1", str(seeds)]
    atheris.Setup(["fuzz", *options], read_one, custom_mutator=mutate_one)
    try:
        atheris.Fuzz()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kind", choices=run.kinds())
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    run.prepare()
    search(options.kind, seconds=options.seconds, seed=options.seed)


if __name__ == "__main__":
    main()
