"""URDF files: where they are, whether they can be trusted, and their text for Pinocchio."""

from __future__ import annotations

import math
import os
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from planner.errors import ModelError
from planner.urdf_inertia import check_inertial, finite_numbers
from planner.urdf_joints import check_joints

MAX_BYTES = 64 * 2**20
MOVING_TYPES = ("revolute", "continuous", "prismatic")
# moments of inertia that matter to no motion [kg m^2]: negative ones down to the first come from
# drawing programs (antennas, screws), any down to the second are round-off


@dataclass(frozen=True)
class Urdf:
    """A URDF file that was read and checked.

    Attributes:
        path: The file.
        text: Its text as handed to Pinocchio: joints without limits (`continuous`) are written
            as `revolute`, so that every joint has one coordinate.
        unlimited: Names of those joints.
        links: Names of the links.
        joints: Names of the joints that move.
        doubts: Remarks for whoever checks the file; none of them prevents its use.
    """

    path: Path
    text: str
    unlimited: frozenset[str]
    links: tuple[str, ...]
    joints: tuple[str, ...]
    doubts: tuple[str, ...]


def package_directories(extra: Sequence[str], directory: Path) -> list[Path]:
    """Returns the folders in which `package://NAME/...` is looked up, first match wins.

    Args:
        extra: Folders that the scenario names, relative to `directory`.
        directory: Folder of the scenario.
    """
    folders = [directory / folder for folder in extra]
    for variable, suffix in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")):
        folders += [
            Path(part) / suffix for part in os.environ.get(variable, "").split(os.pathsep) if part
        ]
    for entry in [*sys.path, sys.prefix]:
        for share in (Path(entry) / "cmeel.prefix" / "share", Path(entry) / "share"):
            folders += [share, share / "example-robot-data" / "robots"]
    unique = dict.fromkeys(folder for folder in folders if folder.is_dir())
    return list(unique)


def find_urdf(name: str, key: str, directory: Path, packages: Sequence[str]) -> Path:
    """Returns the path that a scenario's `urdf` entry stands for.

    Args:
        name: A path relative to `directory`, an absolute one, or `package://NAME/...`.
        key: Dotted key of the entry, for the message.
        directory: Folder of the scenario.
        packages: Extra folders to look packages up in.

    Raises:
        ModelError: There is no such file.
    """
    if name.startswith("package://"):
        rest = name.removeprefix("package://")
        folders = package_directories(packages, directory)
        for folder in folders:
            # a package folder may be named itself instead of its parent
            for candidate in (folder / rest, folder.parent / rest):
                if candidate.is_file():
                    return candidate
        package = rest.split("/", 1)[0]
        raise ModelError(
            "no such file in any package folder",
            key=key,
            value=name,
            remedy=f"install the package {package!r} (example-robot-data: pip install "
            "'dual-arm-planner[robots]'), or name its parent folder in robot.packages "
            "or ROS_PACKAGE_PATH",
        )
    path = directory / name
    if not path.is_file():
        raise ModelError(
            "is a folder, not a file" if path.is_dir() else "no such file",
            source=path,
            key=key,
            remedy="name a URDF file, relative to the scenario",
        )
    return path


def read_urdf(path: Path) -> Urdf:
    """Returns a URDF file's text, checked for what Pinocchio would accept in silence.

    Raises:
        ModelError: The file cannot be read, is no URDF, declares entities, or holds a mass or
            an inertia that no body can have.
    """
    root = _parse(path)
    _refuse_nonsense(root, path)
    check_joints(root, path)
    doubts: list[str] = []
    links = root.findall("link")
    for link in links:
        doubts += check_inertial(link, path)
    unlimited: set[str] = set()
    moving: list[str] = []
    for joint in root.findall("joint"):
        name = joint.get("name", "")
        if joint.get("type") in MOVING_TYPES:
            moving.append(name)
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            limit = joint.find("limit")
            if limit is None:
                limit = ElementTree.SubElement(joint, "limit", effort="0", velocity="0")
            limit.set("lower", str(-4 * math.pi))
            limit.set("upper", str(4 * math.pi))
            unlimited.add(name)
    return Urdf(
        path=path,
        text=ElementTree.tostring(root, encoding="unicode"),
        unlimited=frozenset(unlimited),
        links=tuple(link.get("name", "") for link in links),
        joints=tuple(moving),
        doubts=tuple(doubts),
    )


