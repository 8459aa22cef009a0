"""Batches of Pinocchio's terms: the same as sample by sample, and never changed afterwards."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pinocchio as pin
from mechanisms import Mechanism, random_states


def test_every_sample_is_pinocchios_own(mechanism: Mechanism) -> None:
    dynamics = mechanism.chain.dynamics
    model, data = dynamics.model, dynamics.model.createData()
    q, v, a = np.random.default_rng(0).normal(size=(3, 4, mechanism.chain.n))
    at = dynamics.placements(q)
    inertia, bias = dynamics.inertia_and_bias(q, v)
    torque, along = dynamics.inverse_dynamics_derivatives(q, v, a)
    np.testing.assert_allclose(dynamics.inverse_dynamics(q, v, a), torque, atol=1e-12)
    for k in range(4):
        np.testing.assert_allclose(at.columns[k], pin.computeJointJacobians(model, data, q[k]))
        np.testing.assert_allclose(torque[k], pin.rnea(model, data, q[k], v[k], a[k]), atol=1e-12)
        np.testing.assert_allclose(bias[k], pin.nonLinearEffects(model, data, q[k], v[k]))
        mass = pin.crba(model, data, q[k])
        whole = np.triu(mass) + np.triu(mass, 1).T
        np.testing.assert_allclose(inertia[k], whole, atol=1e-12)
        np.testing.assert_allclose(along[k, 2], whole, atol=1e-12)
        pin.computeRNEADerivatives(model, data, q[k], v[k], a[k])
        np.testing.assert_allclose(along[k, 0], data.dtau_dq, atol=1e-12)
        np.testing.assert_allclose(along[k, 1], data.dtau_dv, atol=1e-12)


def test_later_batches_leave_earlier_ones_alone(mechanism: Mechanism) -> None:
    """Batches of one size share their work space, not what they return."""
    dynamics, n = mechanism.chain.dynamics, mechanism.chain.n
    states = random_states(mechanism, 3)
    still = np.zeros((3, n))
    first = dynamics.placements(states.q)
    load = dynamics.inverse_dynamics_derivatives(states.q, still, still)
    kept = [values.copy() for values in (*vars(first).values(), *load)]
    dynamics.placements(states.q + 0.3)
    dynamics.inverse_dynamics_derivatives(states.q + 0.3, still + 1.0, still)
    for values, before in zip((*vars(first).values(), *load), kept, strict=True):
        np.testing.assert_array_equal(values, before)


def test_any_number_of_batch_sizes_may_be_asked_for(human_arms: Mechanism) -> None:
    dynamics = human_arms.chain.dynamics
    alone = dynamics.placements(human_arms.posture[None]).columns[0]
    for count in range(1, 100):
        q = np.repeat(human_arms.posture[None], count, axis=0)
        np.testing.assert_array_equal(dynamics.placements(q).columns[-1], alone)
    assert dynamics.placements(np.zeros((0, human_arms.chain.n))).columns.shape[0] == 0


def test_a_copied_chain_computes_on_its_own(mechanism: Mechanism) -> None:
    dynamics, q = mechanism.chain.dynamics, mechanism.posture[None]
    wanted, torque = dynamics.placements(q), dynamics.inverse_dynamics(q, q, q)
    for copied in (copy.deepcopy(dynamics), pickle.loads(pickle.dumps(dynamics))):
        copied.placements(q + 0.5)
        found = copied.placements(q)
        for name, values in vars(wanted).items():
            np.testing.assert_allclose(getattr(found, name), values, atol=1e-14)
        np.testing.assert_allclose(copied.inverse_dynamics(q, q, q), torque, atol=1e-12)
