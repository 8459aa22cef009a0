"""Unknowns of the spectral method from a known motion: a guess, or another task's curves."""

from __future__ import annotations

import numpy as np

from planner.chain import CLOSURE_TOLERANCE
from planner.solvers.basis import (
    fit_at_nodes,
    legendre_at_nodes,
    legendre_on_grid,
    spline_at_nodes,
)
from planner.solvers.curves import Curves
from planner.solvers.spectral_ends import EndValues
from planner.solvers.spectral_problem import Point, SpectralProblem

_OPEN = 1e-4  # m, rad: left at the guess, which the first step leaves far behind


def project(
    problem: SpectralProblem, ends: tuple[EndValues, EndValues], y: np.ndarray
) -> np.ndarray:
    """Returns the unknowns nearest to a motion at the nodes, (K, p), with the ends given."""
    motion, _ = problem.carried(ends)
    result = np.zeros(problem.size)
    rest = y - problem.phi[0][:, : len(motion)] @ motion
    fit = fit_at_nodes(*problem.motion_basis.key, len(y))
    result[problem.places[0]] = (fit @ rest).T.ravel()
    return result


def carry_over(problem: SpectralProblem, curves: Curves) -> np.ndarray:
    """Returns the unknowns of given curves: what is left of them beside their own ends.

    Other ends then bend the motion as little as their polynomial does, instead of in haste.
    """
    count = len(problem.nodes.u)
    result = np.zeros(problem.size)
    for place, basis, basis_values, coefficients in (
        (problem.places[0], problem.motion_basis, problem.phi[0], curves.motion),
        (problem.places[1], problem.force_basis, problem.psi, curves.force),
    ):
        degree = len(coefficients) - 1
        rest = legendre_at_nodes(count, degree, 0) @ coefficients
        if basis.conditions:
            own = [
                legendre_on_grid(2, degree, order)[index] @ coefficients
                for index in (0, 1)
                for order in range(basis.ends[index])
            ]
            rest -= basis_values[:, : basis.conditions] @ np.array(own)
        result[place] = (fit_at_nodes(*basis.key, count) @ rest).T.ravel()
    return result


def first_point(
    problem: SpectralProblem,
    curves: Curves | None,
    known_ends: tuple[EndValues, EndValues] | None = None,
) -> Point | None:
    """Returns the first iterate: nearest to given curves or the guess, or else the plainest.

    Args:
        problem: The minimisation.
        curves: Motion and multiplier to start from.
        known_ends: The curves' values at the ends, if they are those of this problem.
    """
    transport, coordinates = problem.transport, problem.coordinates
    count = len(problem.nodes.u)
    ends = list(known_ends or problem.ends.guessed)
    if curves is not None and known_ends is None:
        for index, end in enumerate((transport.start, transport.goal)):
            if not end.held:
                y = curves.y(np.array([float(index)]))[0]
                ends[index] = problem.ends.values(index, ends[index].at, y) or ends[index]
    both = ends[0], ends[1]
    known = spline_at_nodes(coordinates.known.share, coordinates.known.q, count)
    if curves is not None:
        point = problem.evaluate(carry_over(problem, curves), both, known, CLOSURE_TOLERANCE)
        if point is not None:
            return point
    path = known
    if coordinates.known.q is not transport.guess:
        path = spline_at_nodes(transport.share, transport.guess, count)
    y = path[:, transport.joints.independent]
    point = problem.evaluate(project(problem, both, y), both, known, _OPEN)
    return point or problem.evaluate(np.zeros(problem.size), both, known)
