"""Second derivatives of the Hamiltonian along the state, by differences of its gradient.

The gradient is exact, so one difference along each independent joint gives three blocks at once.
It is linear in the joint rates, where a step of any length is exact, and linear in the torques.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from planner.constrained_dynamics import Tangent, accelerate, inertial, inverse_derivatives, tangent
from planner.costates import hamiltonian_gradient
from planner.criteria.base import Evaluation
from planner.vectors import matvec, transpose

_BLOCK = 600  # samples at a time: what fits into the processor's cache
STEP = 1e-6  # rad: closure to first order stays within 1e-12


@dataclass(frozen=True, eq=False)
class Curvature:
    """Second derivatives of n2'a + state cost.

    Attributes:
        y_y: (K, p, p).
        y_rate: Row along y, column along dy/dt, (K, p, p).
        rate_rate: (K, p, p).
        y_tau: Row along y, column along tau, (K, p, N).
    """

    y_y: np.ndarray
    y_rate: np.ndarray
    rate_rate: np.ndarray
    y_tau: np.ndarray


def hamiltonian_curvature(at: Evaluation, rate: np.ndarray, rate_step: float) -> Curvature:
    """Returns the Hamiltonian's second derivatives at K states.

    Args:
        at: The states' evaluation.
        rate: dy/dt, (K, p) [rad/s].
        rate_step: Difference along dy/dt [rad/s]; exact at any size, best near the rates' own.
    """
    count, p = rate.shape
    size = max(1, _BLOCK // (2 * p))
    parts = (slice(low, low + size) for low in range(0, count, size))
    blocks = [_block(at, rate, rate_step, part) for part in parts]
    if len(blocks) == 1:
        return blocks[0]
    names = Curvature.__dataclass_fields__
    return Curvature(
        **{name: np.concatenate([getattr(block, name) for block in blocks]) for name in names}
    )


def _block(at: Evaluation, rate: np.ndarray, rate_step: float, part: slice) -> Curvature:
    """Returns the second derivatives at some of the states."""
    chain, joints = at.coordinates.chain, at.coordinates.joints
    base, old, rate = at.tangent.part(part), at.gradient, rate[part]
    count, p = rate.shape
    moved = base.q[None] + STEP * base.s.transpose(2, 0, 1)
    moved = moved.reshape(p * count, chain.n)
    moved_at = tangent(chain, joints, moved, chain.dynamics.placements(moved))
    both = join_tangents(moved_at, base, p)
    rates = np.broadcast_to(rate, (2, p, count, p)).copy()
    for joint in range(p):
        rates[1, joint, :, joint] += rate_step
    v = matvec(both.s, rates.reshape(-1, p))
    tau, costate = _repeat(at.tau[part], 2 * p), _repeat(at.n2[part], 2 * p)
    motion = accelerate(joints, both, v, inertial(chain, joints, both, v), tau)
    derivatives = inverse_derivatives(chain, joints, both, v, motion.a, motion.multiplier)
    gradient = hamiltonian_gradient(motion, derivatives, costate, at.state_cost)

    def difference(new: np.ndarray, old: np.ndarray, half: int, step: float) -> np.ndarray:
        change = new.reshape(2, p, count, -1)[half] - old[part]
        return change.transpose(1, 0, 2) / step

    y_y = difference(gradient.along_y, old.along_y, 0, STEP)
    rate_rate = difference(gradient.along_rate, old.along_rate, 1, rate_step)
    return Curvature(
        y_y=0.5 * (y_y + transpose(y_y)),
        y_rate=difference(gradient.along_rate, old.along_rate, 0, STEP),
        rate_rate=0.5 * (rate_rate + transpose(rate_rate)),
        y_tau=difference(gradient.along_torque, old.along_torque, 0, STEP),
    )


def _repeat(values: np.ndarray, times: int) -> np.ndarray:
    return np.broadcast_to(values, (times, *values.shape)).reshape(-1, *values.shape[1:])


def join_tangents(moved: Tangent, base: Tangent, times: int) -> Tangent:
    """Returns the moved samples followed by `times` copies of the base samples."""

    def both(new: np.ndarray, old: np.ndarray) -> np.ndarray:
        return np.concatenate([new, _repeat(old, times)])

    at = type(base.at)(*map(both, vars(moved.at).values(), vars(base.at).values()))

    def both_vectors(new: np.ndarray, old: np.ndarray) -> np.ndarray:
        return np.concatenate([new, np.tile(old, (1, times, 1))], axis=1)

    loop = replace(
        base.loop,
        linear=both_vectors(moved.loop.linear, base.loop.linear),
        angular=both_vectors(moved.loop.angular, base.loop.angular),
        frame=both(moved.loop.frame, base.loop.frame),
        _known=[],
    )
    return Tangent(
        both(moved.q, base.q),
        at,
        loop,
        both(moved.gamma, base.gamma),
        both(moved.inverse, base.inverse),
        both(moved.s, base.s),
    )
