"""End conditions: as many as there are states, and costates blind to every change allowed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg
from mechanisms import Mechanism, differences, random_states

from planner.boundary_conditions import EndConditions
from planner.constrained_dynamics import tangent
from planner.criteria import Criterion, make_criterion
from planner.errors import ScenarioError
from planner.holding import preload_torque, static_torque
from planner.independent_joints import Coordinates
from planner.inverse_kinematics import find_posture
from planner.posture_equations import ObjectPose
from planner.scenario import Scenario
from planner.transport import Transport, make_transport

RULES = ["zero", "numbers", "free", "static", "rest", "preload"]


def conditions(mechanism: Mechanism, **overrides: Any) -> tuple[EndConditions, EndConditions]:
    """Those at the start and at the goal of the mechanism's scenario."""
    keys = {key.replace("__", "."): value for key, value in overrides.items()}
    scenario: Scenario = mechanism.scenario.override(keys)
    transport = make_transport(scenario, mechanism.chain)
    criterion = make_criterion(scenario, mechanism.chain, transport.reference)
    assert criterion is not None
    coordinates = Coordinates(mechanism.chain, transport.joints, transport.share, transport.guess)
    return tuple(  # type: ignore[return-value]
        EndConditions(transport, criterion, coordinates, end)
        for end in (transport.start, transport.goal)
    )


def with_rule(mechanism: Mechanism, rule: str, **overrides: Any) -> EndConditions:
    """Conditions at a goal where the torques follow the rule."""
    n = mechanism.chain.n
    given: dict[str, Any] = {"boundary__goal__torque": rule}
    if rule == "numbers":
        given = {"boundary__goal__torque": list(np.linspace(-1.0, 1.0, n))}
    if rule == "preload":
        given = {"boundary__goal__internal_force": [4.0, -3.0, 0.0]}
    return conditions(mechanism, **given, **overrides)[1]


def moved(end: EndConditions) -> Mechanism:
    """The mechanism with the motion's own independent joints."""
    transport: Transport = end.transport
    return Mechanism(None, transport.chain, transport.joints, end.end.posture)  # type: ignore[arg-type]


def self_motions(end: EndConditions, q: np.ndarray) -> np.ndarray:
    """Motions of the independent joints that leave the object in its place, (p, p - r)."""
    chain = end.transport.chain
    if end.end.held:
        return np.zeros((chain.p, 0))
    at = tangent(chain, end.transport.joints, q[None], chain.dynamics.placements(q[None]))
    rows = chain.task_rows(end.end.pose.rotation is not None)
    return scipy.linalg.null_space(rows @ chain.object_jacobian(at.at)[0] @ at.s[0])


def another_posture(end: EndConditions) -> np.ndarray:
    """A posture with the object in its place at that end; another one than guessed, if it may."""
    q, chain = end.end.posture, end.transport.chain
    if end.end.held:
        return q
    motions = moved(end).freedoms(q[None]).s[0] @ self_motions(end, q)
    away = 0.2 * motions.sum(axis=1) / np.linalg.norm(motions.sum(axis=1))
    other = find_posture(chain, end.end.pose, q + away, "k")
    assert np.linalg.norm(other - q) > 0.1
    return other


def allowed_changes(
    end: EndConditions, rule: str, q: np.ndarray, squeeze: np.ndarray
) -> np.ndarray:
    """Spans the changes of (y, tau) that the end leaves open, from differences, (p + n, .)."""
    mechanism, chain = moved(end), end.transport.chain
    p, n = chain.p, chain.n
    motions = self_motions(end, q)

    def torque(d: np.ndarray) -> np.ndarray:
        at = mechanism.freedoms(mechanism.shifted(q[None], d[None]))
        if rule == "preload":
            assert end.end.preload is not None
            return preload_torque(chain, at, end.end.preload)[0]
        if rule in ("static", "rest"):
            tau = static_torque(chain, at)[0]
            return tau + at.gamma[0].T @ squeeze if rule == "rest" else tau
        return np.zeros(n)

    slope = differences(torque, p, 2e-3)
    changes = [np.vstack([motions, slope @ motions])]
    if rule == "free":
        changes.append(np.vstack([np.zeros((p, n)), np.eye(n)]))
    if rule == "rest":
        gamma = mechanism.freedoms(q[None]).gamma[0]
        changes.append(np.vstack([np.zeros((p, chain.m)), gamma.T]))
    return np.hstack(changes)


