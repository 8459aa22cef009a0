"""Optimal cooperative transport with two arms.

Reads two arms and an object from URDF and computes how both arms carry the object together: the
trajectory, every joint torque, and the force that each hand applies.

    import planner

    scenario = planner.load("urdf/human_arms/transport.toml")
    plan = planner.plan(scenario).unwrap()
    plan.save("out")
    plan.show()
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from planner.errors import InputError, PlannerError
    from planner.outcome import Failure, NotSolvedError
    from planner.planning import plan
    from planner.result import Plan
    from planner.scenario import Scenario, load

__version__ = "0.1.0"
__all__ = [
    "Failure",
    "InputError",
    "NotSolvedError",
    "Plan",
    "PlannerError",
    "Scenario",
    "load",
    "plan",
]

# imported on first use: the help page of the command line needs none of them
_PLACES = {
    "Failure": "planner.outcome",
    "InputError": "planner.errors",
    "NotSolvedError": "planner.outcome",
    "Plan": "planner.result",
    "PlannerError": "planner.errors",
    "Scenario": "planner.scenario",
    "load": "planner.scenario",
    "plan": "planner.planning",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'planner' has no attribute {name!r}")
    return getattr(import_module(_PLACES[name]), name)
