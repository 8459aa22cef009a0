"""Kinematic pairs between the hands: which relative motions they block."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from planner.vectors import cross, rotation_log, transpose

PairName = Literal["revolute", "spherical", "cylindrical", "prismatic", "planar", "rigid"]
Rotation = Literal["free", "axis", "blocked"]

# pair: (translation along the axis, translation across it, rotation about it, across it) blocked?
_BLOCKED: dict[str, tuple[bool, bool, bool, bool]] = {
    "revolute": (True, True, False, True),
    "spherical": (True, True, False, False),
    "cylindrical": (False, True, False, True),
    "prismatic": (False, True, True, True),
    "planar": (True, False, False, True),
    "rigid": (True, True, True, True),
}


@dataclass(frozen=True, eq=False)
class Pair:
    """A kinematic pair, seen from the frame of the right hand's grasp on the object.

    Attributes:
        name: Its name.
        axis: Its axis, unit vector (3,).
        rotation: Whether relative rotation is free, free about the axis only, or blocked.
        blocked: Orthonormal rows that select the blocked part of a relative twist
            (linear; angular) in that frame, (m, 6).
    """

    name: str
    axis: np.ndarray
    rotation: Rotation
    blocked: np.ndarray

    @property
    def m(self) -> int:
        """Number of closure rows, m = c - k."""
        return len(self.blocked)

    def gap(self, frame: np.ndarray, apart: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Returns how far the right hand is from its grasp in the blocked motions, (K, m) [m, rad].

        Args:
            frame: Rotation of the grasp on the object, (K, 3, 3).
            apart: Position of the hand less that of the grasp, (K, 3) [m].
            rotation: Rotation of the hand, (K, 3, 3).
        """
        away = (apart[:, None, :] @ frame)[:, 0]
        result: np.ndarray = away @ self.blocked[:, :3].T
        if self.rotation == "free":
            return result
        relative = transpose(frame) @ rotation
        if self.rotation == "blocked":
            turn = rotation_log(relative)
        else:
            turned = relative @ self.axis
            tilt = cross(self.axis, turned)
            sine = np.sqrt((tilt * tilt).sum(axis=1))
            # beyond a right angle the cross product falls again: keep the sense of the way back
            angle = np.arctan2(sine, turned @ self.axis)
            turn = tilt * (angle / np.maximum(sine, 1e-300))[:, None]
        return result + turn @ self.blocked[:, 3:].T


def across(axis: np.ndarray) -> np.ndarray:
    """Returns two unit vectors that complete `axis` to a right-handed frame, rows of (2, 3)."""
    # the unit vector least along the axis keeps aligned axes aligned: z gives x and y
    helper = np.eye(3)[int(np.argmin(np.abs(axis) + 1e-9 * np.arange(3)))]
    first = helper - axis * (axis @ helper)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(axis, first)])


def make_pair(name: str, axis: np.ndarray, normal: np.ndarray | None) -> Pair:
    """Returns the pair's blocked motions.

    Args:
        name: One of the names of `PairName`.
        axis: Axis of the pair, (3,).
        normal: Normal of the plane when the mechanism is planar, else None. Of a planar
            mechanism only the rows within its three motions count: c = 3 instead of 6.
    """
    axis = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    along, sideways = axis[None, :], across(axis)
    slide, shift, spin, tilt = _BLOCKED[name]
    linear = [rows for rows, wanted in ((sideways, shift), (along, slide)) if wanted]
    angular = [rows for rows, wanted in ((sideways, tilt), (along, spin)) if wanted]
    rows = [np.hstack([part, np.zeros_like(part)]) for part in linear]
    rows += [np.hstack([np.zeros_like(part), part]) for part in angular]
    if np.linalg.matrix_rank(np.vstack([np.zeros((1, 3)), *linear])) == 3:
        # a point that cannot move at all: plain axes read better than those of the pair
        rows = [np.hstack([np.eye(3), np.zeros((3, 3))]), *rows[len(linear) :]]
    blocked = np.vstack(rows)
    rotation: Rotation = "blocked" if spin else ("axis" if tilt else "free")
    if normal is not None:
        blocked = _within_plane(blocked, normal)
        turning = np.any(np.abs(blocked[:, 3:] @ normal) > 0.5)
        rotation = "blocked" if turning else "free"
    return Pair(name, axis, rotation, blocked)


def _within_plane(blocked: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Returns orthonormal rows that block the same motions of a planar mechanism."""
    in_plane = across(normal)
    motions = np.zeros((3, 6))
    motions[:2, :3], motions[2, 3:] = in_plane, normal
    restricted = blocked @ motions.T
    _, values, rows = np.linalg.svd(restricted)
    rank = int(np.sum(values > 1e-9))
    rows = rows[:rank]
    # prefer the plane's own axes where they span the same rows
    axes = [unit for unit in np.eye(3) if np.allclose(rows.T @ (rows @ unit), unit, atol=1e-9)]
    if len(axes) == rank:
        rows = np.array(axes).reshape(rank, 3)
    return rows @ motions