def torque_at(end: EndConditions, rule: str, q: np.ndarray, squeeze: np.ndarray) -> np.ndarray:
    """Torques that the rule allows."""
    chain, at = end.transport.chain, moved(end).freedoms(q[None])
    if rule == "free":
        return np.random.default_rng(4).normal(size=chain.n)
    if rule == "numbers":
        return np.linspace(-1.0, 1.0, chain.n)
    if rule == "preload":
        assert end.end.preload is not None
        return preload_torque(chain, at, end.end.preload)[0]
    if rule in ("static", "rest"):
        return static_torque(chain, at)[0] + (rule == "rest") * at.gamma[0].T @ squeeze
    return np.zeros(chain.n)


def state(
    criterion: Criterion, y: np.ndarray, tau: np.ndarray, n1: np.ndarray, n3: np.ndarray
) -> np.ndarray:
    x = np.random.default_rng(6).normal(size=(1, 2 * criterion.state_size))
    x[0, criterion.at_y], x[0, criterion.at_rate] = y, 0.0
    x[0, criterion.at_n1] = n1
    if criterion.torque_is_state:
        x[0, criterion.at_tau], x[0, criterion.at_n3] = tau, n3
    return x


@pytest.mark.parametrize("rule", RULES)
def test_costates_are_blind_to_every_change_that_an_end_allows(
    mechanism: Mechanism, rule: str
) -> None:
    """And to no other: each condition fails for a costate along one of those changes."""
    end = with_rule(mechanism, rule)
    criterion, chain = end.criterion, end.transport.chain
    p = chain.p
    generator = np.random.default_rng(8)
    squeeze = generator.normal(size=chain.m)
    q = another_posture(end)
    changes = allowed_changes(end, rule, q, squeeze)
    rest = scipy.linalg.null_space(changes.T) if changes.shape[1] else np.eye(p + chain.n)
    costates = rest @ generator.normal(size=rest.shape[1])
    y, tau = q[end.transport.joints.independent], torque_at(end, rule, q, squeeze)
    residual = end.residual(state(criterion, y, tau, costates[:p], costates[p:]))
    assert residual.shape == (1, criterion.state_size)
    assert np.max(np.abs(residual)) < 2e-7 * max(1.0, np.max(np.abs(changes), initial=0.0))
    for change in changes.T:
        seeing = costates + change / np.linalg.norm(change)
        residual = end.residual(state(criterion, y, tau, seeing[:p], seeing[p:]))
        assert np.max(np.abs(residual)) > 1e-4


@pytest.mark.parametrize("rule", RULES)
def test_conditions_are_as_many_as_states_and_independent(mechanism: Mechanism, rule: str) -> None:
    end = with_rule(mechanism, rule)
    criterion, chain = end.criterion, end.transport.chain
    squeeze = np.ones(chain.m)
    q = another_posture(end)
    zero = np.zeros(chain.n)
    y, tau = q[end.transport.joints.independent], torque_at(end, rule, q, squeeze)
    x = state(criterion, y, tau, zero[: chain.p], zero)
    unit = 1e-5 * np.eye(2 * criterion.state_size)
    slope = (end.residual(x + unit) - end.residual(x - unit)) / 2e-5
    assert slope.shape[1] == criterion.state_size
    slope = slope / np.linalg.norm(slope, axis=0)
    assert np.linalg.svd(slope, compute_uv=False)[-1] > 1e-4


def test_an_object_out_of_its_place_or_in_motion_is_noticed(mechanism: Mechanism) -> None:
    end = with_rule(mechanism, "zero")
    criterion, zero = end.criterion, np.zeros(mechanism.chain.n)
    y = another_posture(end)[end.transport.joints.independent]
    for part, size in ((criterion.at_y, 1e-3), (criterion.at_rate, 1e-3), (criterion.at_tau, 0.1)):
        x = state(criterion, y, zero, zero[: criterion.p], zero)
        assert np.max(np.abs(end.residual(x))) < 1e-9
        x[0, part] += size
        assert np.max(np.abs(end.residual(x))) > 1e-4


def test_the_object_is_measured_in_metres(three_jointed: Mechanism) -> None:
    """The first conditions of a free posture are the object's offset along the plane's axes."""
    end = with_rule(three_jointed, "zero")
    chain, zero = three_jointed.chain, np.zeros(6)
    off = ObjectPose(end.end.pose.position + np.array([0.003, -0.002, 0.0]), None)
    q = find_posture(chain, off, end.end.posture, "k")
    y = q[end.transport.joints.independent]
    residual = end.residual(state(end.criterion, y, zero, zero[:4], zero))
    np.testing.assert_allclose(residual[0, :2], [0.003, -0.002], atol=1e-9)


