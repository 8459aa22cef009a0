"""Plans of the paper's arms, solved once however many tests look at them."""

from __future__ import annotations

import json
from functools import lru_cache
from typing import Any

import mechanisms
import numpy as np

from planner.assembly import build_chain
from planner.boundary_value_problem import BoundaryValueProblem
from planner.planning import plan
from planner.result import Plan
from planner.scenario import Scenario
from planner.solution import Solution
from planner.solvers.spectral import SpectralResult, minimise
from planner.solving import make_problem, solve
from planner.transport import Transport, make_transport

ZERO_ENDS, FREE_END, TORQUE, JERK = 16.811305, 7.344975, 0.271566, 36.0
"""Reference costs, from two independent formulations; the last one is 360 |way|^2."""

FREE = {"boundary.goal.torque": "free"}
CASES: dict[str, dict[str, Any]] = {
    "zero ends": {},
    "free end": FREE,
    "torque": {"criterion.kind": "torque"},
}
"""The paper's cases."""


def planned(values: dict[str, Any] | None = None) -> Plan:
    """The plan of the paper's task with other values."""
    return _planned(json.dumps(values or {}, sort_keys=True))


@lru_cache(maxsize=128)
def _planned(values: str) -> Plan:
    found = plan(mechanisms.human_arms(json.loads(values)))
    assert isinstance(found, Plan), found
    return found


def solved(values: dict[str, Any] | None = None) -> Solution:
    """Its solution: states and costates at any time."""
    return _solved(json.dumps(values or {}, sort_keys=True))


@lru_cache(maxsize=32)
def _solved(values: str) -> Solution:
    scenario = mechanisms.human_arms(json.loads(values))
    found = solve(scenario, transport_of(scenario))
    assert isinstance(found, Solution), found
    return found


def transport_of(scenario: Scenario) -> Transport:
    """What a scenario asks for."""
    return make_transport(scenario, build_chain(scenario))


def problem_of(scenario: Scenario) -> BoundaryValueProblem:
    """Its boundary value problem."""
    return make_problem(scenario, transport_of(scenario))


def minimised(problem: BoundaryValueProblem, **settings: Any) -> SpectralResult:
    """The problem's motion by the spectral method."""
    result = minimise(problem.transport, problem.criterion, problem.coordinates, **settings)
    assert result is not None
    assert result.converged, result.message
    return result


def at_share(found: Plan, values: np.ndarray, share: float) -> np.ndarray:
    """Samples of a plan at a share of its duration that is one of its times."""
    place = share * (len(found.time) - 1)
    assert place == int(place)
    return np.asarray(values[int(place)])
