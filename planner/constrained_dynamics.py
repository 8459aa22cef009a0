"""Motion of the closed chain in its independent joints (eq. 7), the force at the hands kept.

With independent joints y and dependent ones z:  v = S dy/dt,  S = [1; -Gz^-1 Gy],  and one solve

    [ I  -Gamma'] [a     ]   [tau - C - G]
    [-Gamma  0  ] [lambda] = [gamma_0    ]

gives the accelerations and the multiplier of eq. 2. It is carried out in the independent joints:
S'IS is small, positive and exists even where links have no mass.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.chain import ClosedChain
from planner.closure import Loop
from planner.equation_of_motion import Placements
from planner.vectors import matvec, transpose


@dataclass(frozen=True, eq=False)
class Joints:
    """Which joints are independent (y) and which follow from closure (z).

    Attributes:
        independent: Indices of y, (p,).
        dependent: Indices of z, (m,).
    """

    independent: np.ndarray
    dependent: np.ndarray


@dataclass(frozen=True, eq=False)
class Tangent:
    """The closed chain's freedoms at K postures.

    Attributes:
        q: Closed postures, (K, N) [rad].
        at: Their placements.
        loop: Their twist columns.
        gamma: Closure Jacobian, (K, m, N).
        inverse: Inverse of its dependent columns, (K, m, m).
        s: S = dq/dy, (K, N, p).
    """

    q: np.ndarray
    at: Placements
    loop: Loop
    gamma: np.ndarray
    inverse: np.ndarray
    s: np.ndarray

    def part(self, some: slice) -> Tangent:
        """Returns some of the samples."""
        rest = self.gamma[some], self.inverse[some], self.s[some]
        return Tangent(self.q[some], self.at.part(some), self.loop.part(some), *rest)

    def shifted(self, joints: Joints, y: np.ndarray, gap: np.ndarray | None = None) -> np.ndarray:
        """Returns postures with other independent joints, (K, p), closed to second order, (K, N).

        The second order is half the drift of a motion that goes there in unit time. A gap, (K, m),
        that was left here is closed on the way.
        """
        step = matvec(self.s, y - self.q[:, joints.independent])
        q = self.q + step
        apart = 0.5 * self.loop.bias(step)
        if gap is not None:
            apart = apart + gap
        q[:, joints.dependent] -= matvec(self.inverse, apart)
        return q


@dataclass(frozen=True, eq=False)
class Motion:
    """Accelerations and forces at K states.

    Attributes:
        tangent: The freedoms at these postures.
        v: Joint velocity, (K, N) [rad/s].
        inertia: I(q), (K, N, N) [kg m^2].
        reduced: Inverse of S'IS, (K, p, p).
        a: Joint acceleration, (K, N) [rad/s^2].
        multiplier: lambda of eq. 2, (K, m) [N, Nm].
    """

    tangent: Tangent
    v: np.ndarray
    inertia: np.ndarray
    reduced: np.ndarray
    a: np.ndarray
    multiplier: np.ndarray


def tangent(chain: ClosedChain, joints: Joints, q: np.ndarray, at: Placements) -> Tangent:
    """Returns S and the closure Jacobian at closed postures, see `Tangent`.

    A posture at which the dependent joints cannot follow gets entries that are no numbers.
    """
    loop = chain.loop(at)
    gamma = loop.jacobian()
    inverse = _inverse(gamma[:, :, joints.dependent])
    s = np.zeros((len(q), chain.n, chain.p))
    s[:, joints.independent, np.arange(chain.p)] = 1.0
    s[:, joints.dependent] = -inverse @ gamma[:, :, joints.independent]
    return Tangent(q, at, loop, gamma, inverse, s)


def _inverse(matrices: np.ndarray) -> np.ndarray:
    """Returns inverses of a batch; NaN for those that are singular or not finite."""
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        result = np.full_like(matrices, np.nan)
        with np.errstate(all="ignore"):
            good = np.isfinite(matrices).all(axis=(1, 2))
            good[good] = np.linalg.cond(matrices[good]) < 1e15
        result[good] = np.linalg.inv(matrices[good])
        return result


@dataclass(frozen=True, eq=False)
class Inertial:
    """What the accelerations need besides the torques.

    Attributes:
        inertia: I(q), (K, N, N).
        bias: C + G, (K, N).
        drift: Joint acceleration that closure demands at zero acceleration of y, (K, N).
        reduced: Inverse of S'IS, (K, p, p).
    """

    inertia: np.ndarray
    bias: np.ndarray
    drift: np.ndarray
    reduced: np.ndarray


def inertial(chain: ClosedChain, joints: Joints, at: Tangent, v: np.ndarray) -> Inertial:
    """Returns inertia and bias at postures `at` and joint velocities v, (K, N)."""
    inertia, bias = chain.dynamics.inertia_and_bias(at.q, v)
    drift = np.zeros_like(v)
    drift[:, joints.dependent] = -matvec(at.inverse, at.loop.bias(v))
    reduced = _inverse(transpose(at.s) @ inertia @ at.s)
    return Inertial(inertia, bias, drift, reduced)


def accelerate(
    joints: Joints, at: Tangent, v: np.ndarray, terms: Inertial, tau: np.ndarray
) -> Motion:
    """Returns accelerations and hand force under the torques tau, (K, N) [Nm]."""
    forces = tau - terms.bias
    free = matvec(transpose(at.s), forces - matvec(terms.inertia, terms.drift))
    a = matvec(at.s, matvec(terms.reduced, free)) + terms.drift
    surplus = (matvec(terms.inertia, a) - forces)[:, joints.dependent]
    multiplier = matvec(transpose(at.inverse), surplus)
    return Motion(at, v, terms.inertia, terms.reduced, a, multiplier)


def pseudo_inverse_torque(
    s: np.ndarray, load: np.ndarray, weights: np.ndarray | float = 1.0
) -> np.ndarray:
    """Returns the torques of least weighted norm that move the closed chain alike (eq. 17).

    Args:
        s: S = dq/dy, (K, N, p).
        load: Torques I a + C + G of the open chain, (K, N) [Nm].
        weights: Weights of the squared torques, (N,) or one for all.
    """
    spread = s / np.reshape(weights, (-1, 1))
    share = np.linalg.solve(transpose(s) @ spread, transpose(s) @ load[..., None])
    return matvec(spread, share[..., 0])


@dataclass(frozen=True, eq=False)
class Linearization:
    """Derivatives of the independent joints' accelerations.

    Attributes:
        along_y: (K, p, p).
        along_rate: Along dy/dt, (K, p, p).
        along_torque: B of eq. 7, (K, p, N).
    """

    along_y: np.ndarray
    along_rate: np.ndarray
    along_torque: np.ndarray


@dataclass(frozen=True, eq=False)
class InverseDerivatives:
    """Derivatives of a motion that keep the accelerations d2y/dt2 and the multiplier.

    All others follow: the torques tau(y, dy/dt, d2y/dt2, lambda) are explicit, so that along a
    motion  S'(tau_y dy + tau_rate d(dy/dt) + I S d(d2y/dt2) - d tau) = 0.

    Attributes:
        torque: Of the torques along y and along dy/dt, (K, 2, N, p).
        drag: Of the joint velocity along y, dv/dy, (K, N, p).
    """

    torque: np.ndarray
    drag: np.ndarray


def inverse_derivatives(
    chain: ClosedChain,
    joints: Joints,
    at: Tangent,
    v: np.ndarray,
    a: np.ndarray,
    multiplier: np.ndarray,
    load: np.ndarray | None = None,
) -> InverseDerivatives:
    """Returns the derivatives of the torques that a motion needs, see `InverseDerivatives`.

    Args:
        chain: The closed chain.
        joints: Independent and dependent joints.
        at: Freedoms at the postures.
        v: Joint velocity, (K, N).
        a: Joint acceleration, (K, N).
        multiplier: lambda, (K, m).
        load: Derivatives of I a + C + G along q, v and a if they are known, (K, 3, N, N).
    """
    if load is None:
        _, load = chain.dynamics.inverse_dynamics_derivatives(at.q, v, a)
    dependent, (count, n, p), m = joints.dependent, at.s.shape, chain.m
    closure_q, closure_v, slip = at.loop.derivatives(v, a)
    # the joints' loads and the closure's acceleration along q, then along v, then Gamma v along q
    along = np.empty((count, 2 * (n + m) + m, n))
    along[:, :n] = load[:, 0]
    along[:, :n] -= at.loop.force_jacobian(multiplier)
    along[:, n : n + m] = closure_q
    along[:, n + m : 2 * n + m] = load[:, 1]
    along[:, 2 * n + m : 2 * (n + m)] = closure_v
    along[:, 2 * (n + m) :] = slip
    parts = along @ at.s
    # with y, dy/dt and d2y/dt2 given, closure moves the dependent rates and accelerations along
    drag = -at.inverse @ parts[:, 2 * (n + m) :]
    parts[:, : n + m] += along[:, n + m : 2 * (n + m), dependent] @ drag
    both = parts[:, : 2 * (n + m)].reshape(count, 2, n + m, p)
    lever = load[:, 2][:, :, dependent] @ at.inverse
    whole_drag = np.zeros_like(at.s)
    whole_drag[:, dependent] = drag
    return InverseDerivatives(both[:, :, :n] - lever[:, None] @ both[:, :, n:], whole_drag)


def linearize(motion: Motion, derivatives: InverseDerivatives) -> Linearization:
    """Returns the derivatives of the independent accelerations along y, dy/dt and tau."""
    effect = motion.reduced @ transpose(motion.tangent.s)
    along = -effect[:, None] @ derivatives.torque
    return Linearization(along[:, 0], along[:, 1], effect)
