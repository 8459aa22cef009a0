"""Independent joints: how they are chosen, and the map from them to closed postures."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mechanisms import Mechanism, differences, mirrored, random_states

from planner.independent_joints import Coordinates, KnownMotion, choose_joints
from planner.inverse_kinematics import find_posture
from planner.posture_equations import ObjectPose


@given(seed=st.integers(0, 2**32 - 1))
def test_dependent_joints_can_follow_along_the_whole_path(mechanism: Mechanism, seed: int) -> None:
    chain = mechanism.chain
    path = random_states(mechanism, 5, seed).q
    joints = choose_joints(chain, path)
    both = np.concatenate([joints.independent, joints.dependent])
    np.testing.assert_array_equal(np.sort(both), np.arange(chain.n))
    assert len(joints.dependent) == chain.m
    gamma = chain.loop(chain.dynamics.placements(path)).jacobian()
    smallest = np.linalg.svd(gamma[:, :, joints.dependent], compute_uv=False)[:, -1]
    assert np.min(smallest) > 0.05


@pytest.mark.parametrize(
    ("start", "goal"), [((-0.09, 0.24), (0.54, 0.24)), ((0.43, 0.14), (0.13, 0.18))]
)
def test_the_choice_is_the_best_for_the_worst_place_on_the_path(
    human_arms: Mechanism, start: tuple[float, float], goal: tuple[float, float]
) -> None:
    """Compared with all six choices; in the second path another one is best at the start."""
    chain = human_arms.chain
    places = np.linspace([*start, 0.0], [*goal, 0.0], 13)
    reference = np.array([2.25, -1.64, 1.75, 0.97])
    path = np.array([find_posture(chain, ObjectPose(at, None), reference, "k") for at in places])
    gamma = chain.loop(chain.dynamics.placements(path)).jacobian()

    def worst(dependent: Iterable[int]) -> float:
        return float(np.min(np.linalg.svd(gamma[:, :, list(dependent)], compute_uv=False)))

    chosen = worst(choose_joints(chain, path).dependent)
    assert chosen == pytest.approx(max(worst(pair) for pair in combinations(range(4), 2)))


def test_a_joint_that_loses_its_effect_on_the_way_is_not_dependent(human_arms: Mechanism) -> None:
    """Where the left arm is stretched its two joints push the hand in one direction only."""
    chain = human_arms.chain
    start = np.array([np.pi / 3, 0.0, 1.2, 0.9])
    stretched, _, closed = chain.close(start[None], np.array([2, 3]))
    assert closed.all()
    joints = choose_joints(chain, np.concatenate([human_arms.posture[None], stretched]))
    assert set(joints.dependent) != {0, 1}
    gamma = chain.loop(chain.dynamics.placements(stretched)).jacobian()[0]
    assert np.linalg.cond(gamma[:, joints.dependent]) < 20.0
    assert np.linalg.cond(gamma[:, [0, 1]]) > 1e9


def test_freedoms_keep_the_hands_together(mechanism: Mechanism) -> None:
    """S maps rates of the independent joints to those of all, and is the derivative of phi."""
    chain, joints = mechanism.chain, mechanism.joints
    q = random_states(mechanism, 3).q
    at = mechanism.freedoms(q)
    np.testing.assert_array_equal(
        at.s[:, joints.independent], np.broadcast_to(np.eye(chain.p), (3, chain.p, chain.p))
    )
    assert np.max(np.abs(at.gamma @ at.s)) < 1e-12
    moved = differences(lambda d: mechanism.shifted(q, d), chain.p, 2e-3)
    np.testing.assert_allclose(at.s, moved, atol=1e-8)


def test_closure_is_sought_near_the_last_known_motion(human_arms: Mechanism) -> None:
    """The same independent joints close on either side of the other arm's elbow."""
    chain = human_arms.chain
    share = np.array([0.0, 1.0])
    here = human_arms.posture
    left, right = np.array([0, 1]), np.array([2, 3])
    joints = type(human_arms.joints)(left, right)
    there = np.concatenate([here[:2], mirrored(here)[2:]])
    assert np.max(np.abs(chain.gap(chain.dynamics.placements(there[None])))) < 1e-11
    coordinates = Coordinates(chain, joints, share, np.stack([here, here]))
    y = here[None, left] + np.array([[0.0, 0.0], [0.02, -0.03]])
    q, _, closed = coordinates.close(share, y)
    assert closed.all()
    np.testing.assert_array_equal(q[:, left], y)
    np.testing.assert_allclose(q[0], here, atol=1e-11)
    assert np.all(q[:, 3] > 0.0)
    coordinates.remember(share, np.stack([there, there]))
    q, _, closed = coordinates.close(share, y)
    assert closed.all()
    np.testing.assert_allclose(q[0], there, atol=1e-11)
    assert np.all(q[:, 3] < 0.0)
    at, closed = coordinates.tangent(share, y)
    assert closed.all()
    np.testing.assert_allclose(at.q, q, atol=1e-11)


