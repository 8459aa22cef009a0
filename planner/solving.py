"""How the numerical methods work together.

By default the direct spectral method finds the motion, and collocation, started from it, solves
Pontryagin's boundary value problem and so confirms it. Where that fails, the straight line is
tried as a start, and then a continuation from an easier task.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.blas import one_blas_thread
from planner.boundary_value_problem import BoundaryValueProblem
from planner.criteria import make_criterion
from planner.outcome import Failure, failure
from planner.solution import ProgressCallback, Solution
from planner.solvers.collocation import solve_collocation
from planner.solvers.confirm import compare, confirm, spectral_outcome
from planner.solvers.continuation import solve_by_continuation
from planner.solvers.multistart import best_of_starts
from planner.solvers.nearby import curves_of_plan
from planner.solvers.search import is_usable, search, with_joints_chosen_anew
from planner.solvers.spectral import SpectralResult
from planner.solvers.squeeze import unbounded_squeeze
from planner.solvers.warm_start import spectral_solution
from planner.transport import Transport

if TYPE_CHECKING:
    from planner.result import Plan
    from planner.scenario import Scenario
    from planner.solvers.curves import Curves

__all__ = ["solve"]

_SINGULAR = 1e6


def solve(
    scenario: Scenario,
    transport: Transport,
    *,
    progress: ProgressCallback | None = None,
    start: Plan | None = None,
) -> Solution | Failure:
    """Returns the optimal motion with its costates, or how the solve ended without one.

    Args:
        scenario: What is asked; its solver section chooses the method.
        transport: The motion to be planned.
        progress: Called once per iteration or mesh.
        start: Plan of a similar task, from which the spectral method starts.

    Raises:
        InputError: The plan to start from is of other arms.
    """
    from planner.solvers.shooting import solve_shooting

    with one_blas_thread():
        if scenario.solver.method == "shooting":
            return solve_shooting(make_problem(scenario, transport), scenario, progress=progress)
        curves = None if start is None else curves_of_plan(transport, start)
        found = solve_directly(scenario, transport, progress=progress, start=curves)
        if isinstance(found, Solution) or scenario.solver.start == "line":
            return found
        if found.status == "unbounded-squeeze":
            return found
        found = solve_by_continuation(scenario, transport, found, progress=progress)
        return found if isinstance(found, Solution) else _name_singularity(transport, found)


def _name_singularity(transport: Transport, found: Failure) -> Failure:
    """Returns the failure, named after the singularity that the guessed motion passes, if any."""
    chain = transport.chain
    gamma = chain.loop(chain.dynamics.placements(transport.guess)).jacobian()
    values = np.linalg.svd(gamma, compute_uv=False)
    condition = values[:, 0] / np.maximum(values[:, -1], 1e-300)
    worst = int(np.argmax(condition))
    if condition[worst] < _SINGULAR:
        return found
    return failure(
        "singular-chain",
        f"the closure is singular (condition {condition[worst]:.1e}) near t = "
        f"{transport.share[worst] * transport.duration:.3f} s of the guessed motion",
        found.scenario,
        **found.evidence,
    )


def make_problem(
    scenario: Scenario, transport: Transport, *, speed_cost: float | None = None
) -> BoundaryValueProblem:
    """Returns the scenario's boundary value problem, perhaps with another cost on joint speeds."""
    criterion = make_criterion(
        scenario, transport.chain, transport.reference, speed_cost=speed_cost
    )
    assert criterion is not None
    return BoundaryValueProblem(transport, criterion)


def solve_directly(
    scenario: Scenario,
    transport: Transport,
    *,
    progress: ProgressCallback | None = None,
    start: Curves | None = None,
) -> Solution | Failure:
    """Returns the solution without continuation: spectral and confirmed, or from the line."""
    settings = scenario.solver
    if settings.start == "line" and settings.method != "spectral":
        return _from_line(scenario, transport, progress)
    problem = make_problem(scenario, transport)
    one = settings.starts == 1
    degree = None if start is None else len(start.motion) - 1  # what a similar motion needed
    result = search(
        scenario, problem, start=start, degree=degree, watch_joints=one, progress=progress
    )
    minima: dict[str, Any] = {}
    if not one:
        result, minima = best_of_starts(
            problem,
            result,
            settings.starts,
            settings.seed,
            lambda curves: search(scenario, problem, start=curves),
        )
    if result is not None:
        problem, result = with_joints_chosen_anew(scenario, problem, result, progress)
    found = _finish(scenario, transport, problem, result, progress)
    if minima and isinstance(found, Solution):
        found = replace(found, evidence=found.evidence | minima)
    return found


