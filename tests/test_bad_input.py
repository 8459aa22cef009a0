"""Bad input through the real command line: one line, status 2, nothing written, no traceback.

Every case starts from the paper's example, copied into a folder of its own, with one thing wrong.
"""

import os
import re
import shutil
import sys
from pathlib import Path

import pytest

from planner import cli

EXAMPLE = Path(__file__).resolve().parents[1] / "urdf" / "human_arms"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The example's files, in the current folder."""
    shutil.copytree(EXAMPLE, tmp_path / "arms")
    monkeypatch.chdir(tmp_path / "arms")
    return tmp_path / "arms"


@pytest.fixture
def refused(folder, capfd, monkeypatch):
    """Runs the planner, which must refuse, and returns its one line."""

    def run(*arguments):
        before = _contents(folder)
        monkeypatch.setattr(sys, "argv", ["planner", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        out, err = capfd.readouterr()
        assert ended.value.code == 2, err
        assert out == ""
        assert err.startswith("error: ")
        assert err.count("\n") == 1
        assert "Traceback" not in err
        assert _contents(folder) == before
        return err

    return run


def _contents(folder):
    return {path: path.stat().st_mtime_ns for path in folder.parent.rglob("*") if path.is_file()}


def edit(file, old, new):
    """Replaces text in one of the example's files."""
    path = Path(file)
    text = path.read_text()
    assert old in text, old
    path.write_text(text.replace(old, new))


def plan(refused, *settings):
    """Plans with some settings and an --out that must not come into being."""
    options = [part for setting in settings for part in ("--set", setting)]
    line = refused("plan", "transport.toml", "--out", "out", *options)
    assert not Path("out").exists()
    return line


# ---- the scenario's file -------------------------------------------------------------------------

BOMB = (
    '<?xml version="1.0"?>\n<!DOCTYPE robot [<!ENTITY a "ha">\n'
    + "".join(
        f'<!ENTITY {b} "{f"&{a};" * 10}">\n' for a, b in zip("abcdefgh", "bcdefghi", strict=True)
    )
    + ']>\n<robot name="&i;"><link name="base"/></robot>\n'
)
OUTSIDE = '<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/hostname">]>\n<robot name="&x;"/>'


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        pytest.param(b"", ["left", "is missing", "add it|give"], id="empty"),
        pytest.param(b"title = \xff\xfe", ["not UTF-8", "save it as UTF-8"], id="not-utf-8"),
        pytest.param(b"[left\n", ["not valid TOML", "line 1", "correct"], id="broken-toml"),
        pytest.param(b"a = 1\na = 2\n", ["not valid TOML", "line 2"], id="key-twice"),
        pytest.param(b"x = " + b"[" * 9999, ["not valid TOML", "nested too deeply"], id="nested"),
    ],
)
def test_scenario_file(refused, content, expected):
    Path("bad.toml").write_bytes(content)
    line = refused("plan", "bad.toml", "--out", "out")
    assert line.startswith("error: bad.toml: ")
    for part in expected:
        assert re.search(part, line), line


def test_scenario_that_is_missing_or_a_folder(refused):
    assert "transprt.toml: no such file; did you mean transport.toml?" in refused(
        "plan", "transprt.toml"
    )
    assert "is a folder; name the TOML file in it: transport.toml" in refused("plan", ".")
    assert "no such file" in refused("check", "nowhere/scenario.toml")


