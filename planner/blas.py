"""One BLAS thread during a solve: at these sizes a second one only costs."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from functools import lru_cache

from threadpoolctl import ThreadpoolController

_depth = 0


@lru_cache(maxsize=1)
def _controller() -> ThreadpoolController:
    # looking for the libraries takes milliseconds: once is enough
    return ThreadpoolController()


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limits BLAS to one thread; nested uses cost nothing."""
    global _depth
    if _depth:
        yield
        return
    with _controller().limit(limits=1, user_api="blas"):
        _depth += 1
        try:
            yield
        finally:
            _depth -= 1
