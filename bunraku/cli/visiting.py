"""bunraku studio: serve the page until somebody presses Ctrl-C."""

import threading
from pathlib import Path

import typer

from bunraku.errors import Code
from bunraku.studio.serving import Studio
from bunraku.types import FormatError


def run_studio(figure: Path | None, performance: Path | None, *, host: str, port: int) -> None:
    """Serve until interrupted.

    Raises:
        FormatError: if a file does not exist, or the extra is missing.
    """
    if performance is not None and performance.is_dir():
        message = "is a folder: depth videos are not shown here yet; use bunraku animate"
        raise FormatError(performance, "", message, code=Code.FILE_FOLDER)
    for path in (figure, performance):
        if path is not None and not path.is_file():
            message = "does not exist; check the name and the folder"
            raise FormatError(path, "", message, code=Code.FILE_MISSING)
    studio = Studio(figure, performance, host=host, port=port)
    typer.echo(f"Open {studio.address} in a browser. Ctrl-C ends the studio.")
    try:
        threading.Event().wait()
    finally:
        studio.stop()
