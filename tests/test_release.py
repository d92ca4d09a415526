import os
import re
import shutil
import subprocess
import sys
import tomllib
from importlib import metadata, util
from pathlib import Path

import pytest

import bunraku

ROOT = Path(bunraku.__file__).parents[1]


@pytest.fixture(scope="module")
def project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


def run(*command, folder):
    clean = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    return subprocess.run(
        command, cwd=folder, env=clean, capture_output=True, text=True, check=True
    ).stdout.strip()


@pytest.fixture
def copy(tmp_path):
    """What a build looks at, somewhere else."""
    for name in ("pyproject.toml", "README.md", "LICENSE", "docs/credits.md"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    return tmp_path


def commit(folder):
    run("git", "add", "-A", folder=folder)
    who = ["-c", "user.name=a", "-c", "user.email=a@b.c"]
    run("git", *who, "commit", "-q", "--allow-empty", "-m", "Change", folder=folder)


def version_of(folder):
    return run(sys.executable, "-m", "hatchling", "version", folder=folder)


@pytest.mark.skipif(
    shutil.which("git") is None or util.find_spec("hatch_vcs") is None,
    reason="no git or no hatch-vcs: pip install hatchling hatch-vcs",
)
def test_the_version_is_that_of_the_tag(copy):
    run("git", "init", "-q", folder=copy)
    commit(copy)
    assert re.fullmatch(r"\d\.\d\.\d\.dev1\+g\w+", version_of(copy))  # no tag yet
    run("git", "tag", "v1.2.3", folder=copy)
    assert version_of(copy) == "1.2.3"
    commit(copy)
    assert re.fullmatch(r"1\.2\.4\.dev1\+g\w+", version_of(copy))


@pytest.mark.skipif(util.find_spec("hatch_vcs") is None, reason="pip install hatchling hatch-vcs")
def test_files_without_git_have_a_version(copy, project, monkeypatch):
    expected = project["tool"]["hatch"]["version"]["fallback-version"]
    assert version_of(copy) == expected
    assert f"\nversion: {expected}\n" in (ROOT / "CITATION.cff").read_text()
    monkeypatch.setenv("PATH", "/nowhere")
    assert version_of(copy) == expected


def test_the_package_knows_its_version_without_being_installed(monkeypatch):
    def missing(name):
        raise metadata.PackageNotFoundError(name)

    assert bunraku.__version__ == metadata.version("bunraku")
    monkeypatch.delitem(vars(bunraku), "__version__")
    monkeypatch.setattr(metadata, "version", missing)
    assert bunraku.__version__ == "0+unknown"
    monkeypatch.delitem(vars(bunraku), "__version__")


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
