"""Torques that a motion and a multiplier need: explicit, since every joint is actuated.

    tau = I a + C + G - Gamma' lambda,     q = phi(y),  v = S dy/dt,  a = S d2y/dt2 + drift(q, v)

No equation is solved for them, and their first derivatives need only those of inverse dynamics.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.chain import ClosedChain
from planner.constrained_dynamics import Joints, Tangent
from planner.vectors import matvec, transpose


@dataclass(frozen=True, eq=False)
class Torques:
    """Torques at K samples of a motion, and their derivatives.

    Attributes:
        tangent: Freedoms at the postures.
        v: Joint velocity, (K, N).
        a: Joint acceleration, (K, N).
        tau: Torques, (K, N) [Nm].
        along_y: d tau/dy, (K, N, p).
        along_rate: d tau/d(dy/dt), (K, N, p).
        along_acceleration: d tau/d(d2y/dt2), (K, N, p).
        drag: dv/dy at constant dy/dt, (K, N, p).
    """

    tangent: Tangent
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    along_y: np.ndarray
    along_rate: np.ndarray
    along_acceleration: np.ndarray
    drag: np.ndarray

    @property
    def along_multiplier(self) -> np.ndarray:
        """D tau/d lambda = -Gamma', (K, N, m)."""
        return -transpose(self.tangent.gamma)


def inverse_torques(
    chain: ClosedChain,
    joints: Joints,
    at: Tangent,
    rate: np.ndarray,
    acceleration: np.ndarray,
    multiplier: np.ndarray,
) -> Torques:
    """Returns the torques and their derivatives.

    Args:
        chain: The closed chain.
        joints: Independent and dependent joints.
        at: Freedoms at the postures.
        rate: dy/dt, (K, p).
        acceleration: d2y/dt2, (K, p).
        multiplier: lambda, (K, m).
    """
    s, inverse, dependent = at.s, at.inverse, joints.dependent
    v = matvec(s, rate)
    a = matvec(s, acceleration)
    a[:, dependent] -= matvec(inverse, at.loop.bias(v))
    load, load_q, load_v, inertia = chain.dynamics.inverse_dynamics_derivatives(at.q, v, a)
    closure_q, closure_v = at.loop.acceleration_derivatives(v, a)
    # with y, dy/dt and d2y/dt2 given, closure moves the dependent rates and accelerations along
    drag = np.zeros_like(s)
    drag[:, dependent] = -inverse @ (at.loop.velocity_derivative(v) @ s)
    follow_y = -inverse @ (closure_q @ s + closure_v @ drag)
    follow_rate = -inverse @ (closure_v @ s)
    own = inertia[:, :, dependent]
    pull = at.loop.force_jacobian(multiplier)
    return Torques(
        tangent=at,
        v=v,
        a=a,
        tau=load - matvec(transpose(at.gamma), multiplier),
        along_y=(load_q - pull) @ s + load_v @ drag + own @ follow_y,
        along_rate=load_v @ s + own @ follow_rate,
        along_acceleration=inertia @ s,
        drag=drag,
    )
