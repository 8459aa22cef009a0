"""The tables of a scenario file, one class each.

Every key of the file is an attribute of the same name; what a key may hold is said here once,
and `description` is what an error on that key recommends.
"""

from __future__ import annotations

from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from planner.quantities import (
    Acceleration3,
    Angle,
    Angle3,
    Cost,
    Count,
    Duration,
    Length3,
    Mass,
    Numbers,
    Positive,
    Real3,
    Share,
    Speed3,
    Text,
    Weights,
    WordOr,
)

_ZERO3 = (0.0, 0.0, 0.0)
_INTERNAL = ("internal_force", "internal_moment")


class Section(BaseModel):
    """A table of the file: immutable, and without keys of its own invention."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Placement(Section):
    """Where a frame is in another one.

    Attributes:
        xyz: Position [m].
        rpy: Fixed-axis roll, pitch and yaw [rad].
    """

    xyz: Length3 = _ZERO3
    rpy: Angle3 = _ZERO3


class RobotSection(Section):
    """What both arms share when they are parts of one robot.

    Attributes:
        urdf: The robot's URDF, the default of `left.urdf` and `right.urdf`.
        posture: Angles at which joints are locked that belong to neither arm [rad].
        packages: More folders in which `package://` is looked up.
    """

    urdf: Text | None = None
    posture: dict[str, Angle] = {}
    packages: tuple[Text, ...] = ()


class ArmSection(Section):
    """One arm and how it holds the object.

    Attributes:
        urdf: Path relative to the scenario's file, or `package://...`.
        tip: Frame of the URDF that holds the object.
        joints: The arm's joints, from base to tip; None for all that the URDF has.
        base: The arm's base in the world.
        posture: Seed of inverse kinematics, one angle per joint [rad]; None for the neutral one.
        grasp: The hand's frame on the object.
    """

    urdf: Text = Field(description="the arm's URDF file here, or in robot.urdf for both arms")
    tip: Text = Field(description="the name of the URDF frame that holds the object")
    joints: tuple[Text, ...] | None = Field(default=None, min_length=1)
    base: Placement = Placement()
    posture: tuple[Angle, ...] | None = Field(default=None, min_length=1)
    grasp: Placement = Placement()

    @model_validator(mode="after")
    def _joints_fit(self) -> Self:
        if self.joints is None:
            return self
        repeated = {name for name in self.joints if self.joints.count(name) > 1}
        if repeated:
            raise PydanticCustomError(
                "at:joints",
                "names {name} twice",
                {"name": repr(min(repeated)), "remedy": "name each joint once"},
            )
        if self.posture is not None and len(self.posture) != len(self.joints):
            raise PydanticCustomError(
                "at:posture",
                "has {got} angles for {need} joints",
                {
                    "got": len(self.posture),
                    "need": len(self.joints),
                    "remedy": "give one angle per joint",
                },
            )
        return self


class ObjectSection(Section):
    """The object that both hands hold.

    Attributes:
        urdf: Path relative to the scenario's file, or `package://...`.
        mass: Replaces the mass in the URDF [kg]; None to keep that one.
    """

    urdf: Text = Field(description="the object's URDF file")
    mass: Mass | None = None


class GraspSection(Section):
    """What relative motion the grasp leaves to the two hands.

    Attributes:
        pair: The kinematic pair between the hands.
        axis: Direction of the pair's axis in the right hand's grasp frame, of any length.
    """

    pair: Literal["revolute", "spherical", "cylindrical", "prismatic", "planar", "rigid"] = (
        "revolute"
    )
    axis: Real3 = (0.0, 0.0, 1.0)

    @field_validator("axis")
    @classmethod
    def _axis_has_direction(cls, axis: tuple[float, float, float]) -> tuple[float, float, float]:
        if not any(axis):
            raise PydanticCustomError(
                "axis", "has no direction", {"remedy": "give a nonzero vector"}
            )
        return axis


class WorldSection(Section):
    """What is around the arms.

    Attributes:
        gravity: Acceleration of free fall in the world [m/s^2].
    """

    gravity: Acceleration3 = _ZERO3


class TaskEnd(Section):
    """The object at the start or at the goal.

    Attributes:
        xyz: Position [m].
        rpy: Orientation as roll, pitch and yaw [rad]; None to leave it free.
        velocity: Velocity [m/s].
    """

    xyz: Length3 = Field(description="the object's position, three numbers in m")
    rpy: Angle3 | None = None
    velocity: Speed3 = _ZERO3


class TaskSection(Section):
    """What is to be done.

    Attributes:
        start: The object at time 0.
        goal: The object at the end.
        duration: Time from start to goal [s].
        posture: Whether redundant arms start in any posture or in the given one.
    """

    start: TaskEnd = Field(description="where the object starts, e.g. start.xyz = [0.1, 0.4, 0.0]")
    goal: TaskEnd = Field(description="where the object ends, e.g. goal.xyz = [0.4, 0.3, 0.0]")
    duration: Duration = Field(description="the time from start to goal, in s")
    posture: Literal["free", "start"] = "free"


class CriterionSection(Section):
    """What the motion minimises.

    Attributes:
        kind: The quantity whose weighted square is integrated.
        weights: A rule, or one positive number per joint, left arm first.
        torque_share: Share of the torque term, 0 to 1, where `kind` is "mixed".
        speed_cost: Weight of the squared joint speeds, which regularises redundant arms.
        posture_cost: Weight of the squared distance from the given posture.
    """

    kind: Literal["torque-change", "torque", "jerk", "mixed"] = "torque-change"
    weights: WordOr[Literal["auto", "unit", "effort"], Weights] = Field(
        default="auto", description="auto, unit, effort, or a list of one positive number per joint"
    )
    torque_share: Share = 0.5
    speed_cost: WordOr[Literal["auto"], Cost] = Field(
        default="auto", description="auto, or a number of at least 0"
    )
    posture_cost: Cost = 0.0


class BoundaryEnd(Section):
    """Torques at one end: either prescribed by `torque`, or those of a preload.

    Attributes:
        torque: A rule, or one number per joint, left arm first [Nm]; None where a preload is given.
        internal_force: Hand forces' difference, left - right, on the object at rest [N].
        internal_moment: Likewise for moments about the object's frame [Nm].
    """

    torque: WordOr[Literal["zero", "free", "static", "rest"], Numbers] | None = Field(
        default="zero",
        description="zero, free, static, rest, or a list of one number in Nm per joint",
    )
    internal_force: Real3 | None = None
    internal_moment: Real3 | None = None

    @model_validator(mode="before")
    @classmethod
    def _torque_or_preload(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        preload = [name for name in _INTERNAL if data.get(name) is not None]
        if not preload:
            return data
        if data.get("torque") is not None:
            raise PydanticCustomError(
                "twice",
                "has both torque and {name}",
                {"name": preload[0], "remedy": "a preload sets the torques: give one of the two"},
            )
        return data | {"torque": None}


class BoundarySection(Section):
    """The torques at both ends, where they are a state.

    Attributes:
        start: Torques at time 0.
        goal: Torques at the end.
    """

    start: BoundaryEnd = BoundaryEnd()
    goal: BoundaryEnd = BoundaryEnd()


class SolverSection(Section):
    """How the problem is solved.

    Attributes:
        method: The solver.
        tolerance: Relative residual that is accepted.
        max_nodes: Largest mesh.
        samples: Number of times at which the plan is written.
        starts: Number of initial guesses that are tried.
        seed: Seed of the random part of the initial guesses.
        start: Kind of the initial guess.
    """

    method: Literal["collocation", "shooting", "spectral"] = "collocation"
    tolerance: Positive = Field(default=1e-4, le=0.1)
    max_nodes: Count = Field(default=2000, ge=10)
    samples: Count = Field(default=501, ge=11)
    starts: Count = Field(default=1, ge=1)
    seed: Count = Field(default=0, ge=0)
    start: Literal["auto", "line", "spectral"] = "auto"