def _finish(
    scenario: Scenario,
    transport: Transport,
    problem: BoundaryValueProblem,
    result: SpectralResult | None,
    progress: ProgressCallback | None,
) -> Solution | Failure:
    """Returns the confirmed spectral result, or what can be had where there is none."""
    settings = scenario.solver
    if result is not None and not result.converged:
        squeezed = unbounded_squeeze(scenario, problem, result)
        if squeezed is not None:
            return squeezed
    redundant = transport.chain.redundant
    if redundant and scenario.criterion.speed_cost == "auto" and not _converged(result):
        return _with_speed_cost(scenario, transport, problem, result, progress)
    if settings.method == "spectral":
        return spectral_outcome(scenario, problem, result)
    usable = result is not None and is_usable(scenario, result)
    if not usable and (redundant or settings.start == "spectral"):
        return spectral_outcome(scenario, problem, result)
    if result is not None and usable:
        found = confirm(scenario, problem, result, progress)
        if isinstance(found, Solution) or redundant or settings.start == "spectral":
            return found
    found = _from_line(scenario, transport, progress)
    if isinstance(found, Solution) and result is not None:
        return compare(scenario, found, result)
    return found


def _converged(result: SpectralResult | None) -> bool:
    return result is not None and result.converged


def _with_speed_cost(
    scenario: Scenario,
    transport: Transport,
    problem: BoundaryValueProblem,
    result: SpectralResult | None,
    progress: ProgressCallback | None,
) -> Solution | Failure:
    """Returns the solution with the least cost on joint speeds that determines the motion.

    Without such a cost, light links of redundant arms may move at next to none: the optimum is
    then no smooth motion. The cost starts at a hundredth of the guess's and grows tenfold. Each
    time the way starts from the guess again: what was found without it is far from all smooth ones.
    """
    guess = make_problem(scenario, transport).straight_guess
    path = np.gradient(transport.guess, guess.share * transport.duration, axis=0)
    square = float(np.trapezoid((path**2).sum(axis=1), guess.share) * transport.duration)
    last = spectral_outcome(scenario, problem, result)
    for share in (0.01, 0.1, 1.0):
        speed_cost = float(f"{2.0 * share * guess.cost / max(square, 1e-9):.1e}")
        problem = make_problem(scenario, transport, speed_cost=speed_cost)
        result = search(scenario, problem, watch_joints=True, progress=progress)
        if result is None:
            continue
        problem, result = with_joints_chosen_anew(scenario, problem, result, progress)
        found: Solution | Failure
        if scenario.solver.method == "spectral" and result.converged:
            found = spectral_solution(problem, result)
        elif scenario.solver.method != "spectral" and is_usable(scenario, result):
            found = confirm(scenario, problem, result, progress)
        else:
            continue
        if isinstance(found, Solution):
            remark = (
                f"joint speeds cost {speed_cost:g} |v|^2/2 in this plan: without such a cost the "
                "redundant joints' motion is not determined well enough (set criterion.speed_cost "
                "to choose)"
            )
            return replace(
                found,
                remarks=(*found.remarks, remark),
                evidence=found.evidence | {"speed_cost": speed_cost},
            )
        last = found
    return last


def _from_line(
    scenario: Scenario, transport: Transport, progress: ProgressCallback | None
) -> Solution | Failure:
    """Returns the boundary value solution that starts from the straight line."""
    return solve_collocation(
        make_problem(scenario, transport),
        tolerance=scenario.solver.tolerance,
        max_nodes=scenario.solver.max_nodes,
        progress=progress,
        scenario=scenario,
    )
