"""Progress of long work on stderr."""

from __future__ import annotations

import sys
import time

PAUSE = 60.0
"""Time between two lines of a log, s."""


class Progress:
    """One line that changes on a terminal; a line a minute, and the last one, in a log."""

    def __init__(self, quiet: bool) -> None:
        self._quiet, self._last = quiet, time.monotonic()
        self._terminal = not quiet and sys.stderr.isatty()

    def tell(self, line: str, last: bool = False) -> None:
        """Shows the present state; `last` is true for the final one."""
        now = time.monotonic()
        if self._quiet or not (self._terminal or last or now - self._last >= PAUSE):
            return
        self._last = now
        print(f"\r{line} " if self._terminal else line, end="" if self._terminal else "\n", file=sys.stderr, flush=True)

    def end(self) -> None:
        """Ends the line of a terminal."""
        if self._terminal:
            print(file=sys.stderr)
