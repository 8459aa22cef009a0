"""Pinocchio's own constrained dynamics of the same mechanisms, set up in two independent ways.

`direct` joins the hands of the planner's model by one constraint: a point (3D) or a rigid one (6D).
`explicit` leaves the object out of the left hand, hangs it on the right one by passive joints
that stand for the pair, and welds it to the left: there any pair is a rigid constraint, whose
derivatives Pinocchio gets right. (Those of a 3D constraint that closes a loop deviate, in 4.1,
from differences of its own accelerations.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from mechanisms import Mechanism, differences

from planner.assembly import build_chain
from planner.pairs import across

SETTINGS = (1e-14, 1e-14, 1e-6, 50)
_PASSIVE = {
    "revolute": (pin.JointModelRZ,),
    "spherical": (pin.JointModelRZ, pin.JointModelRY, pin.JointModelRX),
    "cylindrical": (pin.JointModelPZ, pin.JointModelRZ),
    "prismatic": (pin.JointModelPZ,),
    "planar": (pin.JointModelPX, pin.JointModelPY, pin.JointModelRZ),
    "rigid": (),
}


@dataclass(frozen=True, eq=False)
class Answer:
    """What Pinocchio says of one state.

    The wrench (force; moment) is the one that the constraint puts on the first of the two bodies
    it joins, in the constraint's frame there; derivatives are along all its joints.
    """

    a: np.ndarray
    wrench: np.ndarray
    a_q: np.ndarray
    a_v: np.ndarray
    a_tau: np.ndarray
    wrench_q: np.ndarray
    wrench_v: np.ndarray
    wrench_tau: np.ndarray


def solve(
    model: pin.Model,
    constraint: pin.RigidConstraintModel,
    q: np.ndarray,
    v: np.ndarray,
    tau: np.ndarray,
) -> Answer:
    """Pinocchio's constrained dynamics and their derivatives at one state."""
    constraints, work = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    constraints.append(constraint)
    work.append(constraint.createData())
    data = model.createData()
    pin.initConstraintDynamics(model, data, constraints, work)
    settings = pin.ProximalSettings(*SETTINGS)
    a = pin.constraintDynamics(model, data, q, v, tau, constraints, work, settings).copy()
    wrench = work[0].contact_force.vector.copy()
    derivatives = pin.computeConstraintDynamicsDerivatives(model, data, constraints, work, settings)
    return Answer(a, wrench, *(np.array(part) for part in derivatives))


def _hands(mechanism: Mechanism, model: pin.Model) -> tuple[int, int]:
    return tuple(
        model.getJointId(f"{arm.side}/{arm.model.names[arm.tip_joint]}")
        for arm in mechanism.chain.arms
    )


def direct(mechanism: Mechanism, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> Answer:
    """The hands joined by one constraint, its frame the right hand's grasp on the object."""
    chain, model = mechanism.chain, mechanism.chain.dynamics.model
    left, right = _hands(mechanism, model)
    firm = chain.pair.name == "rigid"
    constraint = pin.RigidConstraintModel(
        pin.ContactType.CONTACT_6D if firm else pin.ContactType.CONTACT_3D,
        model,
        left,
        chain.object_in_left * chain.grasp_in_object,
        right,
        chain.right.tip_placement,
        pin.ReferenceFrame.LOCAL,
    )
    return solve(model, constraint, q, v, tau)


class Explicit:
    """The object on the right hand, the pair between them made of passive joints."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        chain = mechanism.chain
        empty = build_chain(mechanism.scenario.override({"object.mass": 0.0}))
        self.model = empty.dynamics.model.copy()
        self.n = chain.n
        left, right = _hands(mechanism, self.model)
        axis = chain.pair.axis
        # passive joints move along and about z of this frame
        along = pin.SE3(np.vstack([across(axis), axis]).T, np.zeros(3))
        parent, placement = right, chain.right.tip_placement * along
        for place, kind in enumerate(_PASSIVE[chain.pair.name]):
            parent = self.model.addJoint(parent, kind(), placement, f"passive{place}")
            placement = pin.SE3.Identity()
        self._object_joint = parent
        self._object = placement * along.inverse() * chain.grasp_in_object.inverse()
        self.model.appendBodyToJoint(parent, chain.body.as_inertia(), self._object)
        self._left = left
        self.constraint = pin.RigidConstraintModel(
            pin.ContactType.CONTACT_6D,
            self.model,
            left,
            chain.object_in_left,
            parent,
            self._object,
            pin.ReferenceFrame.LOCAL,
        )

    def _where(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Object on the right as seen from the left hand, and the derivative of that, (6, .)."""
        data = self.model.createData()
        pin.computeJointJacobians(self.model, data, q)
        at_left = data.oMi[self._left] * self.mechanism.chain.object_in_left
        at_right = data.oMi[self._object_joint] * self._object
        left = pin.getJointJacobian(self.model, data, self._left, pin.WORLD)
        right = pin.getJointJacobian(self.model, data, self._object_joint, pin.WORLD)
        apart = at_left.actInv(at_right)
        return pin.log6(apart).vector, at_right.toActionMatrixInverse() @ (right - left)

    def posture(self, q: np.ndarray) -> np.ndarray:
        """The arms' posture with that of the passive joints."""
        full = np.concatenate([q, np.zeros(self.model.nv - self.n)])
        for _ in range(20):
            apart, slope = self._where(full)
            full[self.n :] -= np.linalg.pinv(slope[:, self.n :]) @ apart
        assert np.max(np.abs(apart)) < 1e-10
        return full

    def velocity(self, full: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The arms' velocity, or several as columns, with that of the passive joints."""
        slope = self._where(full)[1]
        passive = -np.linalg.pinv(slope[:, self.n :]) @ slope[:, : self.n] @ v
        return np.concatenate([v, passive])

    def solve(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> Answer:
        """Accelerations of all joints, passive ones last."""
        full = self.posture(q)
        load = np.concatenate([tau, np.zeros(self.model.nv - self.n)])
        return solve(self.model, self.constraint, full, self.velocity(full, v), load)

    def freedoms(self, q: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """S and dv/dy at constant rates of the independent joints, passive joints included."""
        mechanism = self.mechanism
        s = self.velocity(self.posture(q), mechanism.freedoms(q[None]).s[0])

        def velocity(shift: np.ndarray) -> np.ndarray:
            moved = mechanism.shifted(q[None], shift[None])
            v = mechanism.freedoms(moved).s[0] @ rate
            return self.velocity(self.posture(moved[0]), v)

        return s, differences(velocity, mechanism.chain.p, 1e-3)
