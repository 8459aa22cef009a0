"""Boundary conditions at either end (eqs. 10, 13), transversality included.

At each end as many conditions hold as there are states. What is not prescribed leaves its costates
to transversality: on the set of states that an end allows, the costates have no component.

    posture held          y = y0                        posture free  x(y) = x0,  N'(n1 - k) = 0
    velocity              dy/dt = given
    torque given          tau = tau0                    torque free   n3 = 0
    static, preload       tau = tau_e(y)                and  k = -(d tau_e/dy)' n3
    rest                  a = 0,  Gamma n3 = 0      and  k = (d a/dy)' kappa,  n3 = B' kappa

N spans the motions that leave the prescribed object coordinates x alone. `rest` leaves the
internal wrench free, along which tau = tau0 - Gamma' lambda: hence Gamma n3 = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg

from planner.constrained_dynamics import Tangent, linearize, tangent
from planner.criteria.base import Criterion
from planner.holding import preload_torque, static_torque
from planner.independent_joints import Coordinates
from planner.posture_equations import pose_error
from planner.transport import End, Transport
from planner.vectors import matvec, transpose

_TORQUE_STEP = 1e-4  # rad, central difference of holding torques


@dataclass(frozen=True, eq=False)
class EndConditions:
    """Conditions at one end, as a residual of the states and costates there.

    Attributes:
        transport: The motion.
        criterion: Its criterion.
        coordinates: Map from independent joints to closed postures.
        end: Start or goal.
    """

    transport: Transport
    criterion: Criterion
    coordinates: Coordinates
    end: End

    @property
    def share(self) -> float:
        """The end's share of the duration."""
        return 0.0 if self.end.name == "start" else 1.0

    @property
    def linear(self) -> bool:
        """Whether the conditions are linear in states and costates."""
        rule = self.end.torque_rule
        return self.end.held and (not self.criterion.torque_is_state or rule != "rest")

    @cached_property
    def at_posture(self) -> Tangent:
        """Freedoms at the end's posture."""
        chain = self.transport.chain
        q = self.end.posture[None]
        return tangent(chain, self.transport.joints, q, chain.dynamics.placements(q))

    @cached_property
    def rate(self) -> np.ndarray:
        """Prescribed dy/dt: the object's velocity with the least joint rates, (p,) [rad/s]."""
        if not np.any(self.end.velocity):
            return np.zeros(self.criterion.p)
        at = self.at_posture
        velocity = np.zeros(6)
        velocity[:3] = self.end.velocity
        rows = self.task_rows
        jacobian = rows @ self.transport.chain.object_jacobian(at.at)[0] @ at.s[0]
        # least norm among all joints, not only the independent ones
        root = np.linalg.cholesky(at.s[0].T @ at.s[0]).T
        scaled = np.linalg.lstsq(jacobian @ np.linalg.inv(root), rows @ velocity, rcond=None)[0]
        rate: np.ndarray = np.linalg.solve(root, scaled)
        return rate

    @cached_property
    def task_rows(self) -> np.ndarray:
        """Rows of the object's twist that the end prescribes, (r, 6)."""
        return self.transport.chain.task_rows(self.end.pose.rotation is not None)

    @cached_property
    def null_guess(self) -> np.ndarray:
        """Motions that leave the object at the guessed posture, (p, p - r)."""
        jacobian = (
            self.transport.chain.object_jacobian(self.at_posture.at)[0] @ self.at_posture.s[0]
        )
        null: np.ndarray = scipy.linalg.null_space(self.task_rows @ jacobian)
        return null

    def prescribed_torque(self, at: Tangent) -> np.ndarray | None:
        """Returns the torques that the end prescribes at postures, (K, N); None if it does not."""
        rule, chain = self.end.torque_rule, self.transport.chain
        if rule == "static":
            return static_torque(chain, at)
        if rule == "preload":
            assert self.end.preload is not None
            return preload_torque(chain, at, self.end.preload)
        if rule == "given":
            return np.broadcast_to(self.end.torque, at.q.shape)
        return None

    def _torque_slope(self, y: np.ndarray) -> np.ndarray:
        """Returns d tau_e/dy of the prescribed torques, (K, N, p)."""
        count, p = y.shape
        moved = np.repeat(y[None, None], p, axis=1).repeat(2, axis=0)
        for joint in range(p):
            moved[0, joint, :, joint] += _TORQUE_STEP
            moved[1, joint, :, joint] -= _TORQUE_STEP
        moved = moved.reshape(-1, p)
        at, _ = self.coordinates.precise().tangent(np.full(len(moved), self.share), moved)
        torque = self.prescribed_torque(at)
        assert torque is not None
        sides = torque.reshape(2, p, count, -1)
        slope: np.ndarray = (sides[0] - sides[1]).transpose(1, 2, 0) / (2.0 * _TORQUE_STEP)
        return slope

    def residual(self, x: np.ndarray) -> np.ndarray:
        """Returns the conditions' residual at K states and costates, (K, state_size)."""
        criterion, end = self.criterion, self.end
        y, rate = x[:, criterion.at_y], x[:, criterion.at_rate]
        speed = rate - self.rate
        if self.linear:
            parts = [y - end.posture[self.transport.joints.independent], speed]
            if criterion.torque_is_state:
                prescribed = self.prescribed_torque(self.at_posture)
                free = x[:, criterion.at_n3] / criterion.rate_weights
                parts.append(free if prescribed is None else x[:, criterion.at_tau] - prescribed)
            return np.concatenate(parts, axis=1)
        shares = np.full(len(x), self.share)
        evaluation = criterion.evaluate(self.coordinates.precise(), shares, x)
        torque_rows, correction = self._torque_conditions(evaluation, x)
        parts = [self._posture_conditions(evaluation.tangent, x, correction), speed]
        if torque_rows is not None:
            parts.append(torque_rows)
        return np.concatenate(parts, axis=1)

    def _posture_conditions(self, at: Tangent, x: np.ndarray, correction: np.ndarray) -> np.ndarray:
        criterion, end, chain = self.criterion, self.end, self.transport.chain
        if end.held:
            held: np.ndarray = x[:, criterion.at_y] - end.posture[self.transport.joints.independent]
            return held
        rows = self.task_rows
        error = pose_error(chain, at.at, end.pose.position, end.pose.rotation)
        task = error @ rows[:, : error.shape[1]].T
        jacobian = rows @ chain.object_jacobian(at.at) @ at.s
        guess = self.null_guess
        null = guess - np.linalg.pinv(jacobian) @ (jacobian @ guess)
        free = matvec(transpose(null), x[:, criterion.at_n1] - correction)
        return np.concatenate([task, free], axis=1)

    def _torque_conditions(self, at, x: np.ndarray) -> tuple[np.ndarray | None, np.ndarray]:  # type: ignore[no-untyped-def]
        """Returns the rows on torques, and what they take from n1 in transversality."""
        criterion = self.criterion
        nothing = np.zeros((len(x), criterion.p))
        if not criterion.torque_is_state:
            return None, nothing
        n3, rule = x[:, criterion.at_n3], self.end.torque_rule
        if rule == "free":
            return n3 / criterion.rate_weights, nothing
        if rule == "rest":
            independent = self.transport.joints.independent
            linear = linearize(at.motion, at.derivatives)
            kappa = np.linalg.solve(at.motion.reduced, n3[:, independent, None])
            internal = matvec(at.tangent.gamma, n3)
            rows = [at.motion.a[:, independent], internal]
            return np.concatenate(rows, axis=1), matvec(transpose(linear.along_y), kappa[..., 0])
        prescribed = self.prescribed_torque(at.tangent)
        rows_given = x[:, criterion.at_tau] - prescribed
        if self.end.held or rule == "given":
            return rows_given, nothing
        slope = self._torque_slope(x[:, criterion.at_y])
        return rows_given, -matvec(transpose(slope), n3)
