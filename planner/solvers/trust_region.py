"""One trust-region step of the spectral method, negative curvature included.

For a given motion the cost is quadratic in the multiplier, so only the motion's part of a step has
to be kept short. The multiplier is eliminated first; what remains is small enough for its
eigenvalues, which solve the trust-region problem exactly, whatever their signs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg


@dataclass(frozen=True, eq=False)
class Model:
    """The quadratic model at one iterate, its motion part diagonal.

    Attributes:
        values: Eigenvalues of the reduced Hessian in the metric of the trust region.
        slope: Gradient along its eigenvectors.
        vectors: Eigenvectors, in the unknowns of the motion.
        force_step: Step of the multiplier for a motion that stays.
        force_gain: Gain of that step.
        force_follow: Step of the multiplier per unknown of the motion.
        motion: Places of the motion's unknowns.
        force: Places of the multiplier's unknowns.
    """

    values: np.ndarray
    slope: np.ndarray
    vectors: np.ndarray
    force_step: np.ndarray
    force_gain: float
    force_follow: np.ndarray
    motion: slice | np.ndarray
    force: slice | np.ndarray


def reduce_model(
    gradient: np.ndarray,
    hessian: np.ndarray,
    metric: np.ndarray,
    motion: slice | np.ndarray,
    force: slice | np.ndarray,
) -> Model:
    """Returns the model with the multiplier eliminated.

    Args:
        gradient: (size,).
        hessian: (size, size), positive along the multiplier's unknowns.
        metric: Root M of the trust region's norm |M d| on the motion's unknowns: upper triangle.
        motion: Places of the motion's unknowns.
        force: Places of the multiplier's.
    """
    block = hessian[force][:, force]
    cross = hessian[force][:, motion]
    factor = scipy.linalg.cho_factor(block, check_finite=False)
    right = np.column_stack([gradient[force], cross])
    solved = scipy.linalg.cho_solve(factor, right, check_finite=False)
    step, follow = -solved[:, 0], -solved[:, 1:]
    reduced = hessian[motion][:, motion] + cross.T @ follow
    slope = gradient[motion] + cross.T @ step
    half = scipy.linalg.solve_triangular(metric, reduced, trans="T", check_finite=False)
    scaled = scipy.linalg.solve_triangular(metric, half.T, trans="T", check_finite=False)
    values, vectors = scipy.linalg.eigh(0.5 * (scaled + scaled.T), check_finite=False)
    in_unknowns = scipy.linalg.solve_triangular(metric, vectors, check_finite=False)
    gain = -0.5 * float(gradient[force] @ step)
    return Model(values, in_unknowns.T @ slope, in_unknowns, step, gain, follow, motion, force)


def newton_step(gradient: np.ndarray, hessian: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Returns the step to the model's minimum and its gain; None if the Hessian is not positive."""
    # LAPACK itself: SciPy's checks around it take longer than this small matrix
    _, move, status = scipy.linalg.lapack.dposv(hessian, -gradient, lower=1)
    return None if status else (move, -0.5 * float(gradient @ move))


def trust_region_step(model: Model, radius: float) -> tuple[np.ndarray, float, float]:
    """Returns the step of least model value within the radius, its gain, and its length.

    Args:
        model: The quadratic model.
        radius: Bound on the length of the motion's part.
    """
    values, slope = model.values, model.slope
    tiny = 1e-14 * max(float(np.max(np.abs(values), initial=0.0)), 1e-300)
    shift = 0.0
    if not (values[0] > tiny and _length(values, slope, 0.0) <= radius):
        low = max(0.0, -float(values[0])) + tiny
        high = low + float(np.linalg.norm(slope)) / radius + tiny
        for _ in range(60):
            shift = 0.5 * (low + high)
            length = _length(values, slope, shift)
            if abs(length - radius) < 1e-3 * radius:
                break
            low, high = (shift, high) if length > radius else (low, shift)
    along = -slope / (values + shift)
    # in the hard case no shift reaches the radius: go along the most negative curvature
    short = radius**2 - float(along @ along)
    if values[0] < -tiny and short > 1e-2 * radius**2:
        along[0] += np.copysign(np.sqrt(short), along[0] or 1.0)
    move = np.empty(len(model.slope) + len(model.force_step))
    motion = model.vectors @ along
    move[model.motion] = motion
    move[model.force] = model.force_step + model.force_follow @ motion
    gain = model.force_gain - float(slope @ along + 0.5 * (values * along) @ along)
    return move, gain, float(np.linalg.norm(along))


def _length(values: np.ndarray, slope: np.ndarray, shift: float) -> float:
    return float(np.linalg.norm(slope / (values + shift)))
