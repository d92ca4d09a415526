"""Ten seconds a format, steered by coverage; `make fuzz` searches for longer.

Where atheris does not install, the search of test_search.py is what is left: the same mutations
and the same judge, not steered.
"""

import os
import re
import signal
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.fuzz.run import kinds

ROOT = Path(__file__).parents[2]
SECONDS = float(os.environ.get("BUNRAKU_FUZZ_SECONDS", "10"))
START = 240.0  # seconds that a search may take to begin and to end on a busy machine
ATTEMPTS = 3  # of a search that hangs outside of every reader
HUNG = "Timeout ("  # how the watchdog of a search begins what it tells

pytestmark = pytest.mark.skipif(find_spec("atheris") is None, reason="needs the extra fuzz")


def run_search(*command: str) -> subprocess.CompletedProcess[str]:
    """Run a search in a group of processes of its own, which ends with it or at the deadline."""
    quiet = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    pipe = subprocess.PIPE
    child = subprocess.Popen(
        [sys.executable, *command],
        cwd=ROOT,
        env=quiet,
        text=True,
        stdout=pipe,
        stderr=pipe,
        start_new_session=True,
    )
    try:
        told = child.communicate(timeout=START + 2 * SECONDS)
    except subprocess.TimeoutExpired:
        os.killpg(child.pid, signal.SIGKILL)
        told = child.communicate()
    return subprocess.CompletedProcess(child.args, child.returncode, *told)


@pytest.mark.parametrize("kind", kinds())
def test_only_the_declared_error_escapes_wherever_a_mutant_goes(kind):
    for _ in range(ATTEMPTS):
        run = run_search("-m", "tests.fuzz.coverage", kind, "--seconds", str(SECONDS))
        if HUNG not in run.stderr or "bunraku/formats" in run.stderr:
            break  # atheris itself has been seen to wait for a lock: again
    assert run.returncode == 0, run.stdout + run.stderr[-3000:]
    done = re.search(r"stat::number_of_executed_units:\s+(\d+)", run.stderr)
    assert done and int(done[1]) > 100, run.stderr[-3000:]


def test_what_escapes_ends_the_search(tmp_path):
    leak = "import tests.fuzz.coverage as c; from pathlib import Path; r = c.run; "
    leak += f"r.FINDINGS = Path({str(tmp_path)!r}); r.inspect = lambda path: {{}}['no such key']; "
    leak += "c.search('off', seconds=5, seed=0)"
    assert run_search("-c", leak).returncode not in (0, -signal.SIGKILL)
    assert "no such key" in next(tmp_path.glob("*.txt")).read_text()


def test_a_search_that_hangs_ends_itself_and_tells_where():
    hang = "import tests.fuzz.coverage as c, time; c.PATIENCE = 1.0; r = c.run; "
    hang += "r.store = lambda path, content: time.sleep(1000); "
    hang += "c.search('off', seconds=2, seed=0)"
    run = run_search("-c", hang)
    assert run.returncode == 1
    assert HUNG in run.stderr and "read_one" in run.stderr


def test_a_mutator_that_fails_does_not_hang_the_search():
    broken = "import tests.fuzz.coverage as c; r = c.run; "
    broken += "r.damage = lambda kind, content, rng: 1 / 0; c.search('off', seconds=3, seed=0)"
    run = run_search("-c", broken)
    assert run.returncode == 0 and "no mutant made: ZeroDivisionError" in run.stderr
