"""Minimum jerk: the object's known motion, least joint rates, least torques at every instant."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mechanisms import Mechanism, planar_arms, random_states
from mechanisms import human_arms as human
from plans import JERK, planned, transport_of

from planner.assembly import build_chain
from planner.criteria.jerk import JerkMotion, jerk_motion, pseudo_inverse_torque
from planner.outcome import Failure
from planner.planning import plan
from planner.result import Plan
from planner.scenario import Scenario

KIND: dict[str, Any] = {"criterion.kind": "jerk"}


def quintic(u: np.ndarray) -> np.ndarray:
    return 10 * u**3 - 15 * u**4 + 6 * u**5


def internal_directions(found: Plan, index: int) -> np.ndarray:
    """Torques that only press the hands together at one sample, (m, N)."""
    chain = build_chain(found.scenario)
    gamma: np.ndarray = chain.loop(chain.dynamics.placements(found.q[[index]])).jacobian()[0]
    return gamma


def redundant(folder: Path, **values: Any) -> Scenario:
    return planar_arms(folder, criterion={"kind": "jerk"}, **values)


def test_cost_and_path() -> None:
    found = planned(KIND)
    assert found.cost == pytest.approx(JERK, rel=1e-12)  # 360 * (0.3^2 + 0.1^2)
    start, goal = np.array([0.1, 0.4, 0.0]), np.array([0.4, 0.3, 0.0])
    wanted = start + quintic(found.time)[:, None] * (goal - start)
    assert np.max(np.abs(found.object_position - wanted)) < 1e-9
    assert found.path_length == pytest.approx(np.linalg.norm(goal - start), rel=1e-8)
    assert found.adjoint.shape == (len(found.time), 0)
    assert found.solver["iterations"] == 0


def test_no_other_motion_has_less_jerk() -> None:
    """Any change that keeps the ends, at rest and without acceleration, adds to the cost."""
    u = np.linspace(0.0, 1.0, 4001)
    line = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
    generator = np.random.default_rng(0)
    bump = np.polynomial.Polynomial.fromroots([0, 0, 0, 1, 1, 1])

    def cost(curve: Any) -> float:
        return float(0.5 * np.trapezoid(curve.deriv(3)(u) ** 2, u))

    least = cost(line)
    assert least == pytest.approx(360.0, rel=1e-4)
    for _ in range(5):
        assert cost(line + bump * np.polynomial.Polynomial(generator.normal(size=4))) > least


@pytest.mark.parametrize("duration", [0.05, 3.0, 20.0])
def test_the_cost_goes_with_the_fifth_power_of_the_duration(duration: float) -> None:
    found = planned(KIND | {"task.duration": duration})
    assert found.cost == pytest.approx(JERK / duration**5, rel=1e-12)


def test_neither_mass_nor_gravity_change_the_motion() -> None:
    plain = planned(KIND)
    for values in ({"object.mass": 20.0}, {"world.gravity": [0.0, -9.81, 0.0]}):
        other = planned(KIND | values)
        assert other.cost == plain.cost
        assert np.max(np.abs(other.q - plain.q)) < 1e-9
        assert np.max(np.abs(other.tau - plain.tau)) > 0.1


def test_velocities_at_the_ends() -> None:
    ends = {"task.start.velocity": [0.3, 0.2, 0.0], "task.goal.velocity": [-0.1, 0.4, 0.0]}
    found = planned(KIND | ends)
    step = found.time[1]
    x = found.object_position
    assert np.allclose((-3 * x[0] + 4 * x[1] - x[2]) / (2 * step), [0.3, 0.2, 0.0], atol=1e-4)
    assert np.allclose((3 * x[-1] - 4 * x[-2] + x[-3]) / (2 * step), [-0.1, 0.4, 0.0], atol=1e-4)
    curve = np.polynomial.polynomial.polyfit(found.time, x, 5)
    third = np.polynomial.polynomial.polyder(curve, 3)
    points, parts = np.polynomial.legendre.leggauss(4)
    jerk = np.polynomial.polynomial.polyval(0.5 * (points + 1.0), third)
    assert found.cost == pytest.approx(0.25 * parts @ (jerk**2).sum(axis=0), rel=1e-6)
    coarse = planned(KIND | ends | {"solver.samples": 11})
    assert coarse.cost == pytest.approx(found.cost, rel=1e-12), "samples only show the motion"
    assert found.checks["replay_end"] < 1e-6


@pytest.mark.parametrize(
    ("weights", "gravity"),
    [
        ("unit", [0.0, 0.0, 0.0]),
        ([1.0, 4.0, 0.5, 2.0], [0.0, 0.0, 0.0]),
        ("effort", [0.0, -9.81, 0.0]),
    ],
)
def test_torques_are_the_least_at_each_instant(weights: Any, gravity: list[float]) -> None:
    values = {"criterion.weights": weights, "world.gravity": gravity}
    found = planned(KIND | values)
    scale = np.array(weights) if isinstance(weights, list) else np.ones(4)
    if weights == "effort":
        scale = 1.0 / build_chain(human()).both("effort_limit")
    generator = np.random.default_rng(1)
    for index in (0, 60, 250, 400):
        tau = found.tau[index]
        directions = internal_directions(found, index)
        size = tau @ (scale * tau)
        assert size > 0.0 or index == 0
        # orthogonal to all that leaves the motion as it is, and so least
        assert np.max(np.abs(directions @ (scale * tau))) < 1e-10
        for _ in range(5):
            other = tau + directions.T @ generator.normal(size=len(directions))
            assert other @ (scale * other) > size


def test_those_torques_produce_the_motion() -> None:
    """And so do all that differ along the internal directions, which the replay shows."""
    found = planned(KIND)
    assert found.checks["replay_max"] < 1e-8
    assert found.checks["torque_balance"] < 1e-10
    assert found.checks["force_balance"] < 1e-10


def test_pseudo_inverse(mechanism: Mechanism) -> None:
    states = random_states(mechanism, 3)
    s = mechanism.freedoms(states.q).s
    load = np.random.default_rng(3).normal(size=states.tau.shape)
    weights = np.random.default_rng(4).uniform(0.5, 3.0, load.shape[1])
    tau = pseudo_inverse_torque(s, load, weights)
    # both do the same work along every motion of the chain
    assert np.allclose(np.einsum("knp,kn->kp", s, tau - load), 0.0, atol=1e-12)
    for k in range(3):
        root = np.sqrt(weights)
        wanted = np.linalg.pinv(s[k].T / root) @ s[k].T @ load[k] / root
        assert np.allclose(tau[k], wanted, rtol=1e-9, atol=1e-12)
    # a load that is no heavier than it has to be is its own least
    assert np.allclose(pseudo_inverse_torque(s, tau, weights), tau, atol=1e-11)


def test_redundant_joints_take_the_least_rates(tmp_path: Path) -> None:
    found = plan(redundant(tmp_path)).unwrap()
    start, goal = np.array([0.2, 0.4, 0.0]), np.array([0.3, 0.35, 0.0])
    wanted = start + quintic(found.time)[:, None] * (goal - start)
    assert np.max(np.abs(found.object_position - wanted)) < 1e-6
    chain = build_chain(found.scenario)
    assert chain.p > chain.r
    at = chain.dynamics.placements(found.q)
    rows = chain.task_rows(False) @ chain.object_jacobian(at)
    jacobian = np.concatenate([rows, chain.loop(at).jacobian()], axis=1)
    for k in (100, 250, 420):
        _, values, vectors = np.linalg.svd(jacobian[k])
        null = vectors[len(values) :]
        assert len(null) == chain.p - chain.r
        assert np.max(np.abs(null @ found.v[k])) < 1e-9 * np.max(np.abs(found.v[k]))
    # velocities and accelerations are those of the postures
    for values, rates in ((found.q, found.v), (found.v, found.a)):
        slope = np.gradient(values, found.time, axis=0, edge_order=2)
        assert np.max(np.abs(slope - rates)) < 1e-3 * np.max(np.abs(rates))
    assert found.checks["replay_end"] < 1e-3


def test_orientation_turns_along(tmp_path: Path) -> None:
    scenario = redundant(tmp_path, pair="rigid").override(
        {"task.start.rpy": [0.0, 0.0, 0.0], "task.goal.rpy": [0.0, 0.0, 0.2]}
    )
    found = plan(scenario).unwrap()
    turn = np.arctan2(found.object_rotation[:, 1, 0], found.object_rotation[:, 0, 0])
    assert np.max(np.abs(turn - 0.2 * quintic(found.time))) < 1e-6


def test_where_the_arms_cannot_follow_the_failure_names_the_time() -> None:
    """The line passes the left shoulder closer than the folded arm can hold the object."""
    values = {"task.start.xyz": [-0.12, 0.05, 0.0], "task.goal.xyz": [0.15, 0.05, 0.0]}
    found = plan(human(KIND | values))
    assert isinstance(found, Failure)
    assert found.status == "closure-lost"
    time = found.evidence["time"]
    assert f"t = {time:.3f} s" in found.reason
    # no later than where the hand is within |0.33 - 0.27| m of the shoulder
    u = np.linspace(0.0, 0.5, 10001)
    inner = u[np.argmax(np.hypot(-0.12 + 0.27 * quintic(u), 0.05) < 0.06)]
    assert 0.5 * inner < time <= inner


def test_samples_do_not_change_the_motion() -> None:
    scenario = human(KIND)
    transport = transport_of(scenario)
    coarse, fine = (
        jerk_motion(transport, np.linspace(0.0, 1.0, count), np.ones(4)) for count in (51, 501)
    )
    assert isinstance(coarse, JerkMotion)
    assert isinstance(fine, JerkMotion)
    assert coarse.cost == fine.cost
    assert np.max(np.abs(coarse.tau - fine.tau[::10])) < 1e-7
