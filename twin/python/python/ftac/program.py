"""The command ``ftac`` from Python: for what takes long and has a command of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any


def call(*arguments: str | os.PathLike[str] | float) -> dict[str, Any]:
    """Runs ``ftac ARGUMENTS --json`` in a process of its own and returns what it prints.

    `ValueError` with the command's words for bad input. A result that falls short of its aim is a result all the same. Ctrl-C ends the command.
    """
    command = [sys.executable, "-m", "ftac", *(os.fspath(a) if isinstance(a, os.PathLike) else str(a) for a in arguments)]
    environment = {"FTAC_LOG": "", **os.environ}
    done = subprocess.run([*command, "--json", "--quiet"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    if done.returncode == 2:
        raise ValueError(done.stderr.strip().removeprefix("ftac: ") or "bad input")
    if done.returncode not in (0, 1):
        raise RuntimeError(f"ftac ended with {done.returncode}: {done.stderr.strip()}")
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer
