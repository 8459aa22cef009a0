"""Gradient of the Hamiltonian (eqs. 11, 12) without third derivatives of the kinematics.

The torques that a motion needs are explicit in y, dy/dt, d2y/dt2 and lambda, and their derivatives
give those of the accelerations: S'(tau_y dy + I S d(d2y/dt2)) = 0 at constant torques. Hence, with
mu = S (S'IS)^-1 n2 and the derivatives tau_y and tau_rate at constant accelerations and lambda,

    H_y = -tau_y' mu,   H_rate = n1 - tau_rate' mu,   H_tau = B' n2 = mu,

and the state cost's own gradient besides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.constrained_dynamics import InverseDerivatives, Motion, Tangent
from planner.vectors import matvec, transpose


@dataclass(frozen=True, eq=False)
class StateCost:
    """Small running cost on the motion itself, which makes optima of redundant arms unique.

    It is  speed/2 |v|^2 + posture/2 |q - reference|^2  in the units of the criterion.

    Attributes:
        speed: Weight of the joint speeds.
        posture: Weight of the distance from the reference posture.
        reference: (N,) [rad].
    """

    speed: float
    posture: float
    reference: np.ndarray

    def value(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Returns the running cost at K states, (K,)."""
        away = q - self.reference
        return 0.5 * (self.speed * (v * v).sum(-1) + self.posture * (away * away).sum(-1))


@dataclass(frozen=True, eq=False)
class Gradient:
    """Gradient of n2'a + state cost at K states.

    Attributes:
        along_y: (K, p).
        along_rate: Along dy/dt, n1 left out, (K, p).
        along_torque: mu, (K, N).
    """

    along_y: np.ndarray
    along_rate: np.ndarray
    along_torque: np.ndarray


def torque_costate(at: Tangent, reduced: np.ndarray, n2: np.ndarray) -> np.ndarray:
    """Returns mu = B'n2, (K, N), from the costates n2 of the accelerations, (K, p)."""
    return matvec(at.s, matvec(reduced, n2))


def hamiltonian_gradient(
    motion: Motion,
    derivatives: InverseDerivatives,
    n2: np.ndarray,
    state_cost: StateCost | None,
) -> Gradient:
    """Returns the Hamiltonian's gradient along the state, see the module's text.

    Args:
        motion: The motion at K states.
        derivatives: Derivatives of the torques that it needs.
        n2: Costates of the independent joints' accelerations, (K, p).
        state_cost: Running cost on speed and posture, if any.
    """
    at = motion.tangent
    mu = torque_costate(at, motion.reduced, n2)
    along = -(mu[:, None, None, :] @ derivatives.torque)[:, :, 0]
    along_y, along_rate = along[:, 0], along[:, 1]
    if state_cost is not None:
        away = state_cost.posture * (at.q - state_cost.reference)
        speed = state_cost.speed * motion.v
        along_y += matvec(transpose(at.s), away) + matvec(transpose(derivatives.drag), speed)
        along_rate += matvec(transpose(at.s), speed)
    return Gradient(along_y, along_rate, mu)
