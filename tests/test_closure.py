"""Closure: the gap between the hands, its velocity, acceleration and derivatives."""

from __future__ import annotations

import mechanisms
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mechanisms import Mechanism, difference, differences, random_states, relative_error

from planner.closure import Loop

STEP = 2e-3
ACCURACY = 1e-8


@pytest.fixture(scope="module")
def pairs() -> dict[str, Mechanism]:
    """Two Pandas with each pair between their hands."""
    return {pair: mechanisms.settle(mechanisms.pandas(pair)) for pair in mechanisms.PAIRS}


def loop(mechanism: Mechanism, q: np.ndarray) -> Loop:
    return mechanism.chain.loop(mechanism.chain.dynamics.placements(q))


def hand_motion(
    mechanism: Mechanism, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Right hand's velocity and acceleration at its point, as seen from the left one, (6,) each.

    From Pinocchio's body velocities and accelerations alone, in the axes of the grasp.
    """
    chain, model = mechanism.chain, mechanism.chain.dynamics.model
    data = model.createData()
    pin.forwardKinematics(model, data, q, v, a)
    parts = []
    for arm in chain.arms:
        joint = model.getJointId(f"{arm.side}/{arm.model.names[arm.tip_joint]}")
        world = pin.SE3(data.oMi[joint].rotation, np.zeros(3))
        parts.append((data.oMi[joint], world.act(data.v[joint]), world.act(data.a[joint])))
    (left, left_v, left_a), (right, right_v, right_a) = parts
    point = (right * chain.right.tip_placement).translation

    def at_point(
        place: pin.SE3, twist: pin.Motion, spatial: pin.Motion
    ) -> tuple[np.ndarray, np.ndarray]:
        arm, w = point - place.translation, twist.angular
        velocity = twist.linear + np.cross(w, arm)
        linear = spatial.linear + np.cross(w, twist.linear)
        linear = linear + np.cross(spatial.angular, arm) + np.cross(w, np.cross(w, arm))
        return velocity, linear

    (v_l, a_l), (v_r, a_r) = at_point(left, left_v, left_a), at_point(right, right_v, right_a)
    w_l = left_v.angular
    velocity, spin = v_r - v_l, right_v.angular - w_l
    # seen from the left hand: without what its own turning adds
    acceleration = a_r - a_l - 2.0 * np.cross(w_l, velocity)
    spin_rate = right_a.angular - left_a.angular - np.cross(w_l, spin)
    frame = (left * chain.object_in_left * chain.grasp_in_object).rotation.T
    return (
        np.concatenate([frame @ velocity, frame @ spin]),
        np.concatenate([frame @ acceleration, frame @ spin_rate]),
    )


@given(seed=st.integers(0, 2**32 - 1))
def test_loop_tells_how_the_right_hand_moves_as_seen_from_the_left(
    mechanism: Mechanism, seed: int
) -> None:
    """In any posture, hands together or apart."""
    chain = mechanism.chain
    generator = np.random.default_rng(seed)
    q = generator.uniform(-2.0, 2.0, (2, chain.n))
    v, a = generator.normal(size=(2, 2, chain.n))
    here = loop(mechanism, q)
    motions = [hand_motion(mechanism, *state) for state in zip(q, v, a, strict=True)]
    blocked = chain.pair.blocked
    velocity = np.array([blocked @ motion[0] for motion in motions])
    acceleration = np.array([blocked @ motion[1] for motion in motions])
    jacobian = here.jacobian()
    assert relative_error(np.einsum("kmi,ki->km", jacobian, v), velocity) < 1e-11
    total = np.einsum("kmi,ki->km", jacobian, a) + here.bias(v)
    assert relative_error(total, acceleration) < 1e-11


@pytest.mark.parametrize("pair", mechanisms.PAIRS)
def test_jacobian_is_the_derivative_of_the_gap_where_it_is_closed(
    pair: str, pairs: dict[str, Mechanism]
) -> None:
    chain = pairs[pair].chain
    q = random_states(pairs[pair], 3).q
    gap = differences(lambda d: chain.gap(chain.dynamics.placements(q + d)), chain.n, STEP)
    assert relative_error(loop(pairs[pair], q).jacobian(), gap) < ACCURACY


def test_jacobian_of_planar_arms_is_the_derivative_of_the_gap(mechanism: Mechanism) -> None:
    chain = mechanism.chain
    q = random_states(mechanism, 3).q
    gap = differences(lambda d: chain.gap(chain.dynamics.placements(q + d)), chain.n, STEP)
    assert relative_error(loop(mechanism, q).jacobian(), gap) < ACCURACY


def check_derivatives(mechanism: Mechanism) -> None:
    """Along every joint, closed or not: the formulas hold in any posture."""
    chain = mechanism.chain
    generator = np.random.default_rng(3)
    q = mechanism.posture + generator.uniform(-0.4, 0.4, (3, chain.n))
    v, a = generator.normal(size=(2, 3, chain.n))
    multiplier = generator.normal(size=(3, chain.m))
    here = loop(mechanism, q)

    def velocity(at: Loop) -> np.ndarray:
        return np.einsum("kmi,ki->km", at.jacobian(), v)

    def acceleration(at: Loop, v: np.ndarray) -> np.ndarray:
        return np.einsum("kmi,ki->km", at.jacobian(), a) + at.bias(v)

    def force(at: Loop) -> np.ndarray:
        return np.einsum("kmi,km->ki", at.jacobian(), multiplier)

    n = chain.n
    wanted = differences(lambda d: force(loop(mechanism, q + d)), n, STEP)
    assert relative_error(here.force_jacobian(multiplier), wanted) < ACCURACY
    along_q, along_v, slip = here.derivatives(v, a)
    wanted = differences(lambda d: velocity(loop(mechanism, q + d)), n, STEP)
    assert relative_error(slip, wanted) < ACCURACY
    wanted = differences(lambda d: acceleration(loop(mechanism, q + d), v), n, STEP)
    assert relative_error(along_q, wanted) < ACCURACY
    wanted = differences(lambda d: acceleration(here, v + d), n, 1.0)
    assert relative_error(along_v, wanted) < ACCURACY


@pytest.mark.parametrize("pair", mechanisms.PAIRS)
def test_derivatives_of_each_pair(pair: str, pairs: dict[str, Mechanism]) -> None:
    check_derivatives(pairs[pair])


def test_derivatives(mechanism: Mechanism) -> None:
    check_derivatives(mechanism)


@pytest.mark.parametrize("pair", mechanisms.PAIRS)
def test_bias_is_what_velocity_alone_does_to_the_jacobian(
    pair: str, pairs: dict[str, Mechanism]
) -> None:
    mechanism = pairs[pair]
    states = random_states(mechanism, 3)
    v = mechanism.move(states.q, states.rate, states.tau).v
    turned = difference(
        lambda t: np.einsum("kmi,ki->km", loop(mechanism, states.q + t * v).jacobian(), v), STEP
    )
    assert relative_error(loop(mechanism, states.q).bias(v), turned) < ACCURACY


@pytest.mark.parametrize("pair", mechanisms.PAIRS)
def test_blocked_motions_stay_blocked_and_free_ones_free(
    pair: str, pairs: dict[str, Mechanism]
) -> None:
    """As the closed chain moves, the right hand moves as its pair allows and no other way."""
    mechanism = pairs[pair]
    chain = mechanism.chain
    q = random_states(mechanism, 2).q
    far = mechanism.shifted(q, np.full(chain.p, 0.1))

    def hand(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        at = chain.dynamics.placements(q)
        (wanted, frame), (point, rotation) = chain.grasp_pose(at), chain.right_tip(at)
        inverse = np.swapaxes(frame, 1, 2)
        return np.einsum("kij,kj->ki", inverse, point - wanted), inverse @ rotation

    axis = chain.pair.axis
    moved, turned = hand(far)
    slide, rest = moved @ axis, moved - np.outer(moved @ axis, axis)
    swing = turned @ axis - axis
    angle = np.arccos(np.clip((np.trace(turned, axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0))
    free = {
        "slides along": pair in ("cylindrical", "prismatic"),
        "slides across": pair == "planar",
        "swings": pair == "spherical",
        "turns": pair in ("revolute", "spherical", "cylindrical", "planar"),
    }
    sizes = {
        "slides along": np.abs(slide),
        "slides across": np.linalg.norm(rest, axis=1),
        "swings": np.linalg.norm(swing, axis=1),
        "turns": angle,
    }
    for motion, size in sizes.items():
        if free[motion]:
            assert np.min(size) > 1e-3, motion
        else:
            assert np.max(size) < (1e-7 if motion == "turns" else 1e-11), motion


@given(seed=st.integers(0, 2**32 - 1))
def test_closing_moves_only_the_dependent_joints(mechanism: Mechanism, seed: int) -> None:
    chain, joints = mechanism.chain, mechanism.joints
    generator = np.random.default_rng(seed)
    guess = mechanism.posture + generator.uniform(-0.15, 0.15, (4, chain.n))
    q, at, closed = chain.close(guess, joints.dependent)
    assert closed.all()
    np.testing.assert_array_equal(q[:, joints.independent], guess[:, joints.independent])
    assert np.max(np.abs(chain.gap(chain.dynamics.placements(q)))) < 1e-10
    for kept, fresh in zip(
        vars(at).values(), vars(chain.dynamics.placements(q)).values(), strict=True
    ):
        np.testing.assert_allclose(kept, fresh, atol=1e-14)
    again, _, _ = chain.close(q, joints.dependent)
    np.testing.assert_allclose(again, q, atol=1e-11)


def test_hands_are_where_the_grasp_says_on_the_object(mechanism: Mechanism) -> None:
    """The hand's frame on the object: position and, where the pair is rigid, orientation."""
    chain, q = mechanism.chain, mechanism.posture
    position, rotation = chain.object_pose(chain.dynamics.placements(q[None]))
    thing = pin.SE3(rotation[0], position[0])
    for arm, part in zip(chain.arms, (q[: chain.left.n], q[chain.left.n :]), strict=True):
        data = arm.model.createData()
        pin.forwardKinematics(arm.model, data, part)
        hand = data.oMi[arm.tip_joint] * arm.tip_placement
        given = getattr(mechanism.scenario, arm.side).grasp
        wanted = thing * pin.SE3(pin.rpy.rpyToMatrix(*given.rpy), np.array(given.xyz))
        np.testing.assert_allclose(hand.translation, wanted.translation, atol=1e-10)
        if arm.side == "left" or chain.pair.name == "rigid":
            np.testing.assert_allclose(hand.rotation, wanted.rotation, atol=1e-10)


@pytest.mark.parametrize("name", ["human_arms", "pandas"])
def test_far_guesses_close_on_the_side_where_they_are(
    name: str, request: pytest.FixtureRequest
) -> None:
    mechanism: Mechanism = request.getfixturevalue(name)
    dependent = mechanism.joints.dependent
    guess = np.repeat(mechanism.posture[None], 100, axis=0)
    guess[:, dependent] += np.random.default_rng(0).uniform(-0.6, 0.6, (100, len(dependent)))
    q, _, closed = mechanism.chain.close(guess, dependent)
    assert closed.all()
    np.testing.assert_allclose(q, np.broadcast_to(mechanism.posture, q.shape), atol=1e-6)


def test_a_posture_out_of_reach_stays_open_and_leaves_the_others_alone(
    human_arms: Mechanism,
) -> None:
    """The left hand 0.6 m to the left of its base is 1.05 m from the right arm's."""
    chain = human_arms.chain
    away = np.array([np.pi, 0.0, 2.0, 0.5])
    guess = np.stack([human_arms.posture, away, human_arms.posture + 0.05])
    q, _, closed = chain.close(guess, np.array([2, 3]))
    np.testing.assert_array_equal(closed, [True, False, True])
    gap = np.linalg.norm(chain.gap(chain.dynamics.placements(q[[0, 2]])), axis=1)
    assert np.max(gap) < 1e-11


def test_wrench_and_multiplier_are_each_others_inverse(mechanism: Mechanism) -> None:
    """What the pair transmits comes back; the power of the wrench is that of the multiplier."""
    chain = mechanism.chain
    states = random_states(mechanism, 3)
    here = loop(mechanism, states.q)
    multiplier = np.random.default_rng(0).normal(size=(3, chain.m))
    np.testing.assert_allclose(here.multiplier(here.wrench(multiplier)), multiplier, atol=1e-13)
    v = np.random.default_rng(1).normal(size=states.q.shape)
    at = chain.dynamics.placements(states.q)
    point, _ = chain.right_tip(at)
    moving = at.columns[:, :3] + np.cross(at.columns[:, 3:], point[:, :, None], axis=1)
    sense = np.where(np.arange(chain.n) < chain.left.n, -1.0, 1.0)
    twist = np.concatenate([moving, at.columns[:, 3:]], axis=1) * sense @ v[..., None]
    power = (here.wrench(multiplier) * twist[..., 0]).sum(axis=1)
    own = np.einsum("km,kmi,ki->k", multiplier, here.jacobian(), v)
    np.testing.assert_allclose(power, own, atol=1e-12)


def test_part_of_a_loop_is_that_of_its_postures(mechanism: Mechanism) -> None:
    states = random_states(mechanism, 3)
    alone, own = loop(mechanism, states.q).part(slice(1, 2)), loop(mechanism, states.q[1:2])
    np.testing.assert_allclose(alone.jacobian(), own.jacobian(), atol=1e-14)
    v = np.ones((1, mechanism.chain.n))
    np.testing.assert_allclose(alone.bias(v), own.bias(v), atol=1e-13)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
def test_closed_means_as_close_as_asked(human_arms: Mechanism, tolerance: float) -> None:
    """Whatever the guess: out of reach, near it, or closed by a step that just suffices."""
    chain = human_arms.chain
    guess = np.random.default_rng(0).uniform(-np.pi, np.pi, (2000, chain.n))
    q, at, closed = chain.close(guess, np.array([2, 3]), tolerance)
    gap = np.max(np.abs(chain.gap(chain.dynamics.placements(q))), axis=1)
    np.testing.assert_allclose(np.max(np.abs(chain.gap(at)), axis=1), gap, atol=1e-12)
    assert closed.any()
    assert not closed.all()
    assert np.max(gap[closed]) < tolerance
    assert np.min(gap[~closed]) >= tolerance


def test_closing_to_round_off_ends(mechanism: Mechanism) -> None:
    """Asked for more digits than there are, it gives those there are."""
    q, _, closed = mechanism.chain.close(
        np.repeat(mechanism.posture[None], 50, axis=0)
        + np.random.default_rng(0).uniform(-0.05, 0.05, (50, mechanism.chain.n)),
        mechanism.joints.dependent,
        1e-17,
    )
    assert closed.all()
    gap = mechanism.chain.gap(mechanism.chain.dynamics.placements(q))
    assert np.max(np.abs(gap)) < 1e-14
