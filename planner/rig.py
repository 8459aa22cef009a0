"""Both arms and the object joined in Pinocchio alone, the pair between them made of its joints."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from planner.chain import ClosedChain
from planner.pairs import across

_PROXIMAL = pin.ProximalSettings(1e-14, 1e-10, 30)
# pair: what it leaves free, along x, y, z (0, 1, 2) and about z (5) of a frame with z on its axis
_FREE = {
    "revolute": (5,),
    "cylindrical": (2, 5),
    "prismatic": (2,),
    "planar": (0, 1, 5),
    "rigid": (),
}
_PASSIVE = {
    0: pin.JointModelPX,
    1: pin.JointModelPY,
    2: pin.JointModelPZ,
    5: pin.JointModelRZ,
}
_BALL = 1e-3, 0.1  # share of the total mass, radius [m]


class Rig:
    """The closed chain as Pinocchio's own constrained dynamics.

    Hands that share no more than a point are joined by Pinocchio's point constraint. It has none
    for the other pairs, except a rigid one: these are made of passive joints beyond the right
    hand, which carry the object too, and the rigid constraint welds it to itself on the left hand.

    Attributes:
        model: Joints of the arms, then the passive ones.
        constraint: What closes the loop.
    """

    def __init__(self, chain: ClosedChain) -> None:
        self.model = chain.dynamics.model.copy()
        left, right = (
            int(self.model.getJointId(f"{arm.side}/{arm.model.names[arm.tip_joint]}"))
            for arm in chain.arms
        )
        point = chain.pair.rotation == "free"
        free = () if point else _FREE[chain.pair.name]
        axis = chain.pair.axis
        along = pin.SE3(np.vstack([across(axis), axis]).T, np.zeros(3))
        weld = chain.object_in_left * chain.grasp_in_object * along
        tip, placement = right, chain.right.tip_placement * along
        self._sides = (left, weld), (right, placement)
        for freedom in free:
            tip = self.model.addJoint(tip, _PASSIVE[freedom](), placement, f"passive/{freedom}")
            placement = pin.SE3.Identity()
        if free:
            self._share_object(left, weld, tip)
        kind = pin.ContactType.CONTACT_3D if point else pin.ContactType.CONTACT_6D
        self.constraint = pin.RigidConstraintModel(
            kind, self.model, left, weld, tip, placement, pin.ReferenceFrame.LOCAL
        )
        self._n, self._free = chain.n, list(free)
        self._data = self.model.createData()
        self._constraints = pin.StdVec_RigidConstraintModel()
        self._constraints.append(self.constraint)
        self._work = pin.StdVec_RigidConstraintData()
        self._work.append(self.constraint.createData())
        pin.initConstraintDynamics(self.model, self._data, self._constraints, self._work)

    def _share_object(self, left: int, weld: pin.SE3, tip: int) -> None:
        """Hands part of the left hand's body, object included, over to the passive joints.

        Pinocchio needs inertia beyond every joint, and what is welded may be split at will. Half
        of it would do if it could not lie all on the pair's axis: a ball more, the same ball less
        on the left, makes sure.
        """
        whole = self.model.inertias[left].toDynamicParameters()
        ball = pin.Inertia.FromSphere(_BALL[0] * pin.computeTotalMass(self.model), _BALL[1])
        part = 0.5 * whole + weld.act(ball).toDynamicParameters()
        self.model.inertias[left] = pin.Inertia.FromDynamicParameters(whole - part)
        self.model.inertias[tip] = weld.actInv(pin.Inertia.FromDynamicParameters(part))

    def full_state(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns position and velocity of all joints where those of the arms are q and v."""
        if not self._free:
            return q.copy(), v.copy()
        still = np.zeros(len(self._free))
        q, v = np.concatenate([q, still]), np.concatenate([v, still])
        pin.forwardKinematics(self.model, self._data, q, v)
        (grasp, carried), (hand, moving) = (
            (self._data.oMi[joint] * at, at.actInv(self._data.v[joint]))
            for joint, at in self._sides
        )
        # the grasp seen from the right hand, along and about the axes of the pair there
        apart = hand.actInv(grasp)
        twist = carried - apart.actInv(moving)
        angle = np.arctan2(apart.rotation[1, 0], apart.rotation[0, 0])
        position = np.array([*apart.translation, 0.0, 0.0, angle])
        rate = np.concatenate([apart.rotation @ twist.linear, apart.rotation @ twist.angular])
        q[self._n :], v[self._n :] = position[self._free], rate[self._free]
        return q, v

    def run(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray, step: float) -> np.ndarray:
        """Returns the arms' postures when their torques drive them, (K, N) [rad].

        Args:
            q: The first posture, (N,) [rad].
            v: The velocity there, (N,) [rad/s].
            tau: Torques at the postures and halfway between them, (2 K - 1, N) [Nm].
            step: Time between postures [s].
        """
        model, data = self.model, self._data
        constraints, work, compute = self._constraints, self._work, pin.constraintDynamics

        def acceleration(q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
            a: np.ndarray = compute(model, data, q, v, tau, constraints, work, _PROXIMAL)
            return a

        torque = np.hstack([tau, np.zeros((len(tau), len(self._free)))])
        q, v = self.full_state(q, v)
        postures = [q]
        for k in range(0, len(tau) - 1, 2):
            a1 = acceleration(q, v, torque[k]).copy()
            v2 = v + 0.5 * step * a1
            a2 = acceleration(q + 0.5 * step * v, v2, torque[k + 1]).copy()
            v3 = v + 0.5 * step * a2
            a3 = acceleration(q + 0.5 * step * v2, v3, torque[k + 1]).copy()
            v4 = v + step * a3
            a4 = acceleration(q + step * v3, v4, torque[k + 2])
            q = q + step / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
            v = v + step / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
            postures.append(q)
        return np.array(postures)[:, : self._n]
