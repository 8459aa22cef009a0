"""How the methods work together: agreement, starts, progress, and outcomes without a plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mechanisms import human_arms as human
from plans import CASES, FREE, TORQUE, ZERO_ENDS, planned, solved, transport_of

from planner import load, solving
from planner.errors import InputError
from planner.outcome import Failure, NotSolvedError, failure
from planner.planning import plan
from planner.result import Plan
from planner.scenario import Scenario
from planner.solution import Refinement, Solution
from planner.solvers import search as spectral_search
from planner.solvers.continuation import solve_by_continuation
from planner.solvers.search import (
    cost_tolerance,
    search,
    tail_tolerance,
    with_joints_chosen_anew,
)
from planner.solvers.spectral import FIRST_DEGREE
from planner.solvers.warm_start import MotionJacobian
from planner.solving import make_problem, solve

URDF = Path(__file__).parents[1] / "urdf"
COSTS = {"zero ends": ZERO_ENDS, "free end": 7.344975, "torque": TORQUE}


@pytest.mark.parametrize("case", CASES)
def test_reference_costs_at_default_settings(case: str) -> None:
    found = planned(CASES[case])
    assert found.cost == pytest.approx(COSTS[case], rel=1e-6)
    assert found.solver["method"] == "collocation"
    # one boundary value solve from the spectral motion, which it confirms
    assert found.solver["iterations"] <= 2
    assert found.checks["agreement"] < 1e-6
    assert found.remarks == ()


@pytest.mark.parametrize("case", CASES)
def test_methods_and_starts_agree(case: str) -> None:
    ways = [
        CASES[case] | way
        for way in (
            {},
            {"solver.start": "spectral"},
            {"solver.start": "line"},
            {"solver.method": "spectral"},
        )
    ]
    costs = [planned(way).cost for way in ways]
    assert costs == pytest.approx([costs[0]] * len(costs), rel=1e-6)
    assert planned(ways[0]).cost == planned(ways[1]).cost
    assert planned(ways[2]).solver["iterations"] > planned(ways[0]).solver["iterations"]
    positions = [planned(way).object_position for way in ways]
    for other in positions[1:]:
        assert np.max(np.abs(other - positions[0])) < 2e-5
    torques = [planned(way).tau for way in ways]
    for other in torques[1:]:
        assert np.max(np.abs(other - torques[0])) < 1e-3


def test_tighter_tolerances_change_less_and_less() -> None:
    exact = planned({"solver.tolerance": 1e-8, "solver.max_nodes": 9000}).cost
    assert planned().cost == pytest.approx(exact, rel=3e-7)
    assert planned({"solver.tolerance": 1e-6}).cost == pytest.approx(exact, rel=1e-9)


def test_a_plan_made_before_is_a_start() -> None:
    """Half the steps for a changed task, and the same plan in the end."""
    changed = human({"object.mass": 2.4, "task.goal.xyz": [0.39, 0.31, 0.0]})
    cold = plan(changed).unwrap()
    warm = plan(changed, start=planned()).unwrap()
    assert warm.cost == pytest.approx(cold.cost, rel=1e-7)
    assert warm.checks["spectral_iterations"] < cold.checks["spectral_iterations"]


def test_a_start_keeps_the_degree_that_its_motion_needed() -> None:
    fine = {"solver.tolerance": 1e-7, "solver.method": "spectral"}
    first = planned(fine)
    degrees: list[int] = []
    again = plan(
        human({**fine, "object.mass": 2.2}),
        start=first,
        progress=lambda step: degrees.append(step.nodes),
    ).unwrap()
    assert first.checks["spectral_degree"] > FIRST_DEGREE
    assert min(degrees) == first.checks["spectral_degree"]
    assert again.cost == pytest.approx(planned({**fine, "object.mass": 2.2}).cost, rel=1e-9)


def test_where_the_interpolated_jacobian_fails_the_exact_one_is_tried(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def turned(self: MotionJacobian, share: np.ndarray, z: np.ndarray) -> np.ndarray:
        return -right(self, share, z)

    right = MotionJacobian.__call__
    monkeypatch.setattr(MotionJacobian, "__call__", turned)
    scenario = human({"object.mass": 2.5, "solver.start": "spectral"})
    assert plan(scenario).unwrap().cost == pytest.approx(
        planned({"object.mass": 2.5}).cost, rel=1e-9
    )


def test_a_plan_of_other_arms_is_no_start() -> None:
    other = replace(planned(), joint_names=("a", "b", "c", "d"))
    with pytest.raises(InputError, match="other arms"):
        plan(human(), start=other)


def test_several_starts_list_their_minima() -> None:
    found = planned({"solver.starts": 3, "solver.method": "spectral"})
    assert found.cost == pytest.approx(ZERO_ENDS, rel=1e-6)
    minima = found.checks["local_minima"]
    assert found.checks["starts"] == 3
    assert sum(one["starts"] for one in minima) == found.checks["starts_converged"] >= 1
    costs = [one["cost"] for one in minima]
    assert costs == sorted(costs)
    assert costs[0] == pytest.approx(found.cost, rel=1e-9)


# ---- outcomes without a plan ---------------------------------------------------------------------


def outcome(values: dict[str, Any]) -> Failure:
    found = plan(human(values))
    assert isinstance(found, Failure), found
    return found


def assert_holds_no_motion(found: Failure) -> None:
    assert not found.solved
    assert found.remedy
    names = {field.name for field in fields(found)}
    assert names == {"status", "reason", "remedy", "evidence", "scenario"}
    for value in found.evidence.values():
        assert not isinstance(value, np.ndarray)
    with pytest.raises(NotSolvedError, match=found.status):
        found.unwrap()


def test_mesh_full() -> None:
    for start in ("line", "spectral", "auto"):
        found = outcome({"solver.max_nodes": 20, "solver.tolerance": 1e-7, "solver.start": start})
        assert found.status == "mesh-full", start
        assert "max_nodes = 20" in found.reason
        assert_holds_no_motion(found)


def test_closure_lost_along_a_line_that_the_arms_cannot_follow() -> None:
    found = outcome(
        {
            "criterion.kind": "jerk",
            "task.start.xyz": [-0.12, 0.05, 0.0],
            "task.goal.xyz": [0.15, 0.05, 0.0],
        }
    )
    assert found.status == "closure-lost"
    assert_holds_no_motion(found)


def test_no_start_that_can_be_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spectral_search, "minimise", lambda *_, **__: None)
    found = outcome({"solver.start": "spectral", "solver.max_nodes": 50})
    assert found.status == "closure-lost"
    assert_holds_no_motion(found)


def alter(monkeypatch: pytest.MonkeyPatch, change: Callable[[Any], Any]) -> None:
    """Changes what the spectral method returns."""
    real = spectral_search.minimise
    monkeypatch.setattr(spectral_search, "minimise", lambda *a, **b: change(real(*a, **b)))


def test_no_descent(monkeypatch: pytest.MonkeyPatch) -> None:
    early = {"converged": False, "settled": False, "message": "too many steps"}
    alter(monkeypatch, lambda result: replace(result, **early))
    scenario = human({"solver.start": "spectral"})
    found = solving.solve_directly(scenario, transport_of(scenario))
    assert isinstance(found, Failure)
    assert found.status == "no-descent"
    assert "too many steps" in found.reason
    assert found.evidence["cost"] == pytest.approx(ZERO_ENDS, rel=1e-6)
    assert_holds_no_motion(found)
    # without a word on the start, the straight line is tried, and found to do
    second = solve(human(), transport_of(human()))
    assert isinstance(second, Solution)
    assert second.cost == pytest.approx(ZERO_ENDS, rel=1e-6)


def test_disagreement(monkeypatch: pytest.MonkeyPatch) -> None:
    """An extremal dearer than the direct method's motion is no minimum, and no plan."""
    alter(monkeypatch, lambda result: replace(result, cost=0.99 * result.cost))
    scenario = human({"solver.start": "spectral"})
    found = solving.solve_directly(scenario, transport_of(scenario))
    assert isinstance(found, Failure)
    assert found.status == "disagreement"
    assert found.evidence["agreement"] == pytest.approx(0.01, rel=1e-3)
    assert_holds_no_motion(found)


