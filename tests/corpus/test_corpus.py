"""Damaged and odd files: each ends in what its row says, in one clear line, quickly.

The rows beside this file are what searches and reviews have found. The adversarial corpus of some
hundred files is larger, and lies outside the repository: BUNRAKU_CORPUS names its folder.
"""

import csv
import os
import time
from pathlib import Path

import pytest

from bunraku.cli import run

HERE = Path(__file__).parent
SHARED = Path(os.environ.get("BUNRAKU_CORPUS", HERE.parents[2] / "shared" / "corpus"))
LONGEST_LINE = 300
SECONDS = 20.0  # in one process, under the shape checker, on a busy machine; 5 by itself
CATEGORIES = ("gltf-valid-odd", "gltf-invalid", "mesh-odd", "mesh-broken", "bvh-odd", "depth-odd")


def read_rows(table: Path) -> list[dict[str, str]]:
    with open(table, newline="") as stream:
        return list(csv.DictReader(stream))


def shared_rows() -> list[dict[str, str]]:
    rows = read_rows(SHARED / "MANIFEST.csv") if (SHARED / "MANIFEST.csv").is_file() else []
    return [row for row in rows if row["path"].split("/")[0] in CATEGORIES]


def judge(path: Path, capsys) -> tuple[str, list[str]]:
    """Inspect a file; give the outcome by the contract of the command line, and what was said."""
    started = time.perf_counter()
    code = run(["inspect", "--", str(path)])
    assert time.perf_counter() - started < SECONDS
    shown = capsys.readouterr()
    lines = shown.err.splitlines()
    errors = [line for line in lines if line.startswith("error: ")]
    warnings = [line for line in lines if line.startswith("warning: ")]
    assert len(errors) + len(warnings) == len(lines), lines
    assert all(len(line) <= LONGEST_LINE for line in lines)
    assert "nan" not in shown.out.split()  # as Python writes it; messages say NaN
    if code == 0:
        assert not errors
        return ("warn" if warnings else "load"), lines
    assert (code, len(errors), shown.out) == (2, 1, "")
    return "refuse", lines


@pytest.mark.parametrize("row", read_rows(HERE / "ROWS.csv"), ids=lambda row: row["path"])
def test_findings_end_as_their_row_says(row, capsys):
    outcome, lines = judge(HERE / row["path"], capsys)
    assert outcome == row["expect"], lines
    assert not row["code"] or f"[{row['code']}]" in "".join(lines)


def test_every_finding_has_its_row():
    named = {row["path"] for row in read_rows(HERE / "ROWS.csv")}
    side_files = {".png", ".mtl", ".csv", ".py"}
    found = {path.name for path in HERE.iterdir() if not path.name.startswith((".", "__"))}
    assert {name for name in found if Path(name).suffix not in side_files} == named


@pytest.mark.skipif(not shared_rows(), reason="no adversarial corpus: set BUNRAKU_CORPUS")
@pytest.mark.parametrize("row", shared_rows(), ids=lambda row: row["path"])
def test_the_adversarial_corpus_ends_as_it_may(row, capsys):
    outcome, lines = judge(SHARED / row["path"], capsys)
    assert outcome in row["accept"].split("|"), lines
