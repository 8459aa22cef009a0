"""Masses and inertias of a URDF: what no body can have is refused, what is odd is told."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

from planner.errors import ModelError

_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_NEGLIGIBLE = 1e-6
_ROUND_OFF = 1e-15


def finite_numbers(text: str, path: Path, key: str) -> list[float]:
    """Returns the numbers in an attribute's text.

    Raises:
        ModelError: They are no finite numbers.
    """
    try:
        # float() would also take 1_000, at which Pinocchio drops the whole element in silence
        numbers = [math.nan if "_" in part else float(part) for part in text.split()]
    except ValueError:
        numbers = [math.nan]
    if not numbers or not all(map(math.isfinite, numbers)):
        raise ModelError(
            "is not a finite number", source=path, key=key, value=text, remedy="write numbers"
        )
    return numbers


def _single(element: ElementTree.Element, attribute: str, path: Path, key: str) -> float:
    text = element.get(attribute, "")
    numbers = finite_numbers(text, path, key)
    if len(numbers) > 1:  # Pinocchio would drop the whole element in silence
        raise ModelError(
            "is more than one number", source=path, key=key, value=text, remedy="write one"
        )
    return numbers[0]


def check_inertial(link: ElementTree.Element, path: Path) -> list[str]:
    """Refuses masses and inertias that no body can have; returns doubts about the others."""
    name = link.get("name", "")
    inertial = link.find("inertial")
    if inertial is None:
        return []
    mass_element, inertia_element = inertial.find("mass"), inertial.find("inertia")
    if mass_element is None or mass_element.get("value") is None:
        raise ModelError(
            "inertial without a mass", source=path, key=name, remedy='add <mass value="..."/>'
        )
    mass = _single(mass_element, "value", path, f"{name} mass")
    if mass < 0.0:
        raise ModelError(
            "negative mass", source=path, key=name, value=mass, remedy="a mass is zero or more, kg"
        )
    if inertia_element is None:
        if mass > 0.0:
            raise ModelError(
                "link with mass but no inertia",
                source=path,
                key=name,
                value=mass,
                remedy='add <inertia ixx="..." .../> about its centre of mass',
            )
        ElementTree.SubElement(inertial, "inertia", dict.fromkeys(_MOMENTS, "0"))
        return []
    absent = [entry for entry in _MOMENTS if inertia_element.get(entry) is None]
    if absent:  # Pinocchio would leave the whole inertia out
        raise ModelError(
            f"inertia without {', '.join(absent)}", source=path, key=name, remedy="give all six"
        )
    ixx, ixy, ixz, iyy, iyz, izz = (
        _single(inertia_element, entry, path, f"{name} inertia {entry}") for entry in _MOMENTS
    )
    inertia = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    moments = np.linalg.eigvalsh(inertia)
    if moments[0] < -_NEGLIGIBLE:
        raise ModelError(
            "inertia is not positive",
            source=path,
            key=name,
            value=[float(f"{moment:.4g}") for moment in moments],
            remedy="its principal moments must be zero or more, kg m^2",
        )
    doubts = []
    if moments[0] < -_ROUND_OFF:
        doubts.append(f"link {name}: a principal moment is negative, {moments[0]:.4g} kg m^2")
    elif moments[0] + moments[1] < moments[2] * (1.0 - 1e-6) - _ROUND_OFF:
        doubts.append(
            f"link {name}: principal moments {moments[0]:.4g}, {moments[1]:.4g}, {moments[2]:.4g} "
            "kg m^2 break the triangle inequality: no rigid body has them"
        )
    if mass > 0.0 and moments[2] <= _ROUND_OFF:
        doubts.append(f"link {name}: {mass:g} kg but zero inertia (fine for a point mass)")
    if mass == 0.0 and moments[2] > _ROUND_OFF:
        doubts.append(f"link {name}: inertia but no mass")
    return doubts
