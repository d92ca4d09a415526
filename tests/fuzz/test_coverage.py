"""Ten seconds a format, steered by coverage; `make fuzz` searches for longer.

Where atheris does not install, the search of test_search.py is what is left: the same mutations
and the same judge, not steered.
"""

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.fuzz.mutants import make_seeds

ROOT = Path(__file__).parents[2]
SECONDS = os.environ.get("BUNRAKU_FUZZ_SECONDS", "10")
MODULE = [sys.executable, "-m", "tests.fuzz.coverage"]
QUIET = {**os.environ, "OMP_NUM_THREADS": "1"}

pytestmark = pytest.mark.skipif(find_spec("atheris") is None, reason="needs the extra fuzz")


@pytest.mark.parametrize("kind", sorted(make_seeds()))
def test_only_the_declared_error_escapes_wherever_a_mutant_goes(kind):
    command = [*MODULE, kind, "--seconds", SECONDS]
    patience = 25 + 2 * float(SECONDS)
    try:
        run = subprocess.run(
            command, cwd=ROOT, capture_output=True, text=True, env=QUIET, timeout=patience
        )
    except subprocess.TimeoutExpired:  # a reader that hangs is interrupted long before, and told
        pytest.skip("the search by coverage itself hung, waiting for a lock")
    assert run.returncode == 0, run.stdout + run.stderr[-3000:]
    done = re.search(r"stat::number_of_executed_units:\s+(\d+)", run.stderr)
    assert done and int(done[1]) > 100, run.stderr[-3000:]


def test_what_escapes_ends_the_search(tmp_path):
    leak = "import tests.fuzz.coverage as c; from pathlib import Path; r = c.run; "
    leak += f"r.FINDINGS = Path({str(tmp_path)!r}); r.inspect = lambda path: {{}}['no such key']; "
    leak += "c.search('off', seconds=5, seed=0)"
    command = [sys.executable, "-c", leak]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=QUIET)
    assert run.returncode != 0
    assert "no such key" in next(tmp_path.glob("*.txt")).read_text()
