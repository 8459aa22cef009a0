"""Assembly of the closed chain: both arms and the object in one Pinocchio model, and the pair."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from planner.arm import Arm, Side, read_arm
from planner.body import read_object
from planner.chain import ClosedChain
from planner.equation_of_motion import EquationOfMotion
from planner.errors import ModelError
from planner.pairs import make_pair

if TYPE_CHECKING:
    from planner.scenario import Scenario


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
