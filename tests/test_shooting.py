"""Single shooting: sensitivities, convergence from close by, and an honest end from afar."""

from __future__ import annotations

import numpy as np
import pytest
from mechanisms import difference
from mechanisms import human_arms as human
from plans import FREE, TORQUE, ZERO_ENDS, planned, problem_of, solved

from planner.outcome import Failure
from planner.solution import Refinement, Solution
from planner.solvers.shooting import first_costates, newton_shooting, shoot, solve_shooting

TORQUE_KIND = {"criterion.kind": "torque"}
TIGHT = {"solver.tolerance": 1e-7, "solver.max_nodes": 5000}


def right_start(values: dict) -> tuple:
    """The problem and its scaled states and costates at the start."""
    solution = solved(values | TIGHT)
    return solution.problem, solution.states(np.zeros(1))[0] / solution.problem.scale


@pytest.mark.slow
def test_sensitivities_are_the_derivatives_of_the_goal() -> None:
    problem, start = right_start(TORQUE_KIND)
    shot = shoot(problem, start, sensitive=True)
    assert shot is not None

    def goal(d: np.ndarray) -> np.ndarray:
        moved = shoot(problem, start + d, sensitive=False)
        assert moved is not None
        return moved.goal

    generator = np.random.default_rng(0)
    for along in generator.normal(size=(3, len(start))):
        wanted = difference(lambda t, along=along: goal(t * along), 1e-3)  # type: ignore[misc]
        found = shot.sensitivity @ along
        assert np.max(np.abs(found - wanted)) < 2e-5 * np.max(np.abs(wanted))


def test_the_right_costates_lead_to_the_goal() -> None:
    problem, start = right_start(TORQUE_KIND)
    shot = shoot(problem, start, sensitive=False)
    assert shot is not None
    assert np.max(np.abs(problem.boundary(start, shot.goal))) < 1e-6
    chain = problem.transport.chain
    y = problem.physical(shot.goal[:, None])[:, problem.criterion.at_y]
    at, _ = problem.coordinates.tangent(np.ones(1), y)
    position, _ = chain.object_pose(at.at)
    assert np.allclose(position, [[0.4, 0.3, 0.0]], atol=1e-6)


@pytest.mark.slow
def test_newtons_method_finds_them_again_from_close_by() -> None:
    problem, start = right_start(TORQUE_KIND)
    half = len(start) // 2
    off = start.copy()
    off[half:] *= 1.0 + 0.05 * np.random.default_rng(0).normal(size=half)
    seen: list[Refinement] = []
    found = newton_shooting(problem, off, progress=seen.append)
    assert found.message == "converged"
    assert found.residual < 1e-7
    assert np.max(np.abs(found.start - start)) < 1e-5
    assert len(seen) == found.iterations + 1 > 1
    # the last steps square the residual
    assert seen[-1].residual < 1e-2 * seen[-2].residual
    assert {step.stage for step in seen} == {"shooting"}


def test_a_start_that_blows_up_is_told_as_such() -> None:
    problem = problem_of(human(TORQUE_KIND))
    start = first_costates(problem)
    start[problem.criterion.state_size :] = 1e5
    found = newton_shooting(problem, start)
    assert found.message == "the first integration blows up"
    assert found.iterations == 0
    assert not np.isfinite(found.residual)


def test_a_failure_names_the_reason_and_holds_no_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    from planner.solvers import shooting

    scenario = human(TORQUE_KIND | {"solver.method": "shooting"})
    monkeypatch.setattr(shooting, "shoot", lambda *_, **__: None)
    found = solve_shooting(problem_of(scenario), scenario)
    assert isinstance(found, Failure)
    assert found.status == "no-descent"
    assert "blows up" in found.reason
    assert found.evidence["start"] == "started from the spectral method's costates"
    assert not any(isinstance(value, np.ndarray) for value in found.evidence.values())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("values", "cost"), [({}, ZERO_ENDS), (FREE, 7.344975), (TORQUE_KIND, TORQUE)]
)
def test_shooting_agrees_with_the_other_methods(values: dict, cost: float) -> None:
    shot = planned(values | {"solver.method": "shooting"})
    other = planned(values)
    direct = planned(values | {"solver.method": "spectral"})
    assert shot.cost == pytest.approx(cost, rel=1e-6)
    assert other.cost == pytest.approx(shot.cost, rel=1e-6)
    assert direct.cost == pytest.approx(shot.cost, rel=1e-6)
    assert np.max(np.abs(shot.object_position - other.object_position)) < 1e-5
    assert np.max(np.abs(shot.object_position - direct.object_position)) < 1e-5
    assert shot.solver["method"] == "shooting"
    assert shot.checks["hamiltonian"] < 1e-7
    assert shot.remarks == ("started from the spectral method's costates",)


@pytest.mark.slow
def test_zero_costates_are_a_start_too_for_the_torque_criterion() -> None:
    scenario = human(TORQUE_KIND | {"solver.start": "line"})
    found = solve_shooting(problem_of(scenario), scenario)
    assert isinstance(found, Solution)
    assert found.cost == pytest.approx(TORQUE, rel=1e-6)
    assert found.remarks == ("started from costates zero",)
