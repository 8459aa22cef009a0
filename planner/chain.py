"""The closed chain: two arms, the object between them, and the pair that joins them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from planner.arm import Arm, Side, read_arm
from planner.body import Body, read_object
from planner.closure import Loop
from planner.equation_of_motion import EquationOfMotion, Placements
from planner.errors import ModelError
from planner.pairs import Pair, across, make_pair
from planner.vectors import cross, matvec, rotation_log, transpose

if TYPE_CHECKING:
    from planner.scenario import Scenario

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

    @property
    def n(self) -> int:
        """Number of joints of both arms."""
        return self.left.n + self.right.n

    @property
    def m(self) -> int:
        """Number of closure rows."""
        return self.pair.m

    @property
    def p(self) -> int:
        """Degrees of freedom of the closed chain."""
        return self.n - self.m

    @property
    def r(self) -> int:
        """Number of object coordinates that the task prescribes."""
        return len(self.task_rows(self.orientation))

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

    # ---- kinematics --------------------------------------------------------------------------

    def object_pose(self, at: Placements) -> tuple[np.ndarray, np.ndarray]:
        """Returns the object's position, (K, 3) [m], and rotation, (K, 3, 3)."""
        position = at.left_translation + at.left_rotation @ self.object_in_left.translation
        return position, at.left_rotation @ self.object_in_left.rotation

    def right_tip(self, at: Placements) -> tuple[np.ndarray, np.ndarray]:
        """Returns the right hand's position, (K, 3) [m], and rotation, (K, 3, 3)."""
        tip = self.right.tip_placement
        return (
            at.right_translation + at.right_rotation @ tip.translation,
            at.right_rotation @ tip.rotation,
        )

    def grasp_pose(self, at: Placements) -> tuple[np.ndarray, np.ndarray]:
        """Returns where the object wants the right hand: position (K, 3) and rotation."""
        position, rotation = self.object_pose(at)
        grasp = self.grasp_in_object
        return position + rotation @ grasp.translation, rotation @ grasp.rotation

    def offset(self, at: Placements) -> np.ndarray:
        """Returns the right hand's offset (position; rotation) from its grasp, (K, 6) [m, rad].

        Components are those of the grasp frame. Of the rotation, what the pair leaves free is
        left out.
        """
        wanted, frame = self.grasp_pose(at)
        position, rotation = self.right_tip(at)
        result = np.zeros((len(position), 6))
        result[:, :3] = matvec(transpose(frame), position - wanted)
        relative = transpose(frame) @ rotation
        if self.pair.rotation == "blocked":
            result[:, 3:] = rotation_log(relative)
        elif self.pair.rotation == "axis":
            turned = relative @ self.pair.axis
            result[:, 3:] = cross(self.pair.axis, turned)
            # beyond a right angle the cross product falls again: keep the sense of the way back
            result[:, 3:] /= np.maximum(np.linalg.norm(result[:, 3:], axis=1), 1e-300)[:, None]
            angle = np.arctan2(
                np.linalg.norm(cross(self.pair.axis, turned), axis=1), turned @ self.pair.axis
            )
            result[:, 3:] *= angle[:, None]
        return result

    def gap(self, at: Placements) -> np.ndarray:
        """Returns the closure g(q) (eq. 1), zero where both hands hold the object, (K, m)."""
        return self.offset(at) @ self.pair.blocked.T

    def loop(self, at: Placements) -> Loop:
        """Returns the twist columns of the loop from the left hand to the right."""
        point, _ = self.right_tip(at)
        split = self.left.n
        angular = np.ascontiguousarray(transpose(at.columns[:, 3:]))
        linear = transpose(at.columns[:, :3]) + cross(angular, point[:, None, :])
        # from the left hand to the base the joints turn the other way
        angular[:, :split] *= -1.0
        linear[:, :split] *= -1.0
        order = np.r_[np.arange(split)[::-1], np.arange(split, self.n)]
        frame = self.grasp_pose(at)[1]
        blocked = np.empty((len(point), self.m, 6))
        blocked[..., :3] = self.pair.blocked[:, :3] @ transpose(frame)
        blocked[..., 3:] = self.pair.blocked[:, 3:] @ transpose(frame)
        turning = self.pair.rotation != "free"
        return Loop(linear[:, order], angular[:, order], blocked, order, turning)

    def closure_columns(self, at: Placements, joints: np.ndarray) -> np.ndarray:
        """Returns some columns of the closure's Jacobian, (K, m, len(joints))."""
        point, _ = self.right_tip(at)
        frame = transpose(self.grasp_pose(at)[1])
        columns = at.columns[:, :, joints]
        sign = np.where(joints < self.left.n, -1.0, 1.0)
        linear, angular = columns[:, :3] * sign, columns[:, 3:] * sign
        moving = linear + transpose(cross(transpose(angular), point[:, None, :]))
        result: np.ndarray = self.pair.blocked[:, :3] @ (frame @ moving)
        if self.pair.rotation != "free":
            result = result + self.pair.blocked[:, 3:] @ (frame @ angular)
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
            size = np.max(np.abs(error), axis=1, initial=0.0)
            with np.errstate(invalid="ignore"):
                closed = size < tolerance
            open_ = np.flatnonzero(~closed & np.isfinite(size))
            if not len(open_):
                break
            part = _take(at, open_)
            step = -_solve(self.closure_columns(part, dependent), error[open_])
            largest = np.max(np.abs(step), axis=1)
            step *= np.minimum(1.0, _LARGEST_STEP / np.maximum(largest, 1e-300))[:, None]
            # near round-off a step no longer helps: accept what stands below a looser bound
            moved = q[open_]
            moved[:, dependent] += step
            new = self.dynamics.placements(moved)
            new_error = self.gap(new)
            stuck = (largest < 1e-14) & (size[open_] < 1e-10)
            q[open_], error[open_] = moved, np.where(stuck[:, None], 0.0, new_error)
            _put(at, open_, new)
        size = np.max(np.abs(error), axis=1, initial=0.0)
        return q, at, size < 100.0 * max(tolerance, CLOSURE_TOLERANCE)


