"""Jacobians of the boundary value problem's equations, and the torque rates along a motion."""

from __future__ import annotations

import numpy as np
import pytest
from mechanisms import Mechanism, difference, differences, random_states, relative_error

from planner.costates import StateCost
from planner.criteria import Criterion, Mixed, Torque, TorqueChange, curvature, make_criterion
from planner.independent_joints import Coordinates

# second derivatives are forward differences, some 7e-6 off: Newton's method needs no more
ACCURACY = 3e-5
SHARE = np.array([0.0, 0.4, 1.0])


def criteria(mechanism: Mechanism) -> dict[str, Criterion]:
    chain = mechanism.chain
    n, p = chain.n, chain.p
    weights = np.random.default_rng(7).uniform(0.5, 2.0, (2, n))
    cost = StateCost(0.3, 0.4, mechanism.posture + 0.1)
    return {
        "torque-change": TorqueChange(n, p, weights[0], np.zeros(n), None),
        "regular": TorqueChange(n, p, weights[0], np.zeros(n), cost),
        "mixed": Mixed(n, p, weights[0], weights[1], None),
        "torque": Torque(n, p, np.empty(0), weights[1], cost),
    }


def situation(mechanism: Mechanism, criterion: Criterion) -> tuple[Coordinates, np.ndarray]:
    """A motion to stay near, and states and costates of order one beside it."""
    states = random_states(mechanism, 3)
    coordinates = Coordinates(mechanism.chain, mechanism.joints, SHARE, states.q)
    x = np.random.default_rng(2).normal(size=(3, 2 * criterion.state_size))
    x[:, criterion.at_y] = states.q[:, mechanism.joints.independent]
    return coordinates, x


KINDS = ["torque-change", "regular", "mixed", "torque"]


@pytest.mark.parametrize("kind", KINDS)
def test_jacobian_is_the_derivative_of_the_equations(mechanism: Mechanism, kind: str) -> None:
    criterion = criteria(mechanism)[kind]
    coordinates, x = situation(mechanism, criterion)
    independent = mechanism.joints.independent

    def slope(d: np.ndarray) -> np.ndarray:
        at = criterion.evaluate(coordinates, SHARE, x + d)
        assert at.closed.all()
        return criterion.right_side(at, x + d, independent)

    at = criterion.evaluate(coordinates, SHARE, x)
    found = criterion.jacobian(coordinates, at, x, 1.0)
    wanted = differences(slope, x.shape[1], 2e-3)
    # each block by itself: small ones must not hide behind large ones
    places = [criterion.at_y, criterion.at_rate, criterion.at_n1, criterion.at_n2]
    if criterion.torque_is_state:
        places += [criterion.at_tau, criterion.at_n3]
    compared = 0
    for rows in places:
        for columns in places:
            block, mine = wanted[:, rows, columns], found[:, rows, columns]
            if np.max(np.abs(block)) > 1e-6:
                assert relative_error(mine, block) < ACCURACY, (rows, columns)
                compared += 1
            else:
                assert np.max(np.abs(mine)) < 1e-6, (rows, columns)
    assert compared == {"torque-change": 15, "regular": 15, "mixed": 16, "torque": 11}[kind]


def test_states_are_taken_in_blocks_of_any_size(
    mechanism: Mechanism, monkeypatch: pytest.MonkeyPatch
) -> None:
    criterion = criteria(mechanism)["regular"]
    coordinates, x = situation(mechanism, criterion)
    at = criterion.evaluate(coordinates, SHARE, x)
    whole = criterion.jacobian(coordinates, at, x, 1.0)
    for size in (1, 4 * mechanism.chain.p):
        monkeypatch.setattr(curvature, "_BLOCK", size)
        np.testing.assert_allclose(criterion.jacobian(coordinates, at, x, 1.0), whole, rtol=1e-7)


@pytest.mark.parametrize("kind", KINDS)
def test_hamiltonian_is_constant_along_its_own_flow(mechanism: Mechanism, kind: str) -> None:
    """The equations are Hamilton's: its rate of change along them is zero in any state."""
    criterion = criteria(mechanism)[kind]
    coordinates, x = situation(mechanism, criterion)
    independent = mechanism.joints.independent
    flow = criterion.right_side(criterion.evaluate(coordinates, SHARE, x), x, independent)

    def terms(t: float) -> np.ndarray:
        moved = x + t * flow
        return criterion.hamiltonian(
            criterion.evaluate(coordinates, SHARE, moved), moved, independent
        )

    change = difference(terms, 0.02 / np.max(np.abs(flow)))
    largest = np.max(np.abs(change), axis=1)
    assert np.max(np.abs(change.sum(axis=1)) / largest) < 1e-7


