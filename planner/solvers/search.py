"""The spectral method to a scenario's tolerances, its independent joints chosen anew on the way."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from planner.boundary_value_problem import BoundaryValueProblem
from planner.solution import ProgressCallback
from planner.solvers.nearby import fit_curves, with_better_joints
from planner.solvers.spectral import DEGREE_STEP, LAST_DEGREE, SpectralResult, minimise

if TYPE_CHECKING:
    from planner.scenario import Scenario

_SWITCHES = 5
_USABLE = 20.0  # times the tail allowed: what collocation can still start from
_SHARPER = 0.03  # of the tail allowed, where costates alone give the torques


def cost_tolerance(scenario: Scenario) -> float:
    """Returns the relative cost that the spectral method may leave on the table.

    A thousandth of the residual that is accepted: costs are flat at the optimum.
    """
    return min(1e-3 * scenario.solver.tolerance, 1e-5)


def tail_tolerance(scenario: Scenario) -> float:
    """Returns the share of the highest coefficients at which the degree suffices.

    The relative error of the cost is about its square: below 1e-6 at the default tolerance.
    """
    return min(max(7.0 * scenario.solver.tolerance, 1e-6), 2e-2)


def search(scenario: Scenario, problem: BoundaryValueProblem, **how: Any) -> SpectralResult | None:
    """Returns the motion of least cost as `minimise` finds it, to the scenario's tolerances.

    Args:
        scenario: What is asked.
        problem: Its problem, whose coordinates remember the result.
        how: Further arguments of `minimise`.
    """
    settings = {"tolerance": cost_tolerance(scenario), "tail": tail_tolerance(scenario)}
    return minimise(problem.transport, problem.criterion, problem.coordinates, **(settings | how))


def with_joints_chosen_anew(
    scenario: Scenario,
    problem: BoundaryValueProblem,
    result: SpectralResult,
    progress: ProgressCallback | None,
) -> tuple[BoundaryValueProblem, SpectralResult]:
    """Returns problem and result, with other independent joints where they help clearly.

    On its way down a motion may change so much that the joints have to be chosen again and again.
    """
    for _ in range(_SWITCHES):
        transport, u, point = problem.transport, result.problem.nodes.u, result.point
        at = point.torques.tangent
        better = with_better_joints(transport, u, at)
        if better is None:
            break
        other = BoundaryValueProblem(better, problem.criterion)
        again = search(
            scenario,
            other,
            start=fit_curves(better, u, at.q, point.torques.multiplier, result.degree),
            degree=result.degree,
            watch_joints=True,
            progress=progress,
        )
        if again is None or (result.converged and not again.converged):
            break
        problem, result = other, followed(result, again)
    return problem, result


def followed(before: SpectralResult, result: SpectralResult) -> SpectralResult:
    """Returns a result with the work that led to its start counted in."""
    return replace(
        result,
        iterations=before.iterations + result.iterations,
        seconds=before.seconds + result.seconds,
        refinements=before.refinements + result.refinements,
    )


def sharpened(
    scenario: Scenario,
    problem: BoundaryValueProblem,
    result: SpectralResult,
    progress: ProgressCallback | None,
) -> SpectralResult:
    """Returns the result as finely resolved as collocation needs it to start from.

    Costates are known less well than the motion. Where no torque is a state, they alone give the
    torques, and what they are off by moves light links far.
    """
    tail = _SHARPER * tail_tolerance(scenario)
    sharp = problem.criterion.torque_is_state or result.tail < tail
    if sharp or result.degree + DEGREE_STEP > LAST_DEGREE:
        return result
    finer = search(
        scenario,
        problem,
        tail=tail,
        start=result.curves,
        degree=result.degree + DEGREE_STEP,
        progress=progress,
    )
    if finer is None or not finer.settled or finer.tail > result.tail:
        result.problem.remember(result.point)
        return result
    return followed(result, finer)


def is_usable(scenario: Scenario, result: SpectralResult) -> bool:
    """Returns whether collocation, whose mesh adapts to layers, can start from a result."""
    return result.converged or (result.settled and result.tail < _USABLE * tail_tolerance(scenario))
