"""bunraku studio: serve the page until somebody presses Ctrl-C."""

import threading
from pathlib import Path

import typer

from bunraku.errors import Code
from bunraku.formats import is_depth_folder
from bunraku.studio.serving import Studio
from bunraku.types import FormatError


def run_studio(figure: Path | None, performance: Path | None, *, host: str, port: int) -> None:
    """Serve until interrupted.

    Raises:
        FormatError: if a file does not exist, or the extra is missing.
    """
    for path in (figure, performance):
        if path is None or path.is_file() or (path is performance and is_depth_folder(path)):
            continue
        if path.is_dir():
            message = "is a folder without depth frames; name a file, or a depth video to move by"
            raise FormatError(path, "", message, code=Code.FILE_FOLDER)
        message = "does not exist; check the name and the folder"
        raise FormatError(path, "", message, code=Code.FILE_MISSING)
    studio = Studio(figure, performance, host=host, port=port)
    typer.echo(f"Open {studio.address} in a browser. Ctrl-C ends the studio.")
    try:
        threading.Event().wait()
    finally:
        studio.stop()
