"""A solved boundary value problem: states and costates at any time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from planner.boundary_value_problem import BoundaryValueProblem
from planner.criteria.base import Evaluation

_GAUSS = 3


@dataclass(frozen=True)
class Refinement:
    """Progress of a solve, once per mesh refinement or iteration.

    Attributes:
        nodes: Mesh nodes, or coefficients.
        residual: Largest relative residual of the equations.
        cost: Cost of the motion so far.
        seconds: Time since the solve began [s].
        stage: Which method or attempt reports, e.g. "spectral".
    """

    nodes: int
    residual: float
    cost: float
    seconds: float
    stage: str = ""


ProgressCallback = Callable[[Refinement], None]


@dataclass(frozen=True, eq=False)
class Solution:
    """States and costates of Pontryagin's equations along the whole motion.

    Attributes:
        problem: The problem solved.
        method: Name of the method.
        mesh: Shares of the duration between which the solution is one polynomial, (M,).
        states: Gives states and costates (K, 2 * state_size) at shares (K,).
        cost: The criterion's value.
        known_residual: Largest relative residual of the differential equations as the method
            measured it; None where it is still to be measured.
        iterations: Newton iterations.
        refinements: Progress of the solve.
        seconds: Time that the solve took [s].
        remarks: What the reader should know, e.g. a continuation that was needed.
        evidence: Further numbers for the plan's checks.
        second_variation: Gives the least second variation of the cost, relative to it; None where
            the method does not know it.
    """

    problem: BoundaryValueProblem
    method: str
    mesh: np.ndarray
    states: Callable[[np.ndarray], np.ndarray]
    cost: float
    known_residual: float | None
    iterations: int
    refinements: tuple[Refinement, ...]
    seconds: float
    remarks: tuple[str, ...] = field(default=())
    evidence: dict[str, Any] = field(default_factory=dict)
    second_variation: Callable[[], float] | None = None

    @cached_property
    def residual(self) -> float:
        """Largest relative residual of the differential equations, in scaled states."""
        if self.known_residual is not None:
            return self.known_residual
        middle = 0.5 * (self.mesh[1:] + self.mesh[:-1])
        step = 1e-3 * np.min(np.diff(self.mesh))
        ahead, behind = self.states(middle + step), self.states(middle - step)
        true = self.problem.scaled((ahead - behind) / (2.0 * step))
        slope = self.problem.right_side(middle, self.problem.scaled(self.states(middle)))
        off = ((slope - true) ** 2).sum(axis=0) / (1.0 + slope**2).sum(axis=0)
        return float(np.sqrt(np.max(off)))

    def evaluate(self, share: np.ndarray) -> tuple[np.ndarray, Evaluation]:
        """Returns states and costates, and their evaluation, at shares of the duration, (K,)."""
        x = self.states(share)
        return x, self.problem.evaluate(share, x)


def integrate_cost(
    problem: BoundaryValueProblem,
    mesh: np.ndarray,
    states: Callable[[np.ndarray], np.ndarray],
) -> float:
    """Returns the criterion's integral, by Gauss quadrature on every mesh interval.

    Args:
        problem: The problem.
        mesh: Shares of the duration between which the states are smooth, (M,).
        states: Gives states and costates at shares.
    """
    points, weights = np.polynomial.legendre.leggauss(_GAUSS)
    width = np.diff(mesh)[:, None]
    share = (mesh[:-1, None] + width * (points + 1.0) / 2.0).ravel()
    x = states(share)
    running = problem.criterion.running_cost_of(problem.coordinates, share, x)
    return float(running @ (width * weights / 2.0).ravel()) * problem.transport.duration