def test_the_guess_is_interpolated_over_the_duration(pandas: Mechanism) -> None:
    states = random_states(pandas, 2)
    first, last = states.q
    coordinates = Coordinates(
        pandas.chain, pandas.joints, np.array([0.0, 1.0]), np.stack([first, last])
    )
    y = states.q[:, pandas.joints.independent]
    halfway = y.mean(axis=0)
    q, _, closed = coordinates.close(np.array([0.0, 0.5, 1.0]), np.stack([y[0], halfway, y[1]]))
    assert closed.all()
    np.testing.assert_allclose(q[[0, 2]], states.q, atol=1e-10)
    dependent = pandas.joints.dependent
    guess = 0.5 * (first + last)[dependent]
    assert np.max(np.abs(q[1, dependent] - guess)) < 0.1


def test_a_sample_out_of_reach_is_told(human_arms: Mechanism) -> None:
    here = human_arms.posture
    joints = type(human_arms.joints)(np.array([0, 1]), np.array([2, 3]))
    share = np.array([0.0, 0.5, 1.0])
    coordinates = Coordinates(human_arms.chain, joints, share, np.stack([here] * 3))
    y = np.stack([here[:2], [np.pi, 0.0], here[:2]])
    with np.errstate(all="ignore"):
        _, closed = coordinates.tangent(share, y)
    np.testing.assert_array_equal(closed, [True, False, True])


@pytest.mark.parametrize("pair", ["revolute", "rigid"])
def test_number_of_freedoms(
    pair: str, three_jointed: Mechanism, three_jointed_rigid: Mechanism
) -> None:
    chain = (three_jointed if pair == "revolute" else three_jointed_rigid).chain
    assert (chain.n, chain.m, chain.p, chain.r) == (
        6,
        *{"revolute": (2, 4), "rigid": (3, 3)}[pair],
        2,
    )


def test_a_known_motion_foresees_postures_beside_it(mechanism: Mechanism) -> None:
    """With its freedoms it does so to second order, without them only on the motion itself."""
    chain, joints = mechanism.chain, mechanism.joints
    share = np.linspace(0.0, 1.0, 15)
    way = np.sin(2.0 * share)[:, None] * np.linspace(0.05, 0.1, chain.p)
    q = mechanism.shifted(np.repeat(mechanism.posture[None], 15, axis=0), way)
    s = mechanism.freedoms(q).s
    middle = 0.5 * (share[1:] + share[:-1])

    def gap(known: KnownMotion, aside: float) -> float:
        y = np.sin(2.0 * middle)[:, None] * np.linspace(0.05, 0.1, chain.p)
        y = y + mechanism.posture[joints.independent] + aside
        foreseen = known.near(middle, y)
        np.testing.assert_array_equal(foreseen[:, joints.independent], y)
        return float(np.max(np.abs(chain.gap(chain.dynamics.placements(foreseen)))))

    plain, better = KnownMotion(joints, share, q), KnownMotion(joints, share, q, s)
    assert gap(plain, 0.0) < 1e-4
    assert gap(better, 0.0) < 1e-4
    assert gap(better, 0.01) < 0.1 * gap(plain, 0.01)