def _parse(path: Path) -> ElementTree.Element:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ModelError(
                f"larger than {MAX_BYTES // 2**20} MB", source=path, remedy="is this a URDF file?"
            )
        content = path.read_bytes()
    except OSError as error:
        raise ModelError(
            f"cannot be read: {error.strerror}", source=path, remedy="name a readable URDF file"
        ) from None
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise ModelError(
            "declares a document type or entities",
            source=path,
            remedy="a URDF needs neither: remove the declaration (run xacro first)",
        )
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise ModelError(
            f"is not well-formed XML: {error}", source=path, remedy="mend the file at that place"
        ) from None
    if root.tag != "robot":
        raise ModelError(
            "is XML, but no URDF",
            source=path,
            value=f"<{root.tag}>",
            remedy="its outermost element must be <robot>",
        )
    return root


def _refuse_nonsense(root: ElementTree.Element, path: Path) -> None:
    """Refuses what every reader of URDF would stumble over, with a better message."""
    links = [link.get("name") for link in root.findall("link")]
    if not links:
        raise ModelError("has no link", source=path, remedy="describe at least one <link>")
    for kind in ("link", "joint"):
        names = [element.get("name") for element in root.findall(kind)]
        for name in names:
            if not name:
                raise ModelError(f"has a {kind} without a name", source=path, remedy="name it")
            if names.count(name) > 1:
                raise ModelError(
                    f"has more than one {kind} of this name",
                    source=path,
                    value=name,
                    remedy="names must be unique",
                )
    children: list[str | None] = []
    for joint in root.findall("joint"):
        for role in ("parent", "child"):
            element = joint.find(role)
            link = None if element is None else element.get("link")
            if link not in links:
                raise ModelError(
                    f"the joint's {role} link does not exist",
                    source=path,
                    key=joint.get("name"),
                    value=link,
                    remedy="name a link of this file",
                )
            if role == "child":
                children.append(link)
    for link in links:
        if children.count(link) > 1:
            raise ModelError(
                "link is the child of more than one joint",
                source=path,
                value=link,
                remedy="a URDF is a tree: each link hangs on one joint",
            )
    roots = [link for link in links if link not in children]
    if len(roots) != 1:
        raise ModelError(
            f"has {len(roots)} root links",
            source=path,
            value=roots,
            remedy="joints must connect all links to one tree",
        )
    _refuse_rings(root, roots, path)
    for element in root.iter():
        for attribute in ("xyz", "rpy", "value", "lower", "upper", "effort", "velocity"):
            text = element.get(attribute)
            if text is not None and element.tag in ("origin", "axis", "mass", "limit"):
                finite_numbers(text, path, f"{element.tag} {attribute}")


def _refuse_rings(root: ElementTree.Element, reached: list[str | None], path: Path) -> None:
    """Refuses links that are joined to each other, but not to the root link `reached`."""
    carried: dict[str | None, list[str | None]] = {}
    for joint in root.findall("joint"):
        ends = [joint.find(role) for role in ("parent", "child")]
        parent, child = (None if end is None else end.get("link") for end in ends)
        carried.setdefault(parent, []).append(child)
    reached = [*reached]
    for link in reached:  # grows while it is walked
        reached += carried.get(link, [])
    ring = [link.get("name") for link in root.findall("link") if link.get("name") not in reached]
    if ring:
        raise ModelError(
            "has links in a ring that no root carries",
            source=path,
            value=ring,
            remedy="joints must connect all links to one tree",
        )