def test_held_postures_leave_their_costates_free(human_arms: Mechanism) -> None:
    """Arms without redundancy: n1 and n2 may be anything at either end, as in the paper."""
    for end in conditions(human_arms):
        assert end.end.held
        assert end.linear
        y = end.end.posture[end.transport.joints.independent]
        zero = np.zeros(4)
        x = state(end.criterion, y, zero, np.array([3.0, -5.0]), np.ones(4))
        np.testing.assert_allclose(end.residual(x), 0.0, atol=1e-12)


def test_without_torque_states_only_posture_and_speed_are_prescribed(
    three_jointed: Mechanism,
) -> None:
    end = with_rule(three_jointed, "static", criterion__kind="torque")
    criterion, chain = end.criterion, three_jointed.chain
    q = another_posture(end)
    motions = self_motions(end, q)
    n1 = scipy.linalg.null_space(motions.T) @ [1.0, -2.0]
    y, none = q[end.transport.joints.independent], np.zeros(0)
    residual = end.residual(state(criterion, y, none, n1, none))
    assert residual.shape == (1, 2 * chain.p)
    np.testing.assert_allclose(residual, 0.0, atol=1e-8)
    seeing = end.residual(state(criterion, y, none, n1 + motions[:, 0], none))
    assert np.max(np.abs(seeing)) > 0.1


def test_a_held_start_has_the_given_posture(three_jointed: Mechanism) -> None:
    start, goal = conditions(three_jointed, task__posture="start")
    assert start.end.held
    assert not goal.end.held


@pytest.mark.parametrize("name", ["human_arms", "three_jointed"])
def test_a_given_velocity_is_taken_with_the_least_joint_rates(
    name: str, request: pytest.FixtureRequest
) -> None:
    mechanism: Mechanism = request.getfixturevalue(name)
    velocity = [0.2, -0.1, 0.0]
    start, goal = conditions(mechanism, task__posture="start", task__start__velocity=velocity)
    at = moved(start).freedoms(start.end.posture[None])
    v = at.s[0] @ start.rate
    jacobian = mechanism.chain.object_jacobian(at.at)[0]
    np.testing.assert_allclose(jacobian[:3] @ v, velocity, atol=1e-10)
    still = scipy.linalg.null_space(np.vstack([jacobian[:2], at.gamma[0]]))
    np.testing.assert_allclose(still.T @ v, 0.0, atol=1e-10)
    np.testing.assert_array_equal(goal.rate, 0.0)
    y = start.end.posture[start.transport.joints.independent]
    zero = np.zeros(mechanism.chain.n)
    x = state(start.criterion, y, zero, zero[: start.criterion.p], zero)
    residual = start.residual(x)[0, start.criterion.at_rate]
    np.testing.assert_allclose(residual, -start.rate, atol=1e-12)


def test_a_velocity_where_the_posture_is_free_is_refused(three_jointed: Mechanism) -> None:
    with pytest.raises(ScenarioError, match=r"task\.goal\.velocity"):
        conditions(three_jointed, task__goal__velocity=[0.1, 0.0, 0.0])


def test_torques_must_be_as_many_as_joints(human_arms: Mechanism) -> None:
    with pytest.raises(ScenarioError, match=r"boundary\.goal\.torque: has 3 torques for 4 joints"):
        conditions(human_arms, boundary__goal__torque=[1.0, 2.0, 3.0])


@pytest.mark.parametrize("name", ["human_arms", "three_jointed"])
def test_conditions_of_a_batch_are_those_of_its_states(
    name: str, request: pytest.FixtureRequest
) -> None:
    mechanism: Mechanism = request.getfixturevalue(name)
    for rule in RULES:
        end = with_rule(mechanism, rule)
        x = 0.1 * np.random.default_rng(0).normal(size=(3, 2 * end.criterion.state_size))
        x[:, end.criterion.at_y] += end.end.posture[end.transport.joints.independent]
        alone = np.concatenate([end.residual(x[place : place + 1]) for place in range(3)])
        np.testing.assert_allclose(end.residual(x), alone, rtol=1e-9, atol=1e-9)


def test_random_states_meet_no_end(human_arms: Mechanism) -> None:
    start, goal = conditions(human_arms)
    q = random_states(human_arms, 1).q[0]
    zero = np.zeros(4)
    x = state(start.criterion, q[start.transport.joints.independent], zero, zero[:2], zero)
    assert np.max(np.abs(start.residual(x))) > 1e-3
    assert np.max(np.abs(goal.residual(x))) > 1e-3
