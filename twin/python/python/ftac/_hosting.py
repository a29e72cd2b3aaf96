"""An object of a user's class in a process of its own, started by the program: what `policy_host` and `robot_host` share.

A question is a line of JSON whose ``shapes`` describe the arrays of bytes that follow; an answer too, if it has arrays.
"""

from __future__ import annotations

import importlib.util
import inspect
import json
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any, BinaryIO, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

Role = Literal["policy", "robot"]
"""Of the object: the option that names its class is ``--policy`` or ``--robot``."""
Bytes = list[tuple[list[int], bytes]]
"""Arrays of bytes with their shapes."""
Images = list[NDArray[np.uint8]]
"""Arrays that accompany an answer."""


class Host(Protocol):
    """Answers for an object."""

    def introduction(self) -> dict[str, Any]:
        """The first answer, unasked."""
        ...

    def answer(self, question: dict[str, Any], arrays: Bytes) -> dict[str, Any] | tuple[dict[str, Any], Images]:
        """The answer to a question; ``{"error": words}`` if the object fails."""
        ...


class Refused(Exception):
    """What the class does not take, in words that need no traceback."""


def load(role: Role, asked: str, arguments: dict[str, Any] | None = None) -> Any:
    """An object of the class, or from the function, that ``FILE.py:CLASS`` names, made with `arguments`."""
    file, _, name = asked.rpartition(":")
    path = Path(file).resolve()
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise Refused(f"{file}: expected a Python file, such as my_{role}.py")
    module = importlib.util.module_from_spec(spec)
    # What lies beside the file can be imported, and what the file defines can be pickled.
    sys.path.insert(0, str(path.parent))
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    made, arguments = _class(module, name, file), arguments or {}
    _check(role, made, arguments)
    return made(**arguments)


def _check(role: Role, made: Callable[..., Any], arguments: dict[str, Any]) -> None:
    """`Refused` unless the class takes exactly these `arguments`, of those without a default all."""
    try:
        parameters = list(inspect.signature(made).parameters.values())
    except ValueError:
        # A class of a compiled module says nothing: it refuses by itself.
        return
    named = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    known = [parameter.name for parameter in parameters if parameter.kind in named]
    if not any(parameter.kind is inspect.Parameter.VAR_KEYWORD for parameter in parameters):
        for name in arguments:
            if name not in known:
                takes = f"one of: {', '.join(known)}" if known else "none: it takes no arguments"
                raise Refused(f"--{role}-arg: found {name}, which {made.__name__} does not take, expected {takes}")
    for parameter in parameters:
        if parameter.kind in named and parameter.default is parameter.empty and parameter.name not in arguments:
            name = parameter.name
            raise Refused(f"--{role}-arg: found no {name}, expected {name}=VALUE, without which {made.__name__} cannot be made")


def _class(module: ModuleType, name: str, file: str) -> Any:
    found = getattr(module, name, None)
    if not inspect.isclass(found) and not inspect.isfunction(found):
        classes = [known for known, value in vars(module).items() if inspect.isclass(value)]
        raise Refused(f"{file}: found no class {name}, expected one of: {', '.join(classes) or 'none there'}")
    return found


def serve(
    role: Role,
    host_of: Callable[[Any], Host],
    asked: str,
    questions: BinaryIO,
    answers: BinaryIO,
    arguments: dict[str, Any] | None = None,
) -> None:
    """Answers for the object that `asked` names, behind its host, until the questions end."""

    def say(answer: dict[str, Any] | tuple[dict[str, Any], Images]) -> None:
        told, images = answer if isinstance(answer, tuple) else (answer, [])
        if images:
            told = {**told, "shapes": [image.shape for image in images]}
        answers.write(json.dumps(told, allow_nan=False).encode() + b"\n")
        for image in images:
            answers.write(np.ascontiguousarray(image).data)
        answers.flush()

    try:
        host = host_of(load(role, asked, arguments))
        introduction = host.introduction()
    except Refused as refused:
        say({"error": str(refused)})
        return
    except BaseException:
        say({"error": traceback.format_exc().strip()})
        return
    say(introduction)
    while line := questions.readline():
        question = json.loads(line)
        arrays = [(shape, questions.read(int(np.prod(shape)))) for shape in question["shapes"]]
        try:
            say(host.answer(question, arrays))
        except BaseException:
            # An interrupt, or an exit: the object's own doing.
            say({"error": traceback.format_exc().strip()})
            return


def _end_with(parent: int) -> None:
    """Ends this process and what it has started once nobody is left who could ask: the program `parent` was killed."""
    while os.getppid() == parent:
        time.sleep(0.5)
    if os.getpgrp() == os.getpid():
        os.killpg(os.getpid(), signal.SIGKILL)
    os._exit(1)


def main(role: Role, host_of: Callable[[Any], Host]) -> None:
    """Serves the object that the first argument names, made with the arguments that the second one has as a JSON object."""
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    questions = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb")
    # What the object prints is for people, and it has no questions to read.
    os.dup2(2, 1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    serve(role, host_of, sys.argv[1], questions, answers, json.loads(sys.argv[2]) if len(sys.argv) > 2 else None)
