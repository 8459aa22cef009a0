"""Postures that hold the object where it shall be, and what is said where there is none."""

from __future__ import annotations

import re
from dataclasses import replace

import mechanisms
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from mechanisms import Mechanism, differences, mirrored, random_states, relative_error

from planner.assembly import build_chain
from planner.chain import ClosedChain
from planner.errors import UnreachableError
from planner.inverse_kinematics import (
    branch,
    find_posture,
    follow_poses,
)
from planner.posture_equations import ObjectPose, pose_error

REACH = 0.27 + 0.33
BASES = {"left": np.array([0.0, 0.0]), "right": np.array([0.45, 0.0])}


def object_at(chain: ClosedChain, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    position, rotation = chain.object_pose(chain.dynamics.placements(q[None]))
    return position[0], rotation[0]


def check_holds(chain: ClosedChain, q: np.ndarray, pose: ObjectPose) -> None:
    """Both hands on the object, the object in its place, every joint within its limits."""
    position, rotation = object_at(chain, q)
    np.testing.assert_allclose(position, pose.position, atol=1e-9)
    if pose.rotation is not None:
        np.testing.assert_allclose(rotation, pose.rotation, atol=1e-9)
    assert np.max(np.abs(chain.gap(chain.dynamics.placements(q[None])))) < 1e-10
    assert np.all(q >= chain.both("lower") - 1e-8)
    assert np.all(q <= chain.both("upper") + 1e-8)


# ---- reachable -----------------------------------------------------------------------------------


@given(seed=st.integers(0, 2**32 - 1), turned=st.booleans())
def test_a_posture_is_found_for_any_pose_that_some_posture_has(
    mechanism: Mechanism, seed: int, turned: bool
) -> None:
    chain = mechanism.chain
    known = random_states(mechanism, 1, seed).q[0]
    position, rotation = object_at(chain, known)
    turned = turned and chain.p >= len(chain.task_rows(True))
    pose = ObjectPose(position, rotation if turned else None)
    noise = np.random.default_rng(seed).uniform(-0.1, 0.1, chain.n)
    reference = known + noise
    q = find_posture(chain, pose, reference, "task.start.xyz")
    check_holds(chain, q, pose)
    assert branch(chain, q) == branch(chain, known)
    # the nearest one to the reference is at least as near as the one we know
    assert np.linalg.norm(q - reference) <= np.linalg.norm(known - reference) + 1e-6
    if chain.p == len(chain.task_rows(turned)):
        np.testing.assert_allclose(q, known, atol=1e-7)


@given(x=st.floats(-0.1, 0.55), y=st.floats(0.12, 0.55))
def test_elbows_stay_on_the_side_that_the_scenario_gives(
    human_arms: Mechanism, x: float, y: float
) -> None:
    distances = [np.linalg.norm(np.array([x, y]) - base) for base in BASES.values()]
    assume(min(distances) > 0.12 and max(distances) < REACH - 0.01)
    pose = ObjectPose(np.array([x, y, 0.0]), None)
    q = find_posture(human_arms.chain, pose, np.array([2.25, -1.64, 1.75, 0.97]), "k")
    check_holds(human_arms.chain, q, pose)
    assert q[1] < 0.0 < q[3]
    # the law of cosines
    for elbow, distance in zip(q[[1, 3]], distances, strict=True):
        cosine = (distance**2 - 0.27**2 - 0.33**2) / (2.0 * 0.27 * 0.33)
        assert np.cos(elbow) == pytest.approx(cosine, abs=1e-9)


def test_redundant_joints_rest_as_near_as_they_can_to_their_reference(pandas: Mechanism) -> None:
    chain = pandas.chain
    reference = pandas.posture + 0.1 * np.sin(np.arange(14.0))
    pose = ObjectPose(np.array([0.4, 0.05, 0.5]), None)
    q = find_posture(chain, pose, reference, "task.start.xyz")
    check_holds(chain, q, pose)
    at = chain.dynamics.placements(q[None])
    rows = np.vstack([chain.object_jacobian(at)[0, :3], chain.loop(at).jacobian()[0]])
    away = q - reference
    left_over = away - np.linalg.pinv(rows) @ (rows @ away)
    assert np.linalg.norm(left_over) < 1e-6 * np.linalg.norm(away)
    assert np.linalg.norm(away) > 0.1


def test_arms_on_a_wall_reach_in_their_upright_plane() -> None:
    """The paper's arms turned into the x-z plane."""
    upright = {"base.rpy": [np.pi / 2, 0.0, 0.0]}
    scenario = mechanisms.human_arms(
        {f"{side}.{key}": value for side in ("left", "right") for key, value in upright.items()}
        | {"world.gravity": [0.0, 0.0, -9.81]}
    )
    chain = build_chain(scenario)
    assert chain.normal is not None
    np.testing.assert_allclose(np.abs(chain.normal), [0.0, 1.0, 0.0], atol=1e-12)
    assert (chain.m, chain.p, chain.r) == (2, 2, 2)
    pose = ObjectPose(np.array([0.1, 0.0, 0.4]), None)
    q = find_posture(chain, pose, np.array([2.25, -1.64, 1.75, 0.97]), "task.start.xyz")
    check_holds(chain, q, pose)


def test_a_joint_at_its_limit_leaves_the_rest_to_the_others(three_jointed: Mechanism) -> None:
    chain, reference = three_jointed.chain, three_jointed.posture
    pose = ObjectPose(object_at(chain, reference)[0] + np.array([0.0, -0.1, 0.0]), None)
    free = find_posture(chain, pose, reference, "task.start.xyz")
    moved = int(np.argmax(free[:3] - reference[:3]))
    upper = chain.left.upper.copy()
    upper[moved] = 0.5 * (free + reference)[moved]
    limited = replace(chain, left=replace(chain.left, upper=upper))
    q = find_posture(limited, pose, reference, "task.start.xyz")
    check_holds(limited, q, pose)
    assert q[moved] == pytest.approx(upper[moved], abs=1e-6)


def test_the_side_of_the_elbows_comes_before_the_distance(human_arms: Mechanism) -> None:
    """Hardly bent to their own side, with shoulders turned for the other: the elbows decide."""
    chain, known = human_arms.chain, human_arms.posture
    other = mirrored(known)
    pose = ObjectPose(object_at(chain, known)[0], None)
    np.testing.assert_allclose(object_at(chain, other)[0], pose.position, atol=1e-12)
    reference = other.copy()
    reference[[1, 3]] = 0.05 * np.sign(known[[1, 3]])
    assert np.linalg.norm(other - reference) < np.linalg.norm(known - reference)
    q = find_posture(chain, pose, reference, "k", seeds=[other])
    np.testing.assert_allclose(q, known, atol=1e-8)


def test_mirrored_elbows_are_another_branch(human_arms: Mechanism) -> None:
    chain, q = human_arms.chain, human_arms.posture
    sides = np.array(branch(chain, q))
    np.testing.assert_array_equal(branch(chain, mirrored(q)), -sides)
    np.testing.assert_array_equal(
        branch(chain, human_arms.shifted(q[None], np.full(2, 0.1))[0]), sides
    )


def test_object_jacobian_is_the_derivative_of_its_pose(mechanism: Mechanism) -> None:
    chain = mechanism.chain
    q = random_states(mechanism, 3).q
    before = chain.object_pose(chain.dynamics.placements(q))

    def moved(d: np.ndarray) -> np.ndarray:
        return pose_error(chain, chain.dynamics.placements(q + d), *before)

    wanted = differences(moved, chain.n, 2e-3)
    found = chain.object_jacobian(chain.dynamics.placements(q))
    assert relative_error(found, wanted) < 1e-8


# ---- a path --------------------------------------------------------------------------------------


def test_arms_follow_a_straight_line(mechanism: Mechanism) -> None:
    chain = mechanism.chain
    start = mechanism.posture
    position, _ = object_at(chain, start)
    goal_pose = ObjectPose(position + np.array([0.05, -0.04, 0.0]), None)
    goal = find_posture(chain, goal_pose, start, "task.goal.xyz")
    share = np.linspace(0.0, 1.0, 11)[:, None]
    line = position + share * (goal_pose.position - position)
    q = follow_poses(chain, line, None, start + share * (goal - start))
    assert q is not None
    for posture, point in zip(q, line, strict=True):
        assert np.linalg.norm(object_at(chain, posture)[0] - point) < 1e-8
    np.testing.assert_array_equal(q[[0, -1]], [start, goal])
    assert np.max(np.abs(chain.gap(chain.dynamics.placements(q)))) < 1e-8


def test_a_line_through_an_arms_base_is_not_followed(human_arms: Mechanism) -> None:
    """No elbow folds that far: the hand stays 0.06 m from the base at least."""
    chain = human_arms.chain
    reference = human_arms.posture
    ends = np.array([[-0.12, 0.15, 0.0], [0.14, -0.15, 0.0]])
    ends_q = [find_posture(chain, ObjectPose(end, None), reference, "k") for end in ends]
    share = np.linspace(0.0, 1.0, 33)[:, None]
    guess = ends_q[0] + share * (ends_q[1] - ends_q[0])
    assert follow_poses(chain, ends[0] + share * (ends[1] - ends[0]), None, guess) is None


def test_elbows_do_not_change_sides_on_the_way(human_arms: Mechanism) -> None:
    chain = human_arms.chain
    poses = [ObjectPose(np.array(xyz), None) for xyz in ((0.1, 0.4, 0.0), (0.4, 0.3, 0.0))]
    start, goal = (find_posture(chain, pose, human_arms.posture, "k") for pose in poses)
    share = np.linspace(0.0, 1.0, 33)[:, None]
    line = poses[0].position + share * (poses[1].position - poses[0].position)
    assert follow_poses(chain, line, None, start + share * (goal - start)) is not None
    over = mirrored(goal)
    assert follow_poses(chain, line, None, start + share * (over - start)) is None


# ---- out of reach --------------------------------------------------------------------------------


def complaint(chain: ClosedChain, pose: ObjectPose, reference: np.ndarray) -> str:
    with pytest.raises(UnreachableError) as caught:
        find_posture(chain, pose, reference, "task.goal.xyz")
    error = caught.value
    assert error.key == "task.goal.xyz"
    assert error.remedy
    assert "\n" not in str(error)
    return str(error)


@pytest.mark.parametrize(
    "xyz",
    [(1.0, 0.4, 0.0), (0.2, 0.7, 0.0), (-0.3, 0.3, 0.0), (0.75, 0.3, 0.0), (0.02, 0.01, 0.0)],
)
def test_a_point_out_of_reach_names_the_arm_and_the_distance(
    human_arms: Mechanism, xyz: tuple[float, float, float]
) -> None:
    nearest = np.sqrt(0.27**2 + 0.33**2 + 2.0 * 0.27 * 0.33 * np.cos(2.8))  # elbow at its limit
    text = complaint(
        human_arms.chain, ObjectPose(np.array(xyz), None), np.array([2.25, -1.64, 1.75, 0.97])
    )
    told = {
        side: float(d) for side, d in re.findall(r"the (\w+) arm misses it by ([\d.]+) m", text)
    }
    wanted = {}
    for side, base in BASES.items():
        distance = float(np.linalg.norm(np.array(xyz[:2]) - base))
        missing = max(distance - REACH, nearest - distance)
        if missing > 0.0:
            wanted[side] = missing
    assert wanted
    assert told == pytest.approx(wanted, abs=1e-4)


def test_a_handle_lengthens_the_reach() -> None:
    """The left hand holds the object 0.1 m before its frame, in line with the forearm."""
    chain = build_chain(mechanisms.human_arms({"left.grasp.xyz": [-0.1, 0.0, 0.0]}))
    reference = np.array([2.25, -1.64, 1.75, 0.97])
    text = complaint(chain, ObjectPose(np.array([-0.3, 0.7, 0.0]), None), reference)
    told = re.findall(r"the (\w+) arm misses it by ([\d.]+) m", text)
    longest = 0.27 + 0.33 + 0.1
    wanted = [("left", np.hypot(0.3, 0.7) - longest), ("right", np.hypot(0.75, 0.7) - REACH)]
    assert [side for side, _ in told] == ["left", "right"]
    for (_, distance), (_, missing) in zip(told, wanted, strict=True):
        assert float(distance) == pytest.approx(missing, abs=1e-4)


def test_a_point_beside_the_plane_is_missed_by_both_arms(human_arms: Mechanism) -> None:
    text = complaint(
        human_arms.chain, ObjectPose(np.array([0.2, 0.35, 0.03]), None), human_arms.posture
    )
    assert "the left arm misses it by 0.0300 m and the right arm misses it by 0.0300 m" in text


def test_bases_at_different_heights_are_noticed() -> None:
    chain = build_chain(mechanisms.human_arms({"right.base.xyz": [0.45, 0.0, 0.02]}))
    text = complaint(
        chain, ObjectPose(np.array([0.2, 0.35, 0.0]), None), np.array([2.25, -1.64, 1.75, 0.97])
    )
    assert "the right arm misses it by 0.0200 m" in text
    assert "left arm misses" not in text


def test_an_orientation_that_no_pair_of_wrists_gives(three_jointed_rigid: Mechanism) -> None:
    """Nearly stretched arms reach the place, but not with the object the other way round."""
    chain = three_jointed_rigid.chain
    place = np.array([0.26, 0.53, 0.0])
    rotation = object_at(chain, three_jointed_rigid.posture)[1]
    turned = rotation @ pin.rpy.rpyToMatrix(0.0, 0.0, np.pi)
    text = complaint(chain, ObjectPose(place, turned), three_jointed_rigid.posture)
    assert "each arm reaches the object alone" in text
