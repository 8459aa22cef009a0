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
from planner.constrained_dynamics import accelerate, inertial
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

    def values(self, index: int, y: np.ndarray) -> list[EndValues]:
        """Returns what the polynomials take at an end whose postures are y, (K, p)."""
        end = self.conditions[index]
        chain, joints = self.transport.chain, self.transport.joints
        at, _ = self.coordinates.tangent(np.full(len(y), end.share), y)
        rate = np.broadcast_to(end.rate, y.shape)
        rule = end.end.torque_rule if self.criterion.torque_is_state else "free"
        if rule == "free":
            return [EndValues(row, end.rate, None, None) for row in y]
        if rule == "rest":
            return [EndValues(row, end.rate, np.zeros(self.transport.chain.p), None) for row in y]
        tau = end.prescribed_torque(at)
        assert tau is not None
        v = matvec(at.s, rate)
        motion = accelerate(joints, at, v, inertial(chain, joints, at, v), tau)
        accelerations = motion.a[:, joints.independent]
        return [
            EndValues(y[k], end.rate, accelerations[k], motion.multiplier[k]) for k in range(len(y))
        ]

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
