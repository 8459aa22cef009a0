"""From a scenario to a plan: the whole way in one call."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from planner.assembly import build_chain
from planner.chain import ClosedChain
from planner.checks import verify
from planner.constrained_dynamics import Motion
from planner.criteria import joint_weights
from planner.criteria.jerk import jerk_motion
from planner.errors import InputError
from planner.forces import hand_forces
from planner.outcome import Failure, failure
from planner.result import Plan
from planner.solution import ProgressCallback, Solution
from planner.solving import solve
from planner.transport import Transport, make_transport

if TYPE_CHECKING:
    from planner.scenario import Scenario

_FLAT = 1e-6  # relative second variation that differences cannot tell from none
_SADDLE = (
    "the motion is extremal but no minimum: a small change of it lowers the cost further (see the "
    "check second_variation); several starts find a better one: --set solver.starts=8"
)


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
    if isinstance(scenario, str | Path):  # type checkers know better, people at a prompt do not
        raise InputError(
            "a plan needs the scenario itself, not its file's name",
            value=str(scenario),
            remedy="planner.load reads it: planner.plan(planner.load(...))",
        )
    began = time.perf_counter()
    chain = chain or build_chain(scenario)
    transport = make_transport(scenario, chain, near=None if start is None else start.q)
    solution: Solution | None = None
    result: Plan | Failure
    if scenario.criterion.kind == "jerk":
        result = _least_jerk(scenario, transport, began)
    else:
        found = solve(scenario, transport, progress=progress, start=start)
        if isinstance(found, Failure):
            return found
        solution, result = found, sample(scenario, found)
    if isinstance(result, Failure):
        return result
    result = replace(result, checks=verify(chain, result, solution))
    if result.checks.get("second_variation", 0.0) < -_FLAT:
        result = replace(result, remarks=(*result.remarks, _SADDLE))
    return replace(result, solver=result.solver | {"seconds_total": time.perf_counter() - began})


def sample(scenario: Scenario, solution: Solution) -> Plan:
    """Returns the plan at evenly spaced times, its checks still empty."""
    transport, criterion = solution.problem.transport, solution.problem.criterion
    share = np.linspace(0.0, 1.0, scenario.solver.samples)
    x, at = solution.evaluate(share)
    bare = _plan_of_motion(
        scenario,
        transport,
        share,
        at.motion,
        np.array(at.tau),
        criterion.torque_rate(solution.problem.coordinates, share, x, at),
    )
    return replace(
        bare,
        criterion=criterion.name,
        cost=solution.cost,
        solver={
            "method": solution.method,
            "nodes": len(solution.mesh),
            "iterations": solution.iterations,
            "rms_residual": solution.residual,
            "seconds": solution.seconds,
        },
        remarks=solution.remarks,
        adjoint=x[:, criterion.state_size :].copy(),
    )


def _least_jerk(scenario: Scenario, transport: Transport, began: float) -> Plan | Failure:
    """Returns the minimum-jerk plan, which needs no boundary value problem."""
    share = np.linspace(0.0, 1.0, scenario.solver.samples)
    found = jerk_motion(transport, share, joint_weights(scenario, transport.chain))
    seconds = time.perf_counter() - began
    if isinstance(found, float):
        return failure(
            "closure-lost",
            f"the arms cannot follow the straight line of least jerk beyond t = {found:.3f} s",
            scenario,
            time=found,
        )
    bare = _plan_of_motion(scenario, transport, share, found.motion, found.tau, found.tau_rate)
    solver = {
        "method": "closed-form",
        "nodes": len(share),
        "iterations": 0,
        "rms_residual": 0.0,
        "seconds": seconds,
    }
    return replace(bare, criterion="jerk", cost=found.cost, solver=solver)


def _plan_of_motion(
    scenario: Scenario,
    transport: Transport,
    share: np.ndarray,
    motion: Motion,
    tau: np.ndarray,
    tau_rate: np.ndarray,
) -> Plan:
    """Returns the plan of a sampled motion, with what its solver knows of it still to be filled in.

    Args:
        scenario: What is planned.
        transport: The motion asked for.
        share: Shares of the duration, (K,).
        motion: Accelerations and forces there.
        tau: Torques, (K, N) [Nm].
        tau_rate: Their rates, (K, N) [Nm/s].
    """
    chain = transport.chain
    forces = hand_forces(chain, motion)
    position, rotation = chain.object_pose(motion.tangent.at)
    return Plan(
        scenario=scenario,
        criterion=scenario.criterion.kind,
        cost=np.nan,
        duration=transport.duration,
        solver={},
        checks={},
        remarks=(),
        time=share * transport.duration,
        joint_names=chain.joint_names,
        q=motion.tangent.q,
        v=motion.v,
        a=motion.a,
        tau=tau,
        tau_rate=tau_rate,
        object_position=position,
        object_rotation=rotation,
        hand_force_left=forces.left_force,
        hand_force_right=forces.right_force,
        hand_moment_left=forces.left_moment,
        hand_moment_right=forces.right_moment,
        internal_force=forces.left_force - forces.right_force,
        adjoint=np.empty((len(share), 0)),
    )
