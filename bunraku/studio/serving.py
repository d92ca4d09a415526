"""Serve the studio: one page, and a visit for everybody who opens it."""

import contextlib
import io
import threading
from importlib import import_module
from pathlib import Path
from typing import Any

from bunraku.batching.batches import count_cores
from bunraku.errors import Code
from bunraku.studio.visits import Visit, choices
from bunraku.types import FormatError

HOST, PORT = "127.0.0.1", 8080


class Studio:
    """A running server."""

    def __init__(
        self,
        figure: Path | None = None,
        performance: Path | None = None,
        *,
        host: str = HOST,
        port: int = PORT,
    ) -> None:
        """Start to serve.

        Args:
            figure: offered first, beside the built-in ones.
            performance: offered first, beside the built-in human.
            host: address to listen at; others than this machine's own let strangers in.
            port: the next free one is taken if it is in use.

        Raises:
            FormatError: if the extra is missing.
        """
        try:
            viser = import_module("viser")
        except ImportError as error:
            message = "needs the extra: pip install 'bunraku[studio]'"
            raise FormatError("bunraku studio", "", message, code=Code.EXTRA_MISSING) from error
        self.visits: dict[int, Visit] = {}
        with contextlib.redirect_stdout(io.StringIO()):  # it would print a box
            self.server: Any = viser.ViserServer(host, port, label="bunraku", verbose=False)
        places = threading.Semaphore(count_cores())
        offered = choices(figure, performance)

        def welcome(client: Any) -> None:
            self.visits[client.client_id] = Visit(client, places, *offered)

        def part(client: Any) -> None:
            visit = self.visits.pop(client.client_id, None)
            if visit:
                visit.leave()

        self.server.on_client_connect(welcome)
        self.server.on_client_disconnect(part)

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    def stop(self) -> None:
        """End all visits, and the server."""
        for visit in [*self.visits.values()]:
            visit.leave()
        self.server.stop()