@pytest.mark.parametrize(
    ("setting", "key", "remedy"),
    [
        ("object.mas=8", "object.mas", "did you mean 'object.mass'"),
        ("objekt.mass=8", "objekt", "did you mean 'object'"),
        ("duration=2", "duration", "did you mean 'task.duration'"),
        ("object.mass=-1", "object.mass", "at least 0"),
        ("object.mass=heavy", "object.mass", "give a number"),
        ("object.mass=true", "object.mass", "give a number"),
        ("object.mass=nan", "object.mass", "give a number"),
        ("object.mass=2e6", "object.mass", "kilograms"),
        ("task.duration=0", "task.duration", "greater than 0"),
        ("task.duration=-1.5", "task.duration", "greater than 0"),
        ("task.duration=inf", "task.duration", "give"),
        ("task.duration=1500", "task.duration", "seconds"),
        ("task.goal.xyz=[0.4, nan, 0]", "task.goal.xyz[1]", "give"),
        ("task.goal.xyz=[400, 300, 0]", "task.goal.xyz[0]", "give metres"),
        ("task.goal.xyz=[0.4, 0.3]", "task.goal.xyz", "three numbers"),
        ("task.goal.xyz=[0.4, 0.3, 0, 0]", "task.goal.xyz", "three numbers"),
        ("task.goal.xyz=somewhere", "task.goal.xyz", "three numbers"),
        ('task.goal.xyz=["a", "b", "c"]', "task.goal.xyz[0]", "give"),
        ("left.posture=[129, -94]", "left.posture[0]", "give radians"),
        ("left.posture=[0.1, 0.2, 0.3]", "left.posture", "left_shoulder, left_elbow"),
        ("left.tip=hnd", "left.tip", "hand"),
        ("left.tip=left_base", "left.tip", "at least one joint"),
        ('left.joints=["thumb", "left_elbow"]', "left.joints", "left_shoulder"),
        ('left.joints=["left_elbow"]', "left.posture", "one angle per joint"),
        ('right.joints=["right_elbow", "right_elbow"]', "right.joints", "once"),
        ("left.base.rpy=[0, 0, 90]", "left.base.rpy[2]", "give radians"),
        ("left.urdf=no.urdf", "left.urdf", "name a URDF file"),
        ("left.urdf=.", "left.urdf", "name a URDF file"),
        ("left.urdf=package://nowhere/a.urdf", "left.urdf", "robot.packages"),
        ("object.urdf=left_arm.urdf", "left_arm.urdf", "make them fixed"),
        ("robot.posture.thumb=0.1", "robot.posture.thumb", "choose among"),
        ("grasp.pair=revolut", "grasp.pair", "did you mean 'revolute'"),
        ("grasp.pair=rigid", "grasp.pair", "more freedoms"),
        ("grasp.axis=[0, 0, 0]", "grasp.axis", "nonzero"),
        ("grasp.axis=[1, 0, 0]", "grasp.axis", "choose"),
        ("task.start.rpy=[0, 0, 0.5]", "grasp.pair", "leave out start.rpy"),
        ("world.gravity=[0, 0, -9810]", "world.gravity[2]", "m/s^2"),
        ("criterion.kind=torque_change", "criterion.kind", "did you mean 'torque-change'"),
        ("criterion.weights=[1, 1, 1]", "criterion.weights", "one per joint"),
        ("criterion.weights=[1, 1, 1, -1]", "criterion.weights[3]", "greater than 0"),
        ("criterion.speed_cost=-1", "criterion.speed_cost", "at least 0"),
        ("boundary.start.torque=[1, 2]", "boundary.start.torque", "one per joint"),
        ("boundary.start.torque=none", "boundary.start.torque", "zero, free, static, rest"),
        ("boundary.goal.internal_force=[1, 0, 5]", "boundary.goal.internal_force", "zero"),
        ("boundary.goal.internal_moment=[0, 0, 1]", "boundary.goal.internal_moment", "zero"),
        ("solver.tolerance=0", "solver.tolerance", "greater than 0"),
        ("solver.max_nodes=10.5", "solver.max_nodes", "whole number"),
        ("solver.method=magic", "solver.method", "collocation"),
        ("task.start.xyz=[0.0, 0.59, 0.0]", "task.start.xyz", "closer to the bases"),
        ("task.goal.xyz=[0.4, 3.0, 0.0]", "task.goal.xyz", "closer to the bases"),
        ("task.goal.xyz=[0.4, 0.3, 0.1]", "task.goal.xyz", "closer to the bases"),
        ("right.base.xyz=[0.45, 0.0, 0.2]", "task.start.xyz", "closer to the bases"),
    ],
)
def test_setting(refused, setting, key, remedy):
    line = plan(refused, setting)
    assert re.search(r"\w+\.(toml|urdf): ", line), line
    assert key in line
    assert remedy in line.split(key, 1)[1], line


