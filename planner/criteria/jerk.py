"""Minimum jerk: the object's motion is known beforehand, the rest follows pointwise.

The object goes along a straight line, a quintic of time. Redundant joints take the rates of least
norm. The torques are those of least weighted norm at every instant: the pseudo-inverse of eq. 17,
which in the independent joints reads  tau = V^-1 S (S' V^-1 S)^-1 S' (I a + C + G).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from planner.chain import ClosedChain
from planner.constrained_dynamics import (
    Motion,
    accelerate,
    inertial,
    pseudo_inverse_torque,
    tangent,
)
from planner.forces import object_twist
from planner.inverse_kinematics import follow_poses
from planner.posture_equations import pose_error
from planner.transport import StraightMotion, Transport, straight_motion
from planner.vectors import matvec

_FINE = 4  # substeps between two samples where the rates of least norm are integrated


@dataclass(frozen=True, eq=False)
class JerkMotion:
    """The minimum-jerk motion at K shares of the duration.

    Attributes:
        motion: Accelerations and forces.
        tau: Torques, (K, N) [Nm].
        tau_rate: Their rates, (K, N) [Nm/s].
        cost: Half the integral of the object's squared jerk [m^2/s^5].
    """

    motion: Motion
    tau: np.ndarray
    tau_rate: np.ndarray
    cost: float


def jerk_motion(transport: Transport, share: np.ndarray, weights: np.ndarray) -> JerkMotion | float:
    """Returns the minimum-jerk motion, or the time [s] at which the arms cannot follow it.

    Args:
        transport: The motion asked for.
        share: Evenly spaced shares of the duration, (K,).
        weights: Weights of the squared torques in eq. 17, (N,).
    """
    chain = transport.chain
    time = share * transport.duration
    line = straight_motion(transport.start, transport.goal, share, transport.duration)
    determined = chain.p == len(chain.task_rows(line.rotation is not None))
    q = _follow(transport, share, line) if determined else _least_rates(transport, share)
    if isinstance(q, float):
        return q * transport.duration
    at = tangent(chain, transport.joints, q, chain.dynamics.placements(q))
    v, a = _rates(transport, share, q, line)
    terms = inertial(chain, transport.joints, at, v)
    load = matvec(terms.inertia, a) + terms.bias
    tau = pseudo_inverse_torque(at.s, load, weights)
    motion = accelerate(transport.joints, at, v, terms, tau)
    # the squared jerk is a quartic: three Gauss nodes integrate it exactly
    points, parts = np.polynomial.legendre.leggauss(3)
    nodes = 0.5 * (points + 1.0)
    jerk = straight_motion(transport.start, transport.goal, nodes, transport.duration).jerk
    cost = float(0.25 * transport.duration * parts @ (jerk**2).sum(-1))
    return JerkMotion(motion, tau, CubicSpline(time, tau)(time, 1), cost)


def _follow(transport: Transport, share: np.ndarray, line: StraightMotion) -> np.ndarray | float:
    """Returns the postures along the line, (K, N), or the share at which the arms lose it."""
    chain, rotation = transport.chain, line.rotation
    known = transport.share, transport.guess.T
    guess = np.array([np.interp(share, known[0], joint) for joint in known[1]]).T
    guess[0], guess[-1] = transport.start.posture, transport.goal.posture
    q = follow_poses(chain, line.position, rotation, guess)
    if q is not None:
        return q
    for k in range(2, len(share)):
        part = slice(0, k + 1)
        turned = None if rotation is None else rotation[part]
        if follow_poses(chain, line.position[part], turned, guess[part]) is None:
            return float(share[k])
    return float(share[-1])


def _system(chain: ClosedChain, q: np.ndarray, orientation: bool) -> np.ndarray:
    """Returns the Jacobian of task and closure, (K, r + m, N)."""
    at = chain.dynamics.placements(q)
    rows = chain.task_rows(orientation) @ chain.object_jacobian(at)
    return np.concatenate([rows, chain.loop(at).jacobian()], axis=1)


def _least_rates(transport: Transport, share: np.ndarray) -> np.ndarray | float:
    """Returns postures that follow the line with joint rates of least norm, by Runge-Kutta.

    After every step the posture is put back on the line and closed.
    """
    chain = transport.chain
    steps = _FINE * (len(share) - 1)
    fine = np.linspace(0.0, 1.0, 2 * steps + 1)
    line = straight_motion(transport.start, transport.goal, fine, transport.duration)
    orientation = line.rotation is not None
    rows = chain.task_rows(orientation)
    rates = line.twist @ rows.T
    width = transport.duration / steps

    def slope(q: np.ndarray, k: int) -> np.ndarray:
        jacobian = _system(chain, q[None], orientation)[0]
        result: np.ndarray = np.linalg.pinv(jacobian)[:, : len(rows)] @ rates[k]
        return result

    q = transport.start.posture
    found = [q]
    for k in range(steps):
        k1 = slope(q, 2 * k)
        k2 = slope(q + 0.5 * width * k1, 2 * k + 1)
        k3 = slope(q + 0.5 * width * k2, 2 * k + 1)
        k4 = slope(q + width * k3, 2 * k + 2)
        q = q + width / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        for _ in range(2):
            at = chain.dynamics.placements(q[None])
            turn = None if line.rotation is None else line.rotation[2 * k + 2]
            error = pose_error(chain, at, line.position[2 * k + 2], turn)
            off = np.concatenate([error @ rows[:, : error.shape[1]].T, chain.gap(at)], axis=1)[0]
            q = q - np.linalg.pinv(_system(chain, q[None], orientation)[0]) @ off
        if not np.all(np.isfinite(q)) or np.max(np.abs(off)) > 1e-6:
            return float(fine[2 * k + 2])
        if (k + 1) % _FINE == 0:
            found.append(q)
    return np.array(found)


def _rates(
    transport: Transport, share: np.ndarray, q: np.ndarray, line: StraightMotion
) -> tuple[np.ndarray, np.ndarray]:
    """Returns joint velocities of least norm and the accelerations that belong to them."""
    chain = transport.chain
    orientation = line.rotation is not None
    rows = chain.task_rows(orientation)
    jacobian = _system(chain, q, orientation)
    inverse = np.linalg.pinv(jacobian)
    wanted = np.zeros((2, *jacobian.shape[:2]))
    wanted[0, :, : len(rows)] = line.twist @ rows.T
    v = matvec(inverse, wanted[0])
    at = chain.dynamics.placements(q)
    position, _ = chain.object_pose(at)
    drift = object_twist(chain, at, position).bias(v[:, : chain.left.n])
    wanted[1, :, : len(rows)] = (line.acceleration - drift) @ rows.T
    wanted[1, :, len(rows) :] = -chain.loop(at).bias(v)
    a = matvec(inverse, wanted[1])
    # along motions that leave the object, the acceleration is that of the rates found
    free = CubicSpline(share * transport.duration, v)(share * transport.duration, 1)
    return v, a + free - matvec(inverse, matvec(jacobian, free))
