"""The command ``ftac``, as in ``python -m ftac``."""

import os
import signal
import sys

from ftac import _native


def main() -> None:
    """Runs the command line of this process and ends with its exit code."""
    # Policies of one's own run in this Python.
    os.environ.setdefault("FTAC_POLICY_PYTHON", sys.executable)
    # The program ends in order on Ctrl-C by itself.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_native.run(["ftac", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
