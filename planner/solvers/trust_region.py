"""One trust-region step of the spectral method, negative curvature included.

For a given motion the cost is quadratic in the multiplier, so only the motion's part of a step has
to be kept short. The multiplier is eliminated first; what remains is small enough for its
eigenvalues, which solve the trust-region problem exactly, whatever their signs.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
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
        force_factor: Cholesky factor of the multiplier's block.
    """

    values: np.ndarray
    slope: np.ndarray
    vectors: np.ndarray
    force_step: np.ndarray
    force_gain: float
    force_follow: np.ndarray
    motion: slice | np.ndarray
    force: slice | np.ndarray
    force_factor: tuple[np.ndarray, bool]

    def solve(self, right: np.ndarray, shift: float) -> np.ndarray:
        """Solves with the Hessian, shifted by a multiple of the metric along the motion."""
        force = scipy.linalg.cho_solve(self.force_factor, right[self.force], check_finite=False)
        reduced = right[self.motion] + self.force_follow.T @ right[self.force]
        motion = self.vectors @ ((self.vectors.T @ reduced) / (self.values + shift))
        result = np.empty_like(right)
        result[self.motion] = motion
        result[self.force] = force + self.force_follow @ motion
        return result


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
    return Model(
        values, in_unknowns.T @ slope, in_unknowns, step, gain, follow, motion, force, factor
    )


@dataclass(frozen=True, eq=False)
class Step:
    """A step to the least value of a model.

    Attributes:
        move: The step in all unknowns.
        gain: What the model expects of it.
        length: Length of its motion's part in the trust region's metric.
        convex: Whether the model is.
        solve: Solves the system that gave the step for another right-hand side.
    """

    move: np.ndarray
    gain: float
    length: float
    convex: bool
    solve: Callable[[np.ndarray], np.ndarray]


class QuadraticModel:
    """The cost's quadratic model at one iterate, with its best step within any radius."""

    def __init__(
        self,
        gradient: np.ndarray,
        hessian: np.ndarray,
        metric: np.ndarray,
        motion: slice | np.ndarray,
        force: slice | np.ndarray,
    ) -> None:
        """Takes what `reduce_model` takes; the reduction is made once a radius asks for it."""
        self._parts = gradient, hessian, metric, motion, force
        self._factor: np.ndarray | None = None
        self._newton = self._newton_step()
        self._reduced: Model | None = None

    def tilted(self, gradient: np.ndarray) -> QuadraticModel:
        """Returns the model with another gradient; the Hessian's factor serves again."""
        result = copy.copy(self)
        result._parts = gradient, *self._parts[1:]
        result._newton, result._reduced = result._newton_step(), None
        return result

    def length(self, move: np.ndarray) -> float:
        """Returns the length of a step's motion in the trust region's metric."""
        _, _, metric, motion, _ = self._parts
        return float(np.linalg.norm(metric @ move[motion]))

    def step(self, radius: float) -> Step | None:
        """Returns the step of least model value within a radius.

        None if the model has no minimum in the multiplier.
        """
        if self._newton is not None and self._newton.length <= radius:
            return self._newton
        if self._reduced is None:
            try:
                self._reduced = reduce_model(*self._parts)
            except scipy.linalg.LinAlgError:
                return None
        return trust_region_step(self._reduced, radius)

    def _newton_step(self) -> Step | None:
        """Returns the step to the model's minimum; None if the Hessian is not positive."""
        gradient, hessian = self._parts[:2]
        # LAPACK itself: SciPy's checks around it take longer than this small matrix
        if self._factor is None:
            # symmetric: transposed, it lies in memory as LAPACK wants it
            factor, status = scipy.linalg.lapack.dpotrf(hessian.T, lower=1, clean=0)
            if status:
                return None
            self._factor = factor
        factor = self._factor

        def solve(right: np.ndarray) -> np.ndarray:
            result: np.ndarray = scipy.linalg.lapack.dpotrs(factor, right, lower=1)[0]
            return result

        move = solve(-gradient)
        return Step(move, -0.5 * float(gradient @ move), self.length(move), True, solve)


def trust_region_step(model: Model, radius: float) -> Step:
    """Returns the step of least model value within the radius.

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
    convex = bool(values[0] > -1e-9 * np.max(np.abs(values)))

    def solve(right: np.ndarray) -> np.ndarray:
        return model.solve(right, shift)

    return Step(move, gain, float(np.linalg.norm(along)), convex, solve)


def _length(values: np.ndarray, slope: np.ndarray, shift: float) -> float:
    return float(np.linalg.norm(slope / (values + shift)))
