"""The studio in a headless browser: upload, animate, scrub, download."""

import io
import os
import shutil
import time
import zipfile
from contextlib import suppress
from importlib import util

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import binary_dilation

import bunraku
from bunraku.rotations import quaternions_to_matrices
from bunraku.skinning import linear_blend_skinning
from bunraku.studio.casting import AS_FOUND, BY_MAP
from bunraku.studio.dragging import HANDLE_SIZE, joint_places
from bunraku.types import Mesh
from tests.depth_folders import save_video

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
GL = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
TOP = 60  # rows of the page above what is looked at
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
    picture = Image.open(io.BytesIO(page.screenshot(timeout=120_000))).convert("RGB")
    return np.asarray(picture.crop((0, TOP, 800, 700))).astype(int)


def drag_a_joint(page, visit):
    """Pull the handles of a joint with the mouse; the figure on the page changes."""
    visit.colours.value = AS_FOUND
    page.get_by_text("Move joints").click()
    wait_for(lambda: visit.mover.moving.value)
    visit.mover.joint.value = max(visit.weights.options[1:], key=lambda n: reach(visit, n))
    handles = wait_for(lambda: visit.mover.handles)
    time.sleep(3.0)  # software rendering
    shown = visit.actors[0].character
    length = HANDLE_SIZE * np.ptp(shown.mesh.vertices[:, 1])
    for share in (0.7, 0.5, 0.9):  # somewhere along the arrow that points upwards
        grip = np.add(handles.position, (0, share * length, 0))
        x, y = project(visit.client.camera, grip, page.viewport_size)
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x, y - 15, steps=4)
        page.mouse.move(x, y - 30, steps=4)
        page.mouse.up()
        with suppress(AssertionError):
            wait_for(lambda: visit.mover.moves, seconds=4)
            break
    assert visit.mover.moves, "the handles were not caught"
    page.get_by_text("Move joints").click()
    wait_for(lambda: visit.actors[0].character is not shown)
    weights = shown.skin.weights, visit.actors[0].character.skin.weights
    assert np.abs(weights[1] - weights[0]).max() > 0.01


def reach(visit, name):
    """How high a joint lies: the top of the figure is free of others."""
    character = visit.actors[0].character
    return joint_places(character)[character.skeleton.names.index(name), 1]


def project(camera, points, size):
    """The pixels of points, column and row, on a page of that size, controls included."""
    right_down_ahead = quaternions_to_matrices(np.roll(camera.wxyz, -1))
    seen = (points - camera.position) @ right_down_ahead
    scale = 0.5 * size["height"] / np.tan(0.5 * camera.fov)
    away = seen[..., :2] / seen[..., 2:]
    return 0.5 * size["width"] + scale * away[..., 0], 0.5 * size["height"] + scale * away[..., 1]


def look_at_empty_stage(page, visit):
    """The same picture without anybody."""
    surfaces = [surface for actor in visit.actors for surface, _ in actor.surfaces]
    for surface in surfaces:
        surface.visible = False
    time.sleep(3.0)  # software rendering
    picture = look(page)
    for surface in surfaces:
        surface.visible = True
    return picture


def compare(visit, share, differs):
    """Compare what a picture shows with where the posed vertices of the figure should be in it.

    Returns:
        the share of vertices with something in the picture, and of a wide ring about them.
    """
    actor = visit.actors[0]
    world = actor.world(actor.character.clips[0], share)
    motion = world @ actor.character.skin.inverse_bind
    mesh, weights = actor.character.mesh, actor.character.skin.weights
    size = {"width": 1200, "height": 760}
    places = linear_blend_skinning(mesh.vertices, weights, motion)
    pixels = project(visit.client.camera, places, size)
    columns, rows = (np.rint(part).astype(int) for part in pixels)
    expected = np.zeros(differs.shape, bool)
    expected[rows - TOP, columns] = True
    ring = binary_dilation(expected, iterations=30) & ~binary_dilation(expected, iterations=12)
    middle = int(columns.mean())  # the performer stands to the right, the shadow lies below
    ring[:, middle + int(1.1 * np.ptp(columns) / 2) :] = False
    ring[int(rows.max()) - TOP - 20 :] = False
    return differs[expected].mean(), differs[ring].mean()


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

    empty = look_at_empty_stage(page, visit)
    for share, picture in pictures.items():
        inside, beyond = compare(visit, share, np.abs(picture - empty).max(axis=2) > 30)
        assert inside > 0.9, "the page shows something where the posed vertices are"
        assert beyond < 0.02, "and nothing about them"

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

    drag_a_joint(page, visit)
    with page.expect_download() as download:
        page.get_by_role("button", name="Download GLB").click()
    download.value.save_as(moving)
    (name,) = visit.mover.moves
    moved = bunraku.read_performer(moving)
    place = joint_places(moved)[moved.skeleton.names.index(name)]
    np.testing.assert_allclose(place, visit.mover.moves[name], atol=1e-4)

    uploads = visit.folder
    assert uploads.exists()
    page.close()
    wait_for(lambda: not uploads.exists())


def test_a_depth_video_is_uploaded_and_shown(studio, browser, folder, film):
    """Its points lie where the camera saw them, and take up pixels of the page."""
    pytest.importorskip("pygel3d", reason="skeletons of depth videos need pygel3d")
    recording = save_video(folder / "recording", film.video)
    with zipfile.ZipFile(folder / "recording.zip", "w") as archive:
        for path in recording.iterdir():
            archive.write(path, f"recording/{path.name}")
    page = browser.new_page(viewport={"width": 1200, "height": 760})
    page.goto(studio.address)
    visit = wait_for(lambda: next(iter(studio.visits.values()), None))
    page.get_by_role("button", name="Animate").wait_for(timeout=60_000)
    for button, path in (("figure", "figure.ply"), ("performance", "recording.zip")):
        upload(page, f"Upload a {button}", folder / path)
        page.get_by_text(f"{path} is here").wait_for()
    page.get_by_role("button", name="Animate").click()
    page.get_by_text("Confidence").first.wait_for(timeout=180_000)

    visit.playing.value = False
    visit.moment.value = 0.5
    screen = visit.screen
    wait_for(lambda: screen.shown and screen.shown[0] == screen.footage.frame(visit_time(screen)))
    assert len(screen.clouds) == 2
    page.get_by_text("Tracked points").wait_for()
    time.sleep(3.0)  # software rendering
    shown = look(page)
    screen.depths.value = screen.points.value = False
    wait_for(lambda: not screen.clouds)
    time.sleep(3.0)
    changed = np.abs(look(page) - shown).max(axis=2) > 30
    assert 1e-4 < changed.mean() < 0.2
    page.close()


def visit_time(screen):
    """Halfway through the film."""
    return 0.5 * (screen.footage.times[0] + screen.footage.times[-1])
