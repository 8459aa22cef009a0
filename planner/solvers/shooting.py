"""Single shooting (section 4.1): Newton's method on the unknown initial states and costates.

The equations are integrated from start to goal by an explicit Runge-Kutta method of order 8; the
sensitivities come from the variational equations, integrated along. Errors in the costates grow
along the way, so that Newton's method converges only from close by: that is the method's nature
and the reason why collocation is the default.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import solve_ivp

from planner.boundary_value_problem import BoundaryValueProblem
from planner.outcome import Failure, failure
from planner.solution import ProgressCallback, Refinement, Solution, integrate_cost
from planner.solvers.spectral import minimise
from planner.solvers.warm_start import spectral_states

if TYPE_CHECKING:
    from planner.scenario import Scenario

RTOL, ATOL = 1e-9, 1e-11
_MAX_STEPS = 30
_BLOW_UP = 1e6  # of a scaled state: far beyond any optimal motion
_MAX_EVALUATIONS = 3000


@dataclass(frozen=True, eq=False)
class Shot:
    """One integration from start to goal.

    Attributes:
        goal: Scaled states and costates at the goal, (n,).
        sensitivity: Their derivative along those at the start, (n, n); empty if not asked for.
        trajectory: What `solve_ivp` returned.
    """

    goal: np.ndarray
    sensitivity: np.ndarray
    trajectory: object


def shoot(problem: BoundaryValueProblem, start: np.ndarray, *, sensitive: bool) -> Shot | None:
    """Returns where the scaled states and costates `start`, (n,), lead; None if they blow up.

    Args:
        problem: The boundary value problem.
        start: Scaled states and costates at the start.
        sensitive: Whether to integrate the variational equations along.
    """
    size = len(start)
    spent = 0

    def slope(share: float, state: np.ndarray) -> np.ndarray:
        nonlocal spent
        spent += 1
        at, z = np.array([share]), state[:size, None]
        rate = problem.right_side(at, z)[:, 0]
        if not sensitive:
            return rate
        jacobian = problem.jacobian(at, z)[:, :, 0]
        return np.concatenate([rate, (jacobian @ state[size:].reshape(size, size)).ravel()])

    def blown_up(share: float, state: np.ndarray) -> float:
        if spent > _MAX_EVALUATIONS:
            return 0.0
        return _BLOW_UP - float(np.max(np.abs(state[:size])))

    blown_up.terminal = True  # type: ignore[attr-defined]
    first = np.concatenate([start, np.eye(size).ravel()]) if sensitive else start
    with np.errstate(all="ignore"):
        try:
            found = solve_ivp(
                slope,
                (0.0, 1.0),
                first,
                method="DOP853",
                rtol=RTOL,
                atol=ATOL,
                events=blown_up,
                dense_output=not sensitive,
            )
        except (ValueError, np.linalg.LinAlgError):
            return None
    if found.status != 0 or not np.all(np.isfinite(found.y[:, -1])):
        return None
    goal = found.y[:size, -1]
    sensitivity = found.y[size:, -1].reshape(size, size) if sensitive else np.empty((0, 0))
    return Shot(goal, sensitivity, found)


@dataclass(frozen=True, eq=False)
class ShootingResult:
    """Where Newton's method ended.

    Attributes:
        start: Scaled states and costates at the start, (n,).
        residual: Largest scaled residual of all boundary conditions.
        iterations: Newton iterations.
        message: "converged", or why it ended.
    """

    start: np.ndarray
    residual: float
    iterations: int
    message: str


def newton_shooting(
    problem: BoundaryValueProblem,
    start: np.ndarray,
    *,
    tolerance: float = 1e-7,
    progress: ProgressCallback | None = None,
) -> ShootingResult:
    """Returns the initial states and costates that meet all boundary conditions, or the attempt.

    Args:
        problem: The boundary value problem.
        start: Scaled states and costates to start from, (n,).
        tolerance: Bound on the scaled residual of the boundary conditions.
        progress: Called once per iteration.
    """
    began = time.perf_counter()
    # without sensitivities first: a start that blows up is then found out soon
    alone = shoot(problem, start, sensitive=False)
    shot = None if alone is None else shoot(problem, start, sensitive=True)
    if shot is None:
        return ShootingResult(start, np.inf, 0, "the first integration blows up")
    residual = problem.boundary(start, shot.goal)
    for step in range(_MAX_STEPS):
        size = float(np.max(np.abs(residual)))
        if progress is not None:
            nodes = int(shot.trajectory.t.size)  # type: ignore[attr-defined]
            seconds = time.perf_counter() - began
            progress(Refinement(nodes, size, np.nan, seconds, "shooting"))
        if size < tolerance:
            return ShootingResult(start, size, step, "converged")
        at_start, at_goal = problem.boundary_jacobian(start, shot.goal)
        try:
            move = -np.linalg.solve(at_start + at_goal @ shot.sensitivity, residual)
        except np.linalg.LinAlgError:
            return ShootingResult(start, size, step, "the sensitivity matrix is singular")
        norm, share = float(np.linalg.norm(residual)), 1.0
        while True:
            trial = shoot(problem, start + share * move, sensitive=False)
            if trial is not None:
                new = problem.boundary(start + share * move, trial.goal)
                if np.linalg.norm(new) < (1.0 - 0.1 * share) * norm:
                    break
            share *= 0.5
            if share < 1e-3:
                return ShootingResult(start, size, step, "no step reduces the residual")
        start = start + share * move
        shot = shoot(problem, start, sensitive=True)
        if shot is None:
            return ShootingResult(start, size, step, "the variational equations blow up")
        residual = problem.boundary(start, shot.goal)
    return ShootingResult(start, float(np.max(np.abs(residual))), _MAX_STEPS, "too many iterations")


def first_costates(problem: BoundaryValueProblem) -> np.ndarray:
    """Returns the start of the straight line with its torques and no costates, scaled, (n,)."""
    return problem.straight_guess.x[0] / problem.scale


def solve_shooting(
    problem: BoundaryValueProblem,
    scenario: Scenario,
    *,
    progress: ProgressCallback | None = None,
) -> Solution | Failure:
    """Returns the solution by single shooting, or how it failed.

    It starts from the spectral costates; `solver.start = "line"` starts from none, as one would
    without knowing the solution.
    """
    began = time.perf_counter()
    start = first_costates(problem)
    remarks = ("started from costates zero",)
    if scenario.solver.start != "line":
        result = minimise(problem.transport, problem.criterion, problem.coordinates)
        if result is not None and result.converged:
            start = spectral_states(problem, result)(np.zeros(1))[0] / problem.scale
            remarks = ("started from the spectral method's costates",)
    found = newton_shooting(problem, start, progress=progress)
    final = shoot(problem, found.start, sensitive=False)
    if found.message != "converged" or final is None:
        return failure(
            "no-descent",
            f"shooting did not converge: {found.message}, after {found.iterations} iterations and "
            f"with a residual of {found.residual:.1e} in the boundary conditions",
            scenario,
            iterations=found.iterations,
            residual=found.residual,
            start=remarks[0],
        )
    trajectory = final.trajectory

    def states(share: np.ndarray) -> np.ndarray:
        return problem.physical(trajectory.sol(share))  # type: ignore[attr-defined]

    mesh = np.asarray(trajectory.t)  # type: ignore[attr-defined]
    return Solution(
        problem=problem,
        method="shooting",
        mesh=mesh,
        states=states,
        cost=integrate_cost(problem, mesh, states),
        known_residual=found.residual,
        iterations=found.iterations,
        refinements=(),
        seconds=time.perf_counter() - began,
        remarks=remarks,
    )
