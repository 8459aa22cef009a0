"""Single shooting from many starts at once (section 4.1), to see which of them converge.

The shots fly side by side: one step of the classical Runge-Kutta method for all of them, the
variational equations along, on even steps. That is coarser than the planner's own shooting with its
tight tolerance, but much faster, and enough to tell which starts converge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.boundary_value_problem import BoundaryValueProblem

FLIGHT_STEPS = 25
MAX_STEPS = 12
CONVERGED = 1e-7  # scaled residual of the boundary conditions
_LOST = 1e6  # of a scaled state: far beyond any optimal motion
LENGTHS = (1.0, 0.25, 0.0625)  # of a Newton step, the longest that reduces the residual


@dataclass(frozen=True, eq=False)
class Shots:
    """What Newton's method made of K starts.

    Attributes:
        start: Scaled states and costates at the start, (n, K).
        converged: Which of them meet the conditions at the goal, (K,).
        lost: Which of them could not even be integrated once, (K,).
        steps: Newton steps taken, (K,).
    """

    start: np.ndarray
    converged: np.ndarray
    lost: np.ndarray
    steps: np.ndarray


def fly(
    problem: BoundaryValueProblem, start: np.ndarray, *, sensitive: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Integrates from start to goal.

    Args:
        problem: The scaled problem.
        start: Scaled states and costates, (n, K).
        sensitive: Whether to integrate the variational equations along.

    Returns:
        Those at the goal, (n, K), not a number where a shot is lost, and their derivatives along
        the start, (K, n, n).
    """
    size, count = start.shape
    goal = np.full((size, count), np.nan)
    derivative = np.full((count, size, size), np.nan)
    alive = np.arange(count)
    z, along = start, np.broadcast_to(np.eye(size), (count, size, size))
    width = 1.0 / FLIGHT_STEPS
    with np.errstate(all="ignore"):
        for step in range(FLIGHT_STEPS):
            moved, turned = z, along
            rates: list[np.ndarray] = []
            turns: list[np.ndarray] = []
            for part in (0.0, 0.5, 0.5, 1.0):
                if rates:
                    moved = z + part * width * rates[-1]
                    turned = along + part * width * turns[-1] if sensitive else along
                share = np.full(len(alive), (step + part) * width)
                rates.append(problem.right_side(share, moved))
                if sensitive:
                    turns.append(problem.jacobian(share, moved).transpose(2, 0, 1) @ turned)
            z = z + width * _mean(rates)
            if sensitive:
                along = along + width * _mean(turns)
            kept = np.isfinite(z).all(axis=0) & (np.abs(z).max(axis=0) < _LOST)
            z, along, alive = z[:, kept], along[kept], alive[kept]
            if not len(alive):
                return goal, derivative
    goal[:, alive], derivative[alive] = z, along
    return goal, derivative


def _mean(rates: list[np.ndarray]) -> np.ndarray:
    mean: np.ndarray = (rates[0] + 2.0 * rates[1] + 2.0 * rates[2] + rates[3]) / 6.0
    return mean


def newton_shots(problem: BoundaryValueProblem, start: np.ndarray) -> Shots:
    """Seeks initial costates that meet the conditions at the goal, for K starts at once.

    A step that does not reduce the residual is shortened; where that does not help, it ends.

    Args:
        problem: The scaled problem.
        start: Scaled states and costates to start from, (n, K).
    """
    z = start.copy()
    count = z.shape[1]
    goal, _ = fly(problem, z, sensitive=False)
    lost = ~np.isfinite(goal).all(axis=0)
    converged, steps = np.zeros(count, dtype=bool), np.zeros(count, dtype=int)
    residual = _residuals(problem, z, goal)
    active = np.flatnonzero(~lost)
    for _ in range(MAX_STEPS):
        converged[active] = np.max(np.abs(residual[active]), axis=1) < CONVERGED
        active = active[~converged[active]]
        if not len(active):
            break
        goal, along = fly(problem, z[:, active], sensitive=True)
        move = np.zeros_like(z)
        for place, k in enumerate(active):
            at_start, at_goal = problem.boundary_jacobian(z[:, k], goal[:, place])
            matrix = at_start + at_goal @ along[place]
            move[:, k] = -np.linalg.lstsq(matrix, residual[k], rcond=None)[0]
        active = _advance(problem, z, residual, move, active)
        steps[active] += 1
    return Shots(z, converged, lost, steps)


def _advance(
    problem: BoundaryValueProblem,
    z: np.ndarray,
    residual: np.ndarray,
    move: np.ndarray,
    active: np.ndarray,
) -> np.ndarray:
    """Moves starts z and residuals by a step that reduces these; returns which were moved."""
    trials = z[:, active, None] + move[:, active, None] * np.array(LENGTHS)
    flat = trials.reshape(len(z), -1)
    goal, _ = fly(problem, flat, sensitive=False)
    left = _residuals(problem, flat, goal).reshape(len(active), len(LENGTHS), -1)
    before = np.linalg.norm(residual[active], axis=1)[:, None]
    after = np.linalg.norm(left, axis=2)
    better = np.isfinite(after) & (after < (1.0 - 0.1 * np.array(LENGTHS)) * before)
    moved, chosen = better.any(axis=1), np.argmax(better, axis=1)
    for place in np.flatnonzero(moved):
        k = active[place]
        z[:, k], residual[k] = trials[:, place, chosen[place]], left[place, chosen[place]]
    return active[moved]


def _residuals(problem: BoundaryValueProblem, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Returns the residuals of the boundary conditions, (K, n)."""
    rows = [problem.boundary(start[:, k], goal[:, k]) for k in range(start.shape[1])]
    return np.array(rows).reshape(-1, len(start))
