"""Two planar arms with any number of hinges in CasADi: Newton and Euler link by link.

With absolute angles a link costs one sine, one cosine and some twenty products; velocities and
accelerations of the hands come along, so that closure needs no Jacobian.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pinocchio as pin

from peers.casadi_dynamics import Dynamics
from peers.task import Task, Terminal

_FLAT = 1e-9


@dataclass(frozen=True, eq=False)
class _Hand:
    """A point of the last link: position, acceleration, angle, angular acceleration."""

    position: tuple[ca.SX, ca.SX]
    acceleration: tuple[ca.SX, ca.SX]
    angle: ca.SX
    angular_acceleration: ca.SX


@dataclass(frozen=True, eq=False)
class _Link:
    """What a link asks of its joint, and the way to the next joint."""

    force: tuple[ca.SX, ca.SX]
    moment: ca.SX
    sign: float
    lever: tuple[ca.SX, ca.SX]


def is_covered(task: Task) -> bool:
    """Whether all joints are hinges about z and the pair is a hinge or rigid."""
    chain = task.chain
    if chain.normal is None or not np.allclose(np.abs(chain.normal), [0.0, 0.0, 1.0]):
        return False
    hinges = all(np.abs(_axis(chain.dynamics.model, i)) > 0.5 for i in range(chain.n))
    frames = [placement.rotation for placement in chain.dynamics.model.jointPlacements[1:]]
    upright = all(np.allclose(np.abs(r[2]), [0.0, 0.0, 1.0], atol=_FLAT) for r in frames)
    return hinges and upright and all(r[2, 2] > 0.0 for r in frames) and chain.m in (2, 3)


def planar_dynamics(task: Task) -> Dynamics:
    """Returns the mechanism's dynamics, its numbers read from the Pinocchio model."""
    chain = task.chain
    split, n, m = chain.left.n, chain.n, chain.m
    q, v, a = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("a", n)
    wrench = ca.SX.sym("wrench", m)
    grasp = chain.object_in_left * chain.grasp_in_object
    load = (wrench[0], wrench[1], wrench[2] if m == 3 else 0.0)
    away = tuple(-part for part in load)
    left = _Arm(task, 0, split, q, v, a)
    right = _Arm(task, split, n, q, v, a)
    on_left, on_right = left.point(grasp), right.point(chain.right.tip_placement)
    tau = ca.vertcat(*left.torques(grasp, load), *right.torques(chain.right.tip_placement, away))
    gap = _difference(on_right.position, on_left.position)
    acceleration = _difference(on_right.acceleration, on_left.acceleration)
    if m == 3:
        offset = _angle(chain.right.tip_placement) - _angle(grasp)
        turn = on_right.angle - on_left.angle + offset
        gap.append(ca.atan2(ca.sin(turn), ca.cos(turn)))
        acceleration.append(on_right.angular_acceleration - on_left.angular_acceleration)
    body = left.point(chain.object_in_left)

    def pose(end: Terminal) -> ca.Function:
        rows = _difference(body.position, (float(end.position[0]), float(end.position[1])))
        if end.rotation is not None:
            wanted = np.arctan2(end.rotation[1, 0], end.rotation[0, 0])
            turn = body.angle + _angle(chain.object_in_left) - wanted
            rows.append(ca.atan2(ca.sin(turn), ca.cos(turn)))
        return ca.Function("pose", [q], [ca.vertcat(*rows)])

    return Dynamics(
        point=ca.Function("point", [q, v, a, wrench], [tau, ca.vertcat(*acceleration)]),
        gap=ca.Function("gap", [q], [ca.vertcat(*gap)]),
        start=pose(task.start),
        goal=pose(task.goal),
        wrench=(0, 1, 5)[:m],
    )


