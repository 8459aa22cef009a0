"""A process that holds one loaded contestant and does what it is asked to, one thing at a time."""

from __future__ import annotations

import gc
import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any

_SPAWN = multiprocessing.get_context("spawn")  # a fork would inherit the parent's heap


class Worker:
    """The process, while the context lasts."""

    def __init__(self, load: Callable[[], Any]) -> None:
        """Starts it.

        Args:
            load: Makes the object whose methods are asked for, there; it must be picklable.
        """
        self._pipe, other = _SPAWN.Pipe()
        self._process = _SPAWN.Process(target=_serve, args=(other, load), daemon=True)
        self._process.start()
        other.close()

    def __enter__(self) -> Worker:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._pipe.close()
        self._process.join(5.0)
        self._process.kill()

    def ask(self, name: str) -> Any:
        """Returns what the object's method of that name returns; None where it has none.

        Raises:
            RuntimeError: It raised an error, or the process ended.
        """
        self._pipe.send(name)
        try:
            answer = self._pipe.recv()
        except EOFError as error:
            raise RuntimeError(f"the process that was to {name} has ended") from error
        if isinstance(answer, Exception):
            raise RuntimeError(f"{name} failed: {answer}") from answer
        return answer


def _serve(pipe: Connection, load: Callable[[], Any]) -> None:
    """Answers until the other end is closed."""
    loaded: Any = None
    while True:
        try:
            name = pipe.recv()
        except EOFError:
            return
        try:
            if loaded is None:
                loaded = load()
                gc.collect()
                gc.freeze()  # as timeit does: nobody pays for walking through loaded modules
            method = getattr(loaded, name)
            pipe.send(None if method is None else method())
        except Exception as error:  # whatever it is, the parent is to hear of it
            pipe.send(error)
