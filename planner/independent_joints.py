"""Independent joints y of the closed chain, and the map phi from them to all joints."""

from __future__ import annotations

import copy

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg.lapack import dgeqp3

from planner.chain import CLOSURE_TOLERANCE, ClosedChain
from planner.constrained_dynamics import Joints, Tangent, tangent
from planner.equation_of_motion import Placements

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
            # relative to the whole Jacobian's size, so that wholly singular choices rank last
            proposals[dependent] = float(np.min(values[:, -1]))
    best = max(proposals, key=lambda choice: proposals[choice])
    independent = [joint for joint in range(chain.n) if joint not in best]
    return Joints(np.array(independent, dtype=int), np.array(best, dtype=int))


class Coordinates:
    """The map phi along a motion: closed postures from independent joints.

    Closure has several solutions for the same y. The one wanted is near the last known motion,
    which this object keeps as its only state.

    Attributes:
        chain: The closed chain.
        joints: Independent and dependent joints.
        tolerance: Bound on the gap that is left [m, rad].
        share: Shares of the duration at which the last known motion is kept, (K,).
        path: Its closed postures, (K, N) [rad].
    """

    _spline: CubicSpline | None

    def __init__(
        self, chain: ClosedChain, joints: Joints, share: np.ndarray, path: np.ndarray
    ) -> None:
        """Starts from closed postures `path`, (K, N), at shares of the duration, (K,)."""
        self.chain = chain
        self.joints = joints
        self.tolerance = CLOSURE_TOLERANCE
        self.remember(share, path)

    def close(self, share: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, Placements, np.ndarray]:
        """Returns q = phi(y) with placements, and which samples could be closed.

        Args:
            share: Shares of the duration, increasing where they shall be remembered, (K,).
            y: Independent joints, (K, p) [rad].
        """
        guess = np.empty((len(y), self.chain.n))
        guess[:, self.joints.independent] = y
        if self._spline is None:
            self._spline = CubicSpline(self.share, self.path[:, self.joints.dependent])
        guess[:, self.joints.dependent] = self._spline(share)
        return self.chain.close(guess, self.joints.dependent, self.tolerance)

    def tangent(self, share: np.ndarray, y: np.ndarray) -> tuple[Tangent, np.ndarray]:
        """Returns the freedoms at phi(y), and which samples could be closed, (K,)."""
        q, at, closed = self.close(share, y)
        return tangent(self.chain, self.joints, q, at), closed

    def precise(self) -> Coordinates:
        """Returns the same map, closed to round-off: for what is differenced twice."""
        copied = copy.copy(self)
        copied.tolerance = 1e-15
        return copied

    def remember(self, share: np.ndarray, q: np.ndarray) -> None:
        """Takes closed postures, (K, N) at increasing shares, as what phi shall stay near."""
        self.share, self.path = share, q
        self._spline = None
