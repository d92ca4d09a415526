"""How long each stage of a route took, and what runs now."""

import logging
import time

logger = logging.getLogger(__name__)


class Stopwatch:
    """Seconds of each stage, in order; announces every stage as it begins."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._began = time.perf_counter()
        self._stage = ""

    def begin(self, stage: str) -> None:
        """End the running stage and begin another."""
        self.end()
        self._stage = stage
        logger.info("%s", stage)

    def end(self) -> dict[str, float]:
        """End the running stage; give the seconds of all."""
        now = time.perf_counter()
        if self._stage:
            self.seconds[self._stage] = self.seconds.get(self._stage, 0.0) + now - self._began
        self._began, self._stage = now, ""
        return self.seconds