@pytest.mark.parametrize(
    ("setting", "expected"),
    [
        ("object.mass 8", ["KEY=VALUE"]),
        ("object.mass=", ["KEY=VALUE"]),
        ("=8", ["is no dotted key", "e.g. object.mass"]),
        ("task.goal.xyz=[0.4, 0.3", ["task.goal.xyz", "is not a TOML value"]),
        ("object.mass.kg=8", ["object.mass.kg", "set object.mass itself"]),
    ],
)
def test_setting_that_is_none(refused, setting, expected):
    line = plan(refused, setting)
    assert "--set" in line or "transport.toml" in line
    for part in expected:
        assert part in line


def test_torque_and_preload_at_once(refused):
    edit("transport.toml", "start.torque =", "start.internal_force = [1, 0, 0]\nstart.torque =")
    line = plan(refused)
    assert "transport.toml: boundary.start: has both torque and internal_force" in line
    settings = ("boundary.goal.torque=free", "boundary.goal.internal_force=[1, 0, 0]")
    line = plan(refused, *settings)
    assert "boundary.goal" in line
    assert "one of the two" in line


def test_arms_that_share_joints(refused):
    line = plan(refused, "right.urdf=left_arm.urdf", "right.base.xyz=[0, 0, 0]")
    assert "both arms move with the same joints" in line
    assert "left.joints" in line


# ---- URDF files ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        pytest.param("", ["not well-formed XML"], id="empty"),
        pytest.param("<robot><link></robot>", ["not well-formed XML", "mend"], id="broken-xml"),
        pytest.param(BOMB, ["entities", "remove the declaration"], id="entity-bomb"),
        pytest.param(BOMB.encode("utf-16"), ["entities|not well-formed"], id="entity-bomb-utf-16"),
        pytest.param(OUTSIDE, ["entities", "remove the declaration"], id="entity-from-outside"),
        pytest.param("<html/>", ["no URDF", "<robot>"], id="not-a-urdf"),
        pytest.param(bytes(range(256)), ["not well-formed XML"], id="binary"),
        pytest.param('<robot name="a"/>', ["has no link", "<link>"], id="no-link"),
        pytest.param(
            '<robot name="a"><link name="a"/><link name="b"/></robot>',
            ["2 root links", "one tree"],
            id="two-roots",
        ),
        pytest.param(
            '<robot name="a"><link name="a"/><link name="a"/></robot>',
            ["more than one link", "unique"],
            id="same-name-twice",
        ),
    ],
)
def test_urdf_file(refused, content, expected):
    data = content if isinstance(content, bytes) else content.encode()
    Path("left_arm.urdf").write_bytes(data)
    line = plan(refused)
    assert "left_arm.urdf: " in line
    assert len(line) < 400
    for part in expected:
        assert re.search(part, line), line


INERTIA = '<inertia ixx="0.00018" ixy="0" ixz="0" iyy="0.0054675" iyz="0" izz="0.0054675"/>'
SHOULDER = '<joint name="left_shoulder" type="revolute">'


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        pytest.param('"0.9"', '"-0.9"', ["left_upper_arm", "negative mass"], id="negative-mass"),
        pytest.param('"0.9"', '"nan"', ["mass", "not a finite number"], id="mass-nan"),
        pytest.param('"0.9"', '"heavy"', ["mass", "not a finite number"], id="mass-in-words"),
        pytest.param(INERTIA, "", ["left_upper_arm", "mass but no inertia"], id="no-inertia"),
        pytest.param(
            'izz="0.0054675"', 'izz="-1"', ["left_upper_arm", "not positive"], id="inertia"
        ),
        pytest.param('<mass value="0.9"/>', "", ["left_upper_arm", "without a mass"], id="no-mass"),
        pytest.param(
            '<parent link="left_base"/>',
            '<parent link="table"/>',
            ["left_shoulder", "'table'", "name a link"],
            id="parent-link",
        ),
        pytest.param(
            SHOULDER,
            SHOULDER.replace("revolute", "floating"),
            ["left_shoulder", "not supported", "use revolute"],
            id="floating-joint",
        ),
        pytest.param(
            SHOULDER,
            SHOULDER.replace("revolute", "hinge"),
            ["left_shoulder", "hinge"],
            id="unknown-joint-type",
        ),
        pytest.param(
            'lower="-2.8" upper="2.8"',
            'lower="2.8" upper="-2.8"',
            ["left_elbow", "limit|range"],
            id="limits-turned-round",
        ),
        pytest.param('effort="40" ', "", ["left_elbow", "effort"], id="limit-without-effort"),
        pytest.param('effort="40"', 'effort="-40"', ["left_elbow", "effort"], id="effort-negative"),
        pytest.param('<robot name="left_arm">', "<robot>", ["name"], id="robot-without-a-name"),
        pytest.param(
            '<limit lower="-2.8" upper="2.8" effort="40" velocity="20"/>',
            "",
            ["left_elbow", "limit"],
            id="no-limit",
        ),
        pytest.param('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>', ["axis"], id="axis-zero"),
        pytest.param('<axis xyz="0 0 1"/>', '<axis xyz="0 1"/>', ["axis"], id="axis-short"),
    ],
)
def test_urdf_content(refused, old, new, expected):
    edit("left_arm.urdf", old, new)
    line = plan(refused)
    assert "left_arm.urdf: " in line
    for part in expected:
        assert re.search(part, line), line


