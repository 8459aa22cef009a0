"""Independent solutions: what CasADi and a plain solve_bvp find is what the planner finds."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import mechanisms
import numpy as np
import pytest

pytest.importorskip("casadi", reason="the peers need the extra bench")
sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))

from peers.casadi_collocation import Collocation
from peers.casadi_dynamics import make_dynamics
from peers.casadi_scheme import Answer, Scheme
from peers.growth import PANDA_COST, planar_pair, two_pandas
from peers.plain_bvp import PlainProblem
from peers.task import read_task

import planner
from planner.scenario import Scenario

PAPER = {
    "zero": ({}, 16.811305402),
    "free": ({"boundary.goal.torque": "free"}, 7.344974862),
    "torque": ({"criterion.kind": "torque"}, 0.271566107),
}
FINE = Scheme(10, 6, lifted=True, scalar=False)


def solved(scenario: Scenario, scheme: Scheme = FINE, solver: Any = "ipopt") -> Answer:
    answer = Collocation(read_task(scenario), scheme, solver, tolerance=1e-8).solve()
    assert answer.solved, answer.status
    return answer


def pair(folder: Path, left: int, right: int, grasp: str = "revolute", speed: float = 0.0):
    criterion = {"kind": "torque-change", "weights": "unit", "speed_cost": speed}
    return planar_pair(folder, left, right, grasp, criterion=criterion)


@pytest.fixture(params=["3R+2R", "rigid 3R+3R", "Pandas"])
def redundant(request: pytest.FixtureRequest, tmp_path: Path) -> Scenario:
    if request.param == "Pandas":
        pytest.importorskip("pinocchio")
        return two_pandas(tmp_path)
    grasp, left, right = ("rigid", 3, 3) if "rigid" in request.param else ("revolute", 3, 2)
    return pair(tmp_path, left, right, grasp)


def test_equations_agree_with_pinocchio(redundant: Scenario) -> None:
    task = read_task(redundant)
    chain, dynamics = task.chain, make_dynamics(task)
    generator = np.random.default_rng(0)
    near = task.start.posture + 0.1 * generator.normal(size=(3, chain.n))
    q, _, closed = chain.close(near, task.transport.joints.dependent)
    assert closed.all()
    v, a = generator.normal(size=(2, 3, chain.n))
    loop = chain.loop(chain.dynamics.placements(q))
    # closure speaks of motions that keep the hands together
    v -= np.einsum("kij,kj->ki", np.linalg.pinv(loop.jacobian()) @ loop.jacobian(), v)
    multiplier = generator.normal(size=(3, chain.m))
    wrench = loop.wrench(multiplier)[:, list(dynamics.wrench)]
    tau = chain.dynamics.inverse_dynamics(q, v, a)
    tau -= np.einsum("kij,ki->kj", loop.jacobian(), multiplier)
    relative = np.einsum("kij,kj->ki", loop.jacobian(), a) + loop.bias(v)
    for k in range(3):
        found_tau, found = (
            np.array(part).ravel() for part in dynamics.point(q[k], v[k], a[k], wrench[k])
        )
        np.testing.assert_allclose(found_tau, tau[k], rtol=0, atol=1e-9 * np.abs(tau).max())
        # in world axes here, in those of the grasp there
        assert np.linalg.norm(found) == pytest.approx(np.linalg.norm(relative[k]), rel=1e-9)
        np.testing.assert_allclose(np.array(dynamics.gap(q[k])).ravel(), 0.0, atol=1e-10)
    np.testing.assert_allclose(np.array(dynamics.start(task.start.posture)), 0.0, atol=1e-10)
    np.testing.assert_allclose(
        np.array(dynamics.goal(task.transport.goal.posture)), 0.0, atol=1e-10
    )


@pytest.mark.parametrize("name", PAPER)
def test_paper_costs_agree(name: str) -> None:
    overrides, cost = PAPER[name]
    scenario = mechanisms.human_arms(overrides)
    plan = planner.plan(scenario).unwrap()
    assert solved(scenario).cost == pytest.approx(cost, rel=1e-7)
    assert solved(scenario, Scheme(5, 5), "fatrop").cost == pytest.approx(plan.cost, rel=1e-5)
    assert plan.cost == pytest.approx(cost, rel=1e-6)


@pytest.mark.parametrize("name", PAPER)
def test_plain_solve_bvp_agrees(name: str) -> None:
    overrides, cost = PAPER[name]
    answer = PlainProblem(read_task(mechanisms.human_arms(overrides))).solve(1e-5)
    assert answer.solved
    assert answer.cost == pytest.approx(cost, rel=1e-6)


def test_torques_of_the_paper_agree() -> None:
    scenario = mechanisms.human_arms()
    plan = planner.plan(scenario).unwrap()
    scheme = Scheme(4, 6)
    answer = solved(scenario, scheme)
    # the first stage holds 12 states, 4 accelerations, 2 forces and 4 torque rates at 6 points
    middle = answer.x[2 * (12 + 6 * 10) :][:12]
    half = len(plan.time) // 2
    np.testing.assert_allclose(middle[:4], plan.q[half], atol=1e-5)
    np.testing.assert_allclose(middle[8:], plan.tau[half], atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("left", "right", "grasp", "speed"),
    [(3, 2, "revolute", 0.0), (3, 3, "revolute", 1.0), (3, 3, "rigid", 1.0)],
)
def test_redundant_pairs_agree(
    left: int, right: int, grasp: str, speed: float, tmp_path: Path
) -> None:
    scenario = pair(tmp_path, left, right, grasp, speed)
    plan = planner.plan(scenario).unwrap()
    assert plan.cost == pytest.approx(solved(scenario, Scheme(14, 6, True, False)).cost, rel=1e-5)


@pytest.mark.slow
def test_pandas_agree(tmp_path: Path) -> None:
    scenario = two_pandas(tmp_path)
    assert solved(scenario).cost == pytest.approx(PANDA_COST, rel=1e-8)
    plan = planner.plan(scenario).unwrap()
    assert plan.cost == pytest.approx(PANDA_COST, rel=1e-5)


@pytest.mark.parametrize("joints", [2, 3, 4])
def test_pairs_of_ever_more_joints_are_solved(tmp_path: Path, joints: int) -> None:
    """Three joints: gains near the optimum were once lost in the gap that iterates leave."""
    criterion = {"kind": "torque-change", "weights": "effort", "speed_cost": 0.5}
    scenario = planar_pair(tmp_path, joints, joints, criterion=criterion)
    found = planner.plan(scenario.override({"solver.method": "spectral"})).unwrap()
    assert found.cost == pytest.approx(solved(scenario).cost, rel=1e-6)
