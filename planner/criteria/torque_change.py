"""Minimum torque-change (eqs. 3 to 15): half the integral of the squared torque rates.

The torques are states, their rates u the control. For the paper's arms these are the 16 equations
of its boundary value problem.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.constrained_dynamics import linearize
from planner.criteria.base import Criterion, Evaluation
from planner.criteria.curvature import hamiltonian_curvature
from planner.independent_joints import Coordinates
from planner.vectors import transpose


@dataclass(frozen=True, eq=False)
class TorqueChange(Criterion):
    """L = 1/2 u'W u, with the torques as states; see `Criterion` for the attributes."""

    @property
    def name(self) -> str:
        """The criterion's name in a scenario."""
        return "torque-change"

    def right_side(self, at: Evaluation, x: np.ndarray, independent: np.ndarray) -> np.ndarray:
        """Returns dX/dt: state equations (7), adjoint equations (12), control (15)."""
        result = np.empty_like(x)
        result[:, self.at_y] = x[:, self.at_rate]
        result[:, self.at_rate] = at.motion.a[:, independent]
        result[:, self.at_tau] = -x[:, self.at_n3] / self.rate_weights
        result[:, self.at_n1] = -at.gradient.along_y
        result[:, self.at_n2] = -x[:, self.at_n1] - at.gradient.along_rate
        result[:, self.at_n3] = -at.gradient.along_torque - self.torque_weights * at.tau
        return result

    def jacobian(
        self, coordinates: Coordinates, at: Evaluation, x: np.ndarray, rate_step: float
    ) -> np.ndarray:
        """Returns d(dX/dt)/dX, (K, 2 * state_size, 2 * state_size)."""
        y, rate, tau, n1, n2, n3 = (
            self.at_y, self.at_rate, self.at_tau, self.at_n1, self.at_n2, self.at_n3,
        )  # fmt: skip
        linear = linearize(at.motion, at.derivatives)
        second = hamiltonian_curvature(at, x[:, rate], rate_step)
        result = np.zeros((len(x), x.shape[1], x.shape[1]))
        identity = np.eye(self.p)
        result[:, y, rate] = identity
        result[:, rate, y] = linear.along_y
        result[:, rate, rate] = linear.along_rate
        result[:, rate, tau] = linear.along_torque
        result[:, tau, n3] = -np.diag(1.0 / self.rate_weights)
        result[:, n1, y] = -second.y_y
        result[:, n1, rate] = -second.y_rate
        result[:, n1, tau] = -second.y_tau
        result[:, n1, n2] = -transpose(linear.along_y)
        result[:, n2, y] = -transpose(second.y_rate)
        result[:, n2, rate] = -second.rate_rate
        result[:, n2, n1] = -identity
        result[:, n2, n2] = -transpose(linear.along_rate)
        result[:, n3, y] = -transpose(second.y_tau)
        result[:, n3, tau] = -np.diag(self.torque_weights)
        result[:, n3, n2] = -transpose(linear.along_torque)
        return result

    def torque_rate(
        self, coordinates: Coordinates, share: np.ndarray, x: np.ndarray, at: Evaluation
    ) -> np.ndarray:
        """Returns the control u = -n3 / W (eq. 15), (K, N) [Nm/s]."""
        return -x[:, self.at_n3] / self.rate_weights
