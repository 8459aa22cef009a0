"""One arm read from URDF: which joints move, where the tip is, what limits it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mechanisms
import numpy as np
import pinocchio as pin
import pytest

from planner.arm import Arm, read_arm, read_visuals
from planner.assembly import build_chain
from planner.errors import ModelError
from planner.scenario import Scenario

TORSO = """
<robot name="torso"><link name="ground"/>
<joint name="waist" type="revolute"><origin xyz="0 0 0.5"/><parent link="ground"/>
<child link="chest"/><axis xyz="0 0 1"/>
<limit lower="0.2" upper="1" effort="90" velocity="3"/></joint>
<link name="chest"/>
{left}{right}</robot>
"""
HALF = """
<joint name="{side}_shoulder" type="continuous"><origin xyz="{x} 0 0"/><parent link="chest"/>
<child link="{side}_upper"/><axis xyz="0 0 1"/></joint>
<link name="{side}_upper"><inertial><origin xyz="0.15 0 0"/><mass value="1"/>
<inertia ixx="0.001" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<joint name="{side}_elbow" type="revolute"><origin xyz="0.3 0 0"/><parent link="{side}_upper"/>
<child link="{side}_fore"/><axis xyz="0 0 1"/>
<limit lower="-2.5" upper="2.5" effort="0" velocity="5"/></joint>
<link name="{side}_fore"><inertial><origin xyz="0.1 0 0"/><mass value="0.5"/>
<inertia ixx="0.001" ixy="0" ixz="0" iyy="0.005" iyz="0" izz="0.005"/></inertial></link>
<joint name="{side}_wrist" type="prismatic"><origin xyz="0.2 0 0"/><parent link="{side}_fore"/>
<child link="{side}_hand"/><axis xyz="1 0 0"/>
<limit lower="0" upper="0.1" effort="20" velocity="0.5"/></joint>
<link name="{side}_hand"/>
"""


@pytest.fixture(scope="module")
def torso(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot with a waist, two arms of two hinges, and a slide in either wrist."""
    text = TORSO.format(
        left=HALF.format(side="left", x=-0.2), right=HALF.format(side="right", x=0.2)
    )
    return mechanisms.write(tmp_path_factory.mktemp("torso") / "torso.urdf", text)


def two_armed(torso: Path, **sides: dict[str, Any]) -> Scenario:
    """Both arms in one URDF, the waist locked at 0.4 rad."""
    arms = {
        side: {
            "tip": f"{side}_hand",
            "joints": [f"{side}_shoulder", f"{side}_elbow"],
            **sides.get(side, {}),
        }
        for side in ("left", "right")
    }
    return Scenario.from_resolved(
        {
            "robot": {"urdf": str(torso), "posture": {"waist": 0.4, "left_wrist": 0.05}},
            **{side: {k: v for k, v in arm.items() if v is not None} for side, arm in arms.items()},
            "object": {"urdf": str(mechanisms.HUMAN_ARMS / "point_mass.urdf")},
            "task": {
                "start": {"xyz": [0.1, 0.4, 0.5]},
                "goal": {"xyz": [0.0, 0.4, 0.5]},
                "duration": 1.0,
            },
        }
    )


def tip(arm: Arm, q: list[float]) -> np.ndarray:
    data = arm.model.createData()
    pin.forwardKinematics(arm.model, data, np.array(q))
    return (data.oMi[arm.tip_joint] * arm.tip_placement).translation


def complaint(scenario: Scenario, side: str, key: str, words: str) -> None:
    with pytest.raises(ModelError, match=words) as caught:
        read_arm(scenario, side)  # type: ignore[arg-type]
    error = caught.value
    assert error.key == key
    assert error.remedy
    assert error.source is not None
    assert error.source.suffix == ".urdf"
    assert "\n" not in str(error)


# ---- what is read --------------------------------------------------------------------------------


def test_the_papers_arms_stand_where_the_scenario_puts_them() -> None:
    scenario = mechanisms.human_arms()
    for side, base in (("left", 0.0), ("right", 0.45)):
        arm = read_arm(scenario, side)  # type: ignore[arg-type]
        assert arm.n == 2
        assert arm.joint_names == (f"{side}_shoulder", f"{side}_elbow")
        np.testing.assert_allclose(tip(arm, [0.0, 0.0]), [base + 0.6, 0.0, 0.0], atol=1e-12)
        np.testing.assert_allclose(tip(arm, [np.pi / 2, 0.0]), [base, 0.6, 0.0], atol=1e-12)
        np.testing.assert_allclose(
            tip(arm, [np.pi / 2, -np.pi / 2]), [base + 0.33, 0.27, 0.0], atol=1e-12
        )
        assert sum(inertia.mass for inertia in arm.model.inertias[1:]) == pytest.approx(2.0)
        np.testing.assert_allclose(arm.effort_limit, [60.0, 40.0])
        np.testing.assert_allclose(arm.lower, [-6.283, -2.8])
        np.testing.assert_allclose(arm.upper, [6.283, 2.8])
        np.testing.assert_allclose(arm.velocity_limit, [20.0, 20.0])
        assert arm.posture is not None
        np.testing.assert_allclose(arm.posture, getattr(scenario, side).posture)
        assert arm.locked == ()


