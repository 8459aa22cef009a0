"""Bad URDF files: each is refused in one line that names the file and what to do."""

from __future__ import annotations

import re
import time
from pathlib import Path

import mechanisms
import pytest

from planner.arm import read_arm
from planner.errors import ModelError
from planner.urdf import Urdf, find_urdf, package_directories, read_urdf

GOOD = mechanisms.arm_urdf((0.3, 0.3), (1.0, 0.5))
LINK1 = (
    '<link name="link1"><inertial><origin xyz="0.15 0 0"/><mass value="0.5"/>'
    '<inertia ixx="7.5e-05" ixy="0" ixz="0" iyy="0.00375" iyz="0" izz="0.00375"/></inertial></link>'
)
BOMB = (
    '<?xml version="1.0"?><!DOCTYPE robot [<!ENTITY a "aaaaaaaaaa">'
    + "".join(
        f'<!ENTITY {name} "{f"&{before};" * 10}">'
        for before, name in zip("abcdefghi", "bcdefghij", strict=True)
    )
    + ']><robot name="&j;"><link name="base"/></robot>'
)


def changed(old: str, new: str) -> str:
    """The good arm with one thing changed."""
    assert GOOD.count(old) >= 1, old
    return GOOD.replace(old, new, 1)


def use(path: Path) -> None:
    """Reads the file as the left arm of the paper's scenario."""
    read_arm(mechanisms.human_arms({"left.urdf": str(path), "left.posture": None}), "left")


def complaint(path: Path) -> ModelError:
    """The error that its use raises, after the checks that hold for every one."""
    with pytest.raises(ModelError) as caught:
        use(path)
    error = caught.value
    text = str(error)
    assert "\n" not in text
    assert str(path) in text
    assert error.remedy
    assert len(text) < 600
    return error


def test_the_good_arm_is_good(tmp_path: Path) -> None:
    use(mechanisms.write(tmp_path / "arm.urdf", GOOD))
    assert LINK1 in GOOD


