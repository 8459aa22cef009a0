"""Torques that hold the chain at rest, and what the hands then do to the object."""

from __future__ import annotations

import mechanisms
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mechanisms import Mechanism, random_states

from planner.assembly import build_chain
from planner.constrained_dynamics import Motion
from planner.errors import ScenarioError
from planner.forces import hand_forces
from planner.holding import (
    Preload,
    gravity_torque,
    preload_torque,
    refuse_untransmitted,
    static_torque,
)
from planner.transport import make_transport

FORCE = st.tuples(*[st.floats(-50.0, 50.0)] * 3)


@pytest.fixture(scope="module")
def carrying(tmp_path_factory: pytest.TempPathFactory) -> Mechanism:
    """Two Pandas that hold a bar firmly, its centre of mass off the middle."""
    bar = mechanisms.write(tmp_path_factory.mktemp("bar") / "bar.urdf", mechanisms.bar_urdf())
    return mechanisms.settle(mechanisms.pandas(thing=bar))


def at_rest(mechanism: Mechanism, q: np.ndarray, tau: np.ndarray) -> Motion:
    motion = mechanism.move(q, np.zeros((len(q), mechanism.chain.p)), tau)
    assert np.max(np.abs(motion.a)) < 1e-8
    return motion


def weight(mechanism: Mechanism) -> np.ndarray:
    return -mechanism.chain.body.mass * mechanism.chain.gravity


# ---- least torques -------------------------------------------------------------------------------


def test_static_torques_hold_the_posture_with_the_least_norm(mechanism: Mechanism) -> None:
    q = random_states(mechanism, 3).q
    at = mechanism.freedoms(q)
    tau = static_torque(mechanism.chain, at)
    at_rest(mechanism, q, tau)
    if np.any(mechanism.chain.gravity):
        assert np.min(np.linalg.norm(tau, axis=1)) > 0.1
        # what only presses the hands together is all one may add; it is orthogonal to them
        assert np.max(np.abs(np.einsum("kmi,ki->km", at.gamma, tau))) < 1e-9
        squeeze = np.einsum("kmi,m->ki", at.gamma, np.ones(mechanism.chain.m))
        at_rest(mechanism, q, tau + squeeze)
        assert np.all(np.linalg.norm(tau + squeeze, axis=1) > np.linalg.norm(tau, axis=1))
    else:
        np.testing.assert_array_equal(tau, 0.0)


def test_gravity_torque_is_the_slope_of_potential_energy(pandas: Mechanism) -> None:
    q = random_states(pandas, 1).q
    model = pandas.chain.dynamics.model
    data = model.createData()

    def energy(d: np.ndarray) -> np.ndarray:
        return np.array([pin.computePotentialEnergy(model, data, q[0] + d)])

    slope = mechanisms.differences(energy, pandas.chain.n, 1e-2)
    np.testing.assert_allclose(gravity_torque(pandas.chain, q), slope, atol=1e-8)


# ---- preload -------------------------------------------------------------------------------------


@given(force=FORCE, moment=FORCE)
def test_firm_hands_share_the_weight_and_press_with_the_preload(
    carrying: Mechanism, force: tuple[float, ...], moment: tuple[float, ...]
) -> None:
    chain = carrying.chain
    preload = Preload(np.array(force), np.array(moment))
    q = random_states(carrying, 2).q
    hands = hand_forces(
        chain, at_rest(carrying, q, preload_torque(chain, carrying.freedoms(q), preload))
    )
    for left, right in zip(hands.left_force, hands.right_force, strict=True):
        np.testing.assert_allclose(left + right, weight(carrying), atol=1e-8)
        np.testing.assert_allclose(left - right, force, atol=1e-8)
    position, rotation = chain.object_pose(chain.dynamics.placements(q))
    lever = rotation @ chain.body.com
    for place in range(len(position)):
        left, right = hands.left_moment[place], hands.right_moment[place]
        np.testing.assert_allclose(
            left + right, np.cross(lever[place], weight(carrying)), atol=1e-8
        )
        np.testing.assert_allclose(left - right, moment, atol=1e-8)


@given(force=FORCE)
def test_hinged_hands_press_with_the_preload(
    three_jointed: Mechanism, force: tuple[float, ...]
) -> None:
    chain = three_jointed.chain
    wanted = np.array([force[0], force[1], 0.0])
    q = random_states(three_jointed, 2).q
    tau = preload_torque(chain, three_jointed.freedoms(q), Preload(wanted, np.zeros(3)))
    hands = hand_forces(chain, at_rest(three_jointed, q, tau))
    for left, right in zip(hands.left_force, hands.right_force, strict=True):
        np.testing.assert_allclose(left + right, weight(three_jointed), atol=1e-9)
        np.testing.assert_allclose(left - right, wanted, atol=1e-9)


