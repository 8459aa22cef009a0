"""Unknowns of the spectral method from a known motion: a guess, or another task's curves."""

from __future__ import annotations

import numpy as np

from planner.solvers.curves import Curves
from planner.solvers.spectral_ends import EndValues
from planner.solvers.spectral_problem import SpectralProblem


def project(
    problem: SpectralProblem,
    ends: tuple[EndValues, EndValues],
    y: np.ndarray,
    multiplier: np.ndarray | None,
) -> np.ndarray:
    """Returns the unknowns nearest to a motion, (K, p), and multiplier, (K, m), at nodes."""
    motion, force = problem.carried(ends)
    root = np.sqrt(problem.nodes.weights)[:, None]
    places, result = problem.places, np.zeros(problem.size)
    skip = len(motion)
    rest = root * (y - problem.phi[0][:, :skip] @ motion)
    found = np.linalg.lstsq(root * problem.phi[0][:, skip:], rest, rcond=None)[0]
    result[places[0]] = found.T.ravel()
    if multiplier is not None:
        skip = len(force)
        rest = root * (multiplier - problem.psi[:, :skip] @ force)
        found = np.linalg.lstsq(root * problem.psi[:, skip:], rest, rcond=None)[0]
        result[places[1]] = found.T.ravel()
    return result


def carry_over(problem: SpectralProblem, curves: Curves) -> np.ndarray:
    """Returns the unknowns of given curves: what is left of them beside their own ends.

    Other ends then bend the motion as little as their polynomial does, instead of in haste.
    """
    ends = np.array([0.0, 1.0])
    orders = range(max(problem.motion_basis.ends))
    values = [curves.y(ends, order) for order in orders]
    own = [
        values[order][index]
        for index in (0, 1)
        for order in range(problem.motion_basis.ends[index])
    ]
    force_values = curves.multiplier(ends)
    own_force = [force_values[index] for index in (0, 1) if problem.force_basis.ends[index]]
    u, root = problem.nodes.u, np.sqrt(problem.nodes.weights)[:, None]
    places, result = problem.places, np.zeros(problem.size)
    for place, basis_values, carried, wanted in (
        (places[0], problem.phi[0], own, curves.y(u)),
        (places[1], problem.psi, own_force, curves.multiplier(u)),
    ):
        skip = len(carried)
        rest = wanted - (basis_values[:, :skip] @ np.array(carried) if skip else 0.0)
        free = root * basis_values[:, skip:]
        result[place] = np.linalg.lstsq(free, root * rest, rcond=None)[0].T.ravel()
    return result
