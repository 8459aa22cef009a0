"""Torques that a motion and a multiplier need: explicit, since every joint is actuated.

    tau = I a + C + G - Gamma' lambda,     q = phi(y),  v = S dy/dt,  a = S d2y/dt2 + drift(q, v)

No equation is solved for them, and their first derivatives need only those of inverse dynamics.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from planner.chain import ClosedChain
from planner.constrained_dynamics import Joints, Tangent
from planner.vectors import matvec, transpose


@dataclass(frozen=True, eq=False)
class Torques:
    """Torques at K samples of a motion, and their derivatives once they are asked for.

    Attributes:
        joints: Independent and dependent joints.
        tangent: Freedoms at the postures.
        v: Joint velocity, (K, N).
        a: Joint acceleration, (K, N).
        multiplier: lambda, (K, m).
        load: Derivatives of I a + C + G along q, v and a, (K, 3, N, N).
        tau: Torques, (K, N) [Nm].
    """

    joints: Joints
    tangent: Tangent
    v: np.ndarray
    a: np.ndarray
    multiplier: np.ndarray
    load: np.ndarray
    tau: np.ndarray

    @cached_property
    def _derivatives(self) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of tau along y and its first two rates, (K, 3, N, p), and the drag."""
        at, dependent = self.tangent, self.joints.dependent
        s, inverse = at.s, at.inverse
        count, n, p = s.shape
        m = len(dependent)
        closure_q, closure_v, slip = at.loop.derivatives(self.v, self.a)
        # with y, dy/dt and d2y/dt2 given, closure moves the dependent rates and accelerations along
        drag = -inverse @ (slip @ s)
        slide = np.empty((count, m, 2, p))
        slide[:, :, 0] = closure_q @ s
        slide[:, :, 0] += closure_v[:, :, dependent] @ drag
        slide[:, :, 1] = closure_v @ s
        follow = inverse @ slide.reshape(count, m, 2 * p)
        load = self.load.copy()
        load[:, 0] -= at.loop.force_jacobian(self.multiplier)
        along = (load.reshape(count, 3 * n, n) @ s).reshape(count, 3, n, p)
        along[:, 0] += load[:, 1][:, :, dependent] @ drag
        own = load[:, 2][:, :, dependent] @ follow
        along[:, :2] -= own.reshape(count, n, 2, p).transpose(0, 2, 1, 3)
        whole_drag = np.zeros_like(s)
        whole_drag[:, dependent] = drag
        return along, whole_drag

    @property
    def along_motion(self) -> np.ndarray:
        """D tau/dy, d tau/d(dy/dt) and d tau/d(d2y/dt2), (K, 3, N, p)."""
        return self._derivatives[0]

    @property
    def drag(self) -> np.ndarray:
        """Dv/dy at constant dy/dt, (K, N, p)."""
        return self._derivatives[1]

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
    return Torques(joints, at, v, a, multiplier, load, torque)
