"""Settings and answers of direct collocation in CasADi, and what its polynomials need."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.polynomial import Polynomial

SolverName = Literal["ipopt", "fatrop"]


@dataclass(frozen=True)
class Scheme:
    """How a problem is transcribed.

    Attributes:
        intervals: Number of intervals.
        degree: Gauss points in each.
        lifted: Whether positions and velocities at the points are variables of their own: more
            variables, but second derivatives that couple no two points.
        scalar: Whether all is expanded into scalar operations (SX), or the points stay calls of
            one function (MX).
    """

    intervals: int
    degree: int
    lifted: bool = False
    scalar: bool = True

    def __str__(self) -> str:
        kind = "SX" if self.scalar else "MX"
        return f"{self.intervals}×{self.degree} {kind}{' lifted' if self.lifted else ''}"


@dataclass(frozen=True)
class Answer:
    """What a peer found.

    Attributes:
        cost: Cost.
        iterations: Iterations.
        solved: Whether the solver says so.
        status: What it says.
        variables: Number of variables.
        build: Time to write down the problem and to build its derivatives [s].
        solve: Time to solve it [s].
        guess: Time to compute the start [s].
        x: Solution.
    """

    cost: float
    iterations: int
    solved: bool
    status: str
    variables: int
    build: float
    solve: float
    guess: float
    x: np.ndarray = field(repr=False)


@dataclass(frozen=True, eq=False)
class Gauss:
    """Gauss points on (0, 1) and the integrals of the polynomials through them."""

    points: np.ndarray
    weights: np.ndarray
    once: np.ndarray
    twice: np.ndarray
    once_end: np.ndarray
    twice_end: np.ndarray


def make_gauss(degree: int) -> Gauss:
    x, w = np.polynomial.legendre.leggauss(degree)
    points, weights = (x + 1.0) / 2.0, w / 2.0
    basis = []
    for place in range(degree):
        others = np.delete(points, place)
        one = Polynomial.fromroots(others) if degree > 1 else Polynomial([1.0])
        basis.append(one / one(points[place]))
    first, second = [b.integ() for b in basis], [b.integ(2) for b in basis]
    return Gauss(
        points,
        weights,
        np.array([b(points) for b in first]),
        np.array([b(points) for b in second]),
        np.array([b(1.0) for b in first]),
        np.array([b(1.0) for b in second]),
    )


def solver_options(
    solver: SolverName, tolerance: float, scheme: Scheme, rows: int
) -> dict[str, Any]:
    quiet = {"print_time": False, "error_on_fail": False}
    if solver == "fatrop":
        more = {"structure_detection": "auto", "equality": [True] * rows}
        return quiet | more | {"fatrop.print_level": 0, "fatrop.tol": tolerance}
    # what was fastest of MUMPS' orderings: AMD for few dense rows, METIS (up to 4 times) for many
    ordering = 5 if scheme.lifted else 0
    return quiet | {
        "no_nlp_grad": True,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.tol": tolerance,
        "ipopt.linear_solver": "mumps",
        "ipopt.mumps_pivot_order": ordering,
        "ipopt.mumps_scaling": 0,
        "ipopt.mumps_permuting_scaling": 0,
    }
