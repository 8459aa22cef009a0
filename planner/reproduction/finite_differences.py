"""The paper's finite-difference method (section 4.1): Newton's method on a fixed mesh.

Central differences on every interval, second order:

    z[k+1] - z[k] = h f((s[k] + s[k+1]) / 2, (z[k] + z[k+1]) / 2),

with the boundary conditions one sparse system. The planner's own collocation is of fourth order
and refines its mesh; this module is here to count Newton steps as the paper does.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from scipy.sparse import block_diag, bmat, csc_matrix
from scipy.sparse.linalg import splu

from planner.blas import one_blas_thread
from planner.boundary_value_problem import BoundaryValueProblem

MAX_STEPS = 30
CONVERGED = 1e-8  # of the scaled variables, which are of order one
_SMALLEST_STEP = 1e-3


@dataclass(frozen=True, eq=False)
class FixedMesh:
    """What Newton's method came to on one mesh.

    Attributes:
        share: The mesh, shares of the duration, (K,).
        x: States and costates there, (K, 2 * state_size).
        steps: Newton steps.
        shortened: How many of them had to be shortened.
        converged: Whether the last step was small enough.
        seconds: Time taken [s].
    """

    share: np.ndarray
    x: np.ndarray
    steps: int
    shortened: int
    converged: bool
    seconds: float


def solve_on_mesh(problem: BoundaryValueProblem, points: int) -> FixedMesh:
    """Solves the problem on an even mesh, from the straight line with costates zero.

    Args:
        problem: The scaled problem.
        points: Points of the mesh, both ends included.
    """
    began = time.perf_counter()
    guess = problem.straight_guess
    share = np.linspace(0.0, 1.0, points)
    z = problem.scaled(np.array([np.interp(share, guess.share, row) for row in guess.x.T]).T)
    steps = shortened = 0
    converged = False
    with one_blas_thread():
        residual = _residual(problem, share, z)
        while steps < MAX_STEPS and not converged:
            solver = splu(_matrix(problem, share, z))
            step = solver.solve(residual).reshape(points, -1).T
            length = 1.0
            while True:
                moved = z - length * step
                left = _residual(problem, share, moved)
                # in the norm of the step that the residual calls for, as solve_bvp does
                if np.all(np.isfinite(left)):
                    further = float(np.linalg.norm(solver.solve(left)))
                    if further <= (1.0 - 0.4 * length) * float(np.linalg.norm(step)):
                        break
                if length <= _SMALLEST_STEP or np.max(np.abs(step)) < CONVERGED:
                    break
                length /= 2.0
            shortened += length < 1.0
            z, residual = moved, left
            steps += 1
            converged = float(np.max(np.abs(step))) < CONVERGED
            if not np.all(np.isfinite(residual)):
                break
    seconds = time.perf_counter() - began
    return FixedMesh(share, problem.physical(z), steps, shortened, converged, seconds)


def mesh_cost(problem: BoundaryValueProblem, mesh: FixedMesh) -> float:
    """Returns the cost of a solution on its mesh, by the trapezoidal rule."""
    running = problem.criterion.running_cost(problem.evaluate(mesh.share, mesh.x), mesh.x)
    return float(np.trapezoid(running, mesh.share) * problem.transport.duration)


def _residual(problem: BoundaryValueProblem, share: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Returns what intervals and ends leave, one after the other, (K * 2 * state_size,)."""
    middle, half = (share[1:] + share[:-1]) / 2.0, (z[:, 1:] + z[:, :-1]) / 2.0
    inner = z[:, 1:] - z[:, :-1] - np.diff(share) * problem.right_side(middle, half)
    ends: np.ndarray = np.concatenate([inner.T.ravel(), problem.boundary(z[:, 0], z[:, -1])])
    return ends


def _matrix(problem: BoundaryValueProblem, share: np.ndarray, z: np.ndarray) -> csc_matrix:
    """Returns the residual's derivative, block by block of the mesh's points."""
    points, size = len(share), len(z)
    middle, half = (share[1:] + share[:-1]) / 2.0, (z[:, 1:] + z[:, :-1]) / 2.0
    slope = problem.jacobian(middle, half).transpose(2, 0, 1)
    slope = slope * (np.diff(share) / 2.0)[:, None, None]
    identity = np.eye(size)
    empty = csc_matrix(((points - 1) * size, size))
    before = bmat([[block_diag(list(-identity - slope)), empty]])
    after = bmat([[empty, block_diag(list(identity - slope))]])
    start, goal = problem.boundary_jacobian(z[:, 0], z[:, -1])
    between = csc_matrix((size, (points - 2) * size))
    ends = bmat([[csc_matrix(start), between, csc_matrix(goal)]])
    return bmat([[before + after], [ends]], format="csc")
