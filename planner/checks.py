"""What is verified of every plan, from its samples alone where that is possible."""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.linalg import LinAlgError

from planner.chain import ClosedChain
from planner.replay import replay_checks
from planner.result import Plan
from planner.solution import Solution
from planner.vectors import matvec, transpose


def verify(chain: ClosedChain, plan: Plan, solution: Solution | None) -> dict[str, Any]:
    """Returns the checks of a plan by name.

    `closure` [m, rad], `force_balance` [N], `torque_balance` [Nm], `end_speed` [rad/s],
    `replay_end`, `replay_max` and more where these are large (see `replay_checks`), `hamiltonian`
    (its drift over the range of its terms), `pontryagin_residual` (relative residual of the adjoint
    equations), `second_variation` (the least of the cost, relative to it), `condition` (worst
    condition number of the closure), `limits` (what exceeds a limit, in words).

    Args:
        chain: The closed chain.
        plan: The plan, its checks still empty.
        solution: What it was sampled from; None if it is known in closed form.
    """
    at = chain.dynamics.placements(plan.q)
    gamma = chain.loop(at).jacobian()
    values = np.linalg.svd(gamma, compute_uv=False)
    checks: dict[str, Any] = {
        "closure": float(np.max(np.abs(chain.gap(at)))),
        "end_speed": _end_speed(chain, plan),
        "force_balance": _force_balance(chain, plan),
        "torque_balance": _torque_balance(chain, plan),
        "condition": float(np.max(values[:, 0] / values[:, -1])),
        "limits": exceeded_limits(chain, plan),
    }
    if solution is not None:
        checks["hamiltonian"] = hamiltonian_drift(solution)
        checks["pontryagin_residual"] = solution.residual
        if solution.second_variation is not None:
            with contextlib.suppress(LinAlgError):  # then it is not known
                checks["second_variation"] = solution.second_variation()
        checks |= solution.evidence
    return checks | replay_checks(chain, plan)


def hamiltonian_drift(solution: Solution) -> float:
    """Returns how much the Hamiltonian varies, relative to the range of its terms."""
    share = np.linspace(0.0, 1.0, 201)
    x, at = solution.evaluate(share)
    independent = solution.problem.transport.joints.independent
    terms = solution.problem.criterion.hamiltonian(at, x, independent)
    whole = terms.sum(axis=1)
    span = float(np.max(terms) - np.min(terms))
    return float(np.max(whole) - np.min(whole)) / span if span > 0.0 else 0.0


def _end_speed(chain: ClosedChain, plan: Plan) -> float:
    """Returns the largest joint speed at an end that shall be at rest [rad/s]."""
    speeds = [
        np.max(np.abs(plan.v[index]))
        for index, end in ((0, plan.scenario.task.start), (-1, plan.scenario.task.goal))
        if not any(end.velocity)
    ]
    return float(max(speeds, default=0.0))


def _force_balance(chain: ClosedChain, plan: Plan) -> float:
    """Returns how far the hand forces are from the object's mass times its acceleration [N].

    The acceleration is Pinocchio's own, of the object's centre of mass on the left hand.
    """
    model = chain.left.model.copy()
    joint = chain.left.tip_joint
    place = chain.object_in_left * pin.SE3(np.eye(3), chain.body.com)
    frame = model.addFrame(pin.Frame("object", joint, 0, place, pin.FrameType.OP_FRAME), False)
    data = model.createData()
    acceleration = np.empty((len(plan.time), 3))
    part = slice(0, chain.left.n)
    q, v, a = (np.ascontiguousarray(values[:, part]) for values in (plan.q, plan.v, plan.a))
    for k in range(len(acceleration)):
        pin.forwardKinematics(model, data, q[k], v[k], a[k])
        acceleration[k] = pin.getFrameClassicalAcceleration(
            model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        ).linear
    needed = chain.body.mass * (acceleration - chain.gravity)
    given = plan.hand_force_left + plan.hand_force_right
    return float(np.max(np.linalg.norm(given - needed, axis=1)))


def _torque_balance(chain: ClosedChain, plan: Plan) -> float:
    """Returns how far each arm's torques are from its own dynamics plus its hand's load [Nm].

    Each arm is taken alone, without the object, which loads it by the hand's force and moment.
    """
    at = chain.dynamics.placements(plan.q)
    position, _ = chain.object_pose(at)
    worst = 0.0
    wrenches = (
        (plan.hand_force_left, plan.hand_moment_left),
        (plan.hand_force_right, plan.hand_moment_right),
    )
    start = 0
    for arm, (force, moment) in zip(chain.arms, wrenches, strict=True):
        part = slice(start, start + arm.n)
        start += arm.n
        model = arm.model.copy()
        model.gravity.linear = chain.gravity
        data = model.createData()
        q, v, a = (np.ascontiguousarray(values[:, part]) for values in (plan.q, plan.v, plan.a))
        own = np.array([pin.rnea(model, data, *row).copy() for row in zip(q, v, a, strict=True)])
        columns = at.columns[:, :, part]
        moving = columns[:, :3] + np.cross(columns[:, 3:], position[:, :, None], axis=1)
        load = matvec(transpose(moving), force) + matvec(transpose(columns[:, 3:]), moment)
        worst = max(worst, float(np.max(np.abs(own + load - plan.tau[:, part]))))
    return worst


def exceeded_limits(chain: ClosedChain, plan: Plan) -> list[str]:
    """Returns a line for every joint that leaves its range, its speed or its effort limit."""
    lines = []
    lower, upper = chain.both("lower"), chain.both("upper")
    for values, low, high, name, unit in (
        (plan.q, lower, upper, "position", "rad"),
        (plan.v, *_around(chain.both("velocity_limit")), "speed", "rad/s"),
        (plan.tau, *_around(chain.both("effort_limit")), "torque", "Nm"),
    ):
        over = np.maximum(values - high, low - values)
        for joint in np.flatnonzero(np.max(over, axis=0) > 1e-9):
            k = int(np.argmax(over[:, joint]))
            limit = high[joint] if values[k, joint] > high[joint] else low[joint]
            lines.append(
                f"{plan.joint_names[joint]}: {name} {values[k, joint]:.3f} {unit} at "
                f"t = {plan.time[k]:.3f} s exceeds its limit {limit:.3f}"
            )
    return lines


def _around(limit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return -limit, limit
