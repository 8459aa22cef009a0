"""Pontryagin's two-point boundary value problem (eqs. 12, 13), scaled to order one.

Time runs from 0 to 1. Joint rates are measured in rad per duration, torques by the guess's largest,
costates by the guess's cost over the unit of their state: then heavy objects and short or long
motions look alike to the solver.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.integrate import simpson
from scipy.interpolate import CubicSpline

from planner.boundary_conditions import EndConditions
from planner.chain import CLOSURE_TOLERANCE
from planner.constrained_dynamics import pseudo_inverse_torque, tangent
from planner.criteria.base import Criterion, Evaluation
from planner.independent_joints import Coordinates
from planner.transport import Transport

_DIFFERENCE = 1e-4  # of a scaled state, for boundary conditions that are not linear


@dataclass(frozen=True, eq=False)
class Guess:
    """States and costates to start from.

    Attributes:
        share: Shares of the duration, (K,).
        x: States and costates, (K, 2 * state_size).
        cost: Cost of the guess, for scaling.
    """

    share: np.ndarray
    x: np.ndarray
    cost: float


@lru_cache(maxsize=32)
def _spline_slopes(share: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Returns first and second derivative at its knots of the spline through values there."""
    knots = np.frombuffer(share)
    spline = CubicSpline(knots, np.eye(len(knots)))
    return spline(knots, 1), spline(knots, 2)


