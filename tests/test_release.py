import re
import subprocess
import tomllib
from pathlib import Path

import pytest

import bunraku

ROOT = Path(bunraku.__file__).parents[1]


@pytest.fixture(scope="module")
def project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_the_version_is_the_same_everywhere(project):
    assert project["tool"]["hatch"]["version"]["path"] == "bunraku/__init__.py"
    assert f"\nversion: {bunraku.__version__}\n" in (ROOT / "CITATION.cff").read_text()


def test_a_tagged_commit_has_the_version_of_its_tag():
    command = ["git", "tag", "--points-at", "HEAD"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    tags = [tag for tag in done.stdout.split() if re.fullmatch(r"v\d+(\.\d+)+", tag)]
    assert tags in ([], [f"v{bunraku.__version__}"])


def test_extras_that_messages_ask_for_exist(project):
    extras = set(project["project"]["optional-dependencies"])
    asked = set()
    for path in (ROOT / "bunraku").rglob("*.py"):
        asked |= set(re.findall(r"bunraku\[(\w+)\]", path.read_text()))
    assert {"cluster", "studio"} <= asked <= extras


def test_heavy_packages_are_no_core_dependencies(project):
    core = " ".join(project["project"]["dependencies"])
    for name in ("matplotlib", "pybvh", "torch", "viser", "distributed", "numba", "mkdocs"):
        assert name not in core


def test_the_types_are_for_others_too():
    """PEP 561: without the marker, checkers take everything for Any."""
    assert (ROOT / "bunraku" / "py.typed").exists()