CASES = {
    "empty": ("", "not well-formed XML"),
    "no XML": ("robot: arm", "not well-formed XML"),
    "broken XML": (GOOD.replace("</link>", "", 1), "not well-formed XML"),
    "cut short": (GOOD[: len(GOOD) // 2], "not well-formed XML"),
    "entity bomb": (BOMB, "document type or entities"),
    "file entity": (
        '<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/hostname">]><robot name="&x;"/>',
        "document type or entities",
    ),
    "SDF instead": ('<sdf version="1.9"><model name="arm"/></sdf>', "no URDF.*<sdf>"),
    "no links": ('<robot name="arm"/>', "has no link"),
    "link without name": (changed('<link name="hand"/>', "<link/>"), "link without a name"),
    "joint without name": (changed('joint name="wrist" ', "joint "), "joint without a name"),
    "links of one name": (
        changed('<link name="hand"/>', '<link name="hand"/><link name="hand"/>'),
        "more than one link.*hand",
    ),
    "joints of one name": (changed('"joint1"', '"joint0"'), "more than one joint.*joint0"),
    "unknown parent": (changed('parent link="link0"', 'parent link="elbow"'), "joint1.*elbow"),
    "unknown child": (changed('child link="hand"', 'child link="grip"'), "wrist.*grip"),
    "joint without child": (changed('<child link="hand"/>', ""), "wrist.*child link"),
    "ring beside the root": (
        changed('parent link="base"', 'parent link="hand"'),
        "ring.*link0.*link1.*hand",
    ),
    "loose link": (changed("</robot>", '<link name="floor"/></robot>'), "2 root links.*floor"),
    "closed ring": (
        changed(
            "</robot>",
            '<joint name="ring" type="fixed"><parent link="hand"/><child link="base"/></joint>'
            "</robot>",
        ),
        "0 root links",
    ),
    "two parents": (
        changed(
            "</robot>",
            '<joint name="bridge" type="fixed"><parent link="base"/><child link="hand"/></joint>'
            "</robot>",
        ),
        "child of more than one joint.*hand",
    ),
    "negative mass": (changed('mass value="0.5"', 'mass value="-0.5"'), "link1: negative mass"),
    "NaN mass": (changed('mass value="0.5"', 'mass value="nan"'), "mass value.*not a finite"),
    "infinite mass": (changed('mass value="0.5"', 'mass value="1e999"'), "not a finite"),
    "mass in words": (changed('mass value="0.5"', 'mass value="heavy"'), "not a finite.*heavy"),
    "two masses": (changed('mass value="0.5"', 'mass value="0.5 0.7"'), "0.5 0.7"),
    "mass as Python writes it": (changed('mass value="0.5"', 'mass value="1_0"'), "1_0"),
    "inertia incomplete": (changed(' izz="0.00375"', ""), "link1: inertia without izz"),
    "inertial without mass": (changed('<mass value="0.5"/>', ""), "link1: inertial without a mass"),
    "mass without inertia": (
        changed(LINK1, LINK1[: LINK1.index("<inertia ixx")] + "</inertial></link>"),
        "link1: link with mass but no inertia",
    ),
    "negative inertia": (changed('iyy="0.00375"', 'iyy="-0.00375"'), "link1: inertia is not pos"),
    "indefinite inertia": (changed('iyz="0" izz="0.00375"', 'iyz="0.1" izz="0.00375"'), "not pos"),
    "NaN inertia": (changed('iyy="0.00375"', 'iyy="nan"'), "link1 inertia iyy.*not a finite"),
    "NaN origin": (changed('origin xyz="0.15 0 0"', 'origin xyz="nan 0 0"'), "origin xyz"),
    "short origin": (changed('origin xyz="0.15 0 0"', 'origin xyz="0.15 0"'), "xyz.*0.15 0'"),
    "long axis": (changed('axis xyz="0 0 1"', 'axis xyz="0 0 1 0"'), "joint0 axis.*0 0 1 0"),
    "NaN limit": (changed('lower="-3"', 'lower="nan"'), "limit lower.*not a finite"),
    "limits crossed": (changed('lower="-3" upper="3"', 'lower="3" upper="-3"'), "joint0"),
    "no axis": (changed('axis xyz="0 0 1"', 'axis xyz="0 0 0"'), "joint0"),
    "no limit": (
        changed('<limit lower="-3" upper="3" effort="40" velocity="10"/>', ""),
        "joint0",
    ),
    "no effort limit": (changed(' effort="40"', ""), "joint0.*effort"),
    "unknown joint type": (changed('type="revolute"', 'type="hinge"'), "joint0.*hinge"),
    "joint without type": (changed(' type="revolute"', ""), "joint0"),
}


@pytest.mark.parametrize("name", CASES)
def test_a_bad_urdf_is_refused_in_one_line(
    tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    text, words = CASES[name]
    path = mechanisms.write(tmp_path / "arm.urdf", text)
    assert re.search(words, str(complaint(path)))
    assert capfd.readouterr() == ("", "")  # nor does a parser below print lines of its own


def test_an_entity_bomb_in_another_encoding_is_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_bytes(BOMB.replace('"1.0"', '"1.0" encoding="utf-16"').encode("utf-16"))
    start = time.perf_counter()
    complaint(path)
    assert time.perf_counter() - start < 2.0


def test_a_missing_file_is_named_with_its_key() -> None:
    with pytest.raises(ModelError) as caught:
        use(Path("/nowhere/arm.urdf"))
    assert "/nowhere/arm.urdf: left.urdf: no such file" in str(caught.value)
    assert caught.value.remedy


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="is a folder"):
        use(tmp_path)


def test_bytes_that_are_no_text(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_bytes(bytes(range(256)) * 10)
    assert "not well-formed XML" in str(complaint(path))


def test_a_file_as_large_as_no_urdf_is(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    with path.open("wb") as file:
        file.truncate(65 * 2**20)
    assert "larger than 64 MB" in str(complaint(path))


def test_a_package_that_is_not_installed_is_told_how_to_get() -> None:
    with pytest.raises(ModelError, match=r"package://no_such_robot/.*robot\.packages") as caught:
        find_urdf("package://no_such_robot/arm.urdf", "left.urdf", Path(), [])
    assert caught.value.key == "left.urdf"


def test_packages_are_found_where_the_scenario_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "mine" / "my_arm" / "urdf"
    folder.mkdir(parents=True)
    path = mechanisms.write(folder / "arm.urdf", GOOD)
    name = "package://my_arm/urdf/arm.urdf"
    assert find_urdf(name, "k", tmp_path, ["mine"]).samefile(path)
    assert find_urdf(name, "k", Path("/"), [str(tmp_path / "mine" / "my_arm")]).samefile(path)
    with pytest.raises(ModelError):
        find_urdf(name, "k", tmp_path, [])
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"/nowhere:{tmp_path / 'mine'}")
    assert find_urdf(name, "k", tmp_path, []).samefile(path)
    assert tmp_path / "mine" in package_directories([], tmp_path)


# ---- what may be doubted, but used ---------------------------------------------------------------


def read(folder: Path, text: str) -> Urdf:
    return read_urdf(mechanisms.write(folder / "arm.urdf", text))


def test_a_sound_file_leaves_no_doubt(tmp_path: Path) -> None:
    found = read(tmp_path, GOOD)
    assert found.doubts == ()
    assert found.links == ("base", "link0", "link1", "hand")
    assert found.joints == ("joint0", "joint1")
    assert not found.unlimited


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('iyy="0.00375"', 'iyy="0.0000001"', "link1: principal moments .* triangle"),
        ('ixx="7.5e-05"', 'ixx="-5e-08"', "link1: .*-5e-08"),
        ('mass value="0.5"', 'mass value="0"', "link1: inertia but no mass"),
        (
            'ixx="7.5e-05" ixy="0" ixz="0" iyy="0.00375" iyz="0" izz="0.00375"',
            'ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"',
            "link1: 0.5 kg but zero inertia",
        ),
    ],
)
def test_doubtful_bodies_are_remarked_on(tmp_path: Path, old: str, new: str, words: str) -> None:
    (doubt,) = read(tmp_path, changed(old, new)).doubts
    assert re.search(words, doubt)


def test_continuous_joints_get_one_coordinate_and_no_limits(tmp_path: Path) -> None:
    found = read(tmp_path, changed('"joint1" type="revolute"', '"joint1" type="continuous"'))
    assert found.unlimited == {"joint1"}
    assert 'type="continuous"' not in found.text
