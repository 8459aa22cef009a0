"""What `planner check` finds in a scenario: its sizes, and everything that is wrong with it."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import planner
from planner.examination import examine
from planner.remarks import scenario_remarks

EXAMPLE = Path(__file__).resolve().parents[1] / "urdf" / "human_arms"
PANDA = "package://example-robot-data/robots/panda_description/urdf/panda.urdf"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    shutil.copytree(EXAMPLE, tmp_path / "arms")
    monkeypatch.chdir(tmp_path / "arms")
    return tmp_path / "arms"


def look(**settings):
    """Examines the example in the current folder, dots of the keys written as two underscores."""
    values = {key.replace("__", "."): value for key, value in settings.items()}
    return examine(planner.load("transport.toml", values))


def edit(file, old, new):
    path = Path(file)
    text = path.read_text()
    assert old in text, old
    path.write_text(text.replace(old, new))


def one(lines, *words):
    """Returns the one line that has all the words."""
    found = [line for line in lines if all(word in line for word in words)]
    assert len(found) == 1, lines
    return found[0]


def test_the_example(folder):
    found = look()
    assert found.possible
    assert found.problems == found.doubts == ()
    left, right = found.arms
    assert left.masses == {"left_upper_arm": 0.9, "left_forearm": 1.1}
    assert left.mass == pytest.approx(2.0)
    assert right.joint_types == ("revolute", "revolute")
    chain = found.chain
    assert (chain.n, chain.m, chain.p, chain.r) == (4, 2, 2, 2)
    start, goal = found.ends
    assert np.allclose(start.posture, [2.2508, -1.6371, 1.7518, 0.9702], atol=1e-4)
    assert 1.0 <= start.closure_condition < 10.0
    assert all(
        1.0 <= condition < 10.0 for condition in (*start.arm_conditions, *goal.arm_conditions)
    )


def test_two_pandas(folder, tmp_path):
    example = Path("panda.toml")
    arm = f'urdf = "{PANDA}"\ntip = "panda_hand_tcp"\nposture = [0, -0.3, 0, -2.2, 0, 2.0, 0.8]\n'
    arm += f"joints = {[f'panda_joint{k}' for k in range(1, 8)]}\n"
    example.write_text(
        f"[left]\n{arm}base.xyz = [0, 0.4, 0]\ngrasp.xyz = [0, 0.1, 0]\n"
        "grasp.rpy = [3.1415, 0, 0]\n"
        f"[right]\n{arm}base.xyz = [0, -0.4, 0]\ngrasp.xyz = [0, -0.1, 0]\n"
        "grasp.rpy = [3.1415, 0, 0]\n"
        '[object]\nurdf = "point_mass.urdf"\n[grasp]\npair = "rigid"\n[task]\nduration = 2.0\n'
        "start.xyz = [0.5, 0, 0.4]\ngoal.xyz = [0.5, 0.1, 0.5]\n"
    )
    found = examine(planner.load(example))
    assert found.problems == ()
    chain = found.chain
    assert (chain.n, chain.m, chain.p, chain.r) == (14, 6, 8, 3)
    left = found.arms[0]
    assert left.mass > 15.0
    assert set(left.fixed_masses) == {"panda_link0"}
    assert set(left.arm.locked) == {"panda_finger_joint1", "panda_finger_joint2"}
    assert all(end.posture is not None for end in found.ends)


def test_all_faults_at_once(folder):
    inertia = '<inertia ixx="0.00018" ixy="0" ixz="0" iyy="0.0054675" iyz="0" izz="0.0054675"/>'
    edit("left_arm.urdf", inertia, "")
    edit("left_arm.urdf", '<mass value="1.1"/>', '<mass value="1.3"/>')
    inertia = '<inertia ixx="0.00022" ixy="0" ixz="0" iyy="0.0099825" iyz="0" izz="0.0099825"/>'
    edit("left_arm.urdf", inertia, "")
    found = look(right__tip="palm", object__urdf="none.urdf")
    assert not found.possible
    one(found.problems, "left_arm.urdf", "left_upper_arm", "no inertia")
    one(found.problems, "left_arm.urdf", "left_forearm", "no inertia", "1.3")
    one(found.problems, "right_arm.urdf", "palm", "hand")
    one(found.problems, "none.urdf", "no such file")
    assert found.chain is None
    assert found.ends == ()


def test_end_conditions_that_do_not_fit_are_all_told(folder):
    found = look(
        boundary__start__torque=[1.0, 2.0],
        boundary__goal__internal_force=[0.0, 0.0, 1.0],
        criterion__weights=[1.0, 1.0],
    )
    assert len(found.problems) == 3
    one(found.problems, "transport.toml: boundary.start.torque")
    one(found.problems, "transport.toml: boundary.goal.internal_force")
    one(found.problems, "transport.toml: criterion.weights")
    assert all(end.posture is not None for end in found.ends)


def test_out_of_reach(folder):
    found = look(task__start__xyz=[0.0, 0.6, 0.0], task__goal__xyz=[0.3, 0.9, 0.0])
    assert [end.posture for end in found.ends] == [None, None]
    one(found.problems, "transport.toml: task.start.xyz", "right arm misses it by 0.1500 m")
    one(found.problems, "transport.toml: task.goal.xyz", "left arm", "right arm")
    found = look(task__goal__xyz=[0.3, 0.9, 0.0])
    assert len(found.problems) == 1
    assert found.ends[0].posture is not None


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("<robot", '<!DOCTYPE robot [<!ENTITY a "b">]><robot'),
        ("<robot", "<robat"),
        ("</robot>", ""),
    ],
)
def test_a_file_that_cannot_be_read(folder, old, new):
    edit("left_arm.urdf", old, new)
    found = look()
    one(found.problems, "left_arm.urdf")
    assert found.arms[0] is None
    assert found.arms[1] is not None


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('izz="0.0054675"', 'izz="0.5"', ("left_upper_arm", "triangle inequality")),
        ('effort="40"', 'effort="0"', ("no effort limit", "left_elbow")),
        ('effort="40" velocity="20"', 'effort="40" velocity="0"', ("no speed limit", "left_elbow")),
        ('<sphere radius="0.024"/>', '<mesh filename="no.stl"/>', ("left_upper_arm", "no.stl")),
        (
            '<sphere radius="0.024"/>',
            '<mesh filename="package://no/no.stl"/>',
            ("left_upper_arm", "package://no/no.stl"),
        ),
        ('<mass value="1.1"/>', '<mass value="0"/>', ("left_forearm", "inertia but no mass")),
        ("<geometry><sphere radius", "<geometry/><geometry><sphere radius", ("yourdfpy",)),
    ],
)
def test_doubts_about_a_urdf(folder, old, new, words):
    edit("left_arm.urdf", old, new)
    found = look()
    assert found.possible
    assert any(all(word in line for word in words) for line in found.doubts), found.doubts
    assert all("left_arm.urdf: " in line for line in found.doubts)


def test_a_range_that_is_not_given(folder):
    edit("left_arm.urdf", 'lower="-2.8" upper="2.8" ', "")
    found = look()
    assert not found.possible
    one(found.doubts, "joint left_elbow: its range 0 to 0 is empty")


def test_a_joint_that_moves_no_mass(folder):
    edit("right_arm.urdf", "0.9", "0")
    text = Path("right_arm.urdf").read_text()
    Path("right_arm.urdf").write_text(re.sub(r"<inertial>.*?</inertial>", "", text, flags=re.S))
    found = look()
    for joint in ("right_shoulder", "right_elbow"):
        one(found.doubts, f"joint {joint} moves no link that has a mass")


def test_postures(folder):
    found = look(left__posture=[2.25, -3.0], right__posture=None)
    one(found.doubts, "left.posture", "left_elbow at -3 is outside its range -2.8 to 2.8")
    one(found.doubts, "right.posture is not given")


def test_singular_arms(folder):
    reach = 0.6
    found = look(task__start__xyz=[0.225, float(np.sqrt((reach - 1e-6) ** 2 - 0.225**2)), 0.0])
    assert found.possible
    one(found.doubts, "the left arm", "singularity at the start")
    one(found.doubts, "the right arm", "singularity at the start")
    assert found.ends[0].arm_conditions[0] > 100.0 > found.ends[1].arm_conditions[0]


def test_what_has_no_effect(folder):
    def remarks(**settings):
        values = {key.replace("__", "."): value for key, value in settings.items()}
        return scenario_remarks(planner.load("transport.toml", values))

    assert remarks() == remarks(boundary__goal__torque="free") == ()
    line = one(
        remarks(
            criterion__kind="jerk",
            boundary__start__internal_force=[1.0, 0.0, 0.0],
            boundary__goal__torque="free",
        ),
        "boundary.start.internal_force and boundary.goal.torque do not apply",
    )
    assert "jerk" in line
    one(remarks(criterion__kind="torque", boundary__goal__torque="static"), "does not apply")
    assert remarks(criterion__kind="mixed", boundary__goal__torque="static") == ()
    one(
        remarks(
            criterion__kind="mixed", criterion__torque_share=1.0, boundary__goal__torque="static"
        ),
        "boundary.goal.torque does not apply",
    )
    one(remarks(criterion__torque_share=0.2), "criterion.torque_share")
    one(remarks(criterion__kind="jerk", criterion__speed_cost=0.1), "criterion.speed_cost")
    assert remarks(task__posture="start") == ()
    one(remarks(task__posture="start", left__posture=None), "left.posture is not given")
    assert look(criterion__kind="torque", boundary__goal__torque="free").doubts == remarks(
        criterion__kind="torque", boundary__goal__torque="free"
    )
