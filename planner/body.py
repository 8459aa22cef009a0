"""The object that both arms hold."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from planner.arm import read_shapes
from planner.errors import ModelError
from planner.urdf import Urdf, find_urdf, package_directories, read_urdf
from planner.urdf_joints import parser_messages

if TYPE_CHECKING:
    from planner.scenario import Scenario


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body, or a point mass.

    Attributes:
        mass: [kg].
        com: Centre of mass in the object's frame, (3,) [m].
        inertia: About the centre of mass, in the object's axes, (3, 3) [kg m^2].
        urdf: The file.
    """

    mass: float
    com: np.ndarray
    inertia: np.ndarray
    urdf: Urdf

    def as_inertia(self) -> pin.Inertia:
        """Returns the body's spatial inertia in the object's frame."""
        return pin.Inertia(self.mass, self.com, self.inertia)


def object_path(scenario: Scenario) -> Path:
    """Returns the object's URDF file.

    Raises:
        ModelError: There is no such file.
    """
    packages = scenario.robot.packages if scenario.robot else []
    return find_urdf(scenario.object.urdf, "object.urdf", scenario.directory, packages)


def read_object(scenario: Scenario) -> Body:
    """Returns the object: all links of its URDF as one rigid body.

    A mass in the scenario overrides the URDF's and scales its inertia along.

    Raises:
        ModelError: The URDF cannot be used, or has joints that move.
    """
    urdf = read_urdf(object_path(scenario))
    try:
        with parser_messages() as said:
            model = pin.buildModelFromXML(urdf.text, pin.JointModelFreeFlyer())
    except (ValueError, RuntimeError) as error:
        reason = ", ".join(said) or str(error)
        raise ModelError(
            f"Pinocchio cannot read it: {reason}", source=urdf.path, remedy="mend the URDF"
        ) from None
    if model.njoints > 2:  # after the world and the joint that lets it float
        raise ModelError(
            "the object has joints that move",
            source=urdf.path,
            value=list(model.names)[2:],
            remedy="make them fixed: the object is one rigid body",
        )
    whole = model.inertias[1]
    mass, com, inertia = float(whole.mass), np.array(whole.lever), np.array(whole.inertia)
    if scenario.object.mass is not None:
        if mass > 0.0:
            inertia = inertia * (scenario.object.mass / mass)
        mass = scenario.object.mass
    return Body(mass, com, inertia, urdf)


def read_object_visuals(scenario: Scenario) -> pin.GeometryModel:
    """Returns the object's visual geometry, placed in the object's frame."""
    urdf = read_urdf(object_path(scenario))
    packages = scenario.robot.packages if scenario.robot else []
    folders = [urdf.path.parent, *package_directories(packages, scenario.directory)]
    model = pin.buildModelFromXML(urdf.text)
    return read_shapes(model, urdf, folders)
