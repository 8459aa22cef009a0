"""Torques that a motion and a multiplier need: explicit, since every joint is actuated.

    tau = I a + C + G - Gamma' lambda,     q = phi(y),  v = S dy/dt,  a = S d2y/dt2 + drift(q, v)

No equation is solved for them, and their first derivatives need only those of inverse dynamics.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from planner.chain import ClosedChain
from planner.constrained_dynamics import InverseDerivatives, Joints, Tangent, inverse_derivatives
from planner.vectors import matvec, transpose


@dataclass(frozen=True, eq=False)
class Torques:
    """Torques at K samples of a motion, and their derivatives once they are asked for.

    Attributes:
        chain: The closed chain.
        joints: Independent and dependent joints.
        tangent: Freedoms at the postures.
        v: Joint velocity, (K, N).
        a: Joint acceleration, (K, N).
        multiplier: lambda, (K, m).
        load: Derivatives of I a + C + G along q, v and a, (K, 3, N, N).
        tau: Torques, (K, N) [Nm].
    """

    chain: ClosedChain
    joints: Joints
    tangent: Tangent
    v: np.ndarray
    a: np.ndarray
    multiplier: np.ndarray
    load: np.ndarray
    tau: np.ndarray

    @cached_property
    def derivatives(self) -> InverseDerivatives:
        """Derivatives along y and dy/dt, and the drag."""
        return inverse_derivatives(
            self.chain, self.joints, self.tangent, self.v, self.a, self.multiplier, self.load
        )

    @property
    def along_motion(self) -> np.ndarray:
        """Derivatives of tau along y, dy/dt and d2y/dt2, (K, 3, N, p)."""
        own = self.load[:, 2] @ self.tangent.s
        return np.concatenate([self.derivatives.torque, own[:, None]], axis=1)

    def pulled_back(self, weights: np.ndarray) -> np.ndarray:
        """Returns the derivatives along y, dy/dt, d2y/dt2 of weights' tau, (K, N) to (K, 3, p)."""
        row = weights[:, None, :]
        result = np.empty((len(row), 3, self.tangent.s.shape[2]))
        result[:, :2] = (row[:, None] @ self.derivatives.torque)[:, :, 0]
        result[:, 2:] = (row @ self.load[:, 2]) @ self.tangent.s
        return result

    @property
    def along_multiplier(self) -> np.ndarray:
        """Derivative of tau along lambda, -Gamma', (K, N, m)."""
        return -transpose(self.tangent.gamma)


def inverse_torques(
    chain: ClosedChain,
    joints: Joints,
    at: Tangent,
    rate: np.ndarray,
    acceleration: np.ndarray,
    multiplier: np.ndarray,
) -> Torques:
    """Returns the torques of a motion.

    Args:
        chain: The closed chain.
        joints: Independent and dependent joints.
        at: Freedoms at the postures.
        rate: dy/dt, (K, p).
        acceleration: d2y/dt2, (K, p).
        multiplier: lambda, (K, m).
    """
    v = matvec(at.s, rate)
    a = matvec(at.s, acceleration)
    a[:, joints.dependent] -= matvec(at.inverse, at.loop.bias(v))
    torque, load = chain.dynamics.inverse_dynamics_derivatives(at.q, v, a)
    torque -= (multiplier[:, None, :] @ at.gamma)[:, 0]
    return Torques(chain, joints, at, v, a, multiplier, load, torque)
