"""The scenario: two arms, an object, a grasp, a task and a criterion, read from one TOML file.

Every key of the file is an attribute of the same name, with its default filled in. All values are
immutable; [Scenario.override][planner.scenario.Scenario.override] makes a changed copy.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import Field, PrivateAttr, ValidationError, model_validator

from planner.overrides import Overrides, apply_overrides, parse_override, read_toml, without_none
from planner.sections import (
    ArmSection,
    BoundaryEnd,
    BoundarySection,
    CriterionSection,
    GraspSection,
    ObjectSection,
    Placement,
    RobotSection,
    Section,
    SolverSection,
    TaskEnd,
    TaskSection,
    WorldSection,
)
from planner.wording import scenario_error

__all__ = [
    "ArmSection",
    "BoundaryEnd",
    "BoundarySection",
    "CriterionSection",
    "GraspSection",
    "ObjectSection",
    "Placement",
    "RobotSection",
    "Scenario",
    "SolverSection",
    "TaskEnd",
    "TaskSection",
    "WorldSection",
    "load",
    "parse_override",
]


class Scenario(Section):
    """Everything that a plan depends on. Made by [load][planner.scenario.load].

    Attributes:
        title: One line for people.
        robot: What both arms share, or None.
        left: The arm that carries the object in the equations.
        right: The other one.
        object: What they hold.
        grasp: The relative motion left to the hands.
        world: Gravity.
        task: From where, to where, how fast.
        criterion: What is minimised.
        boundary: Torques at the ends.
        solver: Settings of the solver.
    """

    title: str = ""
    robot: RobotSection | None = None
    left: ArmSection = Field(description="a [left] table with urdf and tip")
    right: ArmSection = Field(description="a [right] table with urdf and tip")
    object: ObjectSection = Field(description="an [object] table with urdf")
    grasp: GraspSection = GraspSection()
    world: WorldSection = WorldSection()
    task: TaskSection = Field(description="a [task] table with start.xyz, goal.xyz and duration")
    criterion: CriterionSection = CriterionSection()
    boundary: BoundarySection = BoundarySection()
    solver: SolverSection = SolverSection()

    _path: Path | None = PrivateAttr(default=None)

    @model_validator(mode="before")
    @classmethod
    def _arms_share_the_robot(cls, data: Any) -> Any:
        robot = data.get("robot") if isinstance(data, dict) else None
        urdf = robot.get("urdf") if isinstance(robot, dict) else None
        if urdf is None:
            return data
        arms = {s: data[s] for s in ("left", "right") if isinstance(data.get(s), dict)}
        return data | {side: {"urdf": urdf} | arm for side, arm in arms.items()}

    @property
    def path(self) -> Path | None:
        """The file that this scenario came from."""
        return self._path

    @property
    def directory(self) -> Path:
        """The folder to which relative paths refer."""
        return Path.cwd() if self._path is None else self._path.absolute().parent

    def locate(self, name: str) -> str:
        """Absolute path of a file that the scenario names; `package://...` stays as it is."""
        if "://" in name:
            return name
        return os.path.normpath(self.directory / Path(name).expanduser())

    def override(self, values: Overrides) -> Scenario:
        """A copy with other values, validated again.

        Args:
            values: New value for each dotted key, e.g. `{"object.mass": 8}`. A table is replaced
                as a whole; None goes back to the default. A preload replaces the torque at that
                end, and a torque the preload.

        Raises:
            ScenarioError: A key does not exist or a value is not valid.
        """
        tree = self.model_dump(exclude_unset=True)
        shared = self.robot.urdf if self.robot else None
        for side in ("left", "right"):
            if tree[side]["urdf"] == shared:  # filled in from there, to be filled in again
                del tree[side]["urdf"]
        return _validated(tree, self._path, values)

    def resolved(self) -> dict[str, Any]:
        """Every value with its default, as plain data for JSON, the paths absolute."""
        tree = self.model_dump(mode="json")
        for section in filter(None, (tree[name] for name in ("robot", "left", "right", "object"))):
            if section["urdf"] is not None:
                section["urdf"] = self.locate(section["urdf"])
        if tree["robot"]:
            tree["robot"]["packages"] = [self.locate(name) for name in tree["robot"]["packages"]]
        return tree

    @classmethod
    def from_resolved(cls, data: Mapping[str, Any], source: Path | None = None) -> Scenario:
        """The inverse of [resolved][planner.scenario.Scenario.resolved].

        Args:
            data: What that gave, perhaps written to a file and read again.
            source: That file, named in errors.

        Raises:
            ScenarioError: The data is no valid scenario.
        """
        return _validated(without_none(data), None, {}, source)


def load(path: str | Path, overrides: Sequence[str] | Overrides = ()) -> Scenario:
    """Reads a scenario from a TOML file.

    Args:
        path: The file.
        overrides: Values set over the file's: texts such as "object.mass=8", or the mapping that
            [Scenario.override][planner.scenario.Scenario.override] takes.

    Raises:
        ScenarioError: The file cannot be read, or the scenario is not valid.
    """
    path = Path(path)
    if isinstance(overrides, str):
        overrides = (overrides,)
    if not isinstance(overrides, Mapping):
        overrides = dict(parse_override(text) for text in overrides)
    return _validated(read_toml(path), path, overrides)


def _validated(
    tree: dict[str, Any],
    path: Path | None,
    overrides: Overrides,
    source: Path | None = None,
) -> Scenario:
    source = source or path
    tree = apply_overrides(tree, overrides, source)
    try:
        scenario = Scenario.model_validate(tree)
    except ValidationError as error:
        raise scenario_error(Scenario, error, source) from None
    scenario._path = path
    return scenario
