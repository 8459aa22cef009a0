"""What the torques' second derivatives add to the Gauss-Newton matrix: Newton's exact Hessian."""

from __future__ import annotations

import numpy as np

from planner.constrained_dynamics import tangent
from planner.criteria.curvature import STEP, join_tangents
from planner.solvers.inverse_torques import inverse_torques
from planner.solvers.spectral_derivatives import along_torque, gradient_at_nodes
from planner.solvers.spectral_problem import Point, SpectralProblem
from planner.solvers.spectral_unknowns import along_coefficients, along_unknowns
from planner.vectors import transpose

_SECOND_STEP = 3e-4  # rad, second differences along the free postures of an end


def torque_curvature(problem: SpectralProblem, point: Point) -> np.ndarray:
    """Returns what the torques' second derivatives add to the Gauss-Newton matrix.

    One difference along each independent joint, and an exact one along each rate: torques are
    quadratic in the rates and linear in accelerations and multiplier.
    """
    chain, joints = problem.transport.chain, problem.transport.joints
    p, count = problem.p, len(problem.nodes.u)
    base = point.torques.tangent
    moved = base.q[None] + STEP * base.s.transpose(2, 0, 1)
    moved = moved.reshape(p * count, problem.n)
    there = tangent(chain, joints, moved, chain.dynamics.placements(moved))
    at = join_tangents(there, base, p)
    rates = np.broadcast_to(point.rate, (2, p, count, p)).copy()
    rate_step = 1.0 / problem.transport.duration
    for joint in range(p):
        rates[1, joint, :, joint] += rate_step

    def repeat(values: np.ndarray) -> np.ndarray:
        return np.tile(values, (2 * p, 1))

    torques = inverse_torques(
        chain,
        joints,
        at,
        rates.reshape(-1, p),
        repeat(point.acceleration),
        repeat(point.torques.multiplier),
    )
    weight = problem.weight
    pull = along_torque(problem, point.torques.tau)
    criterion = problem.criterion
    gradients = gradient_at_nodes(criterion, torques, repeat(pull), repeat(weight))
    old = gradient_at_nodes(criterion, point.torques, pull, weight)
    change = gradients.reshape(2, p, count, -1) - old
    size = 3 * p + problem.m
    second = np.zeros((count, size, size))
    along_y = change[0].transpose(1, 2, 0) / STEP
    second[:, :, :p] = along_y
    second[:, :p, :] = transpose(along_y)
    second[:, :p, :p] = 0.5 * (along_y[:, :p] + transpose(along_y[:, :p]))
    along_rate = change[1][:, :, p : 2 * p].transpose(1, 2, 0) / rate_step
    second[:, p : 2 * p, p : 2 * p] = 0.5 * (along_rate + transpose(along_rate))
    cost = criterion.state_cost
    if cost is not None:  # its Gauss-Newton part is in the normal equations already
        s, drag = base.s, point.torques.derivatives.drag
        both = np.concatenate([drag, s], axis=2)
        second[:, : 2 * p, : 2 * p] -= cost.speed * weight[..., None] * transpose(both) @ both
        second[:, :p, :p] -= cost.posture * weight[..., None] * transpose(s) @ s
    whole = _unknowns_to_motion(problem, point)
    result = np.tensordot(whole, second @ whole, axes=((0, 1), (0, 1)))
    for index, place in ((0, problem.places[2]), (1, problem.places[3])):
        if place.start != place.stop:
            bend = _end_curvature(problem, index, point, old)
            if np.all(np.isfinite(bend)):  # not at the edge of what the arms reach
                result[place, place] += bend
    return result


def _unknowns_to_motion(problem: SpectralProblem, point: Point) -> np.ndarray:
    """Returns how (y, dy/dt, d2y/dt2, lambda) at the nodes depend on the unknowns.

    Shape (K, 3 p + m, size).
    """
    count, p, m = len(problem.nodes.u), problem.p, problem.m
    motion = np.zeros((count, 3, 3, p, p))
    for order in range(3):
        motion[:, order, order] = np.eye(p)
    force = np.broadcast_to(np.eye(m), (count, m, m))
    none = np.zeros((count, 3, m, p))
    return np.concatenate(
        [
            along_unknowns(problem, point, motion.reshape(count, 3, 3 * p, p)),
            along_unknowns(problem, point, none, force),
        ],
        axis=1,
    )


def _end_curvature(
    problem: SpectralProblem, index: int, point: Point, gradient: np.ndarray
) -> np.ndarray:
    """Returns the curvature of the set of allowed end postures, (free, free)."""
    values = point.ends[index]
    null = problem.ends.null(index, values)
    free = null.shape[1]
    motion, force = along_coefficients(problem, gradient)
    along = motion[problem.rows_of_end(index, problem.motion_basis)]
    along_force = force[problem.rows_of_end(index, problem.force_basis)]
    pairs = [
        (i, j, a, b) for i in range(free) for j in range(i + 1) for a in (1, -1) for b in (1, -1)
    ]
    step = _SECOND_STEP
    moves = np.array([step * (a * null[:, i] + b * null[:, j]) for i, j, a, b in pairs])
    at = problem.ends.retract(index, values.at, values.motion[0] + moves)
    moved, pressed = problem.ends.taken(index, at)
    height = (along * moved).sum(axis=(1, 2)) + (along_force * pressed).sum(axis=(1, 2))
    result = np.zeros((free, free))
    for (i, j, a, b), value in zip(pairs, height, strict=True):
        result[i, j] += a * b * value / (4.0 * step**2)
    lower = np.tril(result, -1)
    return lower + lower.T + np.diag(np.diag(result))