def test_a_cheaper_extremal_is_a_plan_with_a_remark(monkeypatch: pytest.MonkeyPatch) -> None:
    alter(monkeypatch, lambda result: replace(result, cost=1.01 * result.cost))
    found = plan(human())
    assert isinstance(found, Plan)
    assert any("spectral method ended at" in remark for remark in found.remarks)
    assert "second_variation" not in found.checks, "it would be that of the other motion"


# ---- progress ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "stages"),
    [
        ({}, ["spectral", "collocation"]),
        ({"solver.method": "spectral"}, ["spectral"]),
        ({"solver.start": "line"}, ["collocation"]),
    ],
)
def test_progress_names_its_stages(settings: dict[str, Any], stages: list[str]) -> None:
    seen: list[Refinement] = []
    found = plan(human(settings), progress=seen.append)
    assert isinstance(found, Plan)
    assert list(dict.fromkeys(step.stage for step in seen)) == stages
    for step in seen:
        assert step.nodes > 0
        assert np.isfinite([step.residual, step.cost, step.seconds]).all()
    # the adapted mesh is not refined again
    if stages[-1] == "collocation":
        assert seen[-1].nodes == found.solver["nodes"]
    assert seen[-1].cost == pytest.approx(found.cost, rel=1e-4)


@pytest.mark.parametrize("error", [ValueError, RuntimeError, np.linalg.LinAlgError, InputError])
@pytest.mark.parametrize("stage", ["spectral", "collocation"])
def test_what_the_callback_raises_comes_out_as_it_is(error: type[Exception], stage: str) -> None:
    """Also the kinds that solvers raise themselves: a failure would hide the caller's fault."""
    raised = error("the listener's own fault")

    def listen(step: Refinement) -> None:
        if step.stage == stage:
            raise raised

    with pytest.raises(error) as caught:
        plan(human(FREE), progress=listen)
    assert caught.value is raised


