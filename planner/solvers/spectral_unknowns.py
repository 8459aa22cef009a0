"""How quantities along the motion depend on the unknowns of the spectral method.

The unknowns are coefficients of motion and multiplier, and the coordinates of free end postures,
which move what the polynomials take there.
"""

from __future__ import annotations

import numpy as np

from planner.solvers.spectral_problem import Point, SpectralProblem
from planner.vectors import transpose


def along_unknowns(
    problem: SpectralProblem,
    point: Point,
    along_motion: np.ndarray,
    along_multiplier: np.ndarray | None = None,
) -> np.ndarray:
    """Returns how quantities at the nodes depend on the unknowns, (K, R, size).

    Args:
        problem: The minimisation.
        point: The iterate.
        along_motion: Their derivatives along y and its rates, (K, orders, R, p).
        along_multiplier: Their derivatives along the multiplier, (K, R, m), if any.
    """
    count, orders, rows, p = along_motion.shape
    skip, skip_force = problem.motion_basis.conditions, problem.force_basis.conditions
    phi = problem.phi[:orders].transpose(1, 0, 2)
    places = problem.places
    shape = count, rows, problem.size
    result = np.zeros(shape) if along_multiplier is None else np.empty(shape)
    flat = along_motion.reshape(count, orders, rows * p).transpose(0, 2, 1)
    result[:, :, places[0]] = (flat @ phi[:, :, skip:]).reshape(count, rows, -1)
    if along_multiplier is not None:
        spread = result[:, :, places[1]].reshape(count, rows, problem.m, -1)  # a view
        psi = problem.psi[:, None, None, skip_force:]
        np.multiply(along_multiplier[..., None], psi, out=spread)
    for index, place in ((0, places[2]), (1, places[3])):
        if place.start == place.stop:
            continue
        motion, force = problem.ends.slopes(index, point.ends[index])
        at_end = problem.rows_of_end(index, problem.motion_basis)
        moved = np.tensordot(phi[:, :, at_end], motion, axes=1)
        result[:, :, place] = (along_motion @ moved).sum(axis=1)
        if along_multiplier is not None and len(force):
            at_end = problem.rows_of_end(index, problem.force_basis)
            moved = np.tensordot(problem.psi[:, at_end], force, axes=1)
            result[:, :, place] += along_multiplier @ moved
    return result


def along_coefficients(
    problem: SpectralProblem, along: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the derivatives along all coefficients of what changes with the nodes' values.

    Shapes (coefficients, p) for the motion's, those that the ends carry included, and
    (coefficients, m) for the multiplier's.

    Args:
        problem: The minimisation.
        along: Derivatives along y, its rates and the multiplier at each node, (K, 3 p + m).
    """
    p = problem.p
    motion: np.ndarray = sum(
        phi.T @ along[:, order * p : (order + 1) * p] for order, phi in enumerate(problem.phi)
    )
    return motion, problem.psi.T @ along[:, 3 * p :]


def gathered(problem: SpectralProblem, point: Point, along: np.ndarray) -> np.ndarray:
    """Returns the derivatives along the unknowns of what changes with the nodes' values.

    Args:
        problem: The minimisation.
        point: The iterate.
        along: As `along_coefficients` takes them.
    """
    (motion, force), places = along_coefficients(problem, along), problem.places
    result = np.empty(problem.size)
    result[places[0]] = motion[problem.motion_basis.conditions :].T.ravel()
    result[places[1]] = force[problem.force_basis.conditions :].T.ravel()
    for index, place in ((0, places[2]), (1, places[3])):
        if place.start != place.stop:
            moved, pressed = problem.ends.slopes(index, point.ends[index])
            rows = problem.rows_of_end(index, problem.motion_basis)
            result[place] = np.tensordot(motion[rows], moved, axes=2)
            if len(pressed):
                rows = problem.rows_of_end(index, problem.force_basis)
                result[place] += np.tensordot(force[rows], pressed, axes=2)
    return result


def metric(problem: SpectralProblem, point: Point) -> np.ndarray:
    """Returns the root M of a norm on the motion's unknowns, upper triangle.

    |M d| is the change of postures and of joint speeds that a step d makes, root mean square in rad
    and rad per duration.
    """
    s, nodes, basis = point.torques.tangent.s, problem.nodes, problem.motion_basis
    p, size = problem.p, problem.phi.shape[2]
    values, speeds = problem.phi[0], problem.phi[1] * problem.transport.duration
    both = values[:, :, None] * values[:, None] + speeds[:, :, None] * speeds[:, None]
    freedoms = (transpose(s) @ s * nodes.weights[:, None, None]).reshape(-1, p * p)
    # coefficients times coefficients, independent joints times independent joints
    whole = (freedoms.T @ both.reshape(-1, size * size)).reshape(p, p, size, size)
    whole = whole.transpose(0, 2, 1, 3)
    motion, skip = problem.places[0], basis.conditions
    free = slice(motion.stop, problem.motion.stop)
    square = np.empty((free.stop, free.stop))
    square[motion, motion] = whole[:, skip:, :, skip:].reshape(motion.stop, -1)
    if free.stop > free.start:
        ends = np.zeros((p, size, free.stop))
        for index, place in ((0, problem.places[2]), (1, problem.places[3])):
            if place.start != place.stop:
                moved, _ = problem.ends.slopes(index, point.ends[index])
                ends[:, problem.rows_of_end(index, basis), place] = moved.transpose(1, 0, 2)
        ends = ends[:, :, free]
        along = np.tensordot(whole, ends, axes=2)
        square[motion, free] = along[:, skip:].reshape(motion.stop, -1)
        square[free, motion] = square[motion, free].T
        square[free, free] = np.tensordot(ends, along, axes=((0, 1), (0, 1)))
    square.flat[:: len(square) + 1] += 1e-10 * square.diagonal().max()
    root: np.ndarray = np.linalg.cholesky(square).T
    return root
