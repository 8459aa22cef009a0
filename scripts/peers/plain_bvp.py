"""SciPy's `solve_bvp` as its manual shows it: a right-hand side in NumPy and nothing else.

For two arms of two hinges with a point mass between them, the dynamics are written by hand in the
object's coordinates, where the inverse kinematics is algebra. The adjoint equations take their
gradient by complex steps, and the solver differences the whole right-hand side itself.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_bvp

from peers.task import Task
from planner.arm import Arm

FIRST_NODES = 21
_STEP = 1e-30


@dataclass(frozen=True)
class PlainAnswer:
    """What `solve_bvp` found.

    Attributes:
        cost: Cost.
        solved: Whether it converged.
        nodes: Nodes of the last mesh.
        status: What it says.
        solve: Time to solve [s].
    """

    cost: float
    solved: bool
    nodes: int
    status: str
    solve: float


@dataclass(frozen=True, eq=False)
class _Arm:
    """Lengths, masses, distances of the centres of mass and moments of inertia of a 2R arm."""

    base: np.ndarray
    l1: float
    l2: float
    m2: float
    c2: float
    first: float
    i2: float
    side: float

    def reflected(self, x: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, ...]:
        """Returns J^-T, the inertia felt at the hand, and the bias felt there.

        Args:
            x: Hand, (2, K) [m].
            rate: Its velocity, (2, K) [m/s].
        """
        px, py = x[0] - self.base[0], x[1] - self.base[1]
        square = px * px + py * py
        cos2 = (square - self.l1**2 - self.l2**2) / (2.0 * self.l1 * self.l2)
        sin2 = self.side * np.sqrt(1.0 - cos2 * cos2)
        along, across = self.l1 + self.l2 * cos2, self.l2 * sin2
        cos1, sin1 = (along * px + across * py) / square, (along * py - across * px) / square
        cos12, sin12 = cos1 * cos2 - sin1 * sin2, sin1 * cos2 + cos1 * sin2
        area = self.l1 * self.l2 * sin2
        inverse = (
            np.array(
                [
                    [self.l2 * cos12, self.l2 * sin12],
                    [-self.l1 * cos1 - self.l2 * cos12, -self.l1 * sin1 - self.l2 * sin12],
                ]
            )
            / area
        )
        v = np.einsum("ijk,jk->ik", inverse, rate)
        both = v[0] + v[1]
        jdot_v = np.array(
            [
                -self.l1 * cos1 * v[0] ** 2 - self.l2 * cos12 * both**2,
                -self.l1 * sin1 * v[0] ** 2 - self.l2 * sin12 * both**2,
            ]
        )
        coupling = self.m2 * self.l1 * self.c2
        m22 = self.i2 + self.m2 * self.c2**2 + 0.0 * cos2
        m12 = m22 + coupling * cos2
        m11 = self.first + m22 + 2.0 * coupling * cos2
        inertia = np.array([[m11, m12], [m12, m22]])
        swing = coupling * sin2
        bias = np.array([-swing * v[1] * (2.0 * v[0] + v[1]), swing * v[0] ** 2])
        bias = bias - np.einsum("ijk,jk->ik", inertia, np.einsum("ijk,jk->ik", inverse, jdot_v))
        felt = np.einsum("jik,jlk,lmk->imk", inverse, inertia, inverse)
        return inverse, felt, np.einsum("jik,jk->ik", inverse, bias)


class PlainProblem:
    """The 16 (or 8) equations of the paper's arms, torques as states or as controls."""

    def __init__(self, task: Task) -> None:
        chain = task.chain
        if chain.left.n != 2 or chain.right.n != 2 or np.any(chain.gravity):
            raise NotImplementedError("plain equations are for two planar arms of two joints")
        self.task = task
        self.mass = chain.body.mass
        self.change = task.rate_weights is not None
        self.weights = task.rate_weights if self.change else task.torque_weights
        postures = np.split(task.start.posture, 2)
        self.arms = tuple(
            _read(arm, posture) for arm, posture in zip(chain.arms, postures, strict=True)
        )
        self.size = 8 if self.change else 4

    def _move(self, x: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns A and B of the acceleration A + B tau, (2, K) and (2, 4, K)."""
        parts = [arm.reflected(x, rate) for arm in self.arms]
        total = parts[0][1] + parts[1][1]
        total[0, 0] += self.mass
        total[1, 1] += self.mass
        determinant = total[0, 0] * total[1, 1] - total[0, 1] * total[1, 0]
        inverse = np.array([[total[1, 1], -total[0, 1]], [-total[1, 0], total[0, 0]]]) / determinant
        A = -np.einsum("ijk,jk->ik", inverse, parts[0][2] + parts[1][2])
        B = np.concatenate([np.einsum("ijk,ljk->ilk", inverse, part[0]) for part in parts], axis=1)
        return A, B

    def right_side(self, t: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Returns dz/dt for states and costates z, (2 size, K)."""
        x, rate = z[:2], z[2:4]
        n1, n2 = z[self.size : self.size + 2], z[self.size + 2 : self.size + 4]
        A, B = self._move(x, rate)
        mu = np.einsum("ijk,ik->jk", B, n2)
        weights = self.weights[:, None]
        tau = z[4:8] if self.change else -mu / weights
        result = np.empty_like(z)
        result[:2], result[2:4] = rate, A + np.einsum("ijk,jk->ik", B, tau)
        gradient = np.empty((4, z.shape[1]))
        for place in range(4):
            moved = np.concatenate([x, rate]).astype(complex)
            moved[place] += 1j * _STEP
            dA, dB = self._move(moved[:2], moved[2:])
            slope = (dA + np.einsum("ijk,jk->ik", dB, tau)).imag / _STEP
            gradient[place] = (n2 * slope).sum(axis=0)
        result[self.size : self.size + 2] = -gradient[:2]
        result[self.size + 2 : self.size + 4] = -n1 - gradient[2:]
        if self.change:
            result[4:8] = -z[12:16] / weights
            result[12:16] = -mu
        return result

    def boundary(self, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Returns the residual of the end conditions."""
        rows = []
        for z, end in ((first, self.task.start), (last, self.task.goal)):
            rows += [z[:2] - end.position[:2], z[2:4]]
            if self.change:
                rows.append(z[12:16] if end.torque is None else z[4:8] - end.torque)
        return np.concatenate(rows)

    def solve(self, tolerance: float, max_nodes: int = 20000) -> PlainAnswer:
        """Returns the solution from the straight line with zero costates."""
        times = np.linspace(0.0, self.task.duration, FIRST_NODES)
        guess = np.zeros((2 * self.size, FIRST_NODES))
        start = self.task.first_guess(times)
        at = self.task.chain.dynamics.placements(start.q)
        guess[:2] = self.task.chain.object_pose(at)[0][:, :2].T
        guess[2:4] = np.gradient(guess[:2], times, axis=1)
        if self.change:
            guess[4:8] = start.tau.T
        began = time.perf_counter()
        found = solve_bvp(
            self.right_side, self.boundary, times, guess, tol=tolerance, max_nodes=max_nodes
        )
        seconds = time.perf_counter() - began
        return PlainAnswer(
            self._cost(found), found.status == 0, len(found.x), str(found.message), seconds
        )

    def _cost(self, found: Any) -> float:
        points, weights = np.polynomial.legendre.leggauss(5)
        width = np.diff(found.x)[:, None]
        times = (found.x[:-1, None] + width * (points + 1.0) / 2.0).ravel()
        z = found.sol(times)
        if self.change:
            squares = (z[12:16] ** 2 / self.weights[:, None]).sum(axis=0)
        else:
            mu = np.einsum("ijk,ik->jk", self._move(z[:2], z[2:4])[1], z[6:8])
            squares = (mu**2 / self.weights[:, None]).sum(axis=0)
        return 0.5 * float(squares @ (width * weights / 2.0).ravel())


def _read(arm: Arm, posture: np.ndarray) -> _Arm:
    model = arm.model
    one, two = model.inertias[1], model.inertias[2]
    l1 = float(model.jointPlacements[2].translation[0])
    inertia = one.inertia[2, 2] + one.mass * one.lever[0] ** 2 + two.mass * l1**2
    return _Arm(
        base=np.array(model.jointPlacements[1].translation[:2]),
        l1=l1,
        l2=float(arm.tip_placement.translation[0]),
        m2=float(two.mass),
        c2=float(two.lever[0]),
        first=float(inertia),
        i2=float(two.inertia[2, 2]),
        side=float(np.sign(posture[1])),
    )
