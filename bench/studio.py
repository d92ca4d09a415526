"""The studio: seconds to the first paint, from the button to a playing figure, and poses a second.

python bench/studio.py [PICTURE.png]

Needs the extra `studio`, playwright and a Chromium. The figure is the built-in stylised one. Other
work on the machine spoils seconds of the clock, so those of the processor are given too: of the
job, and of the server for each pose.
"""

import os
import resource
import shutil
import sys
import time

from playwright.sync_api import sync_playwright

from bunraku.studio.serving import Studio

PROGRAM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))))
GL = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def main() -> None:
    """Open the page, press the button, watch for ten seconds."""
    studio = Studio(port=0)
    with sync_playwright() as player:
        browser = player.chromium.launch(executable_path=PROGRAM, args=GL)
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        began = time.perf_counter()
        page.goto(studio.address)
        button = page.get_by_role("button", name="Animate")
        button.wait_for()
        print(f"first paint after {time.perf_counter() - began:.1f} s")
        began = time.perf_counter()
        button.click()
        page.get_by_text("Confidence").first.wait_for(timeout=180_000)
        (visit,) = studio.visits.values()
        while not visit.poses:
            time.sleep(0.05)
        job = resource.getrusage(resource.RUSAGE_CHILDREN)
        print(
            f"playing {time.perf_counter() - began:.1f} s after the button; "
            f"the job took {job.ru_utime + job.ru_stime:.1f} s of the processor"
        )
        poses, began, used = visit.poses, time.perf_counter(), time.process_time()
        time.sleep(10)
        sent = visit.poses - poses
        rate, cost = sent / (time.perf_counter() - began), (time.process_time() - used) / sent
        vertices = len(visit.actors[0].character.mesh.vertices)
        print(
            f"{rate:.1f} poses a second of {vertices} vertices, beside the performer; "
            f"{1000 * cost:.1f} ms of the processor each; load {os.getloadavg()[0]:.1f}"
        )
        if len(sys.argv) > 1:
            page.screenshot(path=sys.argv[1])
        browser.close()
    studio.stop()


if __name__ == "__main__":
    main()
