"""Derivatives of the criterion along the unknowns: gradient, Gauss-Newton matrix, and bend.

The criterion is a sum of squares, of torques or their slopes and of what the state cost weighs, at
the nodes; the torques' own derivatives are explicit. What Gauss-Newton leaves out, the torques'
second derivatives, is in `spectral_curvature`; along one step a difference tells it.
"""

from __future__ import annotations

import numpy as np

from planner.criteria.base import Criterion
from planner.solvers.inverse_torques import Torques
from planner.solvers.spectral_problem import Point, SpectralProblem
from planner.solvers.spectral_unknowns import along_unknowns, gathered
from planner.vectors import matvec, transpose


def torque_design(problem: SpectralProblem, point: Point) -> np.ndarray:
    """Returns the torques' derivatives along the unknowns, (K, N, size), kept in the point."""
    if point.design is None:
        torques = point.torques
        along = torques.along_motion, torques.along_multiplier
        point.design = along_unknowns(problem, point, *along)
    return point.design


def gradient_at_nodes(
    criterion: Criterion, torques: Torques, pull: np.ndarray, weight: np.ndarray
) -> np.ndarray:
    """Returns the cost's derivatives along (y, dy/dt, d2y/dt2, lambda) at samples, (K, 3 p + m).

    Args:
        criterion: Whose cost.
        torques: Torques and their derivatives at the samples.
        pull: The cost's derivatives along the torques, (K, N), see `along_torque`.
        weight: Weights of the samples, (K, 1) [s].
    """
    motion = torques.pulled_back(pull)
    cost = criterion.state_cost
    if cost is not None:
        s = torques.tangent.s
        speed = weight * cost.speed * torques.v
        away = weight * cost.posture * (torques.tangent.q - cost.reference)
        motion[:, 0] += matvec(transpose(torques.derivatives.drag), speed)
        motion[:, 0] += matvec(transpose(s), away)
        motion[:, 1] += matvec(transpose(s), speed)
    force = matvec(transpose(torques.along_multiplier), pull)
    return np.concatenate([motion.reshape(len(force), -1), force], axis=1)


def gradient(problem: SpectralProblem, point: Point) -> np.ndarray:
    """Returns the cost's derivatives along the unknowns, (size,)."""
    pull = along_torque(problem, point.torques.tau)
    along = gradient_at_nodes(problem.criterion, point.torques, pull, problem.weight)
    return gathered(problem, point, along)


def normal_equations(problem: SpectralProblem, point: Point) -> tuple[np.ndarray, np.ndarray]:
    """Returns gradient, (size,), and Gauss-Newton matrix, (size, size)."""
    criterion, torques, design = problem.criterion, point.torques, torque_design(problem, point)
    count, size = len(problem.nodes.u), problem.size
    of_torque, of_rate = problem.roots
    parts = []
    if np.any(criterion.torque_weights):
        parts.append((torques.tau * of_torque, design * of_torque[..., None]))
    if criterion.torque_is_state:
        slopes = (problem.derivative @ design.reshape(count, -1)).reshape(design.shape)
        slopes *= of_rate[..., None]
        parts.append((point.slope * of_rate, slopes))
    cost = criterion.state_cost
    if cost is not None:
        s, weight = torques.tangent.s, problem.weight
        of_speed, of_posture = np.sqrt(cost.speed * weight), np.sqrt(cost.posture * weight)
        drag = np.stack([torques.derivatives.drag, s], axis=1)
        speeds = along_unknowns(problem, point, drag) * of_speed[..., None]
        postures = along_unknowns(problem, point, s[:, None]) * of_posture[..., None]
        parts.append((torques.v * of_speed, speeds))
        parts.append(((torques.tangent.q - cost.reference) * of_posture, postures))
    rows = [derivative.reshape(-1, size) for _, derivative in parts]
    slope: np.ndarray = sum(
        value.ravel() @ row for (value, _), row in zip(parts, rows, strict=True)
    )
    matrix = rows[0].T @ rows[0]
    for more in rows[1:]:
        matrix += more.T @ more
    return slope, matrix


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
