"""Continuation: easy tasks lead to the one asked for, and the plan says so."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mechanisms import human_arms as human
from mechanisms import planar_arms
from plans import ZERO_ENDS, planned, transport_of

from planner import solving
from planner.outcome import Failure, failure
from planner.planning import plan
from planner.result import Plan
from planner.solution import Solution
from planner.solvers.continuation import Family, families, solve_by_continuation

HARD: dict[str, dict[str, Any]] = {
    "distance": {},
    "mass": {"object.mass": 100.0},
    "duration": {"task.duration": 5.0},
    "preload": {"boundary.start.internal_force": [100.0, 100.0, 0.0]},
}


def named(values: dict[str, Any]) -> dict[str, Family]:
    scenario = human(values)
    return {family.name: family for family in families(scenario, transport_of(scenario))}


def continued(values: dict[str, Any]) -> Solution | Failure:
    scenario = human(values)
    first = failure("no-descent", "pretended", scenario, cost=1.0)
    return solve_by_continuation(scenario, transport_of(scenario), first)


def test_a_task_has_the_families_that_it_can_give() -> None:
    assert list(named({})) == ["distance"]
    assert list(named({"object.mass": 100.0})) == ["mass", "distance"]
    assert list(named({"object.mass": 0.0})) == ["distance"]
    assert list(named({"task.duration": 0.05})) == ["duration", "distance"]
    values = {
        "object.mass": 50.0,
        "task.duration": 9.0,
        "boundary.goal.internal_force": [0.0, 5.0, 0.0],
    }
    assert list(named(values)) == ["preload", "mass", "duration", "distance"]
    assert "preload" not in named({"boundary.goal.internal_force": [0.0, 0.0, 0.0]})


def test_redundant_arms_have_no_family_in_distance(tmp_path: Path) -> None:
    scenario = planar_arms(tmp_path)
    assert [f.name for f in families(scenario, transport_of(scenario))] == []


def test_members_lead_from_the_easy_task_to_the_one_asked_for() -> None:
    scenario = human({"object.mass": 100.0})
    family = named({"object.mass": 100.0})["mass"]
    masses = [family.at(scenario, share).object.mass for share in (0.0, 0.5, 0.75)]
    assert masses == pytest.approx([1.0, 10.0, 100.0**0.75])
    assert family.at(scenario, 1.0) is scenario

    values = {
        "boundary.start.internal_force": [100.0, -20.0, 0.0],
        "boundary.goal.internal_force": [0.0, 8.0, 0.0],
    }
    preload, scenario = named(values)["preload"], human(values)
    member = preload.at(scenario, 0.25)
    assert member.boundary.start.internal_force == pytest.approx((25.0, -5.0, 0.0))
    assert member.boundary.goal.internal_force == pytest.approx((0.0, 2.0, 0.0))
    easy = preload.at(scenario, 0.0)
    assert easy.boundary.start.internal_force == (0.0, 0.0, 0.0)

    distance, scenario = named({})["distance"], human()
    near = distance.at(scenario, 0.0)
    assert near.task.goal.xyz == pytest.approx((0.13, 0.39, 0.0))
    assert near.task.start == scenario.task.start


@pytest.mark.parametrize("name", HARD)
def test_every_family_leads_to_the_plan(name: str) -> None:
    """The independent joints may suit other members better: the way has to hold all the same."""
    found = continued(HARD[name])
    assert isinstance(found, Solution), found
    assert found.method == "collocation"
    assert found.cost == pytest.approx(planned(HARD[name]).cost, rel=1e-6)
    [remark] = [text for text in found.remarks if "continuation" in text]
    assert f"continuation in {name}" in remark
    assert found.evidence["agreement"] < 1e-5


def test_the_method_asked_for_is_kept() -> None:
    found = continued({"object.mass": 100.0, "solver.method": "spectral"})
    assert isinstance(found, Solution)
    assert found.method == "spectral"
    assert any("continuation in mass" in remark for remark in found.remarks)


def test_a_family_that_leads_nowhere_leaves_the_first_failure() -> None:
    """Zero torque under gravity lets the object fall from both ends in turn, for 20 s."""
    found = continued(
        {
            "task.start.xyz": [-0.12, 0.05, 0.0],
            "task.goal.xyz": [0.15, 0.05, 0.0],
            "solver.max_nodes": 100,
        }
    )
    assert isinstance(found, Failure)
    assert found.status == "no-descent"
    assert found.reason == "pretended; continuation in distance failed too"
    assert found.evidence == {"cost": 1.0, "continuation": ["distance"]}


def test_without_a_family_the_first_failure_stays_as_it_is(tmp_path: Path) -> None:
    scenario = planar_arms(tmp_path)
    first = failure("no-descent", "pretended", scenario)
    assert solve_by_continuation(scenario, transport_of(scenario), first) is first


def test_the_planner_tries_it_by_itself_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the plain start fails; here it is made to."""
    asked = human()

    def fails(scenario: Any, *_: Any, **__: Any) -> Failure:
        return failure("no-descent", "pretended", scenario)

    monkeypatch.setattr(solving, "solve_directly", fails)
    found = plan(asked)
    assert isinstance(found, Plan)
    assert found.cost == pytest.approx(ZERO_ENDS, rel=1e-6)
    assert any("reached by continuation" in remark for remark in found.remarks)
    assert found.checks["replay_end"] < 1e-4
    # asked to start from the line it shall do that and nothing else
    line = plan(asked.override({"solver.start": "line"}))
    assert isinstance(line, Failure)
    assert line.reason == "pretended"


def test_progress_goes_on() -> None:
    seen: list[Any] = []
    scenario = human({"object.mass": 100.0})
    first = failure("no-descent", "pretended", scenario)
    solve_by_continuation(scenario, transport_of(scenario), first, progress=seen.append)
    stages = [step.stage for step in seen]
    assert stages[0] == "spectral"
    assert stages[-1] == "collocation"
    assert np.all(np.isfinite([step.cost for step in seen]))
