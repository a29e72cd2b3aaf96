"""Work done side by side, with results in the order of the questions."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future
from typing import Any, TypeVar

Result = TypeVar("Result")


def in_order(pool: Executor, work: Callable[..., Result], questions: Iterable[tuple[Any, ...]], ahead: int) -> Iterator[Result]:
    """Runs `work` with the arguments of each question in `pool`; no more than `ahead` questions are submitted beyond the one whose result is awaited.
    Shuts the pool down at the end and cancels what has not begun."""
    waiting: deque[Future[Result]] = deque()
    try:
        for question in questions:
            waiting.append(pool.submit(work, *question))
            if len(waiting) > ahead:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)
