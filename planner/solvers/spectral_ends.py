"""Ends of the polynomials: what the boundary prescribes there, and what it leaves free.

With the posture held, prescribed torques fix acceleration and multiplier, since for given posture
and velocity the torques determine both. With the posture free, the ends move on the set of
postures that leave the object where it shall be; its coordinates are unknowns of the minimisation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from planner.boundary_conditions import EndConditions
from planner.constrained_dynamics import Motion, Tangent, accelerate, inertial, tangent
from planner.criteria.base import Criterion
from planner.independent_joints import Coordinates
from planner.posture_equations import pose_error
from planner.transport import Transport
from planner.vectors import matvec

_XI_STEP = 1e-5  # rad, differences along the free postures


@dataclass(frozen=True, eq=False)
class EndValues:
    """What the polynomials take at one end.

    Attributes:
        y: Independent joints, (p,).
        rate: Their rates, (p,) [rad/s].
        acceleration: Their accelerations where the end fixes them, (p,), else None.
        multiplier: lambda where the end fixes it, (m,), else None.
    """

    y: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray | None
    multiplier: np.ndarray | None

    def motion(self, duration: float) -> list[np.ndarray]:
        """Returns value, slope and second derivative per share of the duration."""
        values = [self.y, duration * self.rate]
        if self.acceleration is not None:
            values.append(duration**2 * self.acceleration)
        return values


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
        rate = np.array([end.rate for end in self.conditions])
        tau = np.array(
            [np.zeros(chain.n) if tau is None else tau[index] for index, tau in enumerate(taus)]
        )
        prescribed = any(tau is not None for tau in taus)
        motion = self._accelerate(at, rate, tau) if prescribed else None
        y = q[:, transport.joints.independent]
        first, last = (
            self._end_values(index, y, None if taus[index] is None else motion, index)
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

    def _end_values(self, index: int, y: np.ndarray, motion: Motion | None, k: int) -> EndValues:
        """Returns the k-th sample's values."""
        end = self.conditions[index]
        if motion is not None:
            a = motion.a[k, self.transport.joints.independent]
            return EndValues(y[k], end.rate, a, motion.multiplier[k])
        rest = self.criterion.torque_is_state and end.end.torque_rule == "rest"
        return EndValues(y[k], end.rate, np.zeros(len(y[k])) if rest else None, None)

    def values(self, index: int, y: np.ndarray) -> list[EndValues]:
        """Returns what the polynomials take at an end whose postures are y, (K, p)."""
        end, motion = self.conditions[index], None
        if self.criterion.torque_is_state and end.end.torque_rule not in ("free", "rest"):
            at, _ = self.coordinates.tangent(np.full(len(y), end.share), y)
            tau = self._prescribed_torque(index, at)
            assert tau is not None
            motion = self._accelerate(at, np.broadcast_to(end.rate, y.shape), tau)
        return [self._end_values(index, y, motion, k) for k in range(len(y))]

    def retract(self, index: int, y: np.ndarray) -> np.ndarray:
        """Returns postures y, (K, p), moved back to where the object is as prescribed."""
        end = self.conditions[index]
        chain = self.transport.chain
        rows = end.task_rows
        for _ in range(8):
            at, _ = self.coordinates.tangent(np.full(len(y), end.share), y)
            error = pose_error(chain, at.at, end.end.pose.position, end.end.pose.rotation)
            off = error @ rows[:, : error.shape[1]].T
            if np.max(np.abs(off)) < 1e-13:
                break
            jacobian = rows @ chain.object_jacobian(at.at) @ at.s
            y = y - matvec(np.linalg.pinv(jacobian), off)
        return y

    def slopes(self, index: int, values: EndValues) -> tuple[np.ndarray, np.ndarray]:
        """Returns derivatives of the end's values along its free postures.

        Shapes (values of the motion, p, free) and (values of the force, m, free).
        """
        null = self.null(index, values.y)
        moved = np.concatenate([values.y + _XI_STEP * null.T, values.y - _XI_STEP * null.T])
        found = self.values(index, self.retract(index, moved))
        free = null.shape[1]
        motions = np.array([value.motion(self.transport.duration) for value in found])
        motion = (motions[:free] - motions[free:]) / (2.0 * _XI_STEP)
        force = np.zeros((0, self.transport.chain.m, free))
        if values.multiplier is not None:
            forces = np.array([value.multiplier for value in found])
            force = ((forces[:free] - forces[free:]) / (2.0 * _XI_STEP)).T[None]
        return motion.transpose(1, 2, 0), force

    def null(self, index: int, y: np.ndarray) -> np.ndarray:
        """Returns motions of y that leave the object where the end prescribes it, (p, free)."""
        end = self.conditions[index]
        chain = self.transport.chain
        at, _ = self.coordinates.tangent(np.array([end.share]), y[None])
        jacobian = end.task_rows @ chain.object_jacobian(at.at)[0] @ at.s[0]
        guess = self.null_guess[index]
        projected = guess - np.linalg.pinv(jacobian) @ (jacobian @ guess)
        orthonormal: np.ndarray = np.linalg.qr(projected)[0] if guess.size else projected
        return orthonormal
