"""The studio in a headless browser: upload, animate, scrub, download."""

import io
import os
import shutil
import time
from importlib import util

import numpy as np
import pytest
from PIL import Image

import bunraku
from bunraku.studio.casting import BY_MAP
from bunraku.types import Mesh

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
GL = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
QUIET = ["--disable-background-networking", "--disable-component-update", "--disable-sync"]
pytestmark = [
    pytest.mark.skipif(
        util.find_spec("viser") is None or util.find_spec("playwright") is None,
        reason="no viser or no playwright: pip install 'bunraku[studio]' playwright",
    ),
    pytest.mark.filterwarnings("default"),  # of the server's and the browser's libraries
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory, creature):
    """The creature as a performer and, stripped, as a figure; and a figure that is none."""
    folder = tmp_path_factory.mktemp("uploads")
    bunraku.write(folder / "performer.glb", bunraku.animate(creature.mesh, creature))
    bunraku.write(folder / "figure.ply", Mesh(creature.mesh.vertices, creature.mesh.faces))
    (folder / "bad.obj").write_text("v 0 0 nan\n")
    return folder


@pytest.fixture(scope="module")
def studio(folder):
    from bunraku.studio.serving import Studio

    studio = Studio(None, folder / "performer.glb", port=0)
    yield studio
    studio.stop()


@pytest.fixture(scope="module")
def browser():
    names = filter(None, [os.environ.get("CHROMIUM"), *BROWSERS])
    program = next(filter(None, map(shutil.which, names)), None)
    if program is None:
        pytest.skip("no Chromium: install it, or name it in the variable CHROMIUM")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as player:
        opened = player.chromium.launch(executable_path=program, args=[*GL, *QUIET])
        yield opened
        opened.close()


def wait_for(fact, seconds=90):
    """Wait until something is so."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        if found := fact():
            return found
        time.sleep(0.1)
    raise AssertionError("it did not happen")


def upload(page, button, path):
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name=button).click()
    chooser.value.set_files(str(path))


def look(page):
    """The picture on the stage, without the controls."""
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    return np.asarray(picture.crop((0, 60, 800, 700))).astype(int)


def test_upload_animate_scrub_and_download(studio, browser, folder):
    page = browser.new_page(viewport={"width": 1200, "height": 760}, accept_downloads=True)
    page.goto(studio.address)
    visit = wait_for(lambda: next(iter(studio.visits.values()), None))
    page.get_by_role("button", name="Animate").wait_for(timeout=60_000)
    empty = look(page)

    upload(page, "Upload a figure", folder / "bad.obj")
    page.get_by_text("bad.obj is here").wait_for()
    page.get_by_role("button", name="Animate").click()
    page.get_by_text("bad input: bad.obj: has no faces").wait_for(timeout=60_000)

    upload(page, "Upload a figure", folder / "figure.ply")
    page.get_by_text("figure.ply is here").wait_for()
    page.get_by_role("button", name="Animate").click()
    page.get_by_text("Confidence").first.wait_for(timeout=90_000)

    visit.playing.value = False
    pictures = {}
    for share in (0.0, 0.25):
        visit.moment.value = share
        time.sleep(3.0)  # software rendering
        pictures[share] = look(page)
    assert np.ptp(pictures[0.0], axis=(0, 1)).max() > 50
    appeared = np.abs(pictures[0.0] - empty).max(axis=2) > 30
    moved = np.abs(pictures[0.25] - pictures[0.0]).max(axis=2) > 30
    assert 0.01 < appeared.mean() < 0.6
    assert 1e-4 < moved.mean() < 0.2

    visit.colours.value = BY_MAP
    time.sleep(3.0)
    painted = np.abs(look(page) - pictures[0.25]).max(axis=2) > 30
    assert 1e-3 < painted.mean() < 0.2

    with page.expect_download() as download:
        page.get_by_role("button", name="Download GLB").click()
    moving = folder / "moving.glb"
    download.value.save_as(moving)
    assert download.value.suggested_filename == "figure-moving.glb"
    assert [clip.name for clip in bunraku.read_performer(moving).clips] == ["Wave"]

    uploads = visit.folder
    assert uploads.exists()
    page.close()
    wait_for(lambda: not uploads.exists())
