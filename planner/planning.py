"""From a scenario to a plan: the whole way in one call."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from planner.boundary_value_problem import BoundaryValueProblem
from planner.chain import ClosedChain, build_chain
from planner.checks import verify
from planner.criteria import make_criterion
from planner.forces import hand_forces
from planner.outcome import Failure
from planner.result import Plan
from planner.solution import ProgressCallback, Solution
from planner.solvers.collocation import solve_collocation
from planner.transport import Transport, make_transport

if TYPE_CHECKING:
    from planner.scenario import Scenario


def plan(
    scenario: Scenario,
    *,
    progress: ProgressCallback | None = None,
    chain: ClosedChain | None = None,
) -> Plan | Failure:
    """Plans how both arms carry the object.

    Args:
        scenario: What is asked, from `planner.load`.
        progress: Called once per mesh refinement.
        chain: The scenario's closed chain if it was built before, to save reading the URDFs.

    Returns:
        The plan, or a named failure with its reason and a remedy; `unwrap()` gives the plan or
        raises.

    Raises:
        InputError: The scenario or one of its files cannot be used.
    """
    began = time.perf_counter()
    chain = chain or build_chain(scenario)
    transport = make_transport(scenario, chain)
    solution = solve(scenario, transport, progress=progress)
    if isinstance(solution, Failure):
        return solution
    result = sample(scenario, solution)
    result = replace(result, checks=verify(chain, result, solution))
    return replace(result, solver=result.solver | {"seconds_total": time.perf_counter() - began})


def solve(
    scenario: Scenario, transport: Transport, *, progress: ProgressCallback | None = None
) -> Solution | Failure:
    """Returns the solution of the scenario's boundary value problem, or how it failed."""
    criterion = make_criterion(scenario, transport.chain, transport.reference)
    assert criterion is not None
    problem = BoundaryValueProblem(transport, criterion)
    return solve_collocation(
        problem,
        tolerance=scenario.solver.tolerance,
        max_nodes=scenario.solver.max_nodes,
        progress=progress,
        scenario=scenario,
    )


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
        cost=solution.cost(),
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
