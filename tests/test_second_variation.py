"""Minima and saddle points: the least second variation of the cost tells which."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mechanisms import human_arms as human
from mechanisms import planar_arms
from plans import CASES, minimised, planned, problem_of

from planner import load
from planner.planning import plan
from planner.scenario import Scenario
from planner.solvers import descent
from planner.solvers.second_variation import least_second_variation
from planner.solvers.spectral import SpectralResult, minimise
from planner.solvers.spectral_unknowns import metric

PANDAS = Path(__file__).parents[1] / "urdf" / "two_pandas" / "lift.toml"


def second_difference(result: SpectralResult, change: np.ndarray, width: float) -> float:
    """The cost's second derivative along a change of the unknowns, relative to the cost."""
    problem = result.problem
    point = problem.closed(result.point)
    costs = []
    for side in (1.0, -1.0):
        moved = problem.moved(point, side * width * change)
        assert moved is not None
        costs.append(problem.closed(moved).cost)
    return (sum(costs) - 2.0 * point.cost) / (width**2 * point.cost)


@pytest.fixture(params=[*CASES, "free postures"])
def scenario(request: pytest.FixtureRequest, tmp_path: Path) -> Scenario:
    if request.param in CASES:
        return human(CASES[request.param])
    return planar_arms(tmp_path, gravity=(0.0, 0.0, 0.0), criterion={"speed_cost": 0.3})


def test_no_change_of_a_minimum_has_less(scenario: Scenario) -> None:
    result = minimised(problem_of(scenario), tolerance=1e-12)
    least, change = least_second_variation(result.problem, result.point)
    root = metric(result.problem, result.point)
    motion = result.problem.motion
    assert least > 0.0
    assert np.linalg.norm(root @ change[motion]) == pytest.approx(1.0, rel=1e-9)
    assert second_difference(result, change, 1e-2) == pytest.approx(least, rel=1e-2)
    generator = np.random.default_rng(4)
    for _ in range(5):
        other = np.zeros(result.problem.size)
        other[motion] = np.linalg.solve(root, generator.normal(size=len(root)))
        other /= np.linalg.norm(root @ other[motion])
        assert second_difference(result, other, 1e-3) > least


def test_a_saddle_point_is_left_along_the_change(monkeypatch: pytest.MonkeyPatch) -> None:
    """Gauss-Newton passes close by one on its way from the straight line."""
    monkeypatch.setattr(descent, "_MAX_STEPS", 3)
    problem = problem_of(load(PANDAS))
    result = minimise(problem.transport, problem.criterion, problem.coordinates)
    assert result is not None
    assert result.decrease < 0.01
    least, change = least_second_variation(result.problem, result.point)
    assert least < -1e-3
    assert second_difference(result, change, 0.05) == pytest.approx(least, rel=0.2)


def test_a_plan_says_that_it_is_no_minimum(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not any("no minimum" in remark for remark in planned().remarks)
    monkeypatch.setattr(SpectralResult, "second_variation", lambda _: -0.01)
    found = plan(human()).unwrap()
    assert found.checks["second_variation"] == -0.01
    assert any("no minimum" in remark for remark in found.remarks)


@pytest.mark.parametrize("values", [{}, {"solver.method": "spectral"}])
def test_the_papers_plan_is_a_minimum(values: dict[str, Any]) -> None:
    assert planned(values).checks["second_variation"] > 0.1


@pytest.mark.parametrize("values", [{"solver.start": "line"}, {"criterion.kind": "jerk"}])
def test_it_is_known_where_the_spectral_method_was_used(values: dict[str, Any]) -> None:
    assert "second_variation" not in planned(values).checks
