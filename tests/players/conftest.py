"""Programs of others that judge our files; where they are missing, tests skip and say so."""

import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent
VERSIONS = {
    "gltf-validator": "2.0.0-dev.3.10",
    "three": "0.187.0",
    "playwright-core": "1.65.1",
    "@pixiv/three-vrm": "3.5.5",
}
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


@pytest.fixture(scope="session")
def packages() -> Path:
    """The folder of Node packages, filled on first use."""
    if not shutil.which("node") or not shutil.which("npm"):
        pytest.skip("no Node.js: install node and npm to let other programs judge our files")
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "bunraku-tests"
    folder = cache / "-".join(VERSIONS.values())
    if not folder.is_dir():
        cache.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(dir=cache))
        wanted = [f"{name}@{version}" for name, version in VERSIONS.items()]
        fault = install(wanted, fresh)
        if fault:
            shutil.rmtree(fresh)
            pytest.skip(f"npm could not install the players (offline?): {fault}")
        try:
            fresh.rename(folder)
        except OSError:  # another process was faster
            shutil.rmtree(fresh)
    return folder


def install(wanted: list[str], folder: Path) -> str:
    """Let npm fill a folder with packages; say what went wrong, if anything."""
    options = ["--no-audit", "--no-fund", "--ignore-scripts", "--fetch-retries=0"]
    command = ["npm", "install", *options, *wanted]
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
    except (subprocess.TimeoutExpired, OSError) as error:
        return str(error)
    if not done.returncode:
        return ""
    faults = [line for line in done.stderr.splitlines() if line.startswith("npm error")]
    return "; ".join(faults[:2]) or f"npm ended with {done.returncode}"


def run_node(script: str, *arguments: object, job: Any) -> Any:
    """Run one of the scripts beside this file with a job as JSON, and read its answer."""
    command = ["node", str(HERE / script), *map(str, arguments)]
    done = subprocess.run(
        command, input=json.dumps(job), capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


@pytest.fixture(scope="session")
def validate(packages):
    """Call the Khronos validator on files; give its verdict on each."""
    return lambda paths: run_node("validate.mjs", packages, job=[str(path) for path in paths])


@pytest.fixture(scope="session")
def pose_in_browser(packages):
    """Call three.js in a headless browser; give the posed vertices of each job and time."""
    names = filter(None, [os.environ.get("CHROMIUM"), *BROWSERS])
    browser = next(filter(None, map(shutil.which, names)), None)
    if browser is None:
        pytest.skip("no Chromium: install it, or name it in the variable CHROMIUM")
    return lambda jobs: run_node("pose.mjs", packages, browser, job=jobs)


@pytest.fixture(scope="session")
def load_vrm(packages):
    """Call three-vrm on files; give what it finds in each, and how much a turned arm moves."""
    return lambda paths: run_node("vrm.mjs", packages, job=[str(path) for path in paths])
