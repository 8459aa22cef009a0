"""Two serial arms in space in CasADi: recursive Newton-Euler in body axes.

Hinges and sliders about any axis; closure of a rigid or a spherical grasp.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin

from peers.casadi_dynamics import Dynamics
from peers.task import Task, Terminal


def spatial_dynamics(task: Task) -> Dynamics:
    """Returns the mechanism's dynamics, its numbers read from the Pinocchio model.

    Raises:
        NotImplementedError: The pair is neither rigid nor spherical.
    """
    chain = task.chain
    if chain.pair.name not in ("rigid", "spherical") or chain.normal is not None:
        raise NotImplementedError(f"a {chain.pair.name} pair")
    split, n, m = chain.left.n, chain.n, chain.m
    q, v, a = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("a", n)
    wrench = ca.SX.sym("wrench", m)
    grasp, tip = chain.object_in_left * chain.grasp_in_object, chain.right.tip_placement
    left, right = _Arm(task, 0, split, q, v, a), _Arm(task, split, n, q, v, a)
    force, moment = wrench[:3], wrench[3:] if m == 6 else ca.SX.zeros(3)
    tau = ca.vertcat(*left.torques(grasp, force, moment), *right.torques(tip, -force, -moment))
    gap = right.point(tip) - left.point(grasp)
    acceleration = right.acceleration(tip) - left.acceleration(grasp)
    if m == 6:
        relative = left.turned(grasp).T @ right.turned(tip)
        gap = ca.vertcat(gap, _vee(relative))
        turn = right.rotation @ right.turn - left.rotation @ left.turn
        acceleration = ca.vertcat(acceleration, turn)

    def pose(end: Terminal) -> ca.Function:
        rows = left.point(chain.object_in_left) - end.position
        if end.rotation is not None:
            rows = ca.vertcat(rows, _vee(end.rotation.T @ left.turned(chain.object_in_left)))
        return ca.Function("pose", [q], [rows])

    return Dynamics(
        point=ca.Function("point", [q, v, a, wrench], [tau, acceleration]),
        gap=ca.Function("gap", [q], [gap]),
        start=pose(task.start),
        goal=pose(task.goal),
        wrench=tuple(range(m)),
    )


class _Arm:
    """Forward recursion of one arm in body axes; the object is part of the left one's last body."""

    def __init__(self, task: Task, first: int, last: int, q: ca.SX, v: ca.SX, a: ca.SX) -> None:
        self.model = task.chain.dynamics.model
        self.joints = range(first, last)
        self.gravity = task.chain.gravity
        self.rotations, self.steps, self.axes = [], [], []
        self.forces, self.moments = [], []
        spin, turn = ca.SX.zeros(3), ca.SX.zeros(3)
        lift = ca.SX(-self.gravity)  # gravity as an acceleration of the base
        rotation, origin = ca.SX.eye(3), ca.SX.zeros(3)
        for joint in self.joints:
            placement = self.model.jointPlacements[joint + 1]
            axis, slides = _axis(self.model, joint)
            relative, step = ca.SX(_clean(placement.rotation)), ca.SX(placement.translation)
            if slides:
                step = step + relative @ (axis * q[joint])
            else:
                relative = relative @ _about(axis, q[joint])
            lift = relative.T @ (lift + _swing(step, spin, turn))
            spin, turn = relative.T @ spin, relative.T @ turn
            if slides:
                lift = lift + axis * a[joint] + 2.0 * ca.cross(spin, axis * v[joint])
            else:
                turn = turn + axis * a[joint] + ca.cross(spin, axis * v[joint])
                spin = spin + axis * v[joint]
            origin, rotation = origin + rotation @ step, rotation @ relative
            body = self.model.inertias[joint + 1]
            com, inertia = ca.SX(body.lever), ca.SX(_clean(body.inertia))
            force = body.mass * (lift + _swing(com, spin, turn))
            moment = inertia @ turn + ca.cross(spin, inertia @ spin) + ca.cross(com, force)
            self.rotations.append(relative)
            self.steps.append(step)
            self.axes.append((axis, slides))
            self.forces.append(force)
            self.moments.append(moment)
        self.rotation, self.origin = rotation, origin
        self.spin, self.turn, self.lift = spin, turn, lift

    def point(self, placement: pin.SE3) -> ca.SX:
        """Returns a point of the last body in world axes."""
        return self.origin + self.rotation @ placement.translation

    def turned(self, placement: pin.SE3) -> ca.SX:
        """Returns the world axes of a frame of the last body."""
        return self.rotation @ placement.rotation

    def acceleration(self, placement: pin.SE3) -> ca.SX:
        """Returns a point's acceleration in world axes, gravity left in: it cancels in a gap."""
        swing = _swing(ca.SX(placement.translation), self.spin, self.turn)
        return self.rotation @ (self.lift + swing)

    def torques(self, placement: pin.SE3, force: ca.SX, moment: ca.SX) -> list[ca.SX]:
        """Returns the joint torques if the last body exerts a wrench (world axes) at a point."""
        lever = ca.SX(placement.translation)
        force = self.rotation.T @ force
        moment = self.rotation.T @ moment + ca.cross(lever, force)
        result = []
        for place in reversed(range(len(self.joints))):
            force, moment = force + self.forces[place], moment + self.moments[place]
            axis, slides = self.axes[place]
            result.append(ca.dot(axis, force if slides else moment))
            relative = self.rotations[place]
            force = relative @ force
            moment = relative @ moment + ca.cross(self.steps[place], force)
        return result[::-1]


def _axis(model: pin.Model, joint: int) -> tuple[ca.SX, bool]:
    """Returns a joint's axis in its own frame and whether it slides."""
    kind = model.joints[joint + 1]
    data = kind.createData()
    kind.calc(data, np.zeros(1))
    column = np.ravel(data.S)
    slides = bool(np.linalg.norm(column[:3]) > 0.5)
    return ca.SX(column[:3] if slides else column[3:]), slides


def _about(axis: ca.SX, angle: ca.SX) -> ca.SX:
    """Returns the rotation by an angle about an axis (Rodrigues)."""
    cosine, sine = ca.cos(angle), ca.sin(angle)
    skew, outer = ca.skew(axis), axis @ axis.T
    return ca.sparsify(outer + cosine * (ca.SX.eye(3) - outer) + sine * skew)


def _clean(matrix: np.ndarray) -> np.ndarray:
    """Returns a matrix without the dust of quarter turns, whose zeros then drop out."""
    return np.where(np.abs(matrix) < 1e-12, 0.0, matrix)


def _swing(lever: ca.SX, spin: ca.SX, turn: ca.SX) -> ca.SX:
    return ca.cross(turn, lever) + ca.cross(spin, ca.cross(spin, lever))


def _vee(rotation: ca.SX) -> ca.SX:
    """Returns sine of the angle times the axis of a rotation."""
    odd = rotation - rotation.T
    return 0.5 * ca.vertcat(odd[2, 1], odd[0, 2], odd[1, 0])