def _solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solves a batch of small systems; a singular one gets its least-norm answer."""
    try:
        return np.linalg.solve(matrix, right[..., None])[..., 0]
    except np.linalg.LinAlgError:
        return matvec(np.linalg.pinv(matrix), right)


def _take(at: Placements, index: np.ndarray) -> Placements:
    if len(index) == len(at.columns):
        return at
    return Placements(*(getattr(at, name)[index] for name in at.__dataclass_fields__))


def _put(at: Placements, index: np.ndarray, part: Placements) -> None:
    for name in at.__dataclass_fields__:
        getattr(at, name)[index] = getattr(part, name)


def build_chain(scenario: Scenario) -> ClosedChain:
    """Returns the closed chain that a scenario describes.

    Raises:
        ModelError: A URDF cannot be used, or arms and pair do not make a mechanism that can move.
    """
    left, right = read_arm(scenario, "left"), read_arm(scenario, "right")
    _refuse_shared_joints(scenario, left, right)
    body = read_object(scenario)
    gravity = np.array(scenario.world.gravity, dtype=float)
    left_grasp, right_grasp = _grasp(scenario, "left"), _grasp(scenario, "right")
    object_in_left = left.tip_placement * left_grasp.inverse()
    model, left_joint, right_joint = _join(left, right)
    model.gravity.linear = gravity
    model.appendBodyToJoint(left_joint, body.as_inertia(), object_in_left)
    dynamics = EquationOfMotion(model, left_joint, right_joint)
    normal = _plane_normal(dynamics)
    axis = np.array(scenario.grasp.axis, dtype=float)
    frame = np.eye(3)
    if normal is not None:
        at = dynamics.placements(np.zeros((1, dynamics.n)))
        frame = at.left_rotation[0] @ object_in_left.rotation @ right_grasp.rotation
        along = float(frame.T @ normal @ axis) / np.linalg.norm(axis)
        if scenario.grasp.pair in ("revolute", "cylindrical") and abs(along) < 1.0 - 1e-6:
            raise ModelError(
                "axis of the pair is not normal to the plane in which the arms move",
                source=scenario.path,
                key="grasp.axis",
                value=list(scenario.grasp.axis),
                remedy=f"choose {np.round(frame.T @ normal, 6).tolist()}",
            )
    pair = make_pair(scenario.grasp.pair, axis, None if normal is None else frame.T @ normal)
    if pair.m == 0:
        raise ModelError(
            f"a {pair.name} pair leaves arms that move in one plane free of each other",
            source=scenario.path,
            key="grasp.pair",
            value=pair.name,
            remedy="choose revolute or rigid",
        )
    chain = ClosedChain(
        left=left,
        right=right,
        body=body,
        pair=pair,
        gravity=gravity,
        normal=normal,
        object_in_left=object_in_left,
        grasp_in_object=right_grasp,
        orientation=scenario.task.start.rpy is not None or scenario.task.goal.rpy is not None,
        dynamics=dynamics,
    )
    if chain.p < chain.r:
        raise ModelError(
            f"the closed chain has {chain.p} freedoms, the task prescribes {chain.r} coordinates",
            source=scenario.path,
            key="grasp.pair",
            value=scenario.grasp.pair,
            remedy="use a pair with more freedoms or arms with more joints"
            + (", or leave out start.rpy and goal.rpy" if chain.orientation else ""),
        )
    return chain


def _grasp(scenario: Scenario, side: Side) -> pin.SE3:
    grasp = getattr(scenario, side).grasp
    return pin.SE3(pin.rpy.rpyToMatrix(*grasp.rpy), np.array(grasp.xyz, dtype=float))


def _join(left: Arm, right: Arm) -> tuple[pin.Model, int, int]:
    """Returns both arms in one model and the joints that carry the hands."""
    whole = pin.Model()
    tips = []
    for arm in (left, right):
        part = arm.model.copy()
        for joint in range(1, part.njoints):
            part.names[joint] = f"{arm.side}/{part.names[joint]}"
        for frame in part.frames:
            frame.name = f"{arm.side}/{frame.name}"
        tip = part.names[arm.tip_joint]
        whole = pin.appendModel(whole, part, 0, pin.SE3.Identity())
        tips.append(int(whole.getJointId(tip)))
    return whole, tips[0], tips[1]


def _plane_normal(dynamics: EquationOfMotion) -> np.ndarray | None:
    """Returns the unit normal of the plane in which all joints move, or None."""
    lower = np.maximum(dynamics.model.lowerPositionLimit, -np.pi)
    upper = np.minimum(dynamics.model.upperPositionLimit, np.pi)
    shares = np.array([[0.5], [0.29], [0.83]]) + np.zeros(dynamics.n)
    columns = dynamics.placements(lower + shares * (upper - lower)).columns
    axes = columns[:, 3:].transpose(0, 2, 1).reshape(-1, 3)
    turning = np.linalg.norm(axes, axis=1) > 0.5
    if not turning.any():
        return None
    normal = axes[turning][0] / np.linalg.norm(axes[turning][0])
    parallel = np.allclose(np.abs(axes[turning] @ normal), 1.0, atol=1e-9)
    sliding = columns[:, :3].transpose(0, 2, 1).reshape(-1, 3)[~turning]
    if not parallel or not np.allclose(sliding @ normal, 0.0, atol=1e-9):
        return None
    # the sense that reads best: along the positive axis nearest to it
    return normal * np.sign(normal[np.argmax(np.abs(normal))])


def _refuse_shared_joints(scenario: Scenario, left: Arm, right: Arm) -> None:
    if left.urdf.path != right.urdf.path or scenario.left.base != scenario.right.base:
        return
    shared = sorted(set(left.joint_names) & set(right.joint_names))
    if shared:
        raise ModelError(
            "both arms move with the same joints",
            source=left.urdf.path,
            key="left.joints",
            value=shared,
            remedy="list each arm's own joints in left.joints and right.joints; the others "
            "are locked at robot.posture",
        )
