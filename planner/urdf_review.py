"""A second opinion on one URDF file: what yourdfpy reads from it, and what it finds wrong."""

from __future__ import annotations

import io
import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from planner.errors import ModelError
from planner.urdf import package_directories, read_urdf

MOST_DOUBTS = 12  # of one file: a humanoid has dozens of sensors with odd inertias


@dataclass(frozen=True)
class Review:
    """What a URDF file holds.

    Attributes:
        path: The file.
        masses: Mass of every link that has one [kg].
        joint_types: Type of every joint.
        parents: For every link but the root, the joint that carries it and that joint's parent.
        problems: What makes the file unusable.
        doubts: What should be looked at.
    """

    path: Path
    masses: dict[str, float] = field(default_factory=dict)
    joint_types: dict[str, str] = field(default_factory=dict)
    parents: dict[str, tuple[str, str]] = field(default_factory=dict)
    problems: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def carried_by(self, joints: Sequence[str]) -> dict[str, float]:
        """Returns the masses [kg] of the links that at least one of some joints moves."""
        return {
            link: mass
            for link, mass in self.masses.items()
            if not set(self.ancestors(link)).isdisjoint(joints)
        }

    def ancestors(self, link: str) -> list[str]:
        """Returns the joints between the root and a link, the last one first."""
        names: list[str] = []
        while link in self.parents and len(names) <= len(self.parents):
            joint, link = self.parents[link]
            names.append(joint)
        return names


def review_urdf(path: Path, packages: Sequence[str], directory: Path) -> Review:
    """Returns what yourdfpy makes of a URDF file, meshes not loaded.

    It goes on where `read_urdf` stops, so that one look names every link at fault.

    Args:
        path: The file, which exists.
        packages: The scenario's folders in which `package://` is looked up.
        directory: Folder of the scenario.
    """
    problems: list[str] = []
    doubts: list[str] = []
    refused: str | None = None
    try:
        doubts += [f"{path}: {doubt}" for doubt in read_urdf(path).doubts]
    except ModelError as error:
        problems.append(str(error))
        refused = error.key
        if not _is_harmless(path):
            return Review(path, problems=tuple(problems))
    try:
        robot = _parse(path)
    except Exception as error:  # whatever yourdfpy stumbles over: it has no errors of its own
        if not problems:
            text = " ".join(f"{type(error).__name__} {error}".split())
            doubts.append(f"{path}: yourdfpy cannot read it: {text}")
        return Review(path, problems=tuple(problems), doubts=tuple(doubts))
    problems += [
        f"{path}: {link}: link with mass but no inertia (got {mass:g}); add "
        '<inertia ixx="..." .../> about its centre of mass'
        for link, mass in _without_inertia(robot)
        if link != refused
    ]
    doubts += [f"{path}: {text}" for text in _invalid(robot)]
    doubts += [f"{path}: {text}" for text in _empty_ranges(robot)]
    folders = package_directories(packages, directory)
    doubts += [f"{path}: {text}" for text in _missing_meshes(robot, path.parent, folders)]
    if len(doubts) > MOST_DOUBTS:
        doubts[MOST_DOUBTS:] = [f"{path}: and {len(doubts) - MOST_DOUBTS} more"]
    return Review(
        path=path,
        masses={
            link.name: float(link.inertial.mass)
            for link in robot.links
            if link.inertial is not None and link.inertial.mass
        },
        joint_types={joint.name: joint.type for joint in robot.joints},
        parents={joint.child: (joint.name, joint.parent) for joint in robot.joints},
        problems=tuple(problems),
        doubts=tuple(doubts),
    )


def _is_harmless(path: Path) -> bool:
    """Returns whether a file that was refused may be parsed again: it declares no entities."""
    try:
        content = path.read_bytes()
    except OSError:
        return False
    # zero bytes: a wide encoding, in which a declaration would not be seen
    return not any(mark in content for mark in (b"<!DOCTYPE", b"<!ENTITY", b"\0"))


def _parse(path: Path) -> Any:
    """Returns yourdfpy's robot."""
    import yourdfpy

    logger = logging.getLogger("yourdfpy.urdf")
    before, logger.disabled = logger.disabled, True  # what it logs is reported here
    try:
        model = yourdfpy.URDF.load(
            io.BytesIO(path.read_bytes()),
            build_scene_graph=False,
            load_meshes=False,
            load_collision_meshes=False,
        )
    finally:
        logger.disabled = before
    return model.robot


def _without_inertia(robot: Any) -> list[tuple[str, float]]:
    return [
        (link.name, float(link.inertial.mass))
        for link in robot.links
        if link.inertial is not None and link.inertial.mass and link.inertial.inertia is None
    ]


def _invalid(robot: Any) -> list[str]:
    """Returns what yourdfpy's validation finds, with the link or joint in front.

    Its own messages name none, so every link and joint is validated as a robot of its own.
    """
    import yourdfpy

    def errors(**parts: Any) -> list[str]:
        model = yourdfpy.URDF(
            robot=yourdfpy.Robot(name=robot.name or "", **parts),
            build_scene_graph=False,
            load_meshes=False,
        )
        model.validate()
        return [" ".join(str(error).split()) for error in model.errors]

    found = errors()
    for kind, parts in (("link", robot.links), ("joint", robot.joints)):
        for part in parts:
            here = [text for text in errors(**{f"{kind}s": [part]}) if text not in found]
            found += [f"{kind} {part.name}: {text}" for text in dict.fromkeys(here)]
    return found


def _empty_ranges(robot: Any) -> list[str]:
    texts = []
    for joint in robot.joints:
        if joint.limit is not None and joint.type in ("revolute", "prismatic"):
            lower, upper = joint.limit.lower or 0.0, joint.limit.upper or 0.0
            if lower >= upper:
                texts.append(f"joint {joint.name}: its range {lower:g} to {upper:g} is empty")
    return texts


def _missing_meshes(robot: Any, beside: Path, folders: Sequence[Path]) -> list[str]:
    """Returns a line for each link whose meshes are not there; planning does without them."""
    texts = []
    for link in robot.links:
        geometries = [shape.geometry for shape in (*link.visuals, *link.collisions)]
        names = [g.mesh.filename for g in geometries if g is not None and g.mesh is not None]
        missing = [name for name in dict.fromkeys(names) if not _exists(name, beside, folders)]
        if missing:
            texts.append(f"link {link.name}: no mesh file {', '.join(missing)} (only for drawing)")
    return texts


def _exists(name: str, beside: Path, folders: Sequence[Path]) -> bool:
    rest = name.removeprefix("package://")
    if rest != name:
        return any((folder / rest).is_file() for folder in (beside, *folders))
    return (beside / name.removeprefix("file://")).is_file()