def test_links_of_the_papers_arms_are_uniform_slender_rods() -> None:
    arm = read_arm(mechanisms.human_arms(), "left")
    for inertia, length, mass in zip(arm.model.inertias[1:], (0.27, 0.33), (0.9, 1.1), strict=True):
        assert inertia.mass == pytest.approx(mass)
        np.testing.assert_allclose(inertia.lever, [length / 2, 0.0, 0.0])
        assert inertia.inertia[2, 2] == pytest.approx(mass * length**2 / 12)


def test_a_base_may_be_turned() -> None:
    scenario = mechanisms.human_arms(
        {"right.base.rpy": [0.0, -np.pi / 2, 0.0], "right.base.xyz": [1.0, 2.0, 3.0]}
    )
    np.testing.assert_allclose(
        tip(read_arm(scenario, "right"), [0.0, 0.0]), [1.0, 2.0, 3.6], atol=1e-12
    )


def test_a_panda_moves_its_seven_joints_and_locks_its_fingers() -> None:
    arm = read_arm(mechanisms.pandas(), "right")
    assert arm.joint_names == tuple(f"panda_joint{k}" for k in range(1, 8))
    assert set(arm.locked) == {"panda_finger_joint1", "panda_finger_joint2"}
    np.testing.assert_allclose(arm.effort_limit, [87.0] * 4 + [12.0] * 3)
    np.testing.assert_allclose(arm.velocity_limit[0], 2.175)
    position = tip(arm, mechanisms.PANDA_POSTURE)
    np.testing.assert_allclose(position, [0.30689057, -0.3, 0.48688205], atol=1e-7)


def test_locked_joints_keep_the_robots_posture(torso: Path) -> None:
    arm = read_arm(two_armed(torso), "left")
    assert arm.joint_names == ("left_shoulder", "left_elbow")
    assert set(arm.locked) == {
        "waist",
        "left_wrist",
        "right_shoulder",
        "right_elbow",
        "right_wrist",
    }
    c, s = np.cos(0.4), np.sin(0.4)
    reach = -0.2 + 0.3 + 0.2 + 0.05
    np.testing.assert_allclose(tip(arm, [0.0, 0.0]), [c * reach, s * reach, 0.5], atol=1e-12)


def test_locked_joints_without_a_posture_stay_at_zero_or_at_the_nearest_limit(torso: Path) -> None:
    scenario = two_armed(torso).override({"robot.posture": {}})
    c, s = np.cos(0.2), np.sin(0.2)  # the waist turns from 0.2 to 1 rad
    np.testing.assert_allclose(
        tip(read_arm(scenario, "right"), [0.0, 0.0]), [0.7 * c, 0.7 * s, 0.5], atol=1e-12
    )


def test_locked_joints_with_room_on_both_sides_stay_at_zero(torso: Path) -> None:
    arm = read_arm(two_armed(torso, left={"joints": ["left_shoulder"]}), "left")
    assert "left_elbow" in arm.locked
    straight = 0.35 * np.array([np.cos(0.4), np.sin(0.4)])
    np.testing.assert_allclose(tip(arm, [0.0])[:2], straight, atol=1e-12)


def test_joints_without_a_limit_have_none(torso: Path) -> None:
    arm = read_arm(two_armed(torso), "left")
    np.testing.assert_array_equal(arm.lower, [-np.inf, -2.5])
    np.testing.assert_array_equal(arm.upper, [np.inf, 2.5])
    np.testing.assert_array_equal(arm.velocity_limit, [np.inf, 5.0])
    np.testing.assert_array_equal(arm.effort_limit, [np.inf, np.inf])
    assert arm.model.nq == arm.model.nv == 2


def test_slides_move_the_tip_along_their_axis(torso: Path) -> None:
    joints = ["left_shoulder", "left_elbow", "left_wrist"]
    arm = read_arm(two_armed(torso, left={"joints": joints}), "left")
    step = tip(arm, [0.3, 0.2, 0.08]) - tip(arm, [0.3, 0.2, 0.0])
    np.testing.assert_allclose(step, 0.08 * np.array([np.cos(0.9), np.sin(0.9), 0.0]), atol=1e-12)


