"""Descent of the spectral method: Gauss-Newton and Newton steps in a trust region.

Far from the optimum the valley bends: a Gauss-Newton step leaves it where the torques' second
derivative along the step counts. One more evaluation tells that derivative, and a correction of
second order, solved for with the same matrix, follows the bend (geodesic acceleration, Transtrum
and Sethna 2012). Where Gauss-Newton errs for good, steps of the exact Hessian stand beside it.
Close to the optimum one matrix serves several steps, as in the simplified Newton method.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from planner.chain import CLOSURE_TOLERANCE
from planner.solvers.spectral_curvature import torque_curvature
from planner.solvers.spectral_derivatives import gradient, normal_equations, torque_bend
from planner.solvers.spectral_problem import ROUGHLY_CLOSED, Point, SpectralProblem
from planner.solvers.spectral_unknowns import metric
from planner.solvers.trust_region import QuadraticModel, Step

_MAX_STEPS = 80
_FIRST_RADIUS = 8.0  # root mean square change of postures and speeds, rad and rad per duration
_LEAST_RADIUS = 1e-9
_FINE = 1e-3  # of the cost: gains below it may be lost in what gap an iterate leaves
_APART = 1e-4  # m, rad, of gap per share of the cost that a step shall gain
_ROUND_OFF = 1e-12  # of the cost: what it is known to
_LONG = 0.75  # from this length on, steps are bent before they are tried,
_WORTH = 2e-2  # if they promise this share of the cost
_PROBE = 0.2  # of a step, at the end of which its bend is looked at
_MOST_BENT = 0.75  # bend of a step beside its length: beyond, the series is not trusted
_UNDERRATED = 1.4  # times the gain foreseen: from there a longer step is worth a try
_ERRS = 0.4  # of the gain foreseen: Gauss-Newton misses curvature if it errs by more,
_SLOW = 0.3  # gains fall by no more than this factor
_PATIENCE = 3  # and both hold so many times in a row
_STEADY = 0.02  # length of a step beyond which the Gauss-Newton matrix is formed anew,
_AGREES = 0.2  # or if its gain was off by more
_SADDLE = 30.0  # times the tolerance: Gauss-Newton may come so near a saddle before it leaves it


@dataclass(frozen=True, eq=False)
class _Trial:
    """One step that was tried: where it led and how well the model foresaw it."""

    point: Point
    relative: float
    ratio: float
    radius: float
    length: float
    limited: bool
    convex: bool

    @property
    def foreseen(self) -> bool:
        """Whether the model could hardly be better."""
        return self.ratio > 0.7 and self.convex and not self.limited


def _bend(
    problem: SpectralProblem, point: Point, step: Step, model: QuadraticModel
) -> tuple[np.ndarray, float]:
    """Returns the correction of second order to a Gauss-Newton step, and its relative size.

    The size is twice the correction's length beside the step's, infinite if the chain cannot be
    closed along the step.
    """
    near = problem.moved(point, _PROBE * step.move)
    if near is None:
        return np.zeros_like(step.move), np.inf
    bend = -0.5 * step.solve(torque_bend(problem, point, near, step.move, _PROBE))
    return bend, 2.0 * model.length(bend) / max(step.length, 1e-300)


def _try_steps(
    problem: SpectralProblem, point: Point, model: QuadraticModel, radius: float, *, bent: bool
) -> _Trial | None:
    """Returns the first step of a model that lowers the cost, its radius shrunk until it does.

    None if no step does, or if the model has no minimum in the multiplier.
    """
    rejected = False
    while radius > _LEAST_RADIUS:
        step = model.step(radius)
        if step is None:
            return None
        relative = step.gain / max(point.cost, 1e-300)
        limited = step.length > 0.95 * radius
        bend, size = np.zeros_like(step.move), 0.0
        if bent and relative > _WORTH and (rejected or step.length > _LONG):
            bend, size = _bend(problem, point, step, model)
            if size > _MOST_BENT:
                radius = step.length * float(np.clip(0.6 * _MOST_BENT / size, 0.1, 0.7))
                continue
        closure = float(np.clip(_APART * relative, CLOSURE_TOLERANCE, ROUGHLY_CLOSED))
        new = problem.moved(point, step.move + bend, closure)
        ratio = -1.0 if new is None else (point.cost - new.cost) / max(step.gain, 1e-300)
        if new is not None and (ratio > 1e-3 or relative < _ROUND_OFF):
            if bent and ratio > _UNDERRATED and relative > _FINE**2 and 2.0 * step.length < _LONG:
                far = 1.0 / max(2.0 - ratio, 0.25)  # where a parabola has its minimum, at most 4
                far = min(far, _LONG / step.length)
                longer = problem.moved(point, far * step.move + far**2 * bend, closure)
                new = longer if longer is not None and longer.cost < new.cost else new
            if ratio > 0.7 and limited:
                radius *= 2.0
                if size > 0.0:
                    radius = min(radius, step.length * max(_MOST_BENT / size, 1.0))
            elif ratio < 0.25:
                radius = 0.4 * min(step.length, radius)
            return _Trial(new, relative, ratio, radius, step.length, limited, step.convex)
        rejected = True
        radius = 0.3 * min(step.length, radius)
    return None


def _is_steady(trial: _Trial) -> bool:
    """Returns whether the matrix that gave a step serves for the next one too."""
    return trial.foreseen and trial.length < _STEADY and abs(trial.ratio - 1.0) < _AGREES


def descend(
    problem: SpectralProblem,
    point: Point,
    tolerance: float,
    report: Callable[[int, float, float], None],
    barred: Callable[[Point], bool],
    coarse: Callable[[Point, float], bool],
) -> tuple[Point, float, int, str]:
    """Returns the last iterate, its predicted relative decrease, the steps, and why it ended.

    That is "converged", "coarse" or what kept it from descending further.

    Once Gauss-Newton errs, steps of the exact Hessian are tried beside its own, and the better one
    is taken: far from the valley's floor, negative curvature holds over short ways only.

    Args:
        problem: The minimisation.
        point: First iterate.
        tolerance: Relative cost that may still be gained.
        report: Called after each step with degree, predicted relative decrease and cost.
        barred: Whether the way down from an iterate is barred in these independent joints.
        coarse: Whether the degree leaves more at an iterate than such a decrease.
    """
    radius, exact_radius = _FIRST_RADIUS, _FIRST_RADIUS
    exact, errors, before, relative = False, 0, np.inf, np.inf
    redundant = problem.transport.chain.redundant
    parts = metric(problem, point), problem.motion, problem.force
    steady: QuadraticModel | None = None
    for step in range(_MAX_STEPS):
        best, newton = None, False
        if steady is not None:
            model = steady.tilted(gradient(problem, point))
            best = _try_steps(problem, point, model, radius, bent=False)
        if best is None:
            slope, matrix = normal_equations(problem, point)
        while best is None:
            if exact:
                hessian = matrix + torque_curvature(problem, point)
                model = QuadraticModel(slope, hessian, *parts)
                best = _try_steps(problem, point, model, exact_radius, bent=False)
                newton = best is not None
                exact_radius = exact_radius if best is None else best.radius
            if best is None or not best.foreseen:
                model = QuadraticModel(slope, matrix, *parts)
                trial = _try_steps(problem, point, model, radius, bent=True)
                radius = radius if trial is None else trial.radius
                if trial is not None and (best is None or trial.point.cost < best.point.cost):
                    best, newton = trial, False
            if best is None and exact:
                return point, relative, step, "no descent"
            exact = exact or best is None
        steady = model if _is_steady(best) and not newton else None
        relative = best.relative
        report(problem.degree, relative, best.point.cost)
        if best.point.cost <= point.cost:
            point = best.point
        elif relative < _FINE:
            point = problem.closed(point)
        if relative < _ROUND_OFF:
            return point, relative, step + 1, "converged"
        if not best.foreseen and barred(point):
            return point, relative, step + 1, "the chain becomes singular in its independent joints"
        pace = relative / before if np.isfinite(before) and before > 0.0 else 1.0
        # what is left is a geometric series of this pace; Newton squares it
        left = relative * (min(pace, 1.0) ** 2 if newton else pace / max(1.0 - pace, 1e-3))
        settled = left < tolerance and not (redundant and relative > _SADDLE * tolerance)
        if not best.limited and best.convex and (settled or relative < 1e-3 * tolerance):
            return point, relative, step + 1, "converged"
        sound = best.foreseen and best.ratio < _UNDERRATED
        if relative < 1e-2 and sound and coarse(point, relative):
            return point, relative, step + 1, "coarse"
        wrong = abs(best.ratio - 1.0) > _ERRS and pace > _SLOW and relative < 1e-2
        errors = errors + 1 if wrong else 0
        if not exact and errors >= _PATIENCE:
            exact, exact_radius = True, min(4.0 * best.length, _FIRST_RADIUS)
        before = relative
    return point, relative, _MAX_STEPS, "too many steps"
