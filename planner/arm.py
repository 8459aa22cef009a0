"""One arm read from URDF into a Pinocchio model, its other joints locked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import pinocchio as pin

from planner.errors import ModelError
from planner.urdf import Urdf, find_urdf, package_directories, read_urdf
from planner.urdf_joints import parser_messages

if TYPE_CHECKING:
    from planner.scenario import Scenario

Side = Literal["left", "right"]


@dataclass(frozen=True, eq=False)
class Arm:
    """One arm, its base placed in the world.

    Attributes:
        side: Which of the two.
        model: Pinocchio model of the arm's n moving joints alone, one coordinate each.
        tip: Name of the frame that holds the object.
        tip_joint: Index in `model` of the joint that carries the tip.
        tip_placement: Tip in that joint's frame.
        joint_names: Names of the joints, as in the URDF.
        posture: Posture that seeds inverse kinematics, (n,) [rad, m]; None if not given.
        lower: Lower joint limits, (n,) [rad, m]; -inf where there is none.
        upper: Upper joint limits, (n,) [rad, m].
        velocity_limit: (n,) [rad/s, m/s]; inf where there is none.
        effort_limit: (n,) [Nm, N]; inf where there is none.
        locked: Names of the joints that are locked.
        urdf: The file.
    """

    side: Side
    model: pin.Model
    tip: str
    tip_joint: int
    tip_placement: pin.SE3
    joint_names: tuple[str, ...]
    posture: np.ndarray | None
    lower: np.ndarray
    upper: np.ndarray
    velocity_limit: np.ndarray
    effort_limit: np.ndarray
    locked: tuple[str, ...]
    urdf: Urdf

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.model.nv)


@dataclass(frozen=True, eq=False)
class _Chosen:
    """The full model of a URDF and which of its joints belong to one arm."""

    urdf: Urdf
    full: pin.Model
    moving: tuple[int, ...]
    reference: np.ndarray

    @property
    def locked(self) -> list[int]:
        return [joint for joint in range(1, self.full.njoints) if joint not in self.moving]


def urdf_path(scenario: Scenario, side: Side) -> Path:
    """Returns the arm's URDF file.

    Raises:
        ModelError: There is no such file.
    """
    packages = scenario.robot.packages if scenario.robot else []
    return find_urdf(getattr(scenario, side).urdf, f"{side}.urdf", scenario.directory, packages)


def base_placement(scenario: Scenario, side: Side) -> pin.SE3:
    """Returns the placement of the URDF's root link in the world."""
    base = getattr(scenario, side).base
    return pin.SE3(pin.rpy.rpyToMatrix(*base.rpy), np.array(base.xyz, dtype=float))


def read_arm(scenario: Scenario, side: Side) -> Arm:
    """Returns one arm of the scenario.

    Raises:
        ModelError: The URDF cannot be used, or the scenario names a tip, joints or a posture that
            do not fit it.
    """
    section = getattr(scenario, side)
    chosen = _choose_joints(scenario, side)
    reduced = pin.buildReducedModel(chosen.full, chosen.locked, chosen.reference)
    model = pin.appendModel(pin.Model(), reduced, 0, base_placement(scenario, side))
    model.name = side
    tip = _find_frame(model, section.tip)
    assert tip is not None
    names = tuple(model.names[joint] for joint in range(1, model.njoints))
    without_limits = np.array([name in chosen.urdf.unlimited for name in names])
    velocity, effort = np.abs(model.upperVelocityLimit), np.abs(model.upperEffortLimit)
    return Arm(
        side=side,
        model=model,
        tip=section.tip,
        tip_joint=int(tip.parentJoint),
        tip_placement=pin.SE3(tip.placement),
        joint_names=names,
        posture=_posture(section, side, names, chosen.urdf),
        lower=np.where(without_limits, -np.inf, model.lowerPositionLimit),
        upper=np.where(without_limits, np.inf, model.upperPositionLimit),
        velocity_limit=np.where(velocity > 0.0, velocity, np.inf),
        effort_limit=np.where(effort > 0.0, effort, np.inf),
        locked=tuple(chosen.full.names[joint] for joint in chosen.locked),
        urdf=chosen.urdf,
    )


def read_visuals(scenario: Scenario, side: Side) -> tuple[pin.Model, pin.GeometryModel]:
    """Returns the arm's model and its visual geometry.

    Where both arms stand in one URDF at one place, the links that belong to the right arm go with
    it and all the others with the left, so that none is drawn twice.
    """
    chosen = _choose_joints(scenario, side)
    packages = scenario.robot.packages if scenario.robot else []
    folders = [chosen.urdf.path.parent, *package_directories(packages, scenario.directory)]
    geometry = read_shapes(chosen.full, chosen.urdf, folders)
    if _is_shared(scenario):
        right = set(_choose_joints(scenario, "right").moving)
        # copies: removing shifts what the vector's own elements refer to
        for shape in [pin.GeometryObject(shape) for shape in geometry.geometryObjects]:
            of_right = any(joint in right for joint in chosen.full.supports[shape.parentJoint])
            if of_right != (side == "right"):
                geometry.removeGeometryObject(shape.name)
    model, geometries = pin.buildReducedModel(
        chosen.full, [geometry], chosen.locked, chosen.reference
    )
    placed = pin.appendModel(
        pin.Model(),
        model,
        pin.GeometryModel(),
        geometries[0],
        0,
        base_placement(scenario, side),
    )
    return placed[0], placed[1]


