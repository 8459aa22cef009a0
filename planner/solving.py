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
from planner.solvers.multistart import best_of_starts
from planner.solvers.nearby import curves_of_plan, fit_curves, with_better_joints
from planner.solvers.spectral import DEGREE_STEP, LAST_DEGREE, SpectralResult, minimise
from planner.solvers.squeeze import unbounded_squeeze
from planner.solvers.warm_start import spectral_solution, warm_start
from planner.transport import Transport

if TYPE_CHECKING:
    from planner.result import Plan
    from planner.scenario import Scenario
    from planner.solvers.curves import Curves

__all__ = ["solve"]

_AGREEMENT = 1e-3
_SINGULAR = 1e6
_SWITCHES = 5
_USABLE = 20.0  # times the tail allowed: what collocation can still start from
_SHARPER = 0.03  # of the tail allowed, where costates alone give the torques


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
    from planner.solvers.continuation import solve_by_continuation
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
    result = search(scenario, problem, start=start, watch_joints=one, progress=progress)
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
        problem, result = _with_better_joints(scenario, problem, result, progress)
    found = _finish(scenario, transport, problem, result, progress)
    if minima and isinstance(found, Solution):
        found = replace(found, evidence=found.evidence | minima)
    return found


def search(scenario: Scenario, problem: BoundaryValueProblem, **how: Any) -> SpectralResult | None:
    """Returns the motion of least cost as `minimise` finds it, to the scenario's tolerances.

    Args:
        scenario: What is asked.
        problem: Its problem, whose coordinates remember the result.
        how: Further arguments of `minimise`.
    """
    settings = {"tolerance": cost_tolerance(scenario), "tail": tail_tolerance(scenario)}
    return minimise(problem.transport, problem.criterion, problem.coordinates, **(settings | how))


def _with_better_joints(
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
            start=fit_curves(better, u, at.q, point.multiplier, result.degree),
            degree=result.degree,
            watch_joints=True,
            progress=progress,
        )
        if again is None or (result.converged and not again.converged):
            problem.coordinates.remember(u, at.q, at.s)
            break
        problem, result = other, again
    return problem, result


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
    redundant = transport.chain.p > transport.chain.r
    if redundant and scenario.criterion.speed_cost == "auto" and not _converged(result):
        return _with_speed_cost(scenario, transport, problem, result, progress)
    if settings.method == "spectral":
        return _spectral_outcome(scenario, problem, result)
    usable = result is not None and _is_usable(scenario, result)
    if not usable and (redundant or settings.start == "spectral"):
        return _spectral_outcome(scenario, problem, result)
    if result is not None and usable:
        found = confirm(scenario, problem, result, progress)
        if isinstance(found, Solution) or redundant or settings.start == "spectral":
            return found
    found = _from_line(scenario, transport, progress)
    if isinstance(found, Solution) and result is not None:
        return _compare(scenario, found, result)
    return found


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


def _converged(result: SpectralResult | None) -> bool:
    return result is not None and result.converged


def _is_usable(scenario: Scenario, result: SpectralResult) -> bool:
    """Returns whether collocation, whose mesh adapts to layers, can start from a result."""
    return result.converged or (result.settled and result.tail < _USABLE * tail_tolerance(scenario))


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
    last = _spectral_outcome(scenario, problem, result)
    for share in (0.01, 0.1, 1.0):
        speed_cost = float(f"{2.0 * share * guess.cost / max(square, 1e-9):.1e}")
        problem = make_problem(scenario, transport, speed_cost=speed_cost)
        result = search(scenario, problem, watch_joints=True, progress=progress)
        if result is None:
            continue
        problem, result = _with_better_joints(scenario, problem, result, progress)
        if not result.converged:
            continue
        found: Solution | Failure
        if scenario.solver.method == "spectral":
            found = spectral_solution(problem, result)
        else:
            found = confirm(scenario, problem, result, progress)
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


def _sharpened(
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
        return result
    return replace(
        finer,
        iterations=result.iterations + finer.iterations,
        seconds=result.seconds + finer.seconds,
        refinements=result.refinements + finer.refinements,
    )


def confirm(
    scenario: Scenario,
    problem: BoundaryValueProblem,
    result: SpectralResult,
    progress: ProgressCallback | None,
) -> Solution | Failure:
    """Returns the boundary value solution that starts from the spectral one."""
    result = _sharpened(scenario, problem, result, progress)
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
    return replace(found, remarks=remarks, evidence=evidence)
