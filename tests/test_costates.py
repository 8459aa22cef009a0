"""Gradient of the Hamiltonian n2'a + state cost, against differences and its linearization."""

from __future__ import annotations

import mechanisms
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mechanisms import Mechanism, derivatives_of, differences, random_states, relative_error

from planner.constrained_dynamics import linearize
from planner.costates import Gradient, StateCost, hamiltonian_gradient, torque_costate

STEP = 2e-3
ACCURACY = 1e-7


@pytest.fixture(scope="module")
def pairs() -> dict[str, Mechanism]:
    """Two Pandas with each pair between their hands."""
    return {pair: mechanisms.settle(mechanisms.pandas(pair)) for pair in mechanisms.PAIRS}


def gradient(
    mechanism: Mechanism, states: mechanisms.States, cost: StateCost | None = None
) -> Gradient:
    motion = mechanism.move(states.q, states.rate, states.tau)
    return hamiltonian_gradient(motion, derivatives_of(mechanism, motion), states.n2, cost)


def check_against_differences(mechanism: Mechanism, seed: int) -> None:
    states = random_states(mechanism, 3, seed)
    q, rate, tau = states.q, states.rate, states.tau
    chain = mechanism.chain
    cost = StateCost(30.0, 200.0, mechanism.posture + 0.3)

    def hamiltonian(q: np.ndarray, rate: np.ndarray, tau: np.ndarray) -> np.ndarray:
        motion = mechanism.move(q, rate, tau)
        away = q - cost.reference
        running = 0.5 * (30.0 * (motion.v**2).sum(1) + 200.0 * (away**2).sum(1))
        np.testing.assert_allclose(cost.value(q, motion.v), running)
        return (states.n2 * motion.a[:, mechanism.joints.independent]).sum(1) + running

    along_y = differences(lambda d: hamiltonian(mechanism.shifted(q, d), rate, tau), chain.p, STEP)
    along_rate = differences(lambda d: hamiltonian(q, rate + d, tau), chain.p, 1.0)
    along_torque = differences(lambda d: hamiltonian(q, rate, tau + d), chain.n, 1.0)
    found = gradient(mechanism, states, cost)
    assert relative_error(found.along_y, along_y) < ACCURACY
    assert relative_error(found.along_rate, along_rate) < ACCURACY
    assert relative_error(found.along_torque, along_torque) < ACCURACY


@given(seed=st.integers(0, 2**32 - 1))
def test_gradient_is_the_limit_of_differences(mechanism: Mechanism, seed: int) -> None:
    check_against_differences(mechanism, seed)


@pytest.mark.parametrize("pair", mechanisms.PAIRS)
def test_gradient_of_every_pair_is_the_limit_of_differences(
    pair: str, pairs: dict[str, Mechanism]
) -> None:
    check_against_differences(pairs[pair], 5)


def test_gradient_is_the_transposed_linearization_times_the_costates(mechanism: Mechanism) -> None:
    """The costates' equations are the adjoint of the linearized motion, to the last digits."""
    states = random_states(mechanism, 4)
    motion = mechanism.move(states.q, states.rate, states.tau)
    linear = linearize(motion, derivatives_of(mechanism, motion))
    found = gradient(mechanism, states)
    for mine, matrix in (
        (found.along_y, linear.along_y),
        (found.along_rate, linear.along_rate),
        (found.along_torque, linear.along_torque),
    ):
        assert relative_error(mine, np.einsum("kij,ki->kj", matrix, states.n2)) < 1e-10


def test_torque_costates_are_blind_to_internal_forces(mechanism: Mechanism) -> None:
    """Torques that only press the hands against each other do not move the object."""
    states = random_states(mechanism, 4)
    motion = mechanism.move(states.q, states.rate, states.tau)
    mu = torque_costate(motion.tangent, motion.reduced, states.n2)
    blind = np.einsum("kmi,ki->km", motion.tangent.gamma, mu)
    assert np.max(np.abs(blind)) < 1e-11 * np.max(np.abs(mu))
    squeeze = np.random.default_rng(1).normal(size=(4, mechanism.chain.m))
    pressed = states.tau + np.einsum("kmi,km->ki", motion.tangent.gamma, squeeze)
    same = mechanism.move(states.q, states.rate, pressed)
    assert relative_error(same.a, motion.a) < 1e-10
    assert relative_error(motion.multiplier - same.multiplier, squeeze) < 1e-9
