"""How the numerical methods work together.

By default the direct spectral method finds the motion, and collocation, started from it, solves
Pontryagin's boundary value problem and so confirms it. Where that fails, the straight line is
tried as a start, and then a continuation from an easier task.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from planner.boundary_value_problem import BoundaryValueProblem
from planner.criteria import make_criterion
from planner.outcome import Failure, failure
from planner.solution import ProgressCallback, Solution
from planner.solvers.collocation import one_blas_thread, solve_collocation
from planner.solvers.spectral import SpectralResult, minimise
from planner.solvers.warm_start import spectral_solution, warm_start
from planner.transport import Transport

if TYPE_CHECKING:
    from planner.scenario import Scenario
    from planner.solvers.spectral_problem import Curves

__all__ = ["solve"]

_AGREEMENT = 1e-3


def solve(
    scenario: Scenario,
    transport: Transport,
    *,
    progress: ProgressCallback | None = None,
    start: Curves | None = None,
) -> Solution | Failure:
    """Returns the optimal motion with its costates, or how the solve ended without one.

    Args:
        scenario: What is asked; its solver section chooses the method.
        transport: The motion to be planned.
        progress: Called once per iteration or mesh.
        start: Curves of a motion nearby, from which the spectral method starts.
    """
    from planner.solvers.continuation import solve_by_continuation
    from planner.solvers.shooting import solve_shooting

    with one_blas_thread():
        if scenario.solver.method == "shooting":
            return solve_shooting(make_problem(scenario, transport), scenario, progress=progress)
        found = solve_directly(scenario, transport, progress=progress, start=start)
        if isinstance(found, Solution) or scenario.solver.start == "line":
            return found
        return solve_by_continuation(scenario, transport, found, progress=progress)


def make_problem(scenario: Scenario, transport: Transport) -> BoundaryValueProblem:
    """Returns the scenario's boundary value problem."""
    criterion = make_criterion(scenario, transport.chain, transport.reference)
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
    problem = make_problem(scenario, transport)
    result = None
    if settings.start != "line":
        result = minimise(
            transport, problem.criterion, problem.coordinates, start=start, progress=progress
        )
        if settings.method == "spectral":
            return _spectral_outcome(scenario, problem, result)
        if result is not None and result.converged:
            found = _confirm(scenario, problem, result, progress)
            if isinstance(found, Solution) or settings.start == "spectral":
                return found
    fresh = make_problem(scenario, transport)
    found = solve_collocation(
        fresh,
        tolerance=settings.tolerance,
        max_nodes=settings.max_nodes,
        progress=progress,
        scenario=scenario,
    )
    if isinstance(found, Solution) and result is not None:
        return _compare(scenario, found, result)
    return found


def _spectral_outcome(
    scenario: Scenario, problem: BoundaryValueProblem, result: SpectralResult | None
) -> Solution | Failure:
    if result is None:
        return failure(
            "closure-lost",
            "no start was found along which the chain stays closed from start to goal",
            scenario,
        )
    if not result.converged:
        return failure(
            "no-descent",
            f"the spectral method ended early: {result.message}",
            scenario,
            cost=result.cost,
            degree=result.degree,
            tail=result.tail,
            decrease=result.decrease,
        )
    return spectral_solution(problem, result)


def _confirm(
    scenario: Scenario,
    problem: BoundaryValueProblem,
    result: SpectralResult,
    progress: ProgressCallback | None,
) -> Solution | Failure:
    """Returns the boundary value solution that starts from the spectral one."""
    guess, _ = warm_start(problem, result, scenario.solver.tolerance)
    if len(guess.share) > scenario.solver.max_nodes:
        return failure(
            "mesh-full",
            f"the motion needs more nodes than solver.max_nodes = {scenario.solver.max_nodes}",
            scenario,
            nodes=len(guess.share),
        )
    found = solve_collocation(
        problem,
        tolerance=scenario.solver.tolerance,
        max_nodes=scenario.solver.max_nodes,
        guess=guess,
        progress=progress,
        scenario=scenario,
    )
    if isinstance(found, Failure):
        return found
    found = replace(
        found,
        seconds=found.seconds + result.seconds,
        refinements=result.refinements + found.refinements,
    )
    return _compare(scenario, found, result)


def _compare(scenario: Scenario, found: Solution, result: SpectralResult) -> Solution | Failure:
    """Returns the solution with both methods' agreement, or a failure where they differ.

    Both are extremal; where the boundary value solution is dearer it is no minimum.
    """
    difference = (found.cost - result.cost) / max(abs(found.cost), 1e-300)
    evidence = {
        "spectral_cost": result.cost,
        "agreement": abs(difference),
        "spectral_iterations": float(result.iterations),
        "spectral_degree": float(result.degree),
    }
    if difference > _AGREEMENT:
        return failure(
            "disagreement",
            f"the boundary value solution costs {found.cost:.6g}, the direct one "
            f"{result.cost:.6g}: the former is extremal but not the minimum",
            scenario,
            **evidence,
        )
    remarks = found.remarks
    if difference < -_AGREEMENT:
        remarks = (
            *remarks,
            f"the spectral method ended at a cost of {result.cost:.6g} ({result.message}); the "
            f"boundary value solution is {found.cost:.6g}",
        )
    return replace(found, remarks=remarks, evidence=evidence)
