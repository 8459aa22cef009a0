"""Forward replay: the plan's torques, integrated in Pinocchio's own constrained dynamics.

Nothing of the planner's mathematics takes part: Pinocchio closes the loop with its constraint
model and the classical Runge-Kutta method integrates. Where the object ends up tells whether the
torques really produce the motion.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from planner.chain import ClosedChain
from planner.result import Plan

_PROXIMAL = pin.ProximalSettings(1e-14, 1e-10, 30)


def can_replay(chain: ClosedChain) -> bool:
    """Returns whether Pinocchio has a constraint for the chain's pair."""
    return _constraint_type(chain) is not None


def _constraint_type(chain: ClosedChain) -> pin.ContactType | None:
    translations = np.linalg.matrix_rank(chain.pair.blocked[:, :3])
    if chain.pair.rotation == "blocked" and translations == (2 if chain.planar else 3):
        return pin.ContactType.CONTACT_6D
    if chain.pair.rotation == "free" and translations == (2 if chain.planar else 3):
        return pin.ContactType.CONTACT_3D
    return None


def constraint_model(chain: ClosedChain) -> pin.RigidConstraintModel:
    """Returns Pinocchio's constraint between the left hand's grasp and the right hand.

    Raises:
        ValueError: Pinocchio has no constraint for the pair.
    """
    kind = _constraint_type(chain)
    if kind is None:
        raise ValueError(f"no constraint model for a {chain.pair.name} pair")
    model = chain.dynamics.model
    left = model.getJointId(f"left/{chain.left.model.names[chain.left.tip_joint]}")
    right = model.getJointId(f"right/{chain.right.model.names[chain.right.tip_joint]}")
    return pin.RigidConstraintModel(
        kind,
        model,
        left,
        chain.object_in_left * chain.grasp_in_object,
        right,
        chain.right.tip_placement,
        pin.ReferenceFrame.LOCAL,
    )


def replay(chain: ClosedChain, plan: Plan) -> np.ndarray:
    """Returns the object's positions when the torques drive the arms, (N', 3) [m].

    A Runge-Kutta step spans two samples of the plan, whose torques are used as they are.

    Args:
        chain: The closed chain of the plan's scenario.
        plan: The plan; N' is every second of its samples.
    """
    model = chain.dynamics.model
    data = model.createData()
    constraint = constraint_model(chain)
    constraints = pin.StdVec_RigidConstraintModel()
    constraints.append(constraint)
    datas = pin.StdVec_RigidConstraintData()
    datas.append(constraint.createData())
    pin.initConstraintDynamics(model, data, constraints, datas)
    compute = pin.constraintDynamics

    def acceleration(q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        a: np.ndarray = compute(model, data, q, v, tau, constraints, datas, _PROXIMAL)
        return a

    tau = np.ascontiguousarray(plan.tau)
    last = (len(plan.time) - 1) // 2 * 2
    step = float(plan.time[2] - plan.time[0])
    q, v = plan.q[0].copy(), plan.v[0].copy()
    postures = [q]
    for k in range(0, last, 2):
        a1 = acceleration(q, v, tau[k]).copy()
        v2 = v + 0.5 * step * a1
        a2 = acceleration(q + 0.5 * step * v, v2, tau[k + 1]).copy()
        v3 = v + 0.5 * step * a2
        a3 = acceleration(q + 0.5 * step * v2, v3, tau[k + 1]).copy()
        v4 = v + step * a3
        a4 = acceleration(q + step * v3, v4, tau[k + 2])
        q = q + step / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
        v = v + step / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        postures.append(q)
    position, _ = chain.object_pose(chain.dynamics.placements(np.array(postures)))
    return position


def replay_error(chain: ClosedChain, plan: Plan) -> np.ndarray:
    """Returns how far the replayed object is from the planned one over time, (N',) [m]."""
    position = replay(chain, plan)
    error: np.ndarray = np.linalg.norm(
        position - plan.object_position[::2][: len(position)], axis=1
    )
    return error
