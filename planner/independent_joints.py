"""Independent joints y of the closed chain, and the map phi from them to all joints."""

from __future__ import annotations

import copy
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg.lapack import dgeqp3

from planner.chain import CLOSURE_TOLERANCE, ClosedChain
from planner.constrained_dynamics import Joints, Tangent, tangent
from planner.equation_of_motion import Placements
from planner.vectors import matvec

_PROPOSALS = 6


def choose_joints(chain: ClosedChain, path: np.ndarray) -> Joints:
    """Returns the choice of dependent joints that stays best conditioned along a path.

    Every posture proposes the columns that a pivoted QR of its closure Jacobian takes first; the
    proposal whose smallest singular value along the whole path is largest wins.

    Args:
        chain: The closed chain.
        path: Closed postures, (K, N) [rad].
    """
    gamma = chain.loop(chain.dynamics.placements(path)).jacobian()
    proposals = {
        tuple(sorted((dgeqp3(jacobian)[1][: chain.m] - 1).tolist())): 0.0
        for jacobian in gamma[:: max(1, len(gamma) // _PROPOSALS)]
    }
    if len(proposals) > 1:
        for dependent in proposals:
            values = np.linalg.svd(gamma[:, :, dependent], compute_uv=False)
            proposals[dependent] = float(np.min(values[:, -1]))
    best = max(proposals, key=lambda choice: proposals[choice])
    independent = [joint for joint in range(chain.n) if joint not in best]
    return Joints(np.array(independent, dtype=int), np.array(best, dtype=int))


class KnownMotion:
    """A motion that is known: closed postures and, perhaps, the freedoms there.

    Attributes:
        joints: Independent and dependent joints.
        share: Shares of the duration, increasing, (K,).
        q: Closed postures, (K, N) [rad].
        s: S = dq/dy there, (K, N, p); None if it is not known.
    """

    def __init__(
        self, joints: Joints, share: np.ndarray, q: np.ndarray, s: np.ndarray | None = None
    ) -> None:
        self.joints = joints
        self.share = share
        self.q = q
        self.s = s

    @cached_property
    def _spline(self) -> CubicSpline:
        dependent, independent = self.joints.dependent, self.joints.independent
        columns = [self.q[:, dependent]]
        if self.s is not None:
            follow = self.s[:, dependent].reshape(len(self.q), -1)
            columns += [self.q[:, independent], follow]
        return CubicSpline(self.share, np.concatenate(columns, axis=1))

    def near(self, share: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Returns postures with independent joints y, (K, p), as the motion foresees them, (K, N).

        Args:
            share: Shares of the duration, (K,).
            y: Independent joints [rad].
        """
        dependent, independent = self.joints.dependent, self.joints.independent
        m, p, count = len(dependent), len(independent), len(y)
        values = self._spline(share)
        guess = np.empty((count, m + p))
        guess[:, independent] = y
        guess[:, dependent] = values[:, :m]
        if self.s is not None:
            follow = values[:, m + p :].reshape(count, m, p)
            guess[:, dependent] += matvec(follow, y - values[:, m : m + p])
        return guess


class Coordinates:
    """The map phi along a motion: closed postures from independent joints.

    Closure has several solutions for the same y. The one wanted is near the last known motion,
    which this object keeps.

    Attributes:
        chain: The closed chain.
        joints: Independent and dependent joints.
        tolerance: Bound on the gap that is left [m, rad].
        known: The last known motion.
    """

    def __init__(
        self, chain: ClosedChain, joints: Joints, share: np.ndarray, q: np.ndarray
    ) -> None:
        """Starts from closed postures q, (K, N), at shares of the duration, (K,)."""
        self.chain = chain
        self.joints = joints
        self.tolerance = CLOSURE_TOLERANCE
        self.known = KnownMotion(joints, share, q)

    def close(self, share: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, Placements, np.ndarray]:
        """Returns q = phi(y) with placements, and which samples could be closed.

        Args:
            share: Shares of the duration, (K,).
            y: Independent joints, (K, p) [rad].
        """
        guess = self.known.near(share, y)
        return self.chain.close(guess, self.joints.dependent, self.tolerance)

    def tangent(self, share: np.ndarray, y: np.ndarray) -> tuple[Tangent, np.ndarray]:
        """Returns the freedoms at phi(y), and which samples could be closed, (K,)."""
        q, at, closed = self.close(share, y)
        return tangent(self.chain, self.joints, q, at), closed

    def within(self, tolerance: float) -> Coordinates:
        """Returns the same map with another bound on the gap [m, rad]."""
        copied = copy.copy(self)
        copied.tolerance = tolerance
        return copied

    def precise(self) -> Coordinates:
        """Returns the same map, closed to round-off: for what is differenced twice."""
        return self.within(1e-15)

    def remember(self, share: np.ndarray, q: np.ndarray, s: np.ndarray | None = None) -> None:
        """Takes closed postures, (K, N) at increasing shares, as what phi shall stay near.

        Args:
            share: Shares of the duration, (K,).
            q: The postures.
            s: S = dq/dy there, (K, N, p), if it is known: other y are then foreseen better.
        """
        self.known = KnownMotion(self.joints, share, q, s)
