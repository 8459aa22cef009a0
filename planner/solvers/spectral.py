"""Direct spectral method: motion and multiplier as polynomials, the criterion minimised over them.

Every joint is actuated, so torques are explicit in the motion y(t) and the multiplier lambda(t).
Both are polynomials whose ends take what the boundary prescribes; the chain is closed at every
sample, so that every iterate is feasible and the problem has no constraints left:

    min 1/2 int (d tau/dt)' W (d tau/dt) + tau' V tau + state cost  dt

over the free coefficients, a nonlinear least-squares problem on Gauss nodes. Gauss-Newton steps
with adaptive damping lead to the valley, Newton steps with second derivatives down its floor.
The degree grows until the coefficients have decayed.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from planner.criteria.base import Criterion
from planner.independent_joints import Coordinates
from planner.solution import ProgressCallback, Refinement
from planner.solvers.basis import legendre_analysis, spline_at_nodes
from planner.solvers.curves import Curves
from planner.solvers.nearby import with_better_joints
from planner.solvers.spectral_curvature import torque_curvature
from planner.solvers.spectral_problem import Point, SpectralProblem
from planner.solvers.spectral_start import carry_over, project
from planner.solvers.trust_region import newton_step, reduce_model, trust_region_step
from planner.transport import Transport

FIRST_DEGREE = 18
REDUNDANT_DEGREE = 20  # the first one where surplus joints have motions of their own
DEGREE_STEP = 6
LAST_DEGREE = 60
_MAX_STEPS = 80
_FIRST_RADIUS = 8.0  # root mean square change of postures and speeds, rad and rad per duration
_LEAST_RADIUS = 1e-9
_OPEN = 1e-4  # m, rad: left at the guess, which the first step leaves far behind
_CLOSED = 1e-12  # m, rad: a start near the optimum is known as well as what improves on it
_ROUND_OFF = 1e-12  # of the cost: what it is known to
_SLOW = 0.05  # Gauss-Newton reduces its own prediction faster than this, or Newton takes over
_NEAR = 0.03  # of the closure's size: nearer to a singularity, other independent joints are sought
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
        settled: Whether it is below the tolerance, however much of a tail is left.
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

    if degree is None:
        redundant = transport.chain.p > transport.chain.r
        degree = REDUNDANT_DEGREE if redundant else FIRST_DEGREE
    steps, before = 0, np.inf
    curves = start
    while True:
        problem = SpectralProblem(transport, criterion, coordinates, degree)
        point = _first_point(problem, curves)
        if point is None:
            return None
        point, decrease, taken, message = _descend(problem, point, tolerance, report, barred)
        steps += taken
        curves = problem.curves(point)
        coordinates.remember(problem.nodes.u, point.torques.tangent.q, point.torques.tangent.s)
        rest = resolution(problem, point)
        good = message == "converged"
        more = (LAST_DEGREE - degree) // DEGREE_STEP
        if not good or rest < tail or more <= 0:
            break
        if rest < before < np.inf and rest * (rest / before) ** more > _HOPELESS * tail:
            break
        degree, before = degree + DEGREE_STEP, rest
    if good and rest >= tail:
        message = f"degree {degree} leaves a tail of {rest:.1e}"
    return SpectralResult(
        curves=curves,
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


def _first_point(problem: SpectralProblem, curves: Curves | None) -> Point | None:
    """Returns the first iterate: nearest to given curves or the guess, or else the plainest."""
    transport, coordinates = problem.transport, problem.coordinates
    count = len(problem.nodes.u)
    ends = list(problem.ends.guessed)
    if curves is not None:
        for index, end in enumerate((transport.start, transport.goal)):
            if not end.held:
                y = curves.y(np.array([float(index)]))[0]
                ends[index] = problem.ends.values(index, ends[index].at, y) or ends[index]
    both = ends[0], ends[1]
    known = spline_at_nodes(coordinates.path.share, coordinates.path.q, count)
    if curves is not None:
        point = problem.evaluate(carry_over(problem, curves), both, known, _CLOSED)
        if point is not None:
            return point
    path = known
    if coordinates.path.q is not transport.guess:
        path = spline_at_nodes(transport.share, transport.guess, count)
    y = path[:, transport.joints.independent]
    point = problem.evaluate(project(problem, both, y), both, known, _OPEN)
    return point or problem.evaluate(np.zeros(problem.size), both, known)


def _is_barred(transport: Transport, problem: SpectralProblem, point: Point) -> bool:
    """Returns whether a motion is near a singularity that other independent joints do not have."""
    at = point.torques.tangent
    sizes = [(part * part).sum(axis=(1, 2)).max() for part in (at.inverse, at.gamma)]
    if _NEAR**2 * sizes[0] * sizes[1] < 1.0:
        return False
    return with_better_joints(transport, problem.nodes.u, at) is not None


@dataclass(frozen=True, eq=False)
class _Trial:
    """One step that was tried: where it led and how well the model foresaw it."""

    point: Point
    relative: float
    ratio: float
    radius: float
    limited: bool
    convex: bool


def _try_steps(
    problem: SpectralProblem,
    point: Point,
    gradient: np.ndarray,
    matrix: np.ndarray,
    metric: np.ndarray,
    radius: float,
) -> _Trial | None:
    """Returns the first step of a model that lowers the cost, its radius shrunk until it does.

    None if no step does, or if the model has no minimum in the multiplier.
    """
    plain = newton_step(gradient, matrix)
    model = None
    while radius > _LEAST_RADIUS:
        convex = True
        if plain is not None:
            move, gain = plain
            length = float(np.linalg.norm(metric @ move[problem.motion]))
        if plain is None or length > radius:
            plain = None
            if model is None:
                try:
                    model = reduce_model(gradient, matrix, metric, problem.motion, problem.force)
                except scipy.linalg.LinAlgError:
                    return None
            move, gain, length = trust_region_step(model, radius)
            convex = bool(model.values[0] > -1e-9 * np.max(np.abs(model.values)))
        relative = gain / max(point.cost, 1e-300)
        limited = length > 0.95 * radius
        new = problem.moved(point, move)
        ratio = -1.0 if new is None else (point.cost - new.cost) / max(gain, 1e-300)
        if new is not None and (ratio > 1e-3 or relative < _ROUND_OFF):
            if ratio > 0.7 and limited:
                radius *= 4.0
            elif ratio < 0.25:
                radius = 0.4 * min(length, radius)
            return _Trial(new, relative, ratio, radius, limited, convex)
        radius = 0.3 * min(length, radius)
    return None


def _descend(
    problem: SpectralProblem,
    point: Point,
    tolerance: float,
    report: Callable[[int, float, float], None],
    barred: Callable[[Point], bool],
) -> tuple[Point, float, int, str]:
    """Returns the last iterate, its predicted relative decrease, the steps, and why it ended.

    Once Gauss-Newton slows down, steps of the exact Hessian are tried beside its own, and the
    better one is taken: far from the valley's floor, negative curvature holds over short ways only.
    """
    radii = [_FIRST_RADIUS, _FIRST_RADIUS]
    exact, before, relative = False, np.inf, np.inf
    metric = problem.metric(point)
    for step in range(_MAX_STEPS):
        gradient, matrix = problem.normal_equations(point)
        matrices = [matrix]
        if exact:
            matrices.append(matrix + torque_curvature(problem, point))
        best, which = None, 0
        for index in reversed(range(len(matrices))):
            trial = _try_steps(problem, point, gradient, matrices[index], metric, radii[index])
            if trial is None:
                continue
            radii[index] = trial.radius
            if best is None or trial.point.cost < best.point.cost:
                best, which = trial, index
            if trial.ratio > 0.7 and trial.convex and not trial.limited:
                break  # as good as the model can be: Gauss-Newton would not do better
        if best is None:
            return point, relative, step, "no descent"
        relative = best.relative
        report(problem.degree, relative, best.point.cost)
        point = best.point if best.point.cost <= point.cost else point
        if relative < _ROUND_OFF:
            return point, relative, step + 1, "converged"
        if barred(point):
            return point, relative, step + 1, "the chain becomes singular in its independent joints"
        pace = relative / before if np.isfinite(before) and before > 0.0 else 1.0
        # what is left is a geometric series of this pace; Newton squares it
        newton = which == 1
        left = relative * (min(pace, 1.0) ** 2 if newton else pace / max(1.0 - pace, 1e-3))
        if not best.limited and best.convex and (left < tolerance or relative < 1e-3 * tolerance):
            return point, relative, step + 1, "converged"
        if not exact and ((step >= 2 and pace > _SLOW and relative < 0.3) or best.ratio < 0.25):
            exact = True
        before = relative
    return point, relative, _MAX_STEPS, "too many steps"
