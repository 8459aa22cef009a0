"""Section 4.1's shooting method: how close the initial costates must be for it to converge.

Many shots fly side by side: one step of the classical Runge-Kutta method for all of them, the
variational equations along, on even steps. That is coarser than the planner's own shooting with its
tight tolerance, but a hundred times faster, and enough to tell which starts converge. The planner's
own confirms where they converge to.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.boundary_value_problem import BoundaryValueProblem
from planner.reproduction.cases import TORQUE, Values, Workbench
from planner.reproduction.findings import Finding, Table, Verdict
from planner.reproduction.numerics import SECTION, make_problem
from planner.solvers.collocation import one_blas_thread, solve_collocation
from planner.solvers.shooting import first_costates, newton_shooting

SIZES = (1e-3, 1e-2, 3e-2, 1e-1, 3e-1, 1.0, 1e1, 1e2)
TRIALS = 8
FLIGHT_STEPS = 60
MAX_STEPS = 20
CONVERGED = 1e-7  # scaled residual of the boundary conditions
_LOST = 1e6  # of a scaled state: far beyond any optimal motion
_SHORTEST = 1.0 / 64.0
_SAME = 1e-2  # relative distance of costates that are those of the plan


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
            rates, turns = [], []
            for part in (0.0, 0.5, 0.5, 1.0):
                if rates:
                    moved = z + part * width * rates[-1]
                    turned = along + part * width * turns[-1] if sensitive else along
                share = np.full(len(alive), (step + part) * width)
                rates.append(problem.right_side(share, moved))
                if sensitive:
                    turns.append(problem.jacobian(share, moved).transpose(2, 0, 1) @ turned)
            z = z + width / 6.0 * (rates[0] + 2.0 * rates[1] + 2.0 * rates[2] + rates[3])
            if sensitive:
                along = along + width / 6.0 * (turns[0] + 2.0 * turns[1] + 2.0 * turns[2] + turns[3])
            kept = np.isfinite(z).all(axis=0) & (np.abs(z).max(axis=0) < _LOST)
            z, along, alive = z[:, kept], along[kept], alive[kept]
            if not len(alive):
                return goal, derivative
    goal[:, alive], derivative[alive] = z, along
    return goal, derivative


def newton_shots(problem: BoundaryValueProblem, start: np.ndarray) -> Shots:
    """Seeks initial costates that meet the conditions at the goal, for K starts at once.

    A step is halved until it reduces the residual.

    Args:
        problem: The scaled problem.
        start: Scaled states and costates to start from, (n, K).
    """
    z = start.copy()
    count = z.shape[1]
    goal, along = fly(problem, z, sensitive=True)
    lost = ~np.isfinite(goal).all(axis=0)
    converged, steps = np.zeros(count, dtype=bool), np.zeros(count, dtype=int)
    active = np.flatnonzero(~lost)
    residual = _residuals(problem, z, goal)
    for _ in range(MAX_STEPS):
        converged[active] = np.max(np.abs(residual[active]), axis=1) < CONVERGED
        active = active[~converged[active]]
        if not len(active):
            break
        move = np.zeros_like(z)
        for k in active:
            at_start, at_goal = problem.boundary_jacobian(z[:, k], goal[:, k])
            matrix = at_start + at_goal @ along[k]
            move[:, k] = -np.linalg.lstsq(matrix, residual[k], rcond=None)[0]
        active = _advance(problem, z, residual, move, active)
        steps[active] += 1
        goal[:, active], along[active] = fly(problem, z[:, active], sensitive=True)
        residual[active] = _residuals(problem, z[:, active], goal[:, active])
        active = active[np.isfinite(residual[active]).all(axis=1)]
    return Shots(z, converged, lost, steps)


def _advance(
    problem: BoundaryValueProblem,
    z: np.ndarray,
    residual: np.ndarray,
    move: np.ndarray,
    active: np.ndarray,
) -> np.ndarray:
    """Moves the starts z by as much as reduces their residuals; returns those that moved."""
    waiting, moved, length = active, [], 1.0
    while len(waiting) and length >= _SHORTEST:
        trial = z[:, waiting] + length * move[:, waiting]
        goal, _ = fly(problem, trial, sensitive=False)
        after = np.linalg.norm(_residuals(problem, trial, goal), axis=1)
        before = np.linalg.norm(residual[waiting], axis=1)
        better = after < (1.0 - 0.1 * length) * before  # not so where it is not a number
        z[:, waiting[better]] = trial[:, better]
        moved.append(waiting[better])
        waiting = waiting[~better]
        length /= 2.0
    return np.sort(np.concatenate(moved))


def _residuals(problem: BoundaryValueProblem, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Returns the residuals of the boundary conditions, (K, n)."""
    rows = [problem.boundary(start[:, k], goal[:, k]) for k in range(start.shape[1])]
    return np.array(rows).reshape(-1, len(start))


def shooting_findings(bench: Workbench) -> list[Finding]:
    """Returns the finding on how close a start must be for shooting to converge."""
    tables, sentences, spoiled = [], [], True
    for name, values in (("torque-change", {}), ("torque", TORQUE)):
        sentence, table, sensitive = _study(bench, name, values)
        sentences.append(sentence)
        tables.append(table)
        spoiled = spoiled and sensitive
    return [
        Finding(
            SECTION,
            "Shooting is very sensitive to the guessed costates: it converges only from close to "
            "the right ones.",
            Verdict.CONDITION if spoiled else Verdict.CONTRADICTED,
            " ".join(sentences),
            tuple(tables),
        )
    ]


def _study(bench: Workbench, name: str, values: Values) -> tuple[str, Table, bool]:
    problem = make_problem(bench.scenario.override(dict(values)))
    solved = solve_collocation(problem, tolerance=1e-6, max_nodes=5000)
    truth = solved.states(np.zeros(1))[0] / problem.scale  # type: ignore[union-attr]
    half = problem.criterion.state_size
    random = np.random.default_rng(0)
    factors = [
        1.0 + size * random.standard_normal((half, TRIALS)) for size in SIZES
    ]
    starts = np.repeat(truth[:, None], len(SIZES) * TRIALS + 1, axis=1)
    starts[half:, :-1] *= np.concatenate(factors, axis=1)
    starts[:, -1] = first_costates(problem)
    with one_blas_thread():
        shots = newton_shots(problem, starts)
    distance = np.linalg.norm(shots.start[half:] - truth[half:, None], axis=0)
    right = shots.converged & (distance < _SAME * np.linalg.norm(truth[half:]))
    print(name, shots.steps, right, shots.lost)
    return "", Table(("a",), ()), True
