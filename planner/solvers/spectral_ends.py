"""Ends of the polynomials: what the boundary prescribes there, and what it leaves free.

With the posture held, prescribed torques fix acceleration and multiplier, since for given posture
and velocity the torques determine both. With the posture free, the ends move on the set of
postures that leave the object where it shall be; its coordinates are unknowns of the minimisation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np

from planner.boundary_conditions import EndConditions
from planner.chain import CLOSURE_TOLERANCE
from planner.constrained_dynamics import Motion, Tangent, accelerate, inertial, tangent
from planner.criteria.base import Criterion
from planner.independent_joints import Coordinates
from planner.posture_equations import jacobian, residual
from planner.transport import Transport
from planner.vectors import least_norm, matvec

_Found = TypeVar("_Found")

_STEPS = 12
_NEARLY = 1e-6  # m, rad: one Newton step from there ends within round-off
_XI_STEP = 1e-5  # rad, differences along the free postures


@dataclass(frozen=True, eq=False)
class EndValues:
    """What the polynomials take at one end.

    Attributes:
        at: Freedoms at the end's posture, one sample.
        motion: y and as many of its derivatives in the share as the end fixes, (2 or 3, p).
        force: lambda where the end fixes it, (1, m), else (0, m).
    """

    at: Tangent
    motion: np.ndarray
    force: np.ndarray


class _Last(Generic[_Found]):
    """What was found for the last values of an end."""

    def __init__(self) -> None:
        self._known: tuple[EndValues, _Found] | None = None

    def of(self, values: EndValues, find: Callable[[], _Found]) -> _Found:
        """Returns what is known for these values, found anew if they are others."""
        if self._known is None or self._known[0] is not values:
            self._known = values, find()
        return self._known[1]


@dataclass(frozen=True, eq=False)
class Ends:
    """Start and goal of a motion: index 0 and 1 below.

    Attributes:
        transport: The motion asked for.
        criterion: What is minimised.
        coordinates: Map from independent joints to closed postures.
    """

    transport: Transport
    criterion: Criterion
    coordinates: Coordinates
    _known_slopes: tuple[_Last[tuple[np.ndarray, np.ndarray]], ...] = field(
        default_factory=lambda: (_Last(), _Last()), repr=False
    )
    _known_null: tuple[_Last[np.ndarray], ...] = field(
        default_factory=lambda: (_Last(), _Last()), repr=False
    )

    @cached_property
    def conditions(self) -> tuple[EndConditions, EndConditions]:
        """Boundary conditions at start and goal."""
        parts = self.transport, self.criterion, self.coordinates
        return (
            EndConditions(*parts, self.transport.start),
            EndConditions(*parts, self.transport.goal),
        )

    @cached_property
    def null_guess(self) -> tuple[np.ndarray, np.ndarray]:
        """Motions of y that the end leaves free, at the guessed postures, (p, free) each."""
        first, last = (
            np.zeros((self.transport.chain.p, 0)) if end.end.held else end.null_guess
            for end in self.conditions
        )
        return first, last

    def prescribed(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Returns how many values motion and multiplier take at start and goal."""
        motion, force = [], []
        for end in self.conditions:
            rule = end.end.torque_rule if self.criterion.torque_is_state else "free"
            motion.append(2 if rule == "free" else 3)
            force.append(0 if rule in ("free", "rest") else 1)
        return (motion[0], motion[1]), (force[0], force[1])

    @cached_property
    def guessed(self) -> tuple[EndValues, EndValues]:
        """What the polynomials take at the guessed postures of start and goal."""
        transport, chain = self.transport, self.transport.chain
        q = np.array([transport.start.posture, transport.goal.posture])
        at = tangent(chain, transport.joints, q, chain.dynamics.placements(q))
        taus = [self._prescribed_torque(index, at) for index in (0, 1)]
        motion = None
        if not all(tau is None for tau in taus):
            tau = np.zeros(q.shape)
            for index, given in enumerate(taus):
                if given is not None:
                    tau[index] = given[index]
            motion = self._accelerate(at, np.array([end.rate for end in self.conditions]), tau)
        first, last = (
            self._end_values(index, at, None if taus[index] is None else motion, index)
            for index in (0, 1)
        )
        return first, last

    def _prescribed_torque(self, index: int, at: Tangent) -> np.ndarray | None:
        """Returns the torques of an end at postures, (K, N); None where it prescribes none."""
        end = self.conditions[index]
        return end.prescribed_torque(at) if self.criterion.torque_is_state else None

    def _accelerate(self, at: Tangent, rate: np.ndarray, tau: np.ndarray) -> Motion:
        chain, joints = self.transport.chain, self.transport.joints
        v = matvec(at.s, rate)
        return accelerate(joints, at, v, inertial(chain, joints, at, v), tau)

    def _end_values(self, index: int, at: Tangent, motion: Motion | None, k: int) -> EndValues:
        """Returns the k-th sample's values."""
        motions, forces = self._stacked(index, at, motion)
        return EndValues(at.part(slice(k, k + 1)), motions[k], forces[k])

    def _stacked(
        self, index: int, at: Tangent, motion: Motion | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns what the polynomials take at K postures, (K, 2 or 3, p) and (K, 0 or 1, m)."""
        end, independent = self.conditions[index], self.transport.joints.independent
        duration, count = self.transport.duration, len(at.q)
        y = at.q[:, independent]
        parts = [y, np.broadcast_to(duration * end.rate, y.shape)]
        if motion is not None:
            parts.append(duration**2 * motion.a[:, independent])
            return np.stack(parts, axis=1), motion.multiplier[:, None]
        if self.criterion.torque_is_state and end.end.torque_rule == "rest":
            parts.append(np.zeros_like(y))
        return np.stack(parts, axis=1), np.zeros((count, 0, self.transport.chain.m))

    def taken(self, index: int, at: Tangent) -> tuple[np.ndarray, np.ndarray]:
        """Returns what the polynomials take at an end with K postures.

        Shapes (K, 2 or 3, p) and (K, 0 or 1, m), see `EndValues`.
        """
        tau, motion = self._prescribed_torque(index, at), None
        if tau is not None:
            rate = np.broadcast_to(self.conditions[index].rate, (len(at.q), at.s.shape[2]))
            motion = self._accelerate(at, rate, tau)
        return self._stacked(index, at, motion)

    def values(self, index: int, near: Tangent, y: np.ndarray) -> EndValues | None:
        """Returns what the polynomials take at the allowed posture next to y, (p,).

        None if there is none.

        Args:
            index: 0 for the start, 1 for the goal.
            near: Freedoms at a posture nearby, one sample.
            y: Independent joints.
        """
        at = self.retract(index, near, y[None])
        if not np.all(np.isfinite(at.q)):
            return None
        motions, forces = self.taken(index, at)
        return EndValues(at, motions[0], forces[0])

    def retract(self, index: int, near: Tangent, y: np.ndarray) -> Tangent:
        """Returns the freedoms at y, (K, p), moved back to where the object is as prescribed.

        Newton's method closes the chain and places the object at once, by the least joint steps.
        Postures are NaN where that fails.
        """
        chain, joints = self.transport.chain, self.transport.joints
        pose = self.conditions[index].end.pose
        q = near.shifted(joints, y)
        for _ in range(_STEPS):
            now = residual(chain, q, pose.position, pose.rotation)
            size = np.abs(now.error).max()
            if size < CLOSURE_TOLERANCE:
                return tangent(chain, joints, q, now.at)
            slopes = jacobian(chain, now, orientation=pose.rotation is not None)
            q = q - least_norm(slopes, now.error[..., None])[..., 0]
            if not np.isfinite(q).all():
                break
            if size < _NEARLY:
                return tangent(chain, joints, q, chain.dynamics.placements(q))
        return replace(near, q=np.full_like(q, np.nan))

    def _closed(self, near: Tangent, y: np.ndarray) -> Tangent:
        """Returns the freedoms at y, (K, p), closed along those nearby; NaN where that fails."""
        chain, joints = self.transport.chain, self.transport.joints
        guess = near.shifted(joints, y)
        guess[:, joints.independent] = y
        q, at, closed = chain.close(guess, joints.dependent)
        q[~closed] = np.nan
        return tangent(chain, joints, q, at)

    def slopes(self, index: int, values: EndValues) -> tuple[np.ndarray, np.ndarray]:
        """Returns derivatives of the end's values along its free postures; the last are kept.

        Shapes (values of the motion, p, free) and (values of the force, m, free).
        """
        return self._known_slopes[index].of(values, lambda: self._slopes(index, values))

    def _slopes(self, index: int, values: EndValues) -> tuple[np.ndarray, np.ndarray]:
        null = self.null(index, values)
        if len(values.force):
            return self._differences(index, values, null.T)
        # no torques are prescribed: rates and accelerations are the same at every posture
        motion = np.zeros((*values.motion.shape, null.shape[1]))
        motion[0] = null
        return motion, np.zeros((0, self.transport.chain.m, null.shape[1]))

    def _differences(
        self, index: int, values: EndValues, along: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns the derivatives of the end's values along motions of y, (free, p)."""
        y = values.at.q[:, self.transport.joints.independent]
        # off the allowed postures by the same on both sides, which the difference does not see
        at = self._closed(values.at, np.concatenate([y + _XI_STEP * along, y - _XI_STEP * along]))
        free = len(along)
        motion, force = (
            ((part[:free] - part[free:]) / (2.0 * _XI_STEP)).transpose(1, 2, 0)
            for part in self.taken(index, at)
        )
        return motion, force

    def null(self, index: int, values: EndValues) -> np.ndarray:
        """Returns motions of y that leave the object where the end prescribes it, (p, free).

        The last are kept.
        """
        return self._known_null[index].of(values, lambda: self._null(index, values))

    def _null(self, index: int, values: EndValues) -> np.ndarray:
        rows, chain = self.conditions[index].task_rows, self.transport.chain
        task = rows @ chain.object_jacobian(values.at.at)[0] @ values.at.s[0]
        guess = self.null_guess[index]
        projected = guess - least_norm(task, task @ guess)
        orthonormal: np.ndarray = np.linalg.qr(projected)[0] if guess.size else projected
        return orthonormal
