"""The process of one job: `python -m bunraku.batching.working`.

It reads a request from standard input, and writes messages to standard output, a JSON line each.
It ends when its parent does.
"""

import io
import logging
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from PIL import Image

from bunraku.batching.footage import FOOTAGE, PERFORMER, encode_footage, make_footage
from bunraku.batching.records import Message, Record, Request, State, write_record
from bunraku.evaluate.pictures import CLAY, arrange
from bunraku.formats.files import write_atomically
from bunraku.routes.from_rig import RigTransfer
from bunraku.types import FormatError, MatchError
from bunraku.verbs.animating import animate
from bunraku.verbs.engines import prepare_for
from bunraku.verbs.failing import shorten
from bunraku.verbs.filming import Film
from bunraku.verbs.picturing import draw_clips, read_colours
from bunraku.verbs.posing import Posed
from bunraku.verbs.results import Result
from bunraku.verbs.writing import write, write_motions

logger = logging.getLogger(__name__)


def work(request: Request) -> Record:
    """Do a job, write its results and, last of all, its record."""
    began, folder = time.perf_counter(), Path(request.folder)
    try:
        files, report = _produce(request, folder)
        ended: dict[str, Any] = {"state": "done", "files": files, "report": report}
    except Exception as error:
        ended = _explain(error, request)
    seconds = time.perf_counter() - began
    record = Record(name=request.name, job=request.job, seconds=seconds, **ended)
    write_record(folder, record)
    return record


def _produce(request: Request, folder: Path) -> tuple[dict[str, int], dict[str, msgspec.Raw]]:
    """Animate a figure; write the GLB and a picture; give their sizes, and the report."""
    job, name = request.job, request.name
    result = animate(
        job.figure,
        job.performance,
        job.clips or None,
        landmarks=job.landmarks,
        contacts=job.contacts,
        seed=job.seed,
        up=job.up,
        facing=job.facing,
        force=job.force,
    )
    logger.info("writing")
    report = {key: msgspec.Raw(msgspec.json.encode(part)) for key, part in result.report.items()}
    write(folder / f"{name}.glb", result, vrm=job.vrm, engine=job.engine)
    files = [folder / f"{name}.glb", folder / f"{name}.png"]
    write_atomically(files[1], draw_result(result, files[0]))
    if request.keep_map and isinstance(result.transfer, RigTransfer):  # no other has a map
        files.append(folder / f"{name}.npy")
        content = io.BytesIO()
        np.save(content, np.stack([result.character.mesh.vertices, result.counterparts]))
        write_atomically(files[-1], content.getvalue())
    if request.keep_map and isinstance(result, Result) and result.film:
        files += keep_film(result.film, folder / name)
    if job.usd:
        files.append(folder / f"{name}.usdz")
        write(files[-1], result, engine=job.engine)
    if job.bvh:
        files += write_motions(folder / f"{name}.bvh", prepare_for(result.character, job.engine))
    return {file.name: file.stat().st_size for file in files}, report


def keep_film(film: Film, place: Path) -> list[Path]:
    """Write who was filmed as NAME-performer.glb, and what the camera saw as NAME-film.npz."""
    files = [place.with_name(place.name + ending) for ending in (PERFORMER, FOOTAGE)]
    write(files[0], film)
    write_atomically(files[1], encode_footage(make_footage(film.capture)))
    return files


def draw_result(result: Result | Posed, written: Path) -> bytes:
    """Draw three moments of the first clip in the colours of the written file, as a PNG."""
    character = replace(result.character, clips=result.character.clips[:1])
    try:
        colours = read_colours(written, character)
    except Exception as error:  # materials are read by a library, and a picture is not worth a job
        logger.info("no colours for the picture: %s", error)
        colours = np.tile(CLAY, (len(character.mesh.vertices), 1))
    picture: Image.Image = arrange(draw_clips(character, colours))
    content = io.BytesIO()
    picture.save(content, format="png")
    return content.getvalue()


def _explain(error: Exception, request: Request) -> dict[str, str]:
    """Say how a job ended that did not succeed."""
    state: State = "crashed"
    if isinstance(error, MemoryError) or isinstance(error.__cause__, MemoryError):
        wants = f"needs more than {request.memory / (1 << 30):.3g} GB"
        line = f"error: {request.job.figure}: {wants}; simplify it, or allow more with --memory"
        return {"state": "out of memory", "error": shorten(line)}
    if isinstance(error, MatchError):
        state = "no match"
    elif isinstance(error, FormatError):
        state = "bad input"
    if state == "crashed":
        details = "".join(traceback.format_exception(error))
        line = f"error: {type(error).__name__}: {error}; this is a fault of bunraku: report it"
        return {"state": state, "error": shorten(line), "details": details}
    return {"state": state, "error": shorten(f"error: {error}")}


class StageLines(logging.Handler):
    """Tell the parent which stage begins."""

    def __init__(self, tell: Callable[[Message], None]) -> None:
        super().__init__(logging.INFO)
        self.tell = tell

    def emit(self, record: logging.LogRecord) -> None:
        """Pass a record's message on, if it is no warning."""
        if record.levelno < logging.WARNING:
            self.tell(Message(stage=shorten(record.getMessage(), 80)))


def limit_memory(size: int) -> None:
    """Let every allocation fail that would make this process larger, where the system can."""
    with suppress(ImportError, ValueError, OSError):
        import resource  # not on Windows

        resource.setrlimit(resource.RLIMIT_DATA, (size, size))


def _end_with_parent() -> None:
    """Wait for the end of standard input, which is that of the parent, and end at once."""
    while os.read(0, 1):
        pass
    os._exit(1)


def main() -> None:
    """Serve one request."""
    speaker = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever libraries print must not tear a message

    def tell(message: Message) -> None:
        speaker.write(msgspec.json.encode(message) + b"\n")
        speaker.flush()

    request = msgspec.json.decode(sys.stdin.buffer.readline(), type=Request)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    limit_memory(request.memory)
    package = logging.getLogger("bunraku")
    package.setLevel(logging.INFO)
    package.addHandler(StageLines(tell))
    tell(Message(record=work(request)))


if __name__ == "__main__":
    main()
