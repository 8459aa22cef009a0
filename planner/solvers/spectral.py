"""Direct spectral method: motion and multiplier as polynomials, the criterion minimised over them.

Every joint is actuated, so torques are explicit in the motion y(t) and the multiplier lambda(t).
Both are polynomials whose ends take what the boundary prescribes; the chain is closed at every
sample, so that every iterate is feasible and the problem has no constraints left:

    min 1/2 int (d tau/dt)' W (d tau/dt) + tau' V tau + state cost  dt

over the free coefficients, a nonlinear least-squares problem on Gauss nodes. Gauss-Newton steps
that follow the valley's bend lead down, and Newton steps with second derivatives where these err.
The degree grows until the coefficients have decayed, each time as soon as a finer one gains more
than going on.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from planner.criteria.base import Criterion
from planner.independent_joints import Coordinates
from planner.solution import ProgressCallback, Refinement
from planner.solvers.basis import legendre_analysis
from planner.solvers.curves import Curves
from planner.solvers.descent import descend
from planner.solvers.nearby import with_better_joints
from planner.solvers.second_variation import least_second_variation
from planner.solvers.spectral_problem import Point, SpectralProblem
from planner.solvers.spectral_start import first_point
from planner.transport import Transport

FIRST_DEGREE = 18
REDUNDANT_DEGREE = 20  # the first one where surplus joints have motions of their own
DEGREE_STEP = 6
LAST_DEGREE = 60
_NEAR = 0.03  # of the closure's size: nearer to a singularity, other independent joints are sought
_ENOUGH = 10.0  # times a tail squared, which its cost is off by: what smaller steps gain is lost
_HOPELESS = 20.0  # times the tail allowed: where the last degree would still leave more, it ends


@dataclass(frozen=True, eq=False)
class SpectralResult:
    """Where the minimisation ended.

    Attributes:
        curves: Motion and multiplier.
        cost: The criterion.
        degree: Degree of the polynomials.
        tail: Share of the highest coefficients in the size of the motion's third derivative.
        iterations: Steps taken at all degrees.
        decrease: Predicted relative decrease of the next step.
        converged: Whether that is below the tolerance and the tail has decayed.
        settled: Whether it is below the tolerance, however much of a tail is left, or below what
            the degree leaves.
        refinements: Progress.
        seconds: Time taken [s].
        message: Why it ended.
        problem: The problem at the last degree.
        point: The last iterate.
    """

    curves: Curves
    cost: float
    degree: int
    tail: float
    iterations: int
    decrease: float
    converged: bool
    settled: bool
    refinements: tuple[Refinement, ...]
    seconds: float
    message: str
    problem: SpectralProblem
    point: Point

    def second_variation(self) -> float:
        """Returns the cost's least second variation, see `least_second_variation`."""
        return least_second_variation(self.problem, self.point)[0]


def minimise(
    transport: Transport,
    criterion: Criterion,
    coordinates: Coordinates,
    *,
    tolerance: float = 1e-9,
    tail: float = 7e-4,
    start: Curves | None = None,
    degree: int | None = None,
    watch_joints: bool = False,
    progress: ProgressCallback | None = None,
) -> SpectralResult | None:
    """Returns the polynomials of least cost, or None if no start could be closed.

    Args:
        transport: The motion asked for.
        criterion: What is minimised.
        coordinates: Map from independent joints to closed postures; it remembers the result.
        tolerance: Relative cost that may still be gained when the minimisation ends.
        tail: Share of the highest coefficients below which the degree suffices.
        start: Curves to start from, e.g. of a plan nearby.
        degree: First degree, where not the usual one.
        watch_joints: Whether to end early where other independent joints suit the motion clearly
            better: the chain becomes singular in those it has, which bars the way down.
        progress: Called once per iteration.
    """
    began = time.perf_counter()
    seen: list[Refinement] = []

    def report(degree: int, decrease: float, cost: float) -> None:
        step = Refinement(degree, decrease, cost, time.perf_counter() - began, "spectral")
        seen.append(step)
        if progress is not None:
            progress(step)

    def barred(point: Point) -> bool:
        return watch_joints and _is_barred(transport, problem, point)

    def coarse(point: Point, decrease: float) -> bool:
        """Whether more could be gained by a higher degree than by going on with this one."""
        rest = resolution(problem, point)
        return rest > tail and decrease < _ENOUGH * rest**2 and problem.degree < last

    if degree is None:
        degree = REDUNDANT_DEGREE if transport.chain.redundant else FIRST_DEGREE
    last = degree + (LAST_DEGREE - degree) // DEGREE_STEP * DEGREE_STEP
    steps, before = 0, np.inf
    curves, ends, known_ends = start, None, None
    while True:
        finer = SpectralProblem(transport, criterion, coordinates, degree, ends)
        start_point = first_point(finer, curves, known_ends)
        if start_point is None:
            if before == np.inf:
                return None
            degree -= DEGREE_STEP  # what was found at that one stands
            break
        problem, point = finer, start_point
        point, decrease, taken, message = descend(problem, point, tolerance, report, barred, coarse)
        steps += taken
        curves, ends, known_ends = problem.curves(point), problem.ends, point.ends
        problem.remember(point)
        rest = resolution(problem, point)
        good = message in ("converged", "coarse")
        more = (last - degree) // DEGREE_STEP
        if not good or rest < tail or more <= 0:
            break
        if rest < before < np.inf and rest * (rest / before) ** more > _HOPELESS * tail:
            break
        degree, before = degree + DEGREE_STEP, rest
    if good and rest >= tail:
        message = f"degree {degree} leaves a tail of {rest:.1e}"
    return SpectralResult(
        curves=problem.curves(point),
        cost=point.cost,
        degree=degree,
        tail=rest,
        iterations=steps,
        decrease=decrease,
        converged=good and rest < tail,
        settled=good,
        refinements=tuple(seen),
        seconds=time.perf_counter() - began,
        message=message,
        problem=problem,
        point=point,
    )


def resolution(problem: SpectralProblem, point: Point) -> float:
    """Returns the share of the four highest Legendre coefficients in the torque's slope.

    For torque criteria that is its own quantity; for both the size is the root of the sum of
    squares over all joints, weighted as in the criterion.
    """
    criterion = problem.criterion
    if criterion.torque_is_state:
        values = point.slope * np.sqrt(criterion.rate_weights)
    else:
        values = point.torques.tau * np.sqrt(criterion.torque_weights)
    last = problem.degree - 2
    coefficients = legendre_analysis(len(problem.nodes.u), last) @ values
    energy = (coefficients**2).sum(axis=1) / (2.0 * np.arange(last + 1) + 1.0)
    total = float(energy.sum())
    return float(np.sqrt(energy[-4:].sum() / total)) if total > 0.0 else 0.0


def _is_barred(transport: Transport, problem: SpectralProblem, point: Point) -> bool:
    """Returns whether a motion is near a singularity that other independent joints do not have."""
    at = point.torques.tangent
    sizes = [(part * part).sum(axis=(1, 2)).max() for part in (at.inverse, at.gamma)]
    if _NEAR**2 * sizes[0] * sizes[1] < 1.0:
        return False
    return with_better_joints(transport, problem.nodes.u, at) is not None
