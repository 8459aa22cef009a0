"""The scenario: what a file may say, what is filled in, and the one line that a mistake gives."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from planner.errors import InputError, ScenarioError
from planner.scenario import Scenario, load, parse_override

HUMAN_ARMS = Path(__file__).parents[1] / "urdf" / "human_arms"
TRANSPORT = HUMAN_ARMS / "transport.toml"

LEAST = """
[left]
urdf = "left.urdf"
tip = "hand"
[right]
urdf = "right.urdf"
tip = "hand"
[object]
urdf = "object.urdf"
[task]
start.xyz = [0.1, 0.4, 0.0]
goal.xyz = [0.4, 0.3, 0.0]
duration = 1.0
"""


def written(folder: Path, text: str | bytes, name: str = "scenario.toml") -> Path:
    """A file of that content."""
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def complaint(path: Path, *overrides: str, values: dict[Any, Any] | None = None) -> ScenarioError:
    """The error that loading raises, after the checks that hold for every one."""
    with pytest.raises(ScenarioError) as caught:
        load(path, values if values is not None else overrides)
    error = caught.value
    assert isinstance(error, InputError)
    assert "\n" not in str(error)
    assert "pydantic" not in str(error).lower()
    assert error.remedy
    return error


# What a file gives


def test_the_shipped_scenario_is_the_papers() -> None:
    scenario = load(TRANSPORT)
    assert scenario.left.posture == (2.25, -1.64)
    assert scenario.right.base.xyz == (0.45, 0.0, 0.0)
    assert scenario.object.mass == 2.0
    assert scenario.task.start.xyz == (0.1, 0.4, 0.0)
    assert scenario.task.goal.xyz == (0.4, 0.3, 0.0)
    assert scenario.task.duration == 1.0
    assert scenario.criterion.kind == "torque-change"
    assert scenario.boundary.start.torque == scenario.boundary.goal.torque == "zero"
    assert scenario.path == TRANSPORT
    assert scenario.directory == HUMAN_ARMS.absolute()


def test_defaults_are_filled_in(tmp_path: Path) -> None:
    scenario = load(written(tmp_path, LEAST))
    assert scenario.title == ""
    assert scenario.robot is None
    assert scenario.left.joints is None
    assert scenario.left.posture is None
    assert scenario.left.base.xyz == scenario.left.grasp.rpy == (0.0, 0.0, 0.0)
    assert scenario.object.mass is None
    assert scenario.grasp.pair == "revolute"
    assert scenario.grasp.axis == (0.0, 0.0, 1.0)
    assert scenario.world.gravity == (0.0, 0.0, 0.0)
    assert scenario.task.start.rpy is None
    assert scenario.task.posture == "free"
    assert scenario.criterion.weights == "auto"
    assert scenario.criterion.speed_cost == "auto"
    assert scenario.boundary.start.torque == "zero"
    assert scenario.boundary.start.internal_force is None
    assert scenario.solver.method == "collocation"
    assert scenario.solver.tolerance == 1e-4


def test_nested_tables_and_dotted_keys_say_the_same(tmp_path: Path) -> None:
    dotted = load(written(tmp_path, LEAST))
    nested = LEAST.replace(
        "start.xyz = [0.1, 0.4, 0.0]\ngoal.xyz = [0.4, 0.3, 0.0]\nduration = 1.0",
        "duration = 1\n[task.start]\nxyz = [0.1, 0.4, 0]\n[task.goal]\nxyz = [0.4, 0.3, 0]",
    )
    assert load(written(tmp_path, nested)) == dotted


def test_both_arms_may_share_the_robots_urdf(tmp_path: Path) -> None:
    text = LEAST.replace('urdf = "left.urdf"', "").replace('urdf = "right.urdf"', "")
    text += '[robot]\nurdf = "robot.urdf"\npackages = ["meshes"]\nposture.waist = 0.5\n'
    scenario = load(written(tmp_path, text))
    assert scenario.left.urdf == scenario.right.urdf == "robot.urdf"
    assert scenario.robot is not None
    assert scenario.robot.posture == {"waist": 0.5}
    # Another robot for both, and then one arm on its own.
    other = scenario.override({"robot.urdf": "other.urdf"})
    assert (other.left.urdf, other.right.urdf) == ("other.urdf", "other.urdf")
    other = other.override({"left.urdf": "arm.urdf"}).override({"robot.urdf": "third.urdf"})
    assert (other.left.urdf, other.right.urdf) == ("arm.urdf", "third.urdf")


def test_a_byte_order_mark_is_no_fault(tmp_path: Path) -> None:
    assert load(written(tmp_path, b"\xef\xbb\xbf" + LEAST.encode())) == load(
        written(tmp_path, LEAST)
    )


def test_start_may_be_the_goal() -> None:
    load(TRANSPORT, ["task.goal.xyz=[0.1, 0.4, 0.0]"])


def test_nothing_can_be_changed_in_place() -> None:
    scenario = load(TRANSPORT)
    with pytest.raises(Exception, match="frozen"):
        scenario.object.mass = 3.0  # type: ignore[misc]


def test_reading_scenarios_imports_no_robotics() -> None:
    code = "import sys, planner.scenario; print('pinocchio' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[1],
    )
    assert done.stdout.strip() == "False"


# Values set over the file


@pytest.mark.parametrize(
    ("text", "key", "value"),
    [
        ("object.mass=8", ("object", "mass"), 8),
        ("object.mass = 8.5 ", ("object", "mass"), 8.5),
        ("boundary.goal.torque=free", ("boundary", "goal", "torque"), "free"),
        ('grasp.pair="rigid"', ("grasp", "pair"), "rigid"),
        ("task.goal.xyz=[0.4, 0.3, 0]", ("task", "goal", "xyz"), [0.4, 0.3, 0]),
        ("boundary.start={torque='free'}", ("boundary", "start"), {"torque": "free"}),
        ("left.urdf=../a b/arm.urdf", ("left", "urdf"), "../a b/arm.urdf"),
        ("left.urdf=package://p/arm.urdf", ("left", "urdf"), "package://p/arm.urdf"),
        ("title=mass = 3", ("title",), "mass = 3"),
        ("robot.posture.'joint.1'=0.3", ("robot", "posture", "joint.1"), 0.3),
        ("criterion.kind=torque-change", ("criterion", "kind"), "torque-change"),
    ],
)
def test_a_setting_is_a_dotted_key_and_a_toml_value(
    text: str, key: tuple[str, ...], value: object
) -> None:
    assert parse_override(text) == (key, value)


@pytest.mark.parametrize(
    "text",
    [
        *("", "=", "object.mass", "object.mass=", "=3", "object..mass=3", "a b=3", "a\nb=1"),
        *("a=[1, 2", "a={x=", "title='open", "a=[1]\nb=2", "a=1\nb=2", "a=" + "[" * 5000),
    ],
)
def test_what_is_no_setting(text: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        parse_override(text)
    assert "\n" not in str(caught.value)
    assert caught.value.remedy


def test_settings_change_what_the_file_says() -> None:
    scenario = load(TRANSPORT, ["object.mass=8", "boundary.goal.torque=free", "object.mass=9"])
    assert scenario.object.mass == 9.0
    assert scenario.boundary.goal.torque == "free"
    assert scenario.boundary.start.torque == "zero"
    values = {("object", "mass"): 9, ("boundary", "goal", "torque"): "free"}
    assert load(TRANSPORT, values) == scenario
    assert load(TRANSPORT, "object.mass=8").object.mass == 8.0


def test_override_makes_a_changed_copy() -> None:
    scenario = load(TRANSPORT)
    heavy = scenario.override({"object.mass": 8, "title": "heavy"})
    assert (heavy.object.mass, heavy.title) == (8.0, "heavy")
    assert scenario.object.mass == 2.0
    assert heavy.path == scenario.path
    assert heavy.override({"object.mass": None}).object.mass is None


def test_override_takes_numpy_values() -> None:
    goal = np.array([0.3, 0.35, 0.0])
    scenario = load(TRANSPORT).override(
        {"task.goal.xyz": goal, "object.mass": np.float64(3), "solver.samples": np.int64(101)}
    )
    assert scenario.task.goal.xyz == (0.3, 0.35, 0.0)
    assert scenario.solver.samples == 101
    mixed = [np.int64(1), np.float32(2), 3]
    assert scenario.override({"world.gravity": mixed}).world.gravity == (1.0, 2.0, 3.0)


def test_a_table_is_replaced_as_a_whole() -> None:
    scenario = load(TRANSPORT).override({"right": {"urdf": "b.urdf", "tip": "tool"}})
    assert scenario.right.base.xyz == (0.0, 0.0, 0.0)
    assert scenario.right.posture is None


def test_a_setting_below_a_number_is_refused() -> None:
    error = complaint(TRANSPORT, "object.mass.left=3")
    assert error.key == "object.mass.left"
    assert "no table" in str(error)


# Torques or a preload


def test_a_preload_takes_the_place_of_the_torques(tmp_path: Path) -> None:
    scenario = load(TRANSPORT, ["boundary.start.internal_force=[10, 10, 0]"])
    assert scenario.boundary.start.internal_force == (10.0, 10.0, 0.0)
    assert scenario.boundary.start.torque is None
    assert scenario.boundary.goal.torque == "zero"
    in_file = load(written(tmp_path, LEAST + "[boundary]\ngoal.internal_moment = [0, 0, 1]\n"))
    assert in_file.boundary.goal.torque is None


def test_the_last_one_said_counts() -> None:
    scenario = load(TRANSPORT)
    preload = scenario.override({"boundary.start.internal_force": [1, 0, 0]})
    moment = preload.override({"boundary.start.internal_moment": [0, 0, 1]})
    assert moment.boundary.start.internal_force == (1.0, 0.0, 0.0)
    back = moment.override({"boundary.start.torque": "free"})
    assert back.boundary.start.torque == "free"
    assert back.boundary.start.internal_force is back.boundary.start.internal_moment is None
    assert preload.override({"object.mass": 3}).boundary == preload.boundary
    assert preload.override({"boundary.start.internal_force": None}) == scenario.override(
        {"boundary.start.torque": None}
    )


def test_both_at_once_are_refused(tmp_path: Path) -> None:
    text = '[boundary]\nstart.torque = "zero"\nstart.internal_force = [0.0, 0.0, 0.0]\n'
    error = complaint(written(tmp_path, LEAST + text))
    assert error.key == "boundary.start"
    assert "torque" in str(error)
    assert "internal_force" in str(error)
    complaint(TRANSPORT, "boundary.start.torque=free", "boundary.start.internal_force=[1, 0, 0]")
    complaint(TRANSPORT, "boundary.start={torque='free', internal_force=[1, 0, 0]}")


# Resolved, for the result folder


def test_resolved_goes_through_json_and_back() -> None:
    values = {
        "boundary.start.internal_force": [1, 0, 0],
        "criterion.weights": [1, 2, 3, 4],
        "robot.urdf": "package://a/robot.urdf",
        "robot.packages": ["../meshes"],
        "object.mass": None,
    }
    scenario = load(TRANSPORT).override(values)
    data = json.loads(json.dumps(scenario.resolved()))
    again = Scenario.from_resolved(data)
    assert again.resolved() == data
    assert again.boundary == scenario.boundary
    assert again.criterion == scenario.criterion
    assert again.path is None
    assert again.override({"boundary.start.torque": "zero"}).boundary.start.torque == "zero"


def test_resolved_paths_are_absolute() -> None:
    values = {
        "robot.urdf": "package://a/b.urdf",
        "robot.packages": ["../x"],
        "object.urdf": "./a/../o.urdf",
    }
    data = load(TRANSPORT).override(values).resolved()
    assert data["left"]["urdf"] == str(HUMAN_ARMS.absolute() / "left_arm.urdf")
    assert data["object"]["urdf"] == str(HUMAN_ARMS.absolute() / "o.urdf")
    assert data["robot"]["urdf"] == "package://a/b.urdf"
    assert data["robot"]["packages"] == [str(HUMAN_ARMS.absolute().parent / "x")]


def test_damaged_resolved_data_names_its_file() -> None:
    data = load(TRANSPORT).resolved()
    data["object"]["mass"] = "heavy"
    with pytest.raises(ScenarioError, match=r"plan\.json: object\.mass: must be a number"):
        Scenario.from_resolved(data, Path("plan.json"))
    with pytest.raises(ScenarioError):
        Scenario.from_resolved([1, 2])  # type: ignore[arg-type]


# Files that cannot be read


def test_a_missing_file_names_a_near_one(tmp_path: Path) -> None:
    written(tmp_path, LEAST, "transport.toml")
    error = complaint(tmp_path / "transprt.toml")
    assert error.source == tmp_path / "transprt.toml"
    assert "no such file" in str(error)
    assert "transport.toml?" in str(error)
    complaint(tmp_path / "nowhere" / "scenario.toml")


def test_a_folder_names_the_files_in_it(tmp_path: Path) -> None:
    assert "folder" in str(complaint(tmp_path))
    assert "transport.toml" in str(complaint(HUMAN_ARMS))


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (LEAST + "mass = = 3\n", "line 14"),
        (LEAST + "duration = 2.0\n", "line 14"),
        ("[left\n", "line 1"),
        ("title = 'caf\xe9'".encode("latin-1"), "UTF-8"),
        (b"\x00\x01\x02\x03", "not valid TOML"),
        ("a = " + "[" * 20000, "nested"),
        ("a = " + "9" * 5000, "not valid TOML"),
    ],
    ids=["syntax", "twice", "bracket", "encoding", "binary", "nesting", "digits"],
)
def test_text_that_is_no_toml(tmp_path: Path, content: str | bytes, says: str) -> None:
    error = complaint(written(tmp_path, content))
    assert says in str(error)
    assert error.source is not None


def test_a_file_that_cannot_be_opened(tmp_path: Path) -> None:
    assert "cannot be read" in str(complaint(tmp_path / ("a" * 500 + ".toml")))
    complaint(Path("a\0b.toml"))


def test_an_empty_file_lacks_everything(tmp_path: Path) -> None:
    error = complaint(written(tmp_path, ""))
    assert error.key == "left"
    assert "is missing" in str(error)
    assert str(error).endswith("and 3 more")


# Values that cannot be meant

MISTAKES = [
    # Keys
    ("object.mas=1", "object.mas", "'object.mass'"),
    ("boundry.start.torque=free", "boundry", "'boundary'"),
    ("Task.duration=1", "Task", "'task'"),
    ("mass=3", "mass", "'object.mass'"),
    ("left.duration=3", "left.duration", "'task.duration'"),
    ("zzz=3", "zzz", "valid here: title, robot, left"),
    ("left.zzz=3", "left.zzz", "valid here: urdf, tip"),
    ("path=elsewhere.toml", "path", "unknown key"),
    ("left.'a.b'=3", "left.'a.b'", "unknown key"),
    # Missing
    ("task={duration=1.0}", "task.start", "and 1 more"),
    ("left={urdf='a.urdf'}", "left.tip", "frame that holds the object"),
    ("left={tip='hand'}", "left.urdf", "robot.urdf"),
    # Types
    ("object.mass=2kg", "object.mass", "must be a number"),
    ("object.mass=true", "object.mass", "must be a number"),
    ("object.mass='2'", "object.mass", "must be a number"),
    ("title=2", "title", "must be text"),
    ("title=2024-01-01", "title", "must be text"),
    ("left=3", "left", "must be a table"),
    ("robot.posture=[1.0]", "robot.posture", "must be a table"),
    ("left.posture=2", "left.posture", "must be a list"),
    ("left.posture=[1.0, 'a']", "left.posture[1]", "must be a number"),
    ("left.joints=shoulder", "left.joints", "must be a list"),
    ("left.joints=[1]", "left.joints[0]", "must be text"),
    ("left.tip=''", "left.tip", "is empty"),
    ("left.posture=[]", "left.posture", "is empty"),
    ("task.start.xyz=[1, 2]", "task.start.xyz", "too few"),
    ("task.start.xyz=[]", "task.start.xyz", "too few"),
    ("world.gravity=[1]", "world.gravity", "3 entries"),
    ("task.start.xyz=[1, 2, 3, 4]", "task.start.xyz", "too many"),
    ("task.start.xyz={x=1}", "task.start.xyz", "must be a list"),
    ("solver.max_nodes=2e3", "solver.max_nodes", "whole number"),
    ("solver.seed=true", "solver.seed", "whole number"),
    # Words
    ("criterion.kind=torqe", "criterion.kind", "did you mean 'torque'"),
    ("criterion.kind=3", "criterion.kind", "torque, jerk or mixed"),
    ("grasp.pair=revolut", "grasp.pair", "did you mean 'revolute'"),
    ("task.posture=goal", "task.posture", "free or start"),
    ("criterion.weights=units", "criterion.weights", "did you mean 'unit'"),
    ("criterion.weights=3", "criterion.weights", "one positive number per joint"),
    ("criterion.speed_cost=none", "criterion.speed_cost", "auto"),
    ("boundary.goal.torque=zeros", "boundary.goal.torque", "did you mean 'zero'"),
    ("boundary.goal.torque=0", "boundary.goal.torque", "one number in Nm per joint"),
    ("solver.method=magic", "solver.method", "collocation, shooting or spectral"),
    # Not finite
    ("object.mass=nan", "object.mass", "finite"),
    ("object.mass=1e400", "object.mass", "finite"),
    ("object.mass=" + "9" * 400, "object.mass", "finite"),
    ("task.start.xyz=[1, -inf, 0]", "task.start.xyz[1]", "finite"),
    ("boundary.start.torque=[1, nan]", "boundary.start.torque[1]", "finite"),
    # Range
    ("object.mass=-1", "object.mass", "at least 0"),
    ("task.duration=0", "task.duration", "greater than 0"),
    ("task.duration=-1.0", "task.duration", "greater than 0"),
    ("criterion.weights=[1, 0]", "criterion.weights[1]", "greater than 0"),
    ("criterion.speed_cost=-1", "criterion.speed_cost", "at least 0"),
    ("criterion.torque_share=2", "criterion.torque_share", "at most 1"),
    ("solver.tolerance=0", "solver.tolerance", "greater than 0"),
    ("solver.tolerance=1", "solver.tolerance", "at most 0.1"),
    ("solver.samples=5", "solver.samples", "at least 11"),
    ("solver.samples=99999999999999999999", "solver.samples", "at most 1000000"),
    ("grasp.axis=[0, 0, 0]", "grasp.axis", "no direction"),
    ("left.joints=['a', 'b', 'a']", "left.joints", "'a' twice"),
    ("left.joints=['a', 'b', 'c']", "left.posture", "2 angles for 3 joints"),
    # Units
    ("left.posture=[129, -94]", "left.posture[0]", "looks like degrees"),
    ("right.base.rpy=[0, 0, -180]", "right.base.rpy[2]", "looks like degrees"),
    ("task.goal.rpy=[0, 0, 90]", "task.goal.rpy[2]", "looks like degrees"),
    ("robot.posture.waist=90", "robot.posture.waist", "looks like degrees"),
    ("task.start.xyz=[100, 400, 0]", "task.start.xyz[1]", "looks like millimetres"),
    ("right.base.xyz=[450, 0, 0]", "right.base.xyz[0]", "looks like millimetres"),
    ("task.goal.velocity=[250, 0, 0]", "task.goal.velocity[0]", "looks like mm/s"),
    ("world.gravity=[0, 0, -9810]", "world.gravity[2]", "looks like mm/s^2"),
    ("task.duration=1500", "task.duration", "looks like milliseconds"),
    ("object.mass=200001", "object.mass", "looks like grams"),
]


@pytest.mark.parametrize(("setting", "key", "says"), MISTAKES, ids=[m[0][:40] for m in MISTAKES])
def test_a_mistake_gives_one_line_with_file_key_and_remedy(
    setting: str, key: str, says: str
) -> None:
    error = complaint(TRANSPORT, setting)
    assert error.key == key
    assert error.source == TRANSPORT
    assert str(error).startswith(f"{TRANSPORT}: {key}: ")
    assert says in str(error)


def test_an_unknown_key_comes_before_what_it_leaves_missing(tmp_path: Path) -> None:
    error = complaint(written(tmp_path, LEAST.replace('tip = "hand"\n[right]', "tp = 1\n[right]")))
    assert error.key == "left.tp"
    assert "did you mean 'left.tip'?" in str(error)
    assert "and 1 more" in str(error)


def test_numbers_too_long_to_print_are_not_printed() -> None:
    error = complaint(TRANSPORT, values={"object.mass": 10**6000})
    assert "finite" in str(error)
    assert len(str(complaint(TRANSPORT, "left.posture=" + str([0.1] * 999)[:-1] + ",9e9]"))) < 400


def test_limits_themselves_are_allowed() -> None:
    values = [
        "object.mass=0",
        "task.duration=1000",
        "solver.samples=11",
        "left.posture=[12.5, -12]",
    ]
    scenario = load(TRANSPORT, values)
    assert scenario.object.mass == 0.0
