"""Accelerations, hand force and their derivatives: against Pinocchio and against differences."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mechanisms
import numpy as np
import oracle
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mechanisms import (
    Mechanism,
    derivatives_of,
    difference,
    differences,
    random_states,
    relative_error,
)

from planner.constrained_dynamics import (
    Linearization,
    Motion,
    linearize,
)
from planner.forces import hand_forces

ACCURACY = 1e-7
STEP = 2e-3


@pytest.fixture(scope="module")
def bar(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return mechanisms.write(tmp_path_factory.mktemp("bar") / "bar.urdf", mechanisms.bar_urdf())


@pytest.fixture(scope="module")
def with_bar(bar: Path, three_jointed: Mechanism, three_jointed_rigid: Mechanism) -> dict:
    """Mechanisms that hold a bar, whose rotation takes torque too."""
    arms = mechanisms.human_arms({"object.urdf": str(bar), "object.mass": None})
    found = {
        "human_arms": mechanisms.settle(arms),
        "three_jointed": three_jointed,
        "three_jointed_rigid": three_jointed_rigid,
    }
    for pair in mechanisms.PAIRS:
        found[f"pandas-{pair}"] = mechanisms.settle(mechanisms.pandas(pair, thing=bar))
    return found


WITH_BAR = [
    "human_arms",
    "three_jointed",
    "three_jointed_rigid",
    *(f"pandas-{pair}" for pair in mechanisms.PAIRS),
]


def full_derivatives(mechanism: Mechanism, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of all accelerations and of the multiplier along (y, rate, torque).

    The whole system [I -G'; G 0] is solved for them, (K, N, 2p + N) and (K, m, 2p + N).
    """
    chain, at = mechanism.chain, motion.tangent
    n, m, count = chain.n, chain.m, len(motion.a)
    s, drag = at.s, derivatives_of(mechanism, motion).drag
    pull = at.loop.force_jacobian(motion.multiplier)
    _, load = chain.dynamics.inverse_dynamics_derivatives(at.q, motion.v, motion.a)
    torque_q, torque_v = load[:, 0] - pull, load[:, 1]
    closure_q, closure_v, _ = at.loop.derivatives(motion.v, motion.a)
    forces = -np.concatenate([torque_q @ s + torque_v @ drag, torque_v @ s], axis=2)
    forces = np.concatenate([forces, np.broadcast_to(np.eye(n), (count, n, n))], axis=2)
    slide = -np.concatenate([closure_q @ s + closure_v @ drag, closure_v @ s], axis=2)
    slide = np.concatenate([slide, np.zeros((count, m, n))], axis=2)
    matrix = np.zeros((count, n + m, n + m))
    matrix[:, :n, :n] = motion.inertia
    matrix[:, :n, n:] = -np.swapaxes(at.gamma, 1, 2)
    matrix[:, n:, :n] = at.gamma
    both = np.linalg.solve(matrix, np.concatenate([forces, slide], axis=1))
    return both[:, :n], both[:, n:]


def stacked(linear: Linearization) -> np.ndarray:
    return np.concatenate([linear.along_y, linear.along_rate, linear.along_torque], axis=2)


def linearized(mechanism: Mechanism, motion: Motion) -> Linearization:
    return linearize(motion, derivatives_of(mechanism, motion))


# ---- the equation of motion itself ---------------------------------------------------------------


@given(seed=st.integers(0, 2**32 - 1))
def test_motion_obeys_the_equation_of_motion_and_keeps_the_hands_together(
    mechanism: Mechanism, seed: int
) -> None:
    states = random_states(mechanism, 3, seed)
    motion = mechanism.move(states.q, states.rate, states.tau)
    dynamics, gamma = mechanism.chain.dynamics, motion.tangent.gamma
    load = dynamics.inverse_dynamics(states.q, motion.v, motion.a)
    pull = np.einsum("kmi,km->ki", gamma, motion.multiplier)
    assert relative_error(load - pull, states.tau) < 1e-10
    assert np.max(np.abs(np.einsum("kmi,ki->km", gamma, motion.v))) < 1e-10
    slide = np.einsum("kmi,ki->km", gamma, motion.a)
    assert relative_error(slide, -motion.tangent.loop.bias(motion.v)) < 1e-10


