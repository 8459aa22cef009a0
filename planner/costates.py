"""Gradient of the Hamiltonian (eqs. 11, 12) without third derivatives of the kinematics.

The constraint matrix of the equation of motion is solved once more, for the costates n2 of the
accelerations:  [I -Gamma'; -Gamma 0] [mu; sigma] = [E n2; 0].  Then, with P and Q the derivatives
of inverse dynamics and gamma the relative acceleration at the hands,

    dH/dq = -(P - d(Gamma' lambda)/dq)' mu + (d gamma/dq)' sigma,
    dH/dv = -Q' mu + (d gamma/dv)' sigma,
    H_y = S' dH/dq + D' dH/dv,   H_rate = n1 + S' dH/dv,   H_tau = B' n2 = mu.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.constrained_dynamics import InverseDerivatives, Joints, Motion, Tangent
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
    joints: Joints,
    motion: Motion,
    derivatives: InverseDerivatives,
    n2: np.ndarray,
    state_cost: StateCost | None,
) -> Gradient:
    """Returns the Hamiltonian's gradient along the state, see the module's text.

    Args:
        joints: Independent and dependent joints.
        motion: The motion at K states.
        derivatives: Derivatives of inverse dynamics and closure there.
        n2: Costates of the independent joints' accelerations, (K, p).
        state_cost: Running cost on speed and posture, if any.
    """
    at, given = motion.tangent, derivatives
    mu = torque_costate(at, motion.reduced, n2)
    sigma = matvec(transpose(at.inverse), matvec(motion.inertia, mu)[:, joints.dependent])
    along_q = (
        -matvec(transpose(given.torque_q), mu)
        + at.loop.force_derivative(mu, motion.multiplier)
        + matvec(transpose(given.closure_q), sigma)
    )
    along_v = -matvec(transpose(given.torque_v), mu) + matvec(transpose(given.closure_v), sigma)
    if state_cost is not None:
        along_q += state_cost.posture * (at.q - state_cost.reference)
        along_v += state_cost.speed * motion.v
    return Gradient(
        along_y=matvec(transpose(at.s), along_q) + matvec(transpose(given.drag), along_v),
        along_rate=matvec(transpose(at.s), along_v),
        along_torque=mu,
    )
