"""Unknowns of the spectral method from a known motion: a guess, or another task's curves."""

from __future__ import annotations

import numpy as np

from planner.solvers.basis import fit_at_nodes
from planner.solvers.curves import Curves
from planner.solvers.spectral_ends import EndValues
from planner.solvers.spectral_problem import SpectralProblem


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
    ends = np.array([0.0, 1.0])
    values = [curves.y(ends, order) for order in range(max(problem.motion_basis.ends))]
    own = [
        values[order][index]
        for index in (0, 1)
        for order in range(problem.motion_basis.ends[index])
    ]
    force_values = curves.multiplier(ends)
    own_force = [force_values[index] for index in (0, 1) if problem.force_basis.ends[index]]
    u = problem.nodes.u
    places, result = problem.places, np.zeros(problem.size)
    for place, key, basis_values, carried, wanted in (
        (places[0], problem.motion_basis.key, problem.phi[0], own, curves.y(u)),
        (places[1], problem.force_basis.key, problem.psi, own_force, curves.multiplier(u)),
    ):
        skip = len(carried)
        rest = wanted - (basis_values[:, :skip] @ np.array(carried) if skip else 0.0)
        result[place] = (fit_at_nodes(*key, len(u)) @ rest).T.ravel()
    return result
