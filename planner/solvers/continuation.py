"""Continuation: an easy task first, then step by step to the one that was asked for.

Each solution starts the next. The way leads through preload, mass and duration in turn, whichever
the task has to give; the steps shorten where a solve fails.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from planner.assembly import build_chain
from planner.boundary_value_problem import BoundaryValueProblem
from planner.constrained_dynamics import Joints
from planner.criteria import make_criterion
from planner.errors import InputError
from planner.outcome import Failure
from planner.solution import ProgressCallback, Solution
from planner.solvers.confirm import confirm
from planner.solvers.search import search
from planner.solvers.spectral import SpectralResult
from planner.solvers.warm_start import spectral_solution
from planner.transport import Transport, make_transport

if TYPE_CHECKING:
    from planner.scenario import Scenario
    from planner.solvers.curves import Curves

_FIRST_STEP = 0.5
_LEAST_STEP = 0.02
_EASY_MASS = 1.0  # kg
_EASY_DURATION = 1.0  # s


@dataclass(frozen=True)
class Family:
    """A family of scenarios from an easy one (share 0) to the one asked for (share 1).

    Attributes:
        name: What changes along it.
        changes: Keys that change: easy value and value asked for, scalars or lists.
        geometric: Whether they change by equal factors instead of equal steps.
    """

    name: str
    changes: dict[str, tuple[object, object]]
    geometric: bool

    def at(self, scenario: Scenario, share: float) -> Scenario:
        """Returns the member at a share of the way."""
        if share >= 1.0:
            return scenario
        values = {}
        for key, (easy, asked) in self.changes.items():
            first, last = np.asarray(easy, dtype=float), np.asarray(asked, dtype=float)
            if self.geometric:
                between = first * (last / first) ** share
            else:
                between = first + share * (last - first)
            values[key] = between.tolist()
        return scenario.override(values)


def families(scenario: Scenario, transport: Transport) -> Iterator[Family]:
    """Yields the families that lead to a scenario.

    Args:
        scenario: What is asked.
        transport: Its motion.
    """
    mass = transport.chain.body.mass
    preloads: dict[str, tuple[object, object]] = {}
    for end in ("start", "goal"):
        given = getattr(scenario.boundary, end)
        for name in ("internal_force", "internal_moment"):
            value = getattr(given, name)
            if value is not None and any(value):
                preloads[f"boundary.{end}.{name}"] = ([0.0, 0.0, 0.0], list(value))
    if preloads:
        yield Family("preload", preloads, geometric=False)
    if mass > 0.0 and not 0.3 < mass / _EASY_MASS < 3.0:
        yield Family("mass", {"object.mass": (_EASY_MASS, mass)}, geometric=True)
    duration = scenario.task.duration
    if not 0.5 < duration / _EASY_DURATION < 2.0:
        yield Family("duration", {"task.duration": (_EASY_DURATION, duration)}, geometric=True)
    goal, start = scenario.task.goal.xyz, scenario.task.start.xyz
    if transport.chain.redundant:
        return
    near = [0.9 * s + 0.1 * g for s, g in zip(start, goal, strict=True)]
    if near != list(goal) and scenario.task.goal.rpy is None:
        yield Family("distance", {"task.goal.xyz": (near, list(goal))}, geometric=False)


def solve_by_continuation(
    scenario: Scenario,
    transport: Transport,
    first: Failure,
    *,
    progress: ProgressCallback | None = None,
) -> Solution | Failure:
    """Returns the solution reached along one of the families, or the first failure.

    Args:
        scenario: What is asked.
        transport: The motion to be planned.
        first: How the solve without continuation ended.
        progress: Called once per iteration or mesh.
    """
    began = time.perf_counter()
    tried = []
    for family in families(scenario, transport):
        tried.append(family.name)
        found = _follow(scenario, family, transport.joints, progress)
        if found is None:
            continue
        problem, result, members = found
        solution = (
            spectral_solution(problem, result)
            if scenario.solver.method == "spectral"
            else confirm(scenario, problem, result, progress)
        )
        if isinstance(solution, Solution):
            remark = f"reached by continuation in {family.name} over {members} easier tasks"
            return replace(
                solution,
                seconds=time.perf_counter() - began,
                remarks=(*solution.remarks, remark),
            )
    if not tried:
        return first
    return replace(
        first,
        reason=f"{first.reason}; continuation in {', '.join(tried)} failed too",
        evidence=first.evidence | {"continuation": tried},
    )


def _follow(
    scenario: Scenario, family: Family, joints: Joints, progress: ProgressCallback | None
) -> tuple[BoundaryValueProblem, SpectralResult, int] | None:
    """Returns the spectral result at the end of a family, and how many members led to it.

    All members have the same independent joints: curves say nothing of joints other than theirs.
    """
    share, step, members = 0.0, _FIRST_STEP, 0
    curves = None
    while True:
        found = _solve_member(family.at(scenario, share), joints, curves, progress)
        if found is not None and found[1].converged:
            members += 1
            curves = found[1].curves
            if share >= 1.0:
                return found[0], found[1], members - 1
            step = min(1.5 * step, _FIRST_STEP)
            known = share
        else:
            if curves is None or step < _LEAST_STEP:
                return None
            step *= 0.5
        share = min(1.0, known + step)


def _solve_member(
    scenario: Scenario, joints: Joints, curves: Curves | None, progress: ProgressCallback | None
) -> tuple[BoundaryValueProblem, SpectralResult] | None:

    try:
        chain = build_chain(scenario)
        transport = replace(make_transport(scenario, chain), joints=joints)
    except InputError:
        return None
    criterion = make_criterion(scenario, chain, transport.reference)
    assert criterion is not None
    problem = BoundaryValueProblem(transport, criterion)
    result = search(scenario, problem, start=curves, progress=progress)
    return None if result is None else (problem, result)
