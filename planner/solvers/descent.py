"""Descent of the spectral method: Gauss-Newton and Newton steps in a trust region."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from planner.solvers.spectral_curvature import torque_curvature
from planner.solvers.spectral_problem import Point, SpectralProblem
from planner.solvers.trust_region import newton_step, reduce_model, trust_region_step

_MAX_STEPS = 80
_FIRST_RADIUS = 8.0  # root mean square change of postures and speeds, rad and rad per duration
_LEAST_RADIUS = 1e-9
_FINE = 1e-3  # of the cost: gains below it would be lost in what gap an iterate leaves
_ROUND_OFF = 1e-12  # of the cost: what it is known to
_SLOW = 0.05  # Gauss-Newton reduces its own prediction faster than this, or Newton takes over


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


def descend(
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
        if relative < _FINE:
            point = problem.closed(point)
    return point, relative, _MAX_STEPS, "too many steps"