def test_joint_that_does_not_move_the_tip(refused):
    finger = (
        '<joint name="left_finger" type="revolute"><parent link="hand"/><child link="tip"/>'
        '<limit lower="0" upper="1" effort="1" velocity="1"/></joint><link name="tip"/></robot>'
    )
    edit("left_arm.urdf", "</robot>", finger)
    line = plan(refused, 'left.joints=["left_shoulder", "left_finger"]')
    assert "left.joints: no joint of this name moves the tip (got 'left_finger')" in line


@pytest.mark.parametrize("kind", ["floating", "revolute"])
def test_object_with_a_joint_that_moves(refused, kind):
    edit(
        "point_mass.urdf",
        "</robot>",
        f'<link name="lid"/><joint name="hinge" type="{kind}"><parent link="object"/>'
        '<child link="lid"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>',
    )
    line = plan(refused)
    assert "point_mass.urdf: " in line
    assert "hinge" in line
    assert "fixed" in line


def test_effort_weights_without_an_effort_limit(refused):
    edit("left_arm.urdf", 'effort="40"', 'effort="0"')
    line = plan(refused, "criterion.weights=effort")
    assert "transport.toml: criterion.weights: " in line
    assert "left_elbow" in line


# ---- places to write to, folders to read from ----------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--out", "transport.toml"], ["transport.toml: --out", "is a file"]),
        (["--out", "transport.toml/out"], ["--out", "transport.toml is no folder"]),
        (["--html", "."], ["--html", "is a folder", "name a file in it"]),
        (["--html", "transport.toml/page.html"], ["--html", "is no folder"]),
        (["--plot", "plot.gif"], ["plot.gif: --plot", ".png, .svg or .pdf"]),
        (["--plot", "plot"], ["plot: --plot", ".png, .svg or .pdf"]),
        (["--plot", "transport.toml/plot.png"], ["--plot", "is no folder"]),
    ],
)
def test_place(refused, arguments, expected):
    line = refused("plan", "transport.toml", *arguments)
    for part in expected:
        assert part in line


@pytest.mark.parametrize(
    "arguments", [["--out", "shut/out"], ["--out", "shut"], ["--html", "shut/page.html"]]
)
def test_place_that_is_not_writable(refused, arguments, monkeypatch):
    Path("shut").mkdir()
    # not by its mode: root may write anywhere
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path).name != "shut")
    assert "shut is not writable" in refused("plan", "transport.toml", *arguments)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (None, ["holds no plan", "planner plan --out"]),
        ("{", ["holds no plan"]),
        ("[1]", ["holds no plan"]),
        ('{"status": "mesh-full", "remedy": "more nodes"}', ["mesh-full", "more nodes"]),
        ('{"status": "solved"}', ["damaged", "plan it again"]),
        ('{"status": "solved", "scenario": {}}', ["damaged|missing"]),
    ],
)
def test_folder_without_a_plan(refused, content, expected):
    Path("saved").mkdir()
    if content is not None:
        Path("saved/plan.json").write_text(content)
    line = refused("show", "saved", "--html", "page.html")
    assert "saved" in line
    for part in expected:
        assert re.search(part, line), line