def test_the_papers_arms_squeezing_with_ten_newtons(human_arms: Mechanism) -> None:
    """Without weight each hand pushes with half the preload: torques are J' times that."""
    chain = human_arms.chain
    q = human_arms.posture[None]
    preload = Preload(np.array([10.0, 0.0, 0.0]), np.zeros(3))
    tau = preload_torque(chain, human_arms.freedoms(q), preload)
    for start, push in ((0, 5.0), (2, -5.0)):
        shoulder, elbow = q[0, start], q[0, start] + q[0, start + 1]
        across = np.array([-0.27 * np.sin(shoulder) - 0.33 * np.sin(elbow), -0.33 * np.sin(elbow)])
        np.testing.assert_allclose(tau[0, start : start + 2], across * push, atol=1e-10)


@pytest.mark.parametrize(
    ("pair", "key", "force", "moment"),
    [
        ("prismatic", "boundary.goal.internal_force", (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ("planar", "boundary.goal.internal_force", (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),
        ("spherical", "boundary.goal.internal_moment", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        ("cylindrical", "boundary.goal.internal_force", (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    ],
)
def test_a_preload_that_the_pair_cannot_transmit_is_refused(
    pair: str, key: str, force: tuple[float, ...], moment: tuple[float, ...]
) -> None:
    chain = mechanisms.settle(mechanisms.pandas(pair)).chain
    preload = Preload(np.array(force), np.array(moment))
    with pytest.raises(ScenarioError, match=pair) as caught:
        refuse_untransmitted(chain, "goal", preload)
    assert caught.value.key == key
    assert "\n" not in str(caught.value)
    refuse_untransmitted(chain, "goal", Preload(np.zeros(3), np.zeros(3)))


def test_planar_arms_cannot_press_across_their_plane(
    human_arms: Mechanism, three_jointed_rigid: Mechanism
) -> None:
    none = np.zeros(3)
    with pytest.raises(ScenarioError, match=r"boundary\.start\.internal_force: .*plane"):
        refuse_untransmitted(human_arms.chain, "start", Preload(np.array([1.0, 0.0, 2.0]), none))
    with pytest.raises(ScenarioError, match=r"boundary\.start\.internal_moment"):
        refuse_untransmitted(human_arms.chain, "start", Preload(none, np.array([0.0, 0.0, 1.0])))
    firm = Preload(np.array([1.0, 2.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    refuse_untransmitted(three_jointed_rigid.chain, "start", firm)


def test_hands_move_the_object_by_newtons_and_eulers_laws(carrying: Mechanism) -> None:
    """In motion: forces sum to mass times acceleration, moments to the rate of spin momentum."""
    chain = carrying.chain
    states = random_states(carrying, 3)
    motion = carrying.move(states.q, states.rate, states.tau)
    hands = hand_forces(chain, motion)
    body = chain.body

    def momenta(t: float) -> np.ndarray:
        q = states.q + t * motion.v + t * t / 2.0 * motion.a
        v = motion.v + t * motion.a
        at = chain.dynamics.placements(q)
        position, rotation = chain.object_pose(at)
        twist = np.einsum("kij,kj->ki", chain.object_jacobian(at), v)
        lever = rotation @ body.com
        velocity = twist[:, :3] + np.cross(twist[:, 3:], lever)
        inertia = rotation @ body.inertia @ np.swapaxes(rotation, 1, 2)
        spin = np.einsum("kij,kj->ki", inertia, twist[:, 3:])
        about_origin = spin + np.cross(position + lever, body.mass * velocity)
        return np.concatenate([body.mass * velocity, about_origin], axis=1)

    rates = mechanisms.difference(momenta, 1e-4)
    position, rotation = chain.object_pose(chain.dynamics.placements(states.q))
    centre = position + rotation @ body.com
    force = hands.left_force + hands.right_force
    moment = hands.left_moment + hands.right_moment + np.cross(position, force)
    pull = np.broadcast_to(-weight(carrying), force.shape)
    size = np.max(np.abs(rates))
    np.testing.assert_allclose(force + pull, rates[:, :3], atol=1e-7 * size)
    np.testing.assert_allclose(moment + np.cross(centre, pull), rates[:, 3:], atol=1e-7 * size)


def test_a_scenarios_preload_reaches_its_end() -> None:
    scenario = mechanisms.human_arms({"boundary.start.internal_force": [3.0, -4.0, 0.0]})
    transport = make_transport(scenario, build_chain(scenario))
    assert transport.start.torque_rule == "preload"
    assert transport.start.preload is not None
    np.testing.assert_array_equal(transport.start.preload.force, [3.0, -4.0, 0.0])
    np.testing.assert_array_equal(transport.start.preload.moment, 0.0)
    assert transport.goal.torque_rule == "given"