class _Arm:
    """Forward recursion of one arm; the object is part of the left one's last link."""

    def __init__(self, task: Task, first: int, last: int, q: ca.SX, v: ca.SX, a: ca.SX) -> None:
        model, gravity = task.chain.dynamics.model, task.chain.gravity
        self.links: list[_Link] = []
        angle, spin, turn = 0.0, 0.0, 0.0
        origin, lifted = (0.0, 0.0), (0.0, 0.0)
        lever, sine, cosine = (0.0, 0.0), 0.0, 1.0
        for joint in range(first, last):
            placement = model.jointPlacements[joint + 1]
            step = placement.translation
            if joint == first:
                origin = (float(step[0]), float(step[1]))
            else:
                lever = _turned(sine, cosine, step)  # of the link before
                origin = _sum(origin, lever)
                lifted = _sum(lifted, _swing(lever, spin, turn))
                self.links[-1] = _with_lever(self.links[-1], lever)
            sign = float(np.sign(_axis(model, joint)))
            angle = angle + _angle(placement) + sign * q[joint]
            spin, turn = spin + sign * v[joint], turn + sign * a[joint]
            sine, cosine = ca.sin(angle), ca.cos(angle)
            inertia = model.inertias[joint + 1]
            to_com = _turned(sine, cosine, inertia.lever)
            pull = _sum(_sum(lifted, _swing(to_com, spin, turn)), (-gravity[0], -gravity[1]))
            force = (inertia.mass * pull[0], inertia.mass * pull[1])
            moment = inertia.inertia[2, 2] * turn + _cross(to_com, force)
            self.links.append(_Link(force, moment, sign, lever))
        self.sine, self.cosine = sine, cosine
        self.angle, self.spin, self.turn = angle, spin, turn
        self.origin, self.lifted = origin, lifted

    def point(self, placement: pin.SE3) -> _Hand:
        """Returns a point of the last link."""
        lever = _turned(self.sine, self.cosine, placement.translation)
        return _Hand(
            _sum(self.origin, lever),
            _sum(self.lifted, _swing(lever, self.spin, self.turn)),
            self.angle,
            self.turn,
        )

    def torques(self, placement: pin.SE3, load: tuple) -> list[ca.SX]:
        """Returns the joint torques if the last link exerts a load (force, moment) at a point."""
        force, moment = (load[0], load[1]), load[2]
        last = _turned(self.sine, self.cosine, placement.translation)
        result = []
        for link in reversed([*self.links[:-1], _with_lever(self.links[-1], last)]):
            moment = moment + link.moment + _cross(link.lever, force)
            force = _sum(force, link.force)
            result.append(link.sign * moment)
        return result[::-1]


def _axis(model: pin.Model, joint: int) -> float:
    """Returns the z component of a joint's axis: 1 or -1, and 0 for a slider."""
    kind = model.joints[joint + 1]
    data = kind.createData()
    kind.calc(data, np.zeros(1))
    return float(np.ravel(data.S)[5])


def _angle(placement: pin.SE3) -> float:
    return float(np.arctan2(placement.rotation[1, 0], placement.rotation[0, 0]))


def _with_lever(link: _Link, lever: tuple) -> _Link:
    return _Link(link.force, link.moment, link.sign, lever)


def _turned(sine: ca.SX, cosine: ca.SX, step: np.ndarray) -> tuple:
    x, y = float(step[0]), float(step[1])
    return cosine * x - sine * y, sine * x + cosine * y


def _swing(lever: tuple, spin: ca.SX, turn: ca.SX) -> tuple:
    square = spin * spin
    return -turn * lever[1] - square * lever[0], turn * lever[0] - square * lever[1]


def _sum(one: tuple, other: tuple) -> tuple:
    return one[0] + other[0], one[1] + other[1]


def _difference(one: tuple, other: tuple) -> list:
    return [one[0] - other[0], one[1] - other[1]]


def _cross(one: tuple, other: tuple) -> ca.SX:
    return one[0] * other[1] - one[1] * other[0]
