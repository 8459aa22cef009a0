"""Derivatives of the criterion along the unknowns: gradient, Gauss-Newton matrix, and bend.

The criterion is a sum of squares, of torques or their slopes and of what the state cost weighs, at
the nodes; the torques' own derivatives are explicit. What Gauss-Newton leaves out, the torques'
second derivatives, is in `spectral_curvature`; along one step a difference tells it.
"""

from __future__ import annotations

import numpy as np

from planner.solvers.spectral_problem import Point, SpectralProblem


def torque_design(problem: SpectralProblem, point: Point) -> np.ndarray:
    """Returns the torques' derivatives along the unknowns, (K, N, size), kept in the point."""
    if point.design is None:
        torques = point.torques
        along = torques.along_motion, torques.along_multiplier
        point.design = problem.along_unknowns(point, *along)
    return point.design


def normal_equations(problem: SpectralProblem, point: Point) -> tuple[np.ndarray, np.ndarray]:
    """Returns gradient, (size,), and Gauss-Newton matrix, (size, size)."""
    criterion, torques, design = problem.criterion, point.torques, torque_design(problem, point)
    count, size = len(problem.nodes.u), problem.size
    of_torque, of_rate = problem.roots
    parts = []
    if criterion.torque_is_state:
        slopes = problem.derivative @ design.reshape(count, -1)
        parts.append((point.slope, slopes.reshape(design.shape), of_rate))
    if np.any(criterion.torque_weights):
        parts.append((torques.tau, design, of_torque))
    cost = criterion.state_cost
    if cost is not None:
        at, weight = torques.tangent, problem.nodes.weights[:, None] * problem.transport.duration
        speeds = problem.along_unknowns(point, np.stack([torques.derivatives.drag, at.s], axis=1))
        postures = problem.along_unknowns(point, at.s[:, None])
        parts.append((torques.v, speeds, np.sqrt(cost.speed * weight)))
        away = at.q - cost.reference
        parts.append((away, postures, np.sqrt(cost.posture * weight)))
    matrix, gradient = np.zeros((size, size)), np.zeros(size)
    for value, derivative, root in parts:
        rows = (derivative * root[..., None]).reshape(-1, size)
        matrix += rows.T @ rows
        gradient += (value * root).ravel() @ rows
    return gradient, matrix


def along_torque(problem: SpectralProblem, tau: np.ndarray) -> np.ndarray:
    """Returns the cost's derivative along the torques at the nodes, (K, N): linear in them.

    Args:
        problem: The minimisation.
        tau: Torques at the nodes, (K, N) [Nm].
    """
    of_torque, of_rate = problem.roots
    result = of_torque**2 * tau
    if problem.criterion.torque_is_state:
        result += problem.derivative.T @ (of_rate**2 * (problem.derivative @ tau))
    return result


def torque_bend(
    problem: SpectralProblem, point: Point, near: Point, move: np.ndarray, share: float
) -> np.ndarray:
    """Returns the torques' second derivative along a step, as a gradient of the cost, (size,).

    Args:
        problem: The minimisation.
        point: The iterate.
        near: The iterate after a share of the step.
        move: The step.
        share: That share: the torques' difference of second order is taken over it.
    """
    design = torque_design(problem, point)
    second = (near.torques.tau - point.torques.tau) / share - design @ move
    weight = along_torque(problem, second * (2.0 / share))
    result: np.ndarray = np.tensordot(weight, design, axes=2)
    return result
