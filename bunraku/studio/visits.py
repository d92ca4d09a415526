"""A visitor: controls, uploads and a stage of its own; jobs run in processes of their own."""

import contextlib
import re
import shutil
import tempfile
import threading
import time
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from bunraku import builtin
from bunraku.batching.footage import FOOTAGE, PERFORMER, Footage, decode_footage
from bunraku.batching.jobs import Job, name_result
from bunraku.batching.records import Record, Request, find_record
from bunraku.batching.running import MEMORY, SECONDS, Crew, supervise
from bunraku.errors import Code
from bunraku.evaluate.pictures import CLAY
from bunraku.formats import read_character
from bunraku.studio.casting import (
    AS_FOUND,
    BY_WEIGHT,
    PAINTS,
    Cast,
    describe,
    find_counterparts,
)
from bunraku.studio.dragging import JointMover
from bunraku.studio.scenes import Actor
from bunraku.studio.screening import Screen
from bunraku.studio.unpacking import MAGIC, unpack_film
from bunraku.types import Character, FormatError
from bunraku.verbs.performing import BUILT_IN, read_performer
from bunraku.verbs.picturing import read_colours

LARGEST_UPLOAD, MOST_UPLOADS = 200 << 20, 1 << 30  # bytes, of one and of all of a visitor
STAGES = ("proxy", "registration", "skin and skeleton", "rest pose", "retargeting", "writing")
FILM_STAGES = (
    *("subject", "tracking", "skeleton and skin", "proxy", "embedding", "skin"),
    *("following the figure", "retargeting", "writing"),
)
RATE = 30.0  # poses a second
NOTHING = "nothing"
FIGURES, PERFORMANCES, RESULTS = "figures", "performances", "results"