class BoundaryValueProblem:
    """The scaled problem in the form that SciPy's `solve_bvp` takes.

    Attributes:
        transport: The motion.
        criterion: Its criterion.
        coordinates: Map from independent joints to closed postures.
        start: Conditions at the start.
        goal: Conditions at the goal.
        lost: Share of the duration at which closure was lost last, None if it was not.
        closure: Bound on the gap while solving [m, rad], see `ask_for`.
        boundary_calls: How often the boundary conditions were evaluated, for counting steps.
    """

    def __init__(self, transport: Transport, criterion: Criterion) -> None:
        self.transport = transport
        self.criterion = criterion
        self.coordinates = Coordinates(
            transport.chain, transport.joints, transport.share, transport.guess
        )
        parts = transport, criterion, self.coordinates
        self.start = EndConditions(*parts, transport.start)
        self.goal = EndConditions(*parts, transport.goal)
        self.lost: float | None = None
        self.closure = CLOSURE_TOLERANCE
        self.boundary_calls = 0
        self._mesh: tuple[np.ndarray, np.ndarray] | None = None
        self._known: list[tuple[np.ndarray, np.ndarray, float, Evaluation]] = []

    # ---- start and scale -----------------------------------------------------------------------

    @cached_property
    def straight_guess(self) -> Guess:
        """The guessed path with the least torques that follow it, and costates zero."""
        transport, criterion = self.transport, self.criterion
        share, q, duration = transport.share, transport.guess, transport.duration
        first, second = _spline_slopes(share.tobytes())
        v, a = first @ q / duration, second @ q / duration**2
        chain = transport.chain
        at = tangent(chain, transport.joints, q, chain.dynamics.placements(q))
        load = chain.dynamics.inverse_dynamics(q, v, a)
        tau = pseudo_inverse_torque(at.s, load)
        x = np.zeros((len(share), 2 * criterion.state_size))
        x[:, criterion.at_y] = q[:, transport.joints.independent]
        x[:, criterion.at_rate] = v[:, transport.joints.independent]
        cost = 0.5 * (tau * tau) @ criterion.torque_weights
        if criterion.torque_is_state:
            x[:, criterion.at_tau] = tau
            rate = first @ tau / duration
            cost = cost + 0.5 * (rate * rate) @ criterion.rate_weights
        if criterion.state_cost is not None:
            cost = cost + criterion.state_cost.value(q, v)
        total = float(np.trapezoid(cost, share) * duration)
        return Guess(share, x, total)

    @cached_property
    def scale(self) -> np.ndarray:
        """Units of states and costates, (2 * state_size,)."""
        guess = self.straight_guess
        criterion, transport = self.criterion, self.transport
        duration = transport.duration
        units = np.ones(criterion.state_size)
        units[criterion.at_rate] = 1.0 / duration
        cost = guess.cost
        if criterion.torque_is_state:
            tau = guess.x[:, criterion.at_tau]
            ends = [self._end_torque(end, tau[place]) for end, place in self._ends()]
            change = np.concatenate([tau, *ends]) - np.mean(tau, axis=0)
            torque = max(float(np.max(np.abs(change), initial=0.0)), 1e-9)
            units[criterion.at_tau] = torque
            squares = float(np.max(criterion.rate_weights)) / duration
            squares += float(np.max(criterion.torque_weights)) * duration
            cost = max(cost, squares * torque**2)
        cost = max(cost, 1e-12)
        return np.concatenate([units, cost / units])

    def _ends(self) -> tuple[tuple[EndConditions, int], tuple[EndConditions, int]]:
        return (self.start, 0), (self.goal, -1)

    def _end_torque(self, end: EndConditions, torque: np.ndarray) -> np.ndarray:
        """Returns the end's prescribed torques at its guessed posture, else `torque`, (1, N)."""
        prescribed = end.prescribed_torque(end.at_posture)
        return torque[None] if prescribed is None else np.asarray(prescribed)

    def ask_for(self, tolerance: float) -> None:
        """Closes the chain while solving as finely as a relative residual needs it.

        What gap is left counts a thousandfold in the residual of light arms.
        """
        self.closure = min(1e-9, max(1e-5 * tolerance, CLOSURE_TOLERANCE))

    # ---- the problem as solve_bvp takes it: samples last -----------------------------------------

    def physical(self, z: np.ndarray) -> np.ndarray:
        """Returns states and costates in their units, (K, .), from scaled ones, (., K)."""
        return np.ascontiguousarray(z.T) * self.scale

    def scaled(self, x: np.ndarray) -> np.ndarray:
        """Returns scaled states and costates, (., K), from those in their units, (K, .)."""
        return np.ascontiguousarray((x / self.scale).T)

    def evaluate(
        self, share: np.ndarray, x: np.ndarray, closure: float = CLOSURE_TOLERANCE
    ) -> Evaluation:
        """Returns the evaluation at states x; the last few are kept.

        Args:
            share: Shares of the duration, (K,).
            x: States and costates, (K, 2 * state_size).
            closure: Bound on the gap between the hands [m, rad].
        """
        evaluation = self._kept(share, x, closure)
        if evaluation is None:
            share, x = share.copy(), x.copy()  # what is kept must not change with the caller's
            with np.errstate(all="ignore"):
                evaluation = self.criterion.evaluate(self.coordinates.within(closure), share, x)
            self._known = [(share, x, closure, evaluation), *self._known[:3]]
        closed = evaluation.closed
        self.lost = None if closed.all() else float(share[np.argmin(closed)])
        return evaluation

    def _kept(self, share: np.ndarray, x: np.ndarray, closure: float) -> Evaluation | None:
        for known_share, known_x, gap, evaluation in self._known:
            if gap <= closure and np.array_equal(known_x, x) and np.array_equal(known_share, share):
                return evaluation
        return None

    def right_side(self, share: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Returns dz/ds, (., K); NaN where the chain cannot be closed."""
        x = self.physical(z)
        at = self.evaluate(share, x, self.closure)
        if share[0] == 0.0 and share[-1] == 1.0 and len(share) > 1:
            self._mesh = share, x
        with np.errstate(all="ignore"):
            slope = self.criterion.right_side(at, x, self.transport.joints.independent)
        slope[~at.closed] = np.nan
        return np.ascontiguousarray((slope * (self.transport.duration / self.scale)).T)

    def jacobian(self, share: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Returns d(dz/ds)/dz, (., ., K)."""
        x = self.physical(z)
        at = self.evaluate(share, x, self.closure)
        with np.errstate(all="ignore"):
            slope = self.criterion.jacobian(self.coordinates, at, x, 1.0 / self.transport.duration)
        slope *= self.transport.duration * self.scale[None, None, :] / self.scale[None, :, None]
        return np.ascontiguousarray(slope.transpose(1, 2, 0))

    def boundary(self, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """Returns the residual of all boundary conditions, (2 * state_size,)."""
        self.boundary_calls += 1
        parts = [
            self._scaled_residual(end, z[None])[0]
            for end, z in ((self.start, start), (self.goal, goal))
        ]
        return np.concatenate(parts)

    def _scaled_residual(self, end: EndConditions, z: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            residual = end.residual(z * self.scale)
        return residual * self._row_scale(end)

    def _row_scale(self, end: EndConditions) -> np.ndarray:
        """Returns factors that bring the rows of a residual to order one, (state_size,)."""
        criterion = self.criterion
        scale = np.ones(criterion.state_size)
        cost = self.scale[criterion.state_size]
        if not end.end.held:
            free = criterion.p - len(end.task_rows)
            scale[criterion.p - free : criterion.p] = 1.0 / cost
        scale[criterion.at_rate] = self.transport.duration
        if criterion.torque_is_state:
            torque = self.scale[criterion.at_tau][0]
            rows = criterion.at_tau
            rule = end.end.torque_rule
            if rule == "free":
                scale[rows] = criterion.rate_weights * torque / cost
            elif rule == "rest":
                split = rows.start + criterion.p
                scale[rows.start : split] = self.transport.duration**2
                scale[split : rows.stop] = torque / cost
            else:
                scale[rows] = 1.0 / torque
        return scale

    def boundary_jacobian(
        self, start: np.ndarray, goal: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns the derivatives of all conditions along start and goal, (2 n, 2 n) each."""
        size = self.criterion.state_size
        result = np.zeros((2, 2 * size, 2 * size))
        ends = ((self.start, start), (self.goal, goal))
        for place, (end, z) in enumerate(ends):
            rows = slice(place * size, (place + 1) * size)
            step = 1.0 if end.linear else _DIFFERENCE
            moved = np.concatenate([z + step * np.eye(2 * size), z - step * np.eye(2 * size)])
            sides = self._scaled_residual(end, moved)
            result[place, rows] = (sides[: 2 * size] - sides[2 * size :]).T / (2.0 * step)
        return result[0], result[1]

    def cost_so_far(self) -> float:
        """Returns the cost on the last mesh that Newton's method used, by Simpson's rule."""
        if self._mesh is None:
            return self.straight_guess.cost
        share, x = self._mesh
        with np.errstate(all="ignore"):
            running = self.criterion.running_cost(self.evaluate(share, x, self.closure), x)
        return float(simpson(running, x=share) * self.transport.duration)