@pytest.mark.slow
def test_what_the_callback_raises_comes_out_of_shooting() -> None:
    def listen(step: Refinement) -> None:
        if step.stage == "shooting":
            raise ValueError("the listener's own fault")

    values = {"criterion.kind": "torque", "solver.method": "shooting"}
    with pytest.raises(ValueError, match="own fault"):
        plan(human(values), progress=listen)


def test_solving_twice_gives_the_same_plan() -> None:
    first, second = (plan(human()).unwrap() for _ in range(2))
    assert first.cost == second.cost
    assert np.array_equal(first.q, second.q)
    assert np.array_equal(first.tau, second.tau)


def test_solutions_can_be_evaluated_anywhere() -> None:
    solution = solved()
    share = np.array([0.123456, 0.5, 0.987])
    x, at = solution.evaluate(share)
    assert x.shape == (3, 16)
    assert at.closed.all()
    assert np.array_equal(x, solution.states(share))
    assert np.array_equal(at.tau, x[:, solution.problem.criterion.at_tau])


# ---- independent joints, light links, squeezes ---------------------------------------------------


def shipped(name: str, values: dict[str, Any]) -> Scenario:
    return load(URDF / f"{name}.toml").override(values)


def test_joints_are_chosen_anew_on_the_way_down() -> None:
    """Least torque takes two UR5 through the singularity of the joints that suit the guess.

    With those joints alone the descent comes to a halt at a cost of 393.
    """
    scenario = shipped("two_ur5/panel", {"criterion.kind": "torque", "solver.tolerance": 3e-3})
    problem = make_problem(scenario, transport_of(scenario))
    first = search(scenario, problem, watch_joints=True)
    assert first is not None
    assert not first.settled
    assert "singular in its independent joints" in first.message
    other, result = with_joints_chosen_anew(scenario, problem, first, None)
    assert result.converged, result.message
    assert result.cost < 230.0
    mine, its = problem.transport.joints.dependent, other.transport.joints.dependent
    assert mine.tolist() != its.tolist()
    q = result.point.torques.tangent.q
    gamma = problem.transport.chain.loop(problem.transport.chain.dynamics.placements(q)).jacobian()
    nearest = [np.min(np.linalg.svd(gamma[:, :, z], compute_uv=False)[:, -1]) for z in (mine, its)]
    assert nearest[1] > 3.0 * nearest[0]


