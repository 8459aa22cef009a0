"""Closure of the two arms (eq. 1): the loop as one serial chain from the left hand to the right.

Seen from the left hand, the right hand is the end of a serial chain: the left arm's joints from
the hand to the base, turning the other way, then the right arm's from the base to the hand. Its
twist columns (l_j; w_j), taken at the right hand, give everything: for a chain whose joint k comes
no later than joint j,  dJ_j/dq_k = w_k x J_j,  else  (w_j x l_k; 0).  Sums over the joints before
or beyond each one then yield first and second derivatives without a loop. A pair selects which of
the six relative motions are blocked; columns are expressed in the frame of the grasp on the object,
where its rows are constant.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from planner.vectors import transpose, wrap, wrapped_cross


class LoopOrder:
    """In which order the joints come along the loop, as constant operators.

    Attributes:
        before: before[j, k] = 1 where joint j comes before joint k, (N, N).
        from_here: from_here[j, k] = 1 where joint j is joint k or beyond it, (N, N).
    """

    def __init__(self, joints: np.ndarray) -> None:
        """Takes the joint index of each place in the loop, (N,)."""
        place = np.argsort(joints)
        self.before = (place[:, None] < place[None, :]).astype(float)
        self.from_here = 1.0 - self.before


@dataclass(frozen=True, eq=False)
class Loop:
    """Twist columns of the loop for K samples, in the axes of the grasp.

    Attributes:
        linear: l_j, velocity of the right hand's point relative to the left hand per joint rate,
            wrapped vectors, (5, K, N).
        angular: w_j, likewise.
        frame: Rotation of the grasp's axes in the world, (K, 3, 3).
        blocked: The pair's rows, (m, 6).
        order: Order of the joints.
        turning: Whether the pair blocks rotations; if not, their terms are left out.
    """

    linear: np.ndarray
    angular: np.ndarray
    frame: np.ndarray
    blocked: np.ndarray
    order: LoopOrder
    turning: bool = True
    _known: list[Any] = field(default_factory=list, repr=False)

    def part(self, some: slice) -> Loop:
        """Returns some of the samples."""
        linear, angular = self.linear[:, some], self.angular[:, some]
        return Loop(linear, angular, self.frame[some], self.blocked, self.order, self.turning)

    def _rows(self, linear: np.ndarray, angular: np.ndarray | None) -> np.ndarray:
        """Returns blocked rows of per-joint vectors, (5, K, N) twice to (K, m, N)."""
        shape = linear.shape[1:]
        rows = self.blocked[:, :3] @ linear[:3].reshape(3, -1)
        if angular is not None and self.turning:
            rows += self.blocked[:, 3:] @ angular[:3].reshape(3, -1)
        return rows.reshape(-1, *shape).transpose(1, 0, 2)

    def _moving(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the columns times the rates and the spin before each joint; the last are kept."""
        if self._known and self._known[0][0] is v:
            return self._known[0][1]
        angular = self.angular * v
        found = self.linear * v, angular, angular @ self.order.before
        self._known[:] = [(v, found)]
        return found

    def jacobian(self) -> np.ndarray:
        """Returns Gamma = dg/dq on the closed chain, (K, m, N)."""
        return self._rows(self.linear, self.angular)

    def wrench(self, multiplier: np.ndarray) -> np.ndarray:
        """Returns the wrench (force; moment) on the right hand at its point, world axes, (K, 6)."""
        own = (multiplier @ self.blocked).reshape(-1, 2, 3)
        return (own @ transpose(self.frame)).reshape(-1, 6)

    def multiplier(self, wrench: np.ndarray) -> np.ndarray:
        """Returns the components along the pair's rows of a wrench in world axes, (K, 6) to (K, m).

        What the pair does not transmit is left out.
        """
        own = (wrench.reshape(-1, 2, 3) @ self.frame).reshape(-1, 6)
        result: np.ndarray = own @ self.blocked.T
        return result

    def bias(self, v: np.ndarray) -> np.ndarray:
        """Returns the relative acceleration at zero joint acceleration, gamma_0, (K, m)."""
        linear, angular, before = self._moving(v)
        along = wrapped_cross(2.0 * before + angular, linear)[:3].sum(axis=2)
        result: np.ndarray = self.blocked[:, :3] @ along
        if self.turning:
            result += self.blocked[:, 3:] @ wrapped_cross(before, angular)[:3].sum(axis=2)
        return result.T

    def force_jacobian(self, multiplier: np.ndarray) -> np.ndarray:
        """Returns d(Gamma' multiplier)/dq, (K, N, N): row j, derivative along joint k."""
        force = wrap(self.blocked[:, :3].T @ multiplier.T)[..., None]
        # (w_k x l_j) F = w_k (l_j x F), and likewise for the others
        arms = wrapped_cross(self.linear, force)
        if self.turning:
            moment = wrap(self.blocked[:, 3:].T @ multiplier.T)[..., None]
            arms += wrapped_cross(self.angular, moment)
        turned = arms[:3].transpose(1, 2, 0) @ self.angular[:3].transpose(1, 0, 2)
        moved = wrapped_cross(force, self.angular)
        moved = moved[:3].transpose(1, 2, 0) @ self.linear[:3].transpose(1, 0, 2)
        # joint k comes no later than joint j: j is k or beyond it
        return np.where(self.order.from_here, turned, moved)

    def derivatives(
        self, v: np.ndarray, a: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the derivatives of Gamma v and of gamma = Gamma a + (dGamma/dt) v.

        Args:
            v: Joint velocity, (K, N) [rad/s].
            a: Joint acceleration, (K, N) [rad/s^2].

        Returns:
            Of gamma along q at constant v and a, of gamma along v, and of Gamma v along q at
            constant v, each (K, m, N).
        """
        linear, angular, before = self._moving(v)
        here = self.order.from_here
        steps = self.linear * a + wrapped_cross(2.0 * before + angular, linear)
        turns = self.angular * a + wrapped_cross(before, angular)
        # motion of what lies beyond joint l as seen from the body before it
        velocity = linear @ here
        acceleration = steps @ here - 2.0 * wrapped_cross(before, velocity)
        swing = wrapped_cross(self.angular, velocity)
        carried = wrapped_cross(before, self.linear)
        along_q = (
            wrapped_cross(turns @ self.order.before, self.linear)
            + wrapped_cross(before, carried + 2.0 * swing)
            + wrapped_cross(self.angular, acceleration)
        )
        slip = carried + swing
        if not self.turning:
            slip_rows = self._rows(slip, None)
            return self._rows(along_q, None), 2.0 * slip_rows, slip_rows
        spin = angular @ here
        spin_rate = turns @ here - wrapped_cross(before, spin)
        turned = wrapped_cross(self.angular, spin)
        turned_q = wrapped_cross(self.angular, spin_rate) + wrapped_cross(before, turned)
        turned_v = wrapped_cross(before, self.angular) + turned
        return (
            self._rows(along_q, turned_q),
            self._rows(2.0 * slip, turned_v),
            self._rows(slip, turned),
        )
