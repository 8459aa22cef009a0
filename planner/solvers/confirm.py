"""Collocation started from the spectral result: it confirms the motion, or says what is wrong."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

from planner.boundary_value_problem import BoundaryValueProblem
from planner.outcome import Failure, failure
from planner.solution import ProgressCallback, Solution
from planner.solvers.collocation import solve_collocation
from planner.solvers.search import sharpened
from planner.solvers.spectral import SpectralResult
from planner.solvers.warm_start import MotionJacobian, spectral_solution, warm_start

if TYPE_CHECKING:
    from planner.scenario import Scenario

_AGREEMENT = 1e-3
_GROWTH = 1.5  # of the adapted mesh, which hardly needs any


def confirm(
    scenario: Scenario,
    problem: BoundaryValueProblem,
    result: SpectralResult,
    progress: ProgressCallback | None,
) -> Solution | Failure:
    """Returns the boundary value solution that starts from the spectral one."""
    result = sharpened(scenario, problem, result, progress)
    began = time.perf_counter()
    guess, states = warm_start(problem, result, scenario.solver.tolerance)
    if len(guess.share) > scenario.solver.max_nodes:
        return failure(
            "mesh-full",
            f"the motion needs more nodes than solver.max_nodes = {scenario.solver.max_nodes}",
            scenario,
            nodes=len(guess.share),
        )
    # with the Jacobian along the motion first: where that will not do, the mesh grows at once
    most = scenario.solver.max_nodes
    for jacobian, nodes in (
        (MotionJacobian(problem, states), min(_GROWTH * len(guess.share), most)),
        (problem.jacobian, most),
    ):
        found = solve_collocation(
            problem,
            tolerance=scenario.solver.tolerance,
            max_nodes=int(nodes),
            guess=guess,
            jacobian=jacobian,
            progress=progress,
            scenario=scenario,
        )
        if isinstance(found, Solution):
            break
    if isinstance(found, Failure):
        return found
    found = replace(
        found,
        seconds=result.seconds + time.perf_counter() - began,
        refinements=result.refinements + found.refinements,
        second_variation=result.second_variation,
    )
    return compare(scenario, found, result)


def compare(scenario: Scenario, found: Solution, result: SpectralResult) -> Solution | Failure:
    """Returns the solution with both methods' agreement, or a failure where they differ.

    Both are extremal; where the boundary value solution is dearer it is no minimum.
    """
    # a cost of nothing beside the guess's is none: such costs need not agree in their digits
    least = 1e-9 * found.problem.straight_guess.cost
    difference = (found.cost - result.cost) / max(abs(found.cost), least, 1e-300)
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
        found = replace(found, second_variation=None)  # it would be that of another motion
    return replace(found, remarks=remarks, evidence=evidence)


def spectral_outcome(
    scenario: Scenario, problem: BoundaryValueProblem, result: SpectralResult | None
) -> Solution | Failure:
    """Returns the spectral result as the solution, or how the method ended without one."""
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