def test_costates_are_resolved_finer_where_they_alone_give_the_torques() -> None:
    values = {"criterion.kind": "torque", "solver.tolerance": 1e-5}
    scenario = human(values)
    result = search(scenario, make_problem(scenario, transport_of(scenario)))
    assert result is not None
    found = planned(values)
    assert found.checks["spectral_degree"] > result.degree
    assert found.checks["spectral_iterations"] > result.iterations
    plain = search(human(), make_problem(human(), transport_of(human())))
    assert plain is not None
    assert planned().checks["spectral_degree"] == plain.degree


@pytest.mark.slow
@pytest.mark.parametrize("name", ["two_ur5/panel", "tiago_dual/box", "talos/bar"])
def test_least_torque_of_spatial_arms_is_certified(name: str) -> None:
    found = plan(shipped(name, {"criterion.kind": "torque"}))
    assert isinstance(found, Plan), found
    assert found.checks["pontryagin_residual"] < 1e-4
    assert found.checks["hamiltonian"] < 1e-4
    assert found.checks["agreement"] < 1e-3
    assert found.checks["torque_balance"] < 1e-5
    # redundant arms need a cost on their speeds, as small as does
    assert ("speed_cost" in found.checks) == (name != "two_ur5/panel")
    assert bool(found.remarks) == (name != "two_ur5/panel")


REST = {"boundary.start.torque": "rest", "boundary.goal.torque": "rest"}


def test_a_squeeze_without_bound_is_named() -> None:
    """An internal moment about the vertical loads bases and wrists alike wherever the panel is."""
    found = plan(shipped("two_ur5/panel", REST))
    assert isinstance(found, Failure)
    assert found.status == "unbounded-squeeze"
    assert found.evidence["torque"] > 1e3 * found.evidence["torque_needed"]
    assert "continuation" not in found.evidence
    assert_holds_no_motion(found)


@pytest.mark.parametrize(
    "remedy",
    [
        {"boundary.start.torque": "static"},
        {"boundary.start.internal_force": [0.0, 0.0, 0.0]},
        {"criterion.kind": "mixed"},
    ],
)
def test_what_is_advised_against_it_helps(remedy: dict[str, Any]) -> None:
    values: dict[str, Any] = dict(REST)
    if "boundary.start.internal_force" in remedy:  # it takes the torques' place
        values["boundary.start.torque"] = None
    found = plan(shipped("two_ur5/panel", values | remedy))
    assert isinstance(found, Plan), found
    assert found.checks["pontryagin_residual"] < 1e-4
    assert found.checks["replay_max"] < 1e-3
    assert np.max(np.abs(found.tau)) < 100.0


def test_every_spectral_solve_keeps_to_the_tolerances_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    real, seen = spectral_search.minimise, []

    def listen(*given: Any, **settings: Any) -> Any:
        seen.append((settings["tolerance"], settings["tail"]))
        return real(*given, **settings)

    monkeypatch.setattr(spectral_search, "minimise", listen)
    scenario = human({"solver.tolerance": 1e-6, "solver.starts": 3, "solver.max_nodes": 9000})
    asked = cost_tolerance(scenario), tail_tolerance(scenario)
    assert isinstance(plan(scenario), Plan)
    assert len(seen) >= 3
    first = failure("no-descent", "pretended", scenario)
    before = len(seen)
    assert isinstance(solve_by_continuation(scenario, transport_of(scenario), first), Solution)
    assert len(seen) >= before + 2
    assert set(seen) == {asked}
