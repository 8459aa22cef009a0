"""Minimum torque: half the integral of the squared torques, which are the control themselves.

Without a torque state the boundary value problem is half as large: 8 equations for the paper's
arms. The control follows from dH/d tau = 0:  tau = -B'n2 / V.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.constrained_dynamics import linearize
from planner.costates import torque_costate
from planner.criteria.base import Criterion, Evaluation
from planner.criteria.curvature import hamiltonian_curvature
from planner.independent_joints import Coordinates
from planner.vectors import matvec, transpose


@dataclass(frozen=True, eq=False)
class Torque(Criterion):
    """L = 1/2 tau'V tau, no torque state; see `Criterion` for the attributes."""

    @property
    def name(self) -> str:
        """The criterion's name in a scenario."""
        return "torque"

    def right_side(self, at: Evaluation, x: np.ndarray, independent: np.ndarray) -> np.ndarray:
        """Returns dX/dt: state and adjoint equations with the optimal torque."""
        result = np.empty_like(x)
        result[:, self.at_y] = x[:, self.at_rate]
        result[:, self.at_rate] = at.motion.a[:, independent]
        result[:, self.at_n1] = -at.gradient.along_y
        result[:, self.at_n2] = -x[:, self.at_n1] - at.gradient.along_rate
        return result

    def jacobian(
        self, coordinates: Coordinates, at: Evaluation, x: np.ndarray, rate_step: float
    ) -> np.ndarray:
        """Returns d(dX/dt)/dX, the torque's own dependence on the states included."""
        y, rate, n1, n2 = self.at_y, self.at_rate, self.at_n1, self.at_n2
        linear = linearize(at.motion, at.derivatives)
        second = hamiltonian_curvature(at, x[:, rate], rate_step)
        effect = linear.along_torque
        # d tau = -(H_tau_y dy + B' dn2) / V
        tau_y = -transpose(second.y_tau) / self.torque_weights[:, None]
        tau_n2 = -transpose(effect) / self.torque_weights[:, None]
        result = np.zeros((len(x), x.shape[1], x.shape[1]))
        identity = np.eye(self.p)
        result[:, y, rate] = identity
        result[:, rate, y] = linear.along_y + effect @ tau_y
        result[:, rate, rate] = linear.along_rate
        result[:, rate, n2] = effect @ tau_n2
        result[:, n1, y] = -second.y_y - second.y_tau @ tau_y
        result[:, n1, rate] = -second.y_rate
        result[:, n1, n2] = -transpose(linear.along_y) - second.y_tau @ tau_n2
        result[:, n2, y] = -transpose(second.y_rate)
        result[:, n2, rate] = -second.rate_rate
        result[:, n2, n1] = -identity
        result[:, n2, n2] = -transpose(linear.along_rate)
        return result

    def torque_rate(
        self, coordinates: Coordinates, share: np.ndarray, x: np.ndarray, at: Evaluation
    ) -> np.ndarray:
        """Returns d tau/dt along the motion, (K, N) [Nm/s].

        The torques are no state: their rate is that of -B'n2 / V along the motion.
        """
        rate = x[:, self.at_rate]
        flow = self.right_side(at, x, coordinates.joints.independent)
        rate_step = float(np.max(np.abs(rate), initial=1e-3))
        turn = hamiltonian_curvature(at, rate, rate_step).y_tau
        change = matvec(transpose(turn), rate)
        change += torque_costate(at.tangent, at.motion.reduced, flow[:, self.at_n2])
        result: np.ndarray = -change / self.torque_weights
        return result
