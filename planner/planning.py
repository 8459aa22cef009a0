"""From a scenario to a plan: the whole way in one call."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from planner.assembly import build_chain
from planner.chain import ClosedChain
from planner.checks import verify
from planner.criteria import joint_weights
from planner.criteria.jerk import jerk_motion
from planner.forces import hand_forces
from planner.outcome import Failure, failure
from planner.result import Plan
from planner.solution import ProgressCallback, Solution
from planner.solving import solve
from planner.transport import Transport, make_transport

if TYPE_CHECKING:
    from planner.scenario import Scenario


def plan(
    scenario: Scenario,
    *,
    progress: ProgressCallback | None = None,
    chain: ClosedChain | None = None,
    start: Plan | None = None,
) -> Plan | Failure:
    """Plans how both arms carry the object.

    Args:
        scenario: What is asked, from `planner.load`.
        progress: Called once per mesh refinement.
        chain: The scenario's closed chain if it was built before, to save reading the URDFs.
        start: Plan of a similar task of the same arms, to start from: another object, goal or
            duration.

    Returns:
        The plan, or a named failure with its reason and a remedy; `unwrap()` gives the plan or
        raises.

    Raises:
        InputError: The scenario or one of its files cannot be used.
    """
    began = time.perf_counter()
    chain = chain or build_chain(scenario)
    transport = make_transport(scenario, chain, near=None if start is None else start.q)
    if scenario.criterion.kind == "jerk":
        return _least_jerk(scenario, transport, began)
    solution = solve(scenario, transport, progress=progress, start=start)
    if isinstance(solution, Failure):
        return solution
    result = sample(scenario, solution)
    result = replace(result, checks=verify(chain, result, solution))
    return replace(result, solver=result.solver | {"seconds_total": time.perf_counter() - began})


def sample(scenario: Scenario, solution: Solution) -> Plan:
    """Returns the plan at evenly spaced times, its checks still empty."""
    transport, criterion = solution.problem.transport, solution.problem.criterion
    share = np.linspace(0.0, 1.0, scenario.solver.samples)
    x, at = solution.evaluate(share)
    forces = hand_forces(transport.chain, at.motion)
    position, rotation = transport.chain.object_pose(at.tangent.at)
    return Plan(
        scenario=scenario,
        criterion=criterion.name,
        cost=solution.cost,
        duration=transport.duration,
        solver={
            "method": solution.method,
            "nodes": len(solution.mesh),
            "iterations": solution.iterations,
            "rms_residual": solution.residual,
            "seconds": solution.seconds,
        },
        checks={},
        remarks=solution.remarks,
        time=share * transport.duration,
        joint_names=transport.chain.joint_names,
        q=at.tangent.q,
        v=at.motion.v,
        a=at.motion.a,
        tau=np.array(at.tau),
        tau_rate=criterion.torque_rate(solution.problem.coordinates, share, x, at),
        object_position=position,
        object_rotation=rotation,
        hand_force_left=forces.left_force,
        hand_force_right=forces.right_force,
        hand_moment_left=forces.left_moment,
        hand_moment_right=forces.right_moment,
        internal_force=forces.left_force - forces.right_force,
        adjoint=x[:, criterion.state_size :].copy(),
    )


def _least_jerk(scenario: Scenario, transport: Transport, began: float) -> Plan | Failure:
    """Returns the minimum-jerk plan, which needs no boundary value problem."""
    chain = transport.chain
    share = np.linspace(0.0, 1.0, scenario.solver.samples)
    found = jerk_motion(transport, share, joint_weights(scenario, chain))
    seconds = time.perf_counter() - began
    if isinstance(found, float):
        return failure(
            "closure-lost",
            f"the arms cannot follow the straight line of least jerk beyond t = {found:.3f} s",
            scenario,
            time=found,
        )
    forces = hand_forces(chain, found.motion)
    position, rotation = chain.object_pose(found.motion.tangent.at)
    result = Plan(
        scenario=scenario,
        criterion="jerk",
        cost=found.cost,
        duration=transport.duration,
        solver={
            "method": "closed-form",
            "nodes": len(share),
            "iterations": 0,
            "rms_residual": 0.0,
            "seconds": seconds,
        },
        checks={},
        remarks=(),
        time=share * transport.duration,
        joint_names=chain.joint_names,
        q=found.motion.tangent.q,
        v=found.motion.v,
        a=found.motion.a,
        tau=found.tau,
        tau_rate=found.tau_rate,
        object_position=position,
        object_rotation=rotation,
        hand_force_left=forces.left_force,
        hand_force_right=forces.right_force,
        hand_moment_left=forces.left_moment,
        hand_moment_right=forces.right_moment,
        internal_force=forces.left_force - forces.right_force,
        adjoint=np.empty((len(share), 0)),
    )
    result = replace(result, checks=verify(chain, result, None))
    return replace(result, solver=result.solver | {"seconds_total": time.perf_counter() - began})
