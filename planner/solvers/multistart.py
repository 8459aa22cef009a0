"""Several starts: the spectral method from random motions around the guess, minima by cost."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from planner.boundary_value_problem import BoundaryValueProblem
from planner.solvers.curves import Curves
from planner.solvers.nearby import detour
from planner.solvers.spectral import SpectralResult

_SAME = 1e-4  # relative cost by which two minima count as one
_SIZE = 0.5  # rad


def best_of_starts(
    problem: BoundaryValueProblem,
    first: SpectralResult | None,
    starts: int,
    seed: int,
    search: Callable[[Curves], SpectralResult | None],
) -> tuple[SpectralResult | None, dict[str, Any]]:
    """Returns the cheapest result of several starts, and all local minima by cost.

    Args:
        problem: The problem; its coordinates remember the best motion.
        first: The result of the plain start, which counts as one.
        starts: Number of starts, the plain one included.
        seed: Seed of the random motions.
        search: The spectral method from given curves.
    """
    generator = np.random.default_rng(seed)
    found = [] if first is None else [first]
    transport = problem.transport
    for _ in range(starts - 1):
        problem.coordinates.remember(transport.share, transport.guess)
        result = search(detour(transport, generator, _SIZE))
        if result is not None:
            found.append(result)
    good = sorted((one for one in found if one.converged), key=lambda one: one.cost)
    if not good:
        if first is not None:
            first.problem.remember(first.point)
        return first, {}
    minima: list[dict[str, float]] = []
    for one in good:
        if minima and one.cost - minima[-1]["cost"] <= _SAME * abs(one.cost):
            minima[-1]["starts"] += 1
        else:
            minima.append({"cost": one.cost, "starts": 1})
    best = good[0]
    best.problem.remember(best.point)
    return best, {"local_minima": minima, "starts_converged": len(good), "starts": starts}