def test_work_of_the_torques_becomes_energy(mechanism: Mechanism) -> None:
    """The closure force does no work: kinetic and potential energy rise by v'tau."""
    states = random_states(mechanism, 4)
    motion = mechanism.move(states.q, states.rate, states.tau)
    model = mechanism.chain.dynamics.model
    data = model.createData()
    for q, v, a, tau in zip(states.q, motion.v, motion.a, states.tau, strict=True):

        def energy(t: float, q: Any = q, v: Any = v, a: Any = a) -> np.ndarray:
            then = v + t * a
            moved = q + t * v + t * t / 2 * a
            kinetic = pin.computeKineticEnergy(model, data, moved, then)
            return np.array([kinetic + pin.computePotentialEnergy(model, data, moved)])

        assert difference(energy, 2e-4)[0] == pytest.approx(v @ tau, rel=1e-8, abs=1e-8)


def test_samples_do_not_depend_on_their_batch(pandas: Mechanism) -> None:
    states = random_states(pandas, 5)
    together = pandas.move(states.q, states.rate, states.tau)
    alone = pandas.move(states.q[3:4], states.rate[3:4], states.tau[3:4])
    np.testing.assert_allclose(together.a[3:4], alone.a, rtol=1e-12)
    np.testing.assert_allclose(together.multiplier[3:4], alone.multiplier, rtol=1e-11)


# ---- against Pinocchio: hands joined by one constraint -------------------------------------------


def test_accelerations_and_force_are_pinocchios(mechanism: Mechanism) -> None:
    states = random_states(mechanism, 4)
    motion = mechanism.move(states.q, states.rate, states.tau)
    pair = mechanism.chain.pair
    answers = [
        oracle.direct(mechanism, *state)
        for state in zip(states.q, motion.v, states.tau, strict=True)
    ]
    assert relative_error(motion.a, np.array([answer.a for answer in answers])) < ACCURACY
    # Pinocchio tells the force on the left hand, the planner that on the right
    force = np.array([-answer.wrench for answer in answers])
    assert relative_error(motion.multiplier @ pair.blocked, force) < ACCURACY


@pytest.mark.parametrize("name", ["three_jointed_rigid", "pandas"])
def test_derivatives_under_a_rigid_grasp_are_pinocchios(
    name: str, request: pytest.FixtureRequest
) -> None:
    mechanism: Mechanism = request.getfixturevalue(name)
    states = random_states(mechanism, 4)
    motion = mechanism.move(states.q, states.rate, states.tau)
    drag = derivatives_of(mechanism, motion).drag
    accelerations, forces = [], []
    for place in range(4):
        answer = oracle.direct(mechanism, states.q[place], motion.v[place], states.tau[place])
        s, d = motion.tangent.s[place], drag[place]
        accelerations.append(
            np.hstack([answer.a_q @ s + answer.a_v @ d, answer.a_v @ s, answer.a_tau])
        )
        forces.append(
            -np.hstack(
                [answer.wrench_q @ s + answer.wrench_v @ d, answer.wrench_v @ s, answer.wrench_tau]
            )
        )
    independent = mechanism.joints.independent
    wanted = np.array(accelerations)
    assert relative_error(stacked(linearized(mechanism, motion)), wanted[:, independent]) < ACCURACY
    a, multiplier = full_derivatives(mechanism, motion)
    assert relative_error(a, wanted) < ACCURACY
    wrench = mechanism.chain.pair.blocked.T @ multiplier
    assert relative_error(wrench, np.array(forces)) < ACCURACY


# ---- against Pinocchio: the object and the pair as bodies and joints of their own ----------------


@pytest.mark.parametrize("name", WITH_BAR)
def test_a_pair_moves_like_pinocchios_joints_of_its_kind(name: str, with_bar: dict) -> None:
    """The object hung on the right hand by real joints: same motion, forces and derivatives."""
    mechanism: Mechanism = with_bar[name]
    chain = mechanism.chain
    states = random_states(mechanism, 2)
    motion = mechanism.move(states.q, states.rate, states.tau)
    explicit = oracle.Explicit(mechanism)
    hands = hand_forces(chain, motion)
    rotation = chain.object_pose(motion.tangent.at)[1]
    linear = stacked(linearized(mechanism, motion))
    for place, rate in enumerate(states.rate):
        answer = explicit.solve(states.q[place], motion.v[place], states.tau[place])
        assert relative_error(motion.a[place : place + 1], answer.a[None, : chain.n]) < ACCURACY
        left = np.concatenate([hands.left_force[place], hands.left_moment[place]])
        turned = (left.reshape(2, 3) @ rotation[place]).ravel()
        if chain.planar:  # the arms carry what acts across their plane
            keep = [0, 1, 5]
            assert relative_error(turned[None, keep], -answer.wrench[None, keep]) < ACCURACY
        else:
            assert relative_error(turned[None], -answer.wrench[None]) < ACCURACY
        s, drag = explicit.freedoms(states.q[place], rate)
        wanted = np.hstack(
            [answer.a_q @ s + answer.a_v @ drag, answer.a_v @ s, answer.a_tau[:, : chain.n]]
        )[mechanism.joints.independent]
        p = chain.p
        for part in (slice(0, p), slice(p, 2 * p), slice(2 * p, None)):
            assert (
                relative_error(linear[place : place + 1, :, part], wanted[None, :, part]) < ACCURACY
            )