class Visit:
    """What one visitor sees and does; nobody else's."""

    def __init__(
        self,
        client: Any,
        places: threading.Semaphore,
        figures: dict[str, Path],
        performances: dict[str, Path | None],
    ) -> None:
        """Welcome a visitor.

        Args:
            client: of viser.
            places: as many jobs may run at a time, of all visitors together.
            figures: by name; the first one is chosen.
            performances: by name; None is the built-in human.
        """
        self.client, self.places = client, places
        self.figures, self.performances = dict(figures), dict(performances)
        self.kept = tempfile.TemporaryDirectory(prefix="bunraku-studio-")
        self.folder = Path(self.kept.name)
        for name in (FIGURES, PERFORMANCES, RESULTS):  # an upload can never pass for a result
            (self.folder / name).mkdir()
        self.stage = threading.Lock()  # who may change what is shown
        self.keeping, self.numbers = threading.Lock(), count()  # who may upload; of uploads
        self.crew, self.gone, self.busy = Crew(), threading.Event(), threading.Lock()
        self.actors: list[Actor] = []
        self.cast: Cast | None = None
        self.record: Record | None = None
        self.shades: np.ndarray | None = None  # colours of the figure as found
        self.poses = 0  # sent so far
        self._add_inputs()
        self._add_player()
        client.scene.set_up_direction("+y")
        client.scene.add_grid("/floor", width=8.0, height=8.0, plane="xz")
        self._look_at(0.5, 1.8)
        threading.Thread(target=self._play, daemon=True).start()

    def _look_at(self, middle: float, height: float) -> None:
        """Stand where everything on the stage can be seen, a little from above."""
        camera = self.client.camera
        camera.up_direction = (0.0, 1.0, 0.0)
        camera.position = (middle + 0.4 * height, 0.8 * height, 2.2 * height)
        camera.look_at = (middle, 0.5 * height, 0.0)

    def leave(self) -> None:
        """End the visitor's job, and remove what was uploaded and made."""
        self.gone.set()
        self.crew.end()
        with self.busy, self.keeping:
            self.kept.cleanup()

    def _add_inputs(self) -> None:
        gui = self.client.gui
        self.figure = gui.add_dropdown("Figure", list(self.figures))
        figures = gui.add_upload_button("Upload a figure")
        self.performance = gui.add_dropdown("Performance", list(self.performances))
        performances = gui.add_upload_button("Upload a performance")
        figures.on_upload(lambda _: self._take(figures.value, FIGURES, self.figures, self.figure))
        performances.on_upload(
            lambda _: self._take(
                performances.value, PERFORMANCES, self.performances, self.performance
            )
        )
        self.start = gui.add_button("Animate", color="violet")
        self.start.on_click(lambda _: self.animate())
        self.progress = gui.add_progress_bar(0.0)
        self.status = gui.add_markdown("Choose a figure, then press **Animate**.")

    def _add_player(self) -> None:
        gui = self.client.gui
        self.clip = gui.add_dropdown("Clip", [NOTHING], disabled=True)
        self.playing = gui.add_checkbox("Play", True)
        self.moment = gui.add_slider("Moment", 0.0, 1.0, 0.001, 0.0)
        self.speed = gui.add_slider("Speed", 0.1, 2.0, 0.1, 1.0)
        self.skeleton = gui.add_checkbox("Skeleton", False)
        self.colours = gui.add_dropdown("Colours", list(PAINTS), disabled=True)
        self.weights = gui.add_dropdown("Weights of", [NOTHING], disabled=True)
        self.skeleton.on_update(lambda _: self._draw_bones())
        self.colours.on_update(lambda _: self._paint())
        self.weights.on_update(lambda _: self._choose_joint())
        self.downloads = [
            gui.add_button(f"Download {what}", disabled=True) for what in ("GLB", "report")
        ]
        self.downloads[0].on_click(lambda _: self._send(".glb"))
        self.downloads[1].on_click(lambda _: self._send(".json"))
        self.mover = JointMover(self.client, self._show_moved, self._show_own_pose)
        self.screen = Screen(self.client, self._pose)

    def _take(self, upload: Any, kind: str, known: dict[str, Any], choice: Any) -> None:
        """Keep an upload under a name of ours, and choose it; after the visit nothing is kept."""
        with self.keeping:
            if self.gone.is_set():
                return
            name = re.sub(r"[^\w.-]+", "_", Path(upload.name).name).lstrip(".") or "upload"
            try:
                path = self._keep(upload, kind, name)
            except (FormatError, OSError) as error:
                self._say(f"error: {error}")
                return
            earlier, known[name] = known.get(name), path
            self._drop(earlier)
        choice.options = tuple(known)
        choice.value = name
        self._say(f"{name} is here. Press **Animate**.")

    def _keep(self, upload: Any, kind: str, name: str) -> Path:
        """Write an upload into a folder of its own, or nothing at all."""
        size = len(upload.content)
        taken = sum(path.stat().st_size for path in self.folder.rglob("*") if path.is_file())
        if size > LARGEST_UPLOAD or taken + size > MOST_UPLOADS:
            message = f"has {size >> 20} MB, more than may be uploaded here; give a smaller one"
            raise FormatError(upload.name, "", message, code=Code.LIMIT_BYTES)
        folder = self.folder / kind / str(next(self.numbers))
        folder.mkdir()
        try:
            if kind == PERFORMANCES and upload.content.startswith(MAGIC):
                path = (folder / name).with_suffix("")
                unpack_film(name, upload.content, path, most=MOST_UPLOADS - taken)
            else:
                path = folder / name
                path.write_bytes(upload.content)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        return path

    def _drop(self, path: Path | None) -> None:
        """Remove an upload that another one replaces, unless a job may still read it."""
        ours = path is not None and path.is_relative_to(self.folder)
        if path is not None and ours and self.busy.acquire(blocking=False):
            try:
                shutil.rmtree(path.parent, ignore_errors=True)
            finally:
                self.busy.release()

    def _say(self, text: str) -> None:
        """Show a line without the names of our folders."""
        self.status.content = re.sub(rf"{re.escape(str(self.folder))}/\w+/(\d+/)?", "", text)

    def animate(self) -> None:
        """Run the job of the chosen figure and performance; show how it ended."""
        if not self.busy.acquire(blocking=False):
            return
        try:
            if self.gone.is_set():
                return
            self.start.disabled = True
            record = self._run(self.figures[self.figure.value], self.performance.value)
            if record.state == "done":
                self._show(record)
            else:
                self._say(f"**{record.state}**: {record.error.removeprefix('error: ')}")
        except FormatError as error:
            self._say(f"error: {error}")
        except KeyboardInterrupt:  # the visitor has left
            return
        finally:
            with contextlib.suppress(Exception):  # the page may be gone
                self.start.disabled = False
            self.busy.release()

    def _run(self, figure: Path, performance: str) -> Record:
        """Wait for a place, then do the job in a process of its own."""
        self._say("Waiting for other visitors ...")
        while not self.places.acquire(timeout=0.5):
            if self.gone.is_set():
                raise KeyboardInterrupt
        try:
            path = self.performances[performance]
            job = Job(figure=str(figure), performance=None if path is None else str(path))
            folder, name = self.folder / RESULTS, name_result(job)
            request = Request(job, name, str(folder), MEMORY, keep_map=True)
            tell = partial(
                self._tell, FILM_STAGES if path is not None and path.is_dir() else STAGES
            )
            done = find_record(folder, name) or supervise(request, SECONDS, tell, self.crew)
            return msgspec.structs.replace(done, job=job)  # of equal files, the one chosen
        finally:
            self.places.release()

    def _tell(self, stages: tuple[str, ...], stage: str) -> None:
        """Move the progress bar along the stages of a job; a film's tracking counts frames."""
        name = stage.partition(" ")[0] if stage.startswith("tracking ") else stage
        if name in stages:
            self.progress.value = 100.0 * (stages.index(name) + 0.5) / len(stages)
            self._say(f"{stage} ...")

    def _show(self, record: Record) -> None:
        """Put the moving figure beside its performer."""
        moved = read_character(self.folder / RESULTS / f"{record.name}.glb")
        performer, footage = self._read_performer(record)
        width = 0.7 * float(
            np.ptp(moved.mesh.vertices[:, 0]) + np.ptp(performer.mesh.vertices[:, 0])
        )
        height = max(float(np.ptp(who.mesh.vertices[:, 1])) for who in (moved, performer))
        scene, aside = self.client.scene, max(width, 0.5)
        kept = self.folder / RESULTS / f"{record.name}.npy"
        places = find_counterparts(moved, np.load(kept)) if kept.exists() else None
        shades = self._colours(record, moved)
        with self.mover.drawing:  # no joint of the figure before is moved meanwhile
            with self.stage:
                for actor in self.actors:
                    actor.leave()
                self.shades = shades
                self.actors = [
                    Actor(scene, "/figure", moved, shades),
                    Actor(scene, "/performer", performer, clay(performer), aside=aside),
                ]
                self.cast = Cast(moved, performer, places)
                self.screen.take(footage, aside)
            self.mover.take(moved)
        self._look_at(0.5 * aside, height)
        self.record = record
        self.clip.options = tuple(clip.name for clip in moved.clips)
        self.weights.options = (NOTHING, *moved.skeleton.names)
        self.colours.value = AS_FOUND
        for control in (self.clip, self.colours, self.weights, *self.downloads):
            control.disabled = False
        self._draw_bones()
        self.progress.value = 100.0
        line = f"**Confidence {record.confidence:.2f}** after {record.seconds:.1f} s."
        self._say("\n\n".join([line, describe(record.confidence), *record.warnings]))

    def _read_performer(self, record: Record) -> tuple[Character, Footage | None]:
        """Read who performs, and what a camera saw of it if it was filmed."""
        place = self.folder / RESULTS / record.name
        film, performer = (place.with_name(place.name + end) for end in (FOOTAGE, PERFORMER))
        if not film.exists():
            return read_performer(record.job.performance), None
        return read_character(performer), decode_footage(film.read_bytes())

    def _colours(self, record: Record, character: Character) -> np.ndarray:
        try:
            return read_colours(self.folder / RESULTS / f"{record.name}.glb", character)
        except Exception:  # materials are read by a library; clay will do
            return clay(character)

    def _draw_bones(self) -> None:
        """Show the skeletons, or no longer."""
        with self.stage:
            for actor in self.actors:
                if (world := self._place_joints(actor)) is not None:
                    actor.show_skeleton(world, wanted=self.skeleton.value)

    def _choose_joint(self) -> None:
        """Show the weights of a joint, or the figure as found."""
        self.colours.value = AS_FOUND if self.weights.value == NOTHING else BY_WEIGHT
        self._paint()

    def _paint(self) -> None:
        """Show both in the chosen colours."""
        with self.stage:
            if self.cast is None:
                return
            painted = self.cast.paint(self.colours.value, self.weights.value)
            for actor, colours in zip(self.actors, painted, strict=True):
                if (world := self._place_joints(actor)) is not None:
                    actor.show_points(world, colours)

    def _place_joints(self, actor: Actor) -> Any:
        """Tell where an actor's joints are now; None if it has nothing to play."""
        if self.mover.moving.value and actor is self.actors[0]:
            return actor.bound
        clip = self._find_clip(actor)
        return None if clip is None else actor.world(clip, self.moment.value)

    def _show_own_pose(self) -> None:
        """Show the figure in its own pose while joints are moved, and moving otherwise."""
        with self.stage:
            for actor in self.actors[:1]:
                actor.fade(wanted=self.mover.moving.value)
        self._pose()

    def _show_moved(self, character: Character) -> None:
        """Put the figure with another skin in place of the one on the stage."""
        with self.stage:
            if self.cast is None or self.shades is None:
                return
            self.actors[0].leave()
            self.actors[0] = Actor(self.client.scene, "/figure", character, self.shades)
            self.actors[0].fade(wanted=self.mover.moving.value)
            self.cast = replace(self.cast, figure=character)
        self._pose()
        self._draw_bones()
        self._paint()

    def _find_clip(self, actor: Actor) -> Any:
        clips = {clip.name: clip for clip in actor.character.clips}
        return clips.get(self.clip.value)

    def _play(self) -> None:
        """Pose everybody at the chosen moment, again and again."""
        shown: tuple[Any, ...] = ()
        last = time.monotonic()
        while not self.gone.wait(1 / RATE):
            now, before = time.monotonic(), last
            last = now
            clip = self._find_clip(self.actors[0]) if self.actors else None
            if clip is None:
                continue
            if self.playing.value:
                seconds = max(float(clip.times[-1] - clip.times[0]), 1e-3)
                self.moment.value = (
                    self.moment.value + (now - before) * self.speed.value / seconds
                ) % 1
            wanted = (clip.name, self.moment.value, id(self.actors[0]))
            if wanted != shown:
                self._pose()
                shown = wanted

    def _pose(self) -> None:
        with self.stage, self.client.atomic():
            for actor in self.actors:
                if (world := self._place_joints(actor)) is not None:
                    actor.pose(world)
            self.screen.show(self.moment.value)
        self.poses += 1

    def _send(self, suffix: str) -> None:
        """Send a result, or the report in it, as a download."""
        if self.record is None:
            return
        path = self.folder / RESULTS / f"{self.record.name}{suffix}"
        if suffix == ".json":
            report = self.record.report | {"moved_joints": self.mover.moves}
            content = msgspec.json.format(msgspec.json.encode(report), indent=2)
        else:
            content = self.mover.write(path)
        name = f"{Path(self.record.job.figure).stem}-moving{suffix}"
        self.client.send_file_download(name, content, save_immediately=True)


def clay(character: Character) -> np.ndarray:
    """Give every vertex the colour of clay."""
    return np.tile(CLAY, (len(character.mesh.vertices), 1))


def choices(
    figure: Path | None, performance: Path | None
) -> tuple[dict[str, Path], dict[str, Path | None]]:
    """List the figures and performances that every visitor may choose, the given ones first."""
    figures = {figure.name: figure.resolve()} if figure else {}
    performances = {performance.name: performance.resolve()} if performance else {}
    return figures | builtin.figure_paths(), {**performances, BUILT_IN: None}