def test_a_posture_follows_the_order_in_which_joints_are_listed(torso: Path) -> None:
    listed = {"joints": ["left_elbow", "left_shoulder"], "posture": [1.5, -0.5]}
    arm = read_arm(two_armed(torso, left=listed), "left")
    assert arm.joint_names == ("left_shoulder", "left_elbow")
    assert arm.posture is not None
    np.testing.assert_array_equal(arm.posture, [-0.5, 1.5])
    assert read_arm(two_armed(torso), "right").posture is None


def test_two_arms_of_one_robot_make_a_chain(torso: Path) -> None:
    chain = build_chain(two_armed(torso))
    assert (chain.n, chain.m, chain.p, chain.r) == (4, 2, 2, 2)
    assert chain.joint_names == ("left_shoulder", "left_elbow", "right_shoulder", "right_elbow")


def test_joints_of_equal_arms_are_told_apart_by_their_side() -> None:
    names = build_chain(mechanisms.pandas()).joint_names
    assert names[0] == "left/panda_joint1"
    assert names[-1] == "right/panda_joint7"
    assert len(set(names)) == 14


@pytest.mark.parametrize(("joint", "link"), [("wrist", "hand"), ("joint1", "link1")])
def test_a_joint_may_have_the_name_of_a_link(tmp_path: Path, joint: str, link: str) -> None:
    """URDF keeps their names apart."""
    text = mechanisms.arm_urdf((0.3, 0.25), (1.0, 1.0)).replace(f'"{joint}"', f'"{link}"')
    path = mechanisms.write(tmp_path / "arm.urdf", text)
    scenario = mechanisms.human_arms({"left.urdf": str(path)})
    arm = read_arm(scenario, "left")
    assert arm.n == 2
    np.testing.assert_allclose(tip(arm, [0.0, 0.0]), [0.55, 0.0, 0.0], atol=1e-12)
    assert build_chain(scenario).n == 4
    model, shapes = read_visuals(mechanisms.human_arms({"left.tip": "left_forearm"}), "left")
    assert model.nq == 2
    assert len(shapes.geometryObjects) > 5


# ---- what does not fit ---------------------------------------------------------------------------


def test_a_tip_that_is_not_there_is_answered_with_the_links_there_are() -> None:
    scenario = mechanisms.human_arms({"left.tip": "gripper"})
    complaint(
        scenario,
        "left",
        "left.tip",
        r"left_arm\.urdf: left\.tip: no such frame.*left_forearm, hand",
    )


def test_a_tip_that_no_joint_moves() -> None:
    scenario = mechanisms.human_arms({"right.tip": "right_base"})
    complaint(scenario, "right", "right.tip", "no joint moves the tip.*right_base")


@pytest.mark.parametrize("name", ["shoulder", "right_elbow", "left_hand"])
def test_joints_that_do_not_move_the_tip(torso: Path, name: str) -> None:
    scenario = two_armed(torso, left={"joints": ["left_elbow", name]})
    complaint(scenario, "left", "left.joints", f"no joint of this name.*{name}.*left_shoulder")


def test_a_posture_of_another_length() -> None:
    scenario = mechanisms.human_arms({"left.posture": [0.1, 0.2, 0.3]})
    complaint(
        scenario, "left", "left.posture", "has 3 angles for 2 joints.*left_shoulder, left_elbow"
    )


def test_a_locked_joint_that_is_not_there(torso: Path) -> None:
    scenario = two_armed(torso).override({"robot.posture": {"hip": 0.1}})
    complaint(scenario, "left", "robot.posture.hip", "no such joint.*waist")


def test_both_arms_cannot_move_with_the_same_joints(torso: Path) -> None:
    """Without a list of joints either arm would move the waist."""
    scenario = two_armed(torso, left={"joints": None}, right={"joints": None})
    with pytest.raises(
        ModelError, match=r"left\.joints: both arms move with the same joints"
    ) as caught:
        build_chain(scenario)
    assert caught.value.value == ["waist"]


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_joints_with_several_freedoms_are_refused_by_name(tmp_path: Path, kind: str) -> None:
    text = mechanisms.arm_urdf((0.3, 0.3), (1.0, 1.0)).replace(
        'name="joint1" type="revolute"', f'name="joint1" type="{kind}"'
    )
    path = mechanisms.write(tmp_path / "odd.urdf", text)
    scenario = mechanisms.human_arms({"left.urdf": str(path), "left.posture": None})
    complaint(scenario, "left", "joint1", "type that is not supported.*revolute, continuous")
