"""Closure of the two arms (eq. 1): the loop as one serial chain from the left hand to the right.

Seen from the left hand, the right hand is the end of a serial chain: the left arm's joints from
the hand to the base, turning the other way, then the right arm's from the base to the hand. Its
twist columns (l_j; w_j), taken at the right hand, give everything: for a chain whose joint k comes
no later than joint j,  dJ_j/dq_k = w_k x J_j,  else  (w_j x l_k; 0).  Running sums over the joints
then yield first and second derivatives without a loop. A pair selects which of the six relative
motions are blocked; its rows are fixed in the frame of the grasp on the object.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from planner.vectors import cross, matvec, transpose


@dataclass(frozen=True, eq=False)
class Loop:
    """Twist columns of the loop for K samples, joints in loop order.

    Attributes:
        linear: l_j, velocity of the right hand's point relative to the left hand per joint rate,
            in world axes, (K, N, 3).
        angular: w_j, (K, N, 3).
        blocked: The pair's rows in world axes, (K, m, 6).
        order: Joint index of each place in the loop, (N,).
        turning: Whether the pair blocks rotations; if not, their terms are left out.
    """

    linear: np.ndarray
    angular: np.ndarray
    blocked: np.ndarray
    order: np.ndarray
    turning: bool = True
    _known: list[Any] = field(default_factory=list, repr=False)

    def _to_loop(self, rates: np.ndarray) -> np.ndarray:
        return rates[:, self.order, None]

    def _rows(self, linear: np.ndarray, angular: np.ndarray | None) -> np.ndarray:
        """Returns blocked rows of per-joint vectors, (K, N, 3) twice to (K, m, N), joint order."""
        result = np.empty((len(linear), self.blocked.shape[1], len(self.order)))
        rows = self.blocked[:, :, :3] @ transpose(linear)
        if angular is not None:
            rows += self.blocked[:, :, 3:] @ transpose(angular)
        result[:, :, self.order] = rows
        return result

    def _moving(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the columns times the rates and the spin before each joint; the last are kept."""
        if self._known and self._known[0][0] is v:
            return self._known[0][1]
        rates = self._to_loop(v)
        linear, angular = self.linear * rates, self.angular * rates
        found = linear, angular, _before(angular)
        self._known[:] = [(v, found)]
        return found

    def jacobian(self) -> np.ndarray:
        """Returns Gamma = dg/dq on the closed chain, (K, m, N)."""
        return self._rows(self.linear, self.angular if self.turning else None)

    def wrench(self, multiplier: np.ndarray) -> np.ndarray:
        """Returns the wrench (force; moment) on the right hand at its point, world axes, (K, 6)."""
        return matvec(transpose(self.blocked), multiplier)

    def bias(self, v: np.ndarray) -> np.ndarray:
        """Returns the relative acceleration at zero joint acceleration, gamma_0, (K, m)."""
        linear, angular, before = self._moving(v)
        along = cross(2.0 * before + angular, linear).sum(axis=1)
        result = matvec(self.blocked[:, :, :3], along)
        if self.turning:
            result += matvec(self.blocked[:, :, 3:], cross(before, angular).sum(axis=1))
        return result

    def velocity_derivative(self, v: np.ndarray) -> np.ndarray:
        """Returns d(Gamma v)/dq at constant v, (K, m, N)."""
        linear, angular, before = self._moving(v)
        turned = cross(self.angular, _from_here(angular)) if self.turning else None
        return self._rows(
            cross(before, self.linear) + cross(self.angular, _from_here(linear)), turned
        )

    def force_derivative(self, v: np.ndarray, multiplier: np.ndarray) -> np.ndarray:
        """Returns d(v' Gamma' multiplier)/dq at constant v and multiplier, (K, N)."""
        return matvec(transpose(self.velocity_derivative(v)), multiplier)

    def force_jacobian(self, multiplier: np.ndarray) -> np.ndarray:
        """Returns d(Gamma' multiplier)/dq, (K, N, N): row j, derivative along joint k."""
        wrench = self.wrench(multiplier)
        force, moment = wrench[:, None, :3], wrench[:, None, 3:]
        place = np.arange(len(self.order))
        inner = (place[None, :] <= place[:, None])[None, :, :]
        # (w_k x l_j) F = w_k (l_j x F), and likewise for the others
        arms = cross(self.linear, force)
        if self.turning:
            arms += cross(self.angular, moment)
        turned = arms @ transpose(self.angular)
        moved = cross(force, self.angular) @ transpose(self.linear)
        result = np.empty_like(turned)
        result[:, self.order[:, None], self.order[None, :]] = np.where(inner, turned, moved)
        return result

    def acceleration_derivatives(
        self, v: np.ndarray, a: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns the derivatives of gamma = Gamma a + (dGamma/dt) v.

        Args:
            v: Joint velocity, (K, N) [rad/s].
            a: Joint acceleration, (K, N) [rad/s^2].

        Returns:
            Along q at constant v and a, and along v, each (K, m, N).
        """
        linear, angular, before = self._moving(v)
        accelerations = self._to_loop(a)
        steps = self.linear * accelerations + cross(2.0 * before + angular, linear)
        turns = self.angular * accelerations + cross(before, angular)
        # motion of what lies beyond joint l as seen from the body before it
        velocity = _from_here(linear)
        acceleration = _from_here(steps) - 2.0 * cross(before, velocity)
        swing = cross(self.angular, velocity)
        carried = cross(before, self.linear)
        along_q = (
            cross(_before(turns), self.linear)
            + cross(before, carried + 2.0 * swing)
            + cross(self.angular, acceleration)
        )
        along_v = 2.0 * (carried + swing)
        if not self.turning:
            return self._rows(along_q, None), self._rows(along_v, None)
        spin = _from_here(angular)
        spin_rate = _from_here(turns) - cross(before, spin)
        turned = cross(self.angular, spin)
        return (
            self._rows(along_q, cross(self.angular, spin_rate) + cross(before, turned)),
            self._rows(along_v, cross(before, self.angular) + turned),
        )


def _before(values: np.ndarray) -> np.ndarray:
    """Returns sums over all joints before each one, (K, N, 3)."""
    result = np.empty_like(values)
    result[:, 0] = 0.0
    np.cumsum(values[:, :-1], axis=1, out=result[:, 1:])
    return result


def _from_here(values: np.ndarray) -> np.ndarray:
    """Returns sums over each joint and all beyond it, (K, N, 3)."""
    return np.cumsum(values[:, ::-1], axis=1)[:, ::-1]