def read_shapes(model: pin.Model, urdf: Urdf, folders: Sequence[Path]) -> pin.GeometryModel:
    """Returns the visual geometry of a URDF.

    Raises:
        ModelError: A mesh is not there or cannot be read.
    """
    try:
        with parser_messages():
            return pin.buildGeomFromUrdfString(
                model,
                urdf.text,
                pin.GeometryType.VISUAL,
                package_dirs=[str(folder) for folder in folders],
            )
    except (ValueError, RuntimeError) as error:
        raise ModelError(
            f"its shapes cannot be drawn: {error}",
            source=urdf.path,
            remedy="mend the file name, or name the folder of its package in robot.packages",
        ) from None


def _is_shared(scenario: Scenario) -> bool:
    same_place = scenario.left.base == scenario.right.base
    return same_place and urdf_path(scenario, "left") == urdf_path(scenario, "right")


def _choose_joints(scenario: Scenario, side: Side) -> _Chosen:
    section = getattr(scenario, side)
    urdf = read_urdf(urdf_path(scenario, side))
    full = _full_model(urdf)
    tip = _tip_joint(full, section.tip, side, urdf)
    chain = [int(joint) for joint in full.supports[tip] if joint != 0]
    if section.joints is None:
        moving = chain
    else:
        moving = []
        for name in section.joints:
            joint = full.getJointId(name) if full.existJointName(name) else None
            if joint not in chain:
                raise ModelError(
                    "no joint of this name moves the tip",
                    source=urdf.path,
                    key=f"{side}.joints",
                    value=name,
                    remedy=f"choose among {[full.names[j] for j in chain]}",
                )
            moving.append(joint)
    if not moving:
        raise ModelError(
            "no joint moves the tip",
            source=urdf.path,
            key=f"{side}.tip",
            value=section.tip,
            remedy="name a frame beyond at least one joint",
        )
    for joint in moving:
        if full.joints[joint].nq != 1:
            raise ModelError(
                "joint of a type that is not supported",
                source=urdf.path,
                key=full.names[joint],
                value=full.joints[joint].shortname(),
                remedy="use revolute, continuous or prismatic joints, or lock it by "
                f"leaving it out of {side}.joints",
            )
    return _Chosen(urdf, full, tuple(sorted(moving)), _locked_posture(scenario, full, urdf))


def _full_model(urdf: Urdf) -> pin.Model:
    try:
        with parser_messages() as said:
            model = pin.buildModelFromXML(urdf.text)
    except (ValueError, RuntimeError) as error:
        reason = ", ".join(said) or str(error)
        raise ModelError(
            f"Pinocchio cannot read it: {reason}", source=urdf.path, remedy="mend the URDF"
        ) from None
    # Pinocchio looks frames up by name alone, where joints and links may share one
    links = set(urdf.links)
    for frame in model.frames:
        if frame.type != pin.FrameType.BODY and frame.name in links:
            frame.name = f"{frame.name} (joint)"
    return model


def _tip_joint(full: pin.Model, tip: str, side: Side, urdf: Urdf) -> int:
    frame = _find_frame(full, tip)
    if frame is None:
        raise ModelError(
            "no such frame",
            source=urdf.path,
            key=f"{side}.tip",
            value=tip,
            remedy=f"choose among the links {_shorten(urdf.links)}",
        )
    return int(frame.parentJoint)


def _find_frame(model: pin.Model, name: str) -> pin.Frame | None:
    """Returns the frame of this name; where a joint has the name too, the link's."""
    named = [frame for frame in model.frames if frame.name == name]
    links = [frame for frame in named if frame.type == pin.FrameType.BODY]
    return next(iter([*links, *named]), None)


def _shorten(names: tuple[str, ...]) -> str:
    return ", ".join(names if len(names) <= 12 else [*names[:4], "...", *names[-8:]])


def _locked_posture(scenario: Scenario, full: pin.Model, urdf: Urdf) -> np.ndarray:
    """Returns the full configuration that the locked joints keep: given, or zero within limits."""
    posture = np.clip(pin.neutral(full), full.lowerPositionLimit, full.upperPositionLimit)
    given = scenario.robot.posture if scenario.robot else {}
    for name, value in given.items():
        if full.existJointName(name):
            joint = full.joints[full.getJointId(name)]
            if joint.nq == 1:
                posture[joint.idx_q] = value
        elif not any(
            name in read_urdf(urdf_path(scenario, other)).joints for other in ("left", "right")
        ):
            raise ModelError(
                "no such joint",
                source=urdf.path,
                key=f"robot.posture.{name}",
                remedy=f"choose among {_shorten(urdf.joints)}",
            )
    return posture


def _posture(section, side: Side, names: tuple[str, ...], urdf: Urdf) -> np.ndarray | None:  # type: ignore[no-untyped-def]
    if section.posture is None:
        return None
    if len(section.posture) != len(names):
        raise ModelError(
            f"has {len(section.posture)} angles for {len(names)} joints",
            source=urdf.path,
            key=f"{side}.posture",
            value=list(section.posture),
            remedy=f"give one angle per joint: {', '.join(names)}",
        )
    listed = section.joints or list(names)
    by_name = dict(zip(listed, section.posture, strict=True))
    return np.array([by_name[name] for name in names])