@pytest.mark.parametrize("kind", KINDS)
def test_torque_rate_is_the_torques_rate_of_change(mechanism: Mechanism, kind: str) -> None:
    criterion = criteria(mechanism)[kind]
    coordinates, x = situation(mechanism, criterion)
    at = criterion.evaluate(coordinates, SHARE, x)
    flow = criterion.right_side(at, x, mechanism.joints.independent)
    step = 0.02 / np.max(np.abs(flow))
    wanted = difference(lambda t: criterion.evaluate(coordinates, SHARE, x + t * flow).tau, step)
    assert relative_error(criterion.torque_rate(coordinates, SHARE, x, at), wanted) < ACCURACY


@pytest.mark.parametrize("kind", KINDS)
def test_control_minimises_the_hamiltonian(human_arms: Mechanism, kind: str) -> None:
    """Eq. 15: at the optimal control no other one gives less, and its derivative vanishes."""
    criterion = criteria(human_arms)[kind]
    coordinates, x = situation(human_arms, criterion)
    at = criterion.evaluate(coordinates, SHARE, x)
    chain, independent = human_arms.chain, human_arms.joints.independent
    n2 = x[:, criterion.at_n2]

    def hamiltonian(d: np.ndarray) -> np.ndarray:
        if criterion.torque_is_state:
            u = criterion.torque_rate(coordinates, SHARE, x, at) + d
            return 0.5 * u**2 @ criterion.rate_weights + (x[:, criterion.at_n3] * u).sum(1)
        tau = at.tau + d
        a = human_arms.move(at.tangent.q, x[:, criterion.at_rate], tau).a[:, independent]
        return 0.5 * tau**2 @ criterion.torque_weights + (n2 * a).sum(1)

    slope = differences(hamiltonian, chain.n, 1e-2)
    assert np.max(np.abs(slope)) < 1e-9 * np.max(np.abs(hamiltonian(np.full(chain.n, 1.0))))
    for change in np.random.default_rng(0).normal(size=(5, chain.n)):
        assert np.all(hamiltonian(change) > hamiltonian(0.0 * change))


def test_states_of_the_papers_problem_are_sixteen_and_eight(human_arms: Mechanism) -> None:
    sizes = {}
    for kind in ("torque-change", "torque", "mixed", "jerk"):
        scenario = human_arms.scenario.override({"criterion.kind": kind})
        criterion = make_criterion(scenario, human_arms.chain, human_arms.posture)
        if criterion is not None:
            assert criterion.name == kind
            sizes[kind] = 2 * criterion.state_size
    assert sizes == {"torque-change": 16, "torque": 8, "mixed": 16}


def test_places_of_states_and_costates_fill_the_vector(mechanism: Mechanism) -> None:
    for criterion in criteria(mechanism).values():
        places = [criterion.at_y, criterion.at_rate, criterion.at_tau]
        places += [criterion.at_n1, criterion.at_n2, criterion.at_n3]
        filled = np.concatenate([np.arange(100)[place] for place in places])
        np.testing.assert_array_equal(filled, np.arange(2 * criterion.state_size))


def test_mixed_criterion_shares_its_weights_between_torque_and_its_rate(
    human_arms: Mechanism,
) -> None:
    def made(**values: object) -> Criterion:
        keys = {f"criterion.{key}": value for key, value in values.items()}
        scenario = human_arms.scenario.override({"criterion.kind": "mixed", **keys})
        criterion = make_criterion(scenario, human_arms.chain, human_arms.posture)
        assert criterion is not None
        return criterion

    weights = [1.0, 2.0, 3.0, 4.0]
    quarter = made(weights=weights, torque_share=0.25)
    np.testing.assert_allclose(quarter.rate_weights, 0.75 * np.array(weights))
    np.testing.assert_allclose(quarter.torque_weights, 0.25 * np.array(weights))
    assert quarter.torque_is_state
    whole = made(weights=weights, torque_share=1.0)
    assert not whole.torque_is_state
    np.testing.assert_allclose(whole.torque_weights, weights)
    cost = made(speed_cost=0.2, posture_cost=0.3).state_cost
    assert cost is not None
    assert (cost.speed, cost.posture) == (0.2, 0.3)
    np.testing.assert_array_equal(cost.reference, human_arms.posture)
