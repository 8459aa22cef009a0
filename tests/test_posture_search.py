"""What is reachable is reached: stretched arms, joints at their limits, far from the reference."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mechanisms import Mechanism
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from test_inverse_kinematics import check_holds, object_at

from planner import load
from planner.assembly import build_chain
from planner.chain import ClosedChain
from planner.errors import UnreachableError
from planner.inverse_kinematics import _unwound, find_posture
from planner.posture_equations import ObjectPose, jacobian, residual
from planner.posture_search import closed_within_limits, nearest_within_limits
from planner.transport import reference_posture
from planner.vectors import rotation_log

URDF = Path(__file__).parents[1] / "urdf"
SAMPLES = 12


def some_closed(chain: ClosedChain, count: int) -> list[np.ndarray]:
    """Closed postures from anywhere within the limits, many at a limit, by SciPy alone."""
    lower, upper = (np.clip(limit, -np.pi, np.pi) for limit in chain.limits)
    generator = np.random.default_rng(11)
    every = np.arange(chain.n)
    found: list[np.ndarray] = []
    while len(found) < count:
        solved = least_squares(
            lambda q: chain.gap(chain.dynamics.placements(q[None]))[0],
            generator.uniform(lower + 1e-6, upper - 1e-6),
            lambda q: chain.closure_columns(chain.dynamics.placements(q[None]), every)[0],
            bounds=(lower, upper),
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
        )
        if np.max(np.abs(solved.fun)) < 1e-10:
            found.append(solved.x)
    return found


def check_reaches(chain: ClosedChain, reference: np.ndarray) -> None:
    """Every pose of a sample is found again from the reference, with and without orientation."""
    lost = []
    for known in some_closed(chain, SAMPLES):
        position, rotation = object_at(chain, known)
        for wanted in (None, rotation):
            if chain.p < len(chain.task_rows(wanted is not None)):
                continue
            pose = ObjectPose(position, wanted)
            try:
                check_holds(chain, find_posture(chain, pose, reference, "k"), pose)
            except UnreachableError:
                lost.append(known)
    assert not lost


def test_reachable_poses_are_reached(mechanism: Mechanism) -> None:
    check_reaches(mechanism.chain, mechanism.posture)


@pytest.mark.parametrize("name", ["two_ur5/panel", "baxter/crate", "two_pandas/facing"])
def test_reachable_poses_are_reached_by_robots(name: str) -> None:
    scenario = load(URDF / f"{name}.toml")
    chain = build_chain(scenario)
    check_reaches(chain, reference_posture(scenario, chain))


def test_stretched_arms_reach_what_they_just_reach(human_arms: Mechanism) -> None:
    chain = human_arms.chain
    for left, right in ((1.1, None), (None, 2.0), (1.2, 1.9)):
        # one arm straight at an angle, or both where their circles meet
        reach, bases = 0.6, (np.zeros(2), np.array([0.45, 0.0]))
        if left is not None and right is not None:
            place = np.array([0.225, np.sqrt(reach**2 - 0.225**2)])
        else:
            base, angle = (bases[0], left) if left is not None else (bases[1], right)
            place = base + reach * np.array([np.cos(angle), np.sin(angle)])
        pose = ObjectPose(np.array([*place, 0.0]), None)
        check_holds(chain, find_posture(chain, pose, human_arms.posture, "k"), pose)


def test_every_joint_may_stand_at_its_limit(pandas: Mechanism) -> None:
    chain, known = pandas.chain, pandas.posture
    at_upper = np.arange(14) % 2 == 0
    lower, upper = np.where(at_upper, known - 0.5, known), np.where(at_upper, known, known + 0.5)
    sides = {}
    for arm, part in zip(chain.arms, (slice(0, 7), slice(7, 14)), strict=True):
        sides[arm.side] = replace(arm, lower=lower[part], upper=upper[part])
    limited = replace(chain, **sides)
    reference = np.where(at_upper, known - 0.3, known + 0.3)
    pose = ObjectPose(*object_at(chain, known))
    check_holds(limited, find_posture(limited, pose, reference, "k"), pose)


def test_whole_turns_are_taken_back() -> None:
    scenario = load(URDF / "two_ur5" / "panel.toml")
    chain = build_chain(scenario)
    reference = reference_posture(scenario, chain)
    for known in some_closed(chain, 4):
        pose = ObjectPose(*object_at(chain, known))
        away = find_posture(chain, pose, reference, "k") - reference
        assert np.max(np.abs(away)) < 2.0 * np.pi


def test_turns_are_taken_back_where_the_limits_allow() -> None:
    """UR5 joints turn twice around; those of a Panda do not."""
    chain = build_chain(load(URDF / "two_ur5" / "panel.toml"))
    reference = np.zeros(chain.n)
    lower, upper = chain.limits
    known = np.random.default_rng(0).uniform(-0.5, 0.5, (3, chain.n))
    wound = known + 2.0 * np.pi
    allowed = (wound <= upper).all(axis=0) & (lower <= -np.pi)
    assert allowed.any()
    found = _unwound(chain, wound, reference)
    np.testing.assert_allclose(found[:, allowed], known[:, allowed], atol=1e-12)
    pandas = build_chain(load(URDF / "two_pandas" / "lift.toml"))
    bent = np.clip(np.zeros(pandas.n), *pandas.limits)
    bent[5] = 3.7  # a turn back would be below that joint's range
    np.testing.assert_array_equal(_unwound(pandas, bent[None], np.zeros(pandas.n))[0], bent)


def test_the_damped_walk_stays_within_the_limits(mechanism: Mechanism) -> None:
    chain = mechanism.chain
    lower, upper = (np.clip(limit, -np.pi, np.pi) for limit in chain.limits)
    pose = ObjectPose(object_at(chain, mechanism.posture)[0], None)
    seeds = np.random.default_rng(5).uniform(lower - 1.0, upper + 1.0, (20, chain.n))
    found = closed_within_limits(chain, pose, seeds)
    assert len(found)
    for q in found:
        check_holds(chain, q, pose)
        assert np.all((q >= chain.limits[0]) & (q <= chain.limits[1]))


@given(seed=st.integers(0, 2**32 - 1))
def test_the_nearest_point_within_limits(seed: int) -> None:
    """Of a convex problem, x = clip(reference + matrix' multiplier) on the equations is the one."""
    generator = np.random.default_rng(seed)
    matrix = generator.normal(size=(5, 12))
    inside = generator.uniform(-1.0, 1.0, 12)
    reference = inside + generator.normal(size=12)
    limits = -np.ones(12), np.ones(12)
    x, multiplier = nearest_within_limits(matrix, matrix @ inside, reference, limits, np.zeros(5))
    np.testing.assert_allclose(x, np.clip(reference + matrix.T @ multiplier, *limits), atol=1e-12)
    np.testing.assert_allclose(matrix @ x, matrix @ inside, atol=1e-10)
    assert np.linalg.norm(x - reference) <= np.linalg.norm(inside - reference) + 1e-9
    beyond, _ = nearest_within_limits(
        matrix, matrix @ (3.0 * limits[1]), reference, limits, np.zeros(5)
    )
    assert np.all(np.abs(beyond) <= 1.0)


def test_errors_and_their_jacobian_are_those_of_the_chain(mechanism: Mechanism) -> None:
    chain = mechanism.chain
    q = mechanism.posture + np.random.default_rng(2).uniform(-0.2, 0.2, (3, chain.n))
    position, rotation = object_at(chain, mechanism.posture)
    now = residual(chain, q, position, rotation)
    rows = chain.task_rows(True)
    np.testing.assert_allclose(now.error[:, len(rows) :], chain.gap(now.at), atol=1e-14)
    found = jacobian(chain, now, orientation=True)
    task, closure = (
        rows @ chain.object_jacobian(now.at),
        chain.closure_columns(now.at, np.arange(chain.n)),
    )
    np.testing.assert_allclose(found, np.concatenate([task, closure], axis=1), atol=1e-14)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-7, 1e-3, 1.0, 2.09, 2.1, 3.1, np.pi - 1e-9])
def test_rotation_vectors(size: float) -> None:
    vectors = np.random.default_rng(0).normal(size=(20, 3))
    vectors *= size / np.linalg.norm(vectors, axis=1)[:, None]
    found = rotation_log(Rotation.from_rotvec(vectors).as_matrix())
    np.testing.assert_allclose(found, vectors, rtol=1e-13, atol=3e-15)
