"""The closed chain: two arms, the object between them, and the pair that joins them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from planner.arm import Arm
from planner.body import Body
from planner.closure import Loop, LoopOrder
from planner.equation_of_motion import EquationOfMotion, Placements
from planner.pairs import Pair, across
from planner.vectors import cross, matvec, transpose, wrap, wrapped_cross

CLOSURE_TOLERANCE = 1e-12
_MAX_NEWTON_STEPS = 30
_LARGEST_STEP = 0.4  # rad or m: a longer Newton step would leave the branch it started on


@dataclass(frozen=True, eq=False)
class ClosedChain:
    """Two arms that hold one object.

    The object is fixed to the left hand, its inertia lumped there; the pair joins it to the right.
    Joint vectors hold the left arm's joints, then the right arm's.

    Attributes:
        left: The left arm.
        right: The right arm.
        body: The object.
        pair: The pair between object and right hand.
        gravity: (3,) [m/s^2].
        normal: Normal of the plane of motion in the world if the mechanism is planar, else None.
        object_in_left: The object's frame in the body that carries the left hand.
        grasp_in_object: The right hand's grasp frame in the object's.
        orientation: Whether the task prescribes the object's orientation at either end.
        dynamics: Equation of motion of both arms and the object.
    """

    left: Arm
    right: Arm
    body: Body
    pair: Pair
    gravity: np.ndarray
    normal: np.ndarray | None
    object_in_left: pin.SE3
    grasp_in_object: pin.SE3
    orientation: bool
    dynamics: EquationOfMotion

    # ---- sizes -------------------------------------------------------------------------------

    @property
    def arms(self) -> tuple[Arm, Arm]:
        """Both arms, left first."""
        return self.left, self.right

    @cached_property
    def n(self) -> int:
        """Number of joints of both arms."""
        return self.left.n + self.right.n

    @cached_property
    def m(self) -> int:
        """Number of closure rows."""
        return self.pair.m

    @cached_property
    def p(self) -> int:
        """Degrees of freedom of the closed chain."""
        return self.n - self.m

    @property
    def r(self) -> int:
        """Number of object coordinates that the task prescribes."""
        return len(self.task_rows(self.orientation))

    @property
    def redundant(self) -> bool:
        """Whether the arms can move while the object stays as the task prescribes it."""
        return self.p > self.r

    @property
    def planar(self) -> bool:
        """Whether all joints move in one plane."""
        return self.normal is not None

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of all joints; with the side in front where both arms use the same name."""
        names = [*self.left.joint_names, *self.right.joint_names]
        if len(set(names)) == len(names):
            return tuple(names)
        return tuple(f"{arm.side}/{name}" for arm in self.arms for name in arm.joint_names)

    def both(self, attribute: str) -> np.ndarray:
        """Returns a per-joint attribute of the arms for all joints, (N,)."""
        return np.concatenate([getattr(arm, attribute) for arm in self.arms])

    @cached_property
    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper limits of all joints, each (N,) [rad]."""
        return self.both("lower"), self.both("upper")

    # ---- kinematics --------------------------------------------------------------------------

    def object_pose(self, at: Placements) -> tuple[np.ndarray, np.ndarray]:
        """Returns the object's position, (K, 3) [m], and rotation, (K, 3, 3)."""
        position = at.left_translation + at.left_rotation @ self.object_in_left.translation
        return position, at.left_rotation @ self.object_in_left.rotation

    def right_tip(self, at: Placements) -> tuple[np.ndarray, np.ndarray]:
        """Returns the right hand's position, (K, 3) [m], and rotation, (K, 3, 3)."""
        return self._right_point(at), at.right_rotation @ self._tip[1]

    def grasp_pose(self, at: Placements) -> tuple[np.ndarray, np.ndarray]:
        """Returns where the object wants the right hand: position (K, 3) and rotation."""
        place, turn = self._grasp
        return at.left_translation + at.left_rotation @ place, at.left_rotation @ turn

    @cached_property
    def _grasp(self) -> tuple[np.ndarray, np.ndarray]:
        """Translation and rotation of the grasp in the body that carries the left hand."""
        grasp = self.object_in_left * self.grasp_in_object
        return np.array(grasp.translation), np.array(grasp.rotation)

    @cached_property
    def _tip(self) -> tuple[np.ndarray, np.ndarray]:
        """Translation and rotation of the right hand in the body that carries it."""
        tip = self.right.tip_placement
        return np.array(tip.translation), np.array(tip.rotation)

    def _right_point(self, at: Placements) -> np.ndarray:
        """Returns the right hand's position, (K, 3) [m]."""
        point: np.ndarray = at.right_translation + at.right_rotation @ self._tip[0]
        return point

    def gap(self, at: Placements) -> np.ndarray:
        """Returns the closure g(q) (eq. 1), zero where both hands hold the object, (K, m)."""
        (wanted, frame), (point, rotation) = self.grasp_pose(at), self.right_tip(at)
        return self.pair.gap(frame, point - wanted, rotation)

    @cached_property
    def _order(self) -> LoopOrder:
        split = self.left.n
        return LoopOrder(np.r_[np.arange(split)[::-1], np.arange(split, self.n)])

    @cached_property
    def _sense(self) -> np.ndarray:
        """Sense in which joints turn along the loop: against their own from hand to base, (N,)."""
        return np.where(np.arange(self.n) < self.left.n, -1.0, 1.0)

    def loop(self, at: Placements) -> Loop:
        """Returns the twist columns of the loop from the left hand to the right."""
        count = len(at.columns)
        frame = at.left_rotation @ self._grasp[1]
        inverse = transpose(frame)
        columns = inverse[:, None] @ at.columns.reshape(count, 2, 3, self.n)
        columns *= self._sense
        point = wrap((self._right_point(at)[:, None, :] @ frame)[:, 0].T)[..., None]
        angular = wrap(columns[:, 1].transpose(1, 0, 2))
        linear = wrapped_cross(angular, point)
        linear += wrap(columns[:, 0].transpose(1, 0, 2))
        turning = self.pair.rotation != "free"
        return Loop(linear, angular, frame, self.pair.blocked, self._order, turning)

    def closure_columns(self, at: Placements, joints: np.ndarray) -> np.ndarray:
        """Returns some columns of the closure's Jacobian, (K, m, len(joints))."""
        point = self._right_point(at)
        inverse = transpose(at.left_rotation @ self._grasp[1])
        # as wrenches at the world's origin, where the columns are taken
        rows = np.empty((len(point), self.m, 6))
        force = self.pair.blocked[:, :3] @ inverse
        rows[:, :, :3] = force
        rows[:, :, 3:] = cross(point[:, None, :], force)
        if self.pair.rotation != "free":
            rows[:, :, 3:] += self.pair.blocked[:, 3:] @ inverse
        result: np.ndarray = rows @ (at.columns[:, :, joints] * self._sense[joints])
        return result

    def object_jacobian(self, at: Placements) -> np.ndarray:
        """Returns the object's twist (linear at its origin; angular) per joint rate, (K, 6, N)."""
        position, _ = self.object_pose(at)
        split = self.left.n
        result = np.zeros_like(at.columns)
        angular = at.columns[:, 3:, :split]
        result[:, 3:, :split] = angular
        result[:, :3, :split] = at.columns[:, :3, :split] + transpose(
            cross(transpose(angular), position[:, None, :])
        )
        return result

    @cached_property
    def _position_rows(self) -> np.ndarray:
        linear = np.eye(3) if self.normal is None else across(self.normal)
        return np.hstack([linear, np.zeros_like(linear)])

    @cached_property
    def _pose_rows(self) -> np.ndarray:
        angular = np.eye(3) if self.normal is None else self.normal[None, :]
        turning = np.hstack([np.zeros_like(angular), angular])
        return np.vstack([self._position_rows, turning])

    def task_rows(self, orientation: bool) -> np.ndarray:
        """Returns rows that select the prescribed part of the object's twist, (r, 6).

        Args:
            orientation: Whether the orientation is prescribed besides the position.
        """
        return self._pose_rows if orientation else self._position_rows

    def close(
        self, guess: np.ndarray, dependent: np.ndarray, tolerance: float = CLOSURE_TOLERANCE
    ) -> tuple[np.ndarray, Placements, np.ndarray]:
        """Returns phi: the dependent joints moved until the chain is closed, by Newton's method.

        Args:
            guess: Postures near closure, (K, N) [rad].
            dependent: Indices of the m joints that may move, (m,).
            tolerance: Bound on the gap [m, rad].

        Returns:
            The closed postures, their placements, and which of them are closed, (K,). Postures
            that are out of reach stay open.
        """
        q = np.array(guess, dtype=float)
        at = self.dynamics.placements(q)
        error = self.gap(at)
        for _ in range(_MAX_NEWTON_STEPS):
            size = np.abs(error).max(axis=1, initial=0.0)
            if size.max(initial=0.0) < tolerance:
                break
            open_ = np.flatnonzero((size >= tolerance) & np.isfinite(size))
            if not len(open_):
                break
            # a step more does no harm where it is not needed, and picking samples costs as much
            everywhere = 2 * len(open_) > len(q) and bool(np.isfinite(size).all())
            part, wrong = (at, error) if everywhere else (at.part(open_), error[open_])
            step = _solve(self.closure_columns(part, dependent), wrong)
            largest = np.abs(step).max(axis=1)
            step *= np.minimum(1.0, _LARGEST_STEP / np.maximum(largest, 1e-300))[:, None]
            moved = q if everywhere else q[open_]
            moved[:, dependent] -= step
            new = self.dynamics.placements(moved)
            new_error = self.gap(new)
            # near round-off a step no longer helps: accept what stands below a looser bound
            stuck = (largest < 1e-14) & ((size if everywhere else size[open_]) < 1e-10)
            new_error[stuck] = 0.0
            if everywhere:
                at, error = new, new_error
            else:
                q[open_], error[open_] = moved, new_error
                _put(at, open_, new)
        size = np.abs(error).max(axis=1, initial=0.0)
        # what round-off keeps from the last digits is closed all the same
        return q, at, size < max(tolerance, 100.0 * CLOSURE_TOLERANCE)


def _solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solves a batch of small systems; a singular one gets its least-norm answer."""
    try:
        return np.linalg.solve(matrix, right[..., None])[..., 0]
    except np.linalg.LinAlgError:
        return matvec(np.linalg.pinv(matrix), right)


def _put(at: Placements, index: np.ndarray, part: Placements) -> None:
    for values, new in zip(vars(at).values(), vars(part).values(), strict=True):
        values[index] = new
