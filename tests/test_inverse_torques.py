"""Torques that a motion and a multiplier need, on all mechanisms."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from mechanisms import Mechanism, differences, random_states, relative_error

from planner.solvers.inverse_torques import Torques, inverse_torques


class Case(NamedTuple):
    mechanism: Mechanism
    q: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    multiplier: np.ndarray

    def torques(
        self,
        *,
        along: np.ndarray | float = 0.0,
        rate: np.ndarray | float = 0.0,
        acceleration: np.ndarray | float = 0.0,
        multiplier: np.ndarray | float = 0.0,
    ) -> Torques:
        """Torques after changes of the motion."""
        mechanism = self.mechanism
        along = np.broadcast_to(along, self.rate.shape)
        return inverse_torques(
            mechanism.chain,
            mechanism.joints,
            mechanism.freedoms(mechanism.shifted(self.q, along)),
            self.rate + rate,
            self.acceleration + acceleration,
            self.multiplier + multiplier,
        )


@pytest.fixture
def case(mechanism: Mechanism) -> Case:
    states = random_states(mechanism, 3)
    generator = np.random.default_rng(4)
    shape = states.rate.shape
    return Case(
        mechanism,
        states.q,
        states.rate,
        generator.normal(size=shape),
        3.0 * generator.normal(size=(3, mechanism.chain.m)),
    )


def test_they_undo_the_equation_of_motion(mechanism: Mechanism) -> None:
    """Forward from torques to accelerations and force, and back."""
    states = random_states(mechanism, 4, seed=1)
    motion = mechanism.move(states.q, states.rate, states.tau)
    torques = inverse_torques(
        mechanism.chain,
        mechanism.joints,
        motion.tangent,
        states.rate,
        motion.a[:, mechanism.joints.independent],
        motion.multiplier,
    )
    assert relative_error(torques.tau, states.tau) < 1e-11
    assert relative_error(torques.v, motion.v) < 1e-13
    assert relative_error(torques.a, motion.a) < 1e-11


def test_they_are_pinocchios_inverse_dynamics_less_the_hands_force(case: Case) -> None:
    torques = case.torques()
    model = case.mechanism.chain.dynamics.model
    data = model.createData()
    own = np.array(
        [
            pin.rnea(model, data, q, v, a).copy()
            for q, v, a in zip(case.q, torques.v, torques.a, strict=True)
        ]
    )
    pull = np.einsum("kmn,km->kn", torques.tangent.gamma, case.multiplier)
    assert relative_error(torques.tau, own - pull) < 1e-12


def test_derivatives(case: Case) -> None:
    found = case.torques()
    p, m = case.mechanism.chain.p, case.mechanism.chain.m

    def tau(**change: np.ndarray) -> np.ndarray:
        return case.torques(**change).tau

    for name, derivative, size in (
        ("along", found.along_motion[:, 0], p),
        ("rate", found.along_motion[:, 1], p),
        ("acceleration", found.along_motion[:, 2], p),
        ("multiplier", found.along_multiplier, m),
    ):
        wanted = differences(lambda d, name=name: tau(**{name: d}), size, 2e-3)  # type: ignore[misc]
        assert relative_error(derivative, wanted) < 1e-8, name


def test_drag_is_the_turn_of_the_velocity(case: Case) -> None:
    found = case.torques()
    wanted = differences(lambda d: case.torques(along=d).v, case.mechanism.chain.p, 2e-3)
    assert relative_error(found.derivatives.drag, wanted) < 1e-9