# ---- against differences -------------------------------------------------------------------------


def check_against_differences(mechanism: Mechanism, seed: int) -> None:
    states = random_states(mechanism, 3, seed)
    q, rate, tau = states.q, states.rate, states.tau
    motion = mechanism.move(q, rate, tau)
    n, p = mechanism.chain.n, mechanism.chain.p

    def both(motion: Motion) -> np.ndarray:
        return np.concatenate([motion.a, motion.multiplier], axis=1)

    along = (
        differences(lambda d: both(mechanism.move(mechanism.shifted(q, d), rate, tau)), p, STEP),
        differences(lambda d: both(mechanism.move(q, rate + d, tau)), p, 1.0),
        differences(lambda d: both(mechanism.move(q, rate, tau + d)), n, 1.0),
    )
    linear = linearized(mechanism, motion)
    a, multiplier = full_derivatives(mechanism, motion)
    mine = (linear.along_y, linear.along_rate, linear.along_torque)
    place = 0
    for wanted, of_y in zip(along, mine, strict=True):
        part = slice(place, place + wanted.shape[2])
        place = part.stop
        assert relative_error(of_y, wanted[:, mechanism.joints.independent]) < ACCURACY
        assert relative_error(a[:, :, part], wanted[:, :n]) < ACCURACY
        assert relative_error(multiplier[:, :, part], wanted[:, n:]) < ACCURACY


@given(seed=st.integers(0, 2**32 - 1))
def test_derivatives_are_the_limits_of_differences(mechanism: Mechanism, seed: int) -> None:
    check_against_differences(mechanism, seed)


@pytest.mark.parametrize("name", WITH_BAR[3:])
def test_derivatives_of_every_pair_are_the_limits_of_differences(name: str, with_bar: dict) -> None:
    check_against_differences(with_bar[name], 1)


def test_a_stretched_arm_cannot_follow_the_other(human_arms: Mechanism) -> None:
    """Its hand moves only across the arm: as dependent joints those of that arm are no choice."""
    left, right = np.array([0, 1]), np.array([2, 3])
    joints = type(human_arms.joints)
    stretched = np.array([[np.pi / 3, 0.0, 1.2, 0.9]])
    q = Mechanism(human_arms.scenario, human_arms.chain, joints(left, right), stretched[0]).closed(
        stretched
    )
    leading = Mechanism(human_arms.scenario, human_arms.chain, joints(left, right), q[0])
    assert np.max(np.abs(leading.freedoms(q).s)) < 10.0
    following = Mechanism(human_arms.scenario, human_arms.chain, joints(right, left), q[0])
    s = following.freedoms(q).s
    assert not np.isfinite(s).all() or np.max(np.abs(s)) > 1e9
    # one lost sample leaves the others of its batch as they are
    batch = following.freedoms(np.concatenate([q, human_arms.posture[None]]))
    alone = following.freedoms(human_arms.posture[None])
    np.testing.assert_allclose(batch.s[1], alone.s[0], rtol=1e-12)


def test_shifted_postures_are_closed_to_second_order(mechanism: Mechanism) -> None:
    """Half the step leaves an eighth of the gap; what gap there was is closed on the way."""
    chain, joints = mechanism.chain, mechanism.joints
    q = random_states(mechanism, 3).q
    at = mechanism.freedoms(q)
    way = np.random.default_rng(0).normal(size=(3, chain.p))

    def gap(step: float) -> float:
        moved = at.shifted(joints, q[:, joints.independent] + step * way)
        np.testing.assert_allclose(
            moved[:, joints.independent], q[:, joints.independent] + step * way, atol=1e-14
        )
        return float(np.max(np.abs(chain.gap(chain.dynamics.placements(moved)))))

    assert gap(0.0) < 1e-12
    assert 6.0 < gap(2e-2) / gap(1e-2) < 10.0
    opened = q.copy()
    opened[:, joints.dependent] += 1e-5
    there = mechanism.freedoms(opened)
    closed = there.shifted(joints, opened[:, joints.independent], chain.gap(there.at))
    assert np.max(np.abs(chain.gap(chain.dynamics.placements(closed)))) < 1e-8
