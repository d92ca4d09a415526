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
VERSIONS = {"gltf-validator": "2.0.0-dev.3.10", "three": "0.187.0", "playwright-core": "1.65.1"}
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
        command = ["npm", "install", "--no-audit", "--no-fund", "--ignore-scripts", *wanted]
        done = subprocess.run(command, cwd=fresh, capture_output=True, text=True, timeout=300)
        if done.returncode:
            shutil.rmtree(fresh)
            pytest.skip(f"npm could not install the players (offline?): {done.stderr[-200:]}")
        try:
            fresh.rename(folder)
        except OSError:  # another process was faster
            shutil.rmtree(fresh)
    return folder


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
