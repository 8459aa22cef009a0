"""Joints of a URDF: what Pinocchio's parser would refuse on the console, or take in silence."""

from __future__ import annotations

import contextlib
import math
import os
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

from planner.errors import ModelError

TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")


def check_joints(root: ElementTree.Element, path: Path) -> None:
    """Refuses joints without a known type, a range, a direction or a placement.

    Raises:
        ModelError: It names the joint.
    """
    for joint in root.findall("joint"):
        name, kind = joint.get("name"), joint.get("type")
        if kind not in TYPES:
            raise ModelError(
                "joint of an unknown type",
                source=path,
                key=name,
                value=kind,
                remedy=f"give {', '.join(TYPES[:-1])} or {TYPES[-1]}",
            )
        if kind in ("revolute", "prismatic"):
            _check_limit(joint, path)
        axis = joint.find("axis")
        if axis is not None and kind != "fixed":
            direction = _three(axis.get("xyz"), path, f"{name} axis")
            if not any(direction):
                raise ModelError(
                    "axis without a direction",
                    source=path,
                    key=name,
                    value=axis.get("xyz"),
                    remedy='give a nonzero vector such as <axis xyz="0 0 1"/>',
                )
    for element in root.iter("origin"):
        for attribute in ("xyz", "rpy"):
            if element.get(attribute) is not None:
                _three(element.get(attribute), path, f"origin {attribute}")


def _check_limit(joint: ElementTree.Element, path: Path) -> None:
    limit = joint.find("limit")
    wanted = '<limit lower="..." upper="..." effort="..." velocity="..."/>'
    missing = [part for part in ("effort", "velocity") if limit is None or limit.get(part) is None]
    if limit is None or missing:
        raise ModelError(
            "joint without a limit" if limit is None else f"limit without {' and '.join(missing)}",
            source=path,
            key=joint.get("name"),
            remedy=f"give {wanted}; an effort or velocity of 0 stands for none",
        )
    for part in ("effort", "velocity"):
        if float(limit.get(part, "0")) < 0.0:
            raise ModelError(
                f"{part} limit is negative",
                source=path,
                key=joint.get("name"),
                value=limit.get(part),
                remedy="a limit is zero (none) or more",
            )
    lower, upper = (float(limit.get(part, "0")) for part in ("lower", "upper"))
    if lower > upper:
        raise ModelError(
            f"its range ends below where it begins: lower {lower:g}, upper {upper:g}",
            source=path,
            key=joint.get("name"),
            remedy="exchange the two",
        )


def _three(text: str | None, path: Path, key: str) -> list[float]:
    try:
        numbers = [float(part) for part in (text or "").split()]
    except ValueError:
        numbers = []
    if len(numbers) != 3 or not all(map(math.isfinite, numbers)):
        raise ModelError(
            "is no vector", source=path, key=key, value=text, remedy="give three numbers"
        )
    return numbers


@contextlib.contextmanager
def parser_messages() -> Iterator[list[str]]:
    """Collects what a C++ parser writes to the console instead of raising it.

    Yields:
        A list that holds the lines when the context ends.
    """
    lines: list[str] = []
    with tempfile.TemporaryFile() as file:
        before = os.dup(2)
        os.dup2(file.fileno(), 2)
        try:
            yield lines
        finally:
            os.dup2(before, 2)
            os.close(before)
            file.seek(0)
            text = file.read().decode(errors="replace")
            lines += [line.removeprefix("Error:").strip() for line in text.splitlines()]
