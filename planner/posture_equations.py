"""Equations of a posture: the object where the task wants it, both hands on the object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.chain import ClosedChain
from planner.equation_of_motion import Placements
from planner.vectors import rotation_log, transpose

# p @ _CROSS is, row by row, the matrix that takes w to w x p
_CROSS = np.zeros((3, 9))
_CROSS[[0, 1, 2], [5, 6, 1]] = 1.0
_CROSS[[0, 1, 2], [7, 2, 3]] = -1.0


@dataclass(frozen=True, eq=False)
class ObjectPose:
    """Where the object shall be.

    Attributes:
        position: (3,) [m].
        rotation: (3, 3); None if the task leaves the orientation open.
    """

    position: np.ndarray
    rotation: np.ndarray | None


@dataclass(frozen=True, eq=False)
class Residual:
    """How far K postures are from what they shall be.

    Attributes:
        error: Task and closure rows, (K, r + m) [m, rad].
        at: Placements.
        position: The object's, (K, 3) [m].
        frame: Rotation of the right hand's grasp frame on the object, (K, 3, 3).
        tip: The right hand's position, (K, 3) [m].
        off_plane: How far a planar mechanism holds the object from where its joints cannot move
            it, (K,) [m]; zero for a spatial one.
    """

    error: np.ndarray
    at: Placements
    position: np.ndarray
    frame: np.ndarray
    tip: np.ndarray
    off_plane: np.ndarray


def pose_error(
    chain: ClosedChain, at: Placements, position: np.ndarray, rotation: np.ndarray | None
) -> np.ndarray:
    """Returns the object's distance from where it shall be, in all its rows.

    Args:
        chain: The closed chain.
        at: Placements of K postures.
        position: (3,) or (K, 3) [m].
        rotation: (3, 3) or (K, 3, 3); None leaves the orientation open.

    Returns:
        (K, 3) or, with a rotation, (K, 6) [m, rad] in world axes.
    """
    is_position, is_rotation = chain.object_pose(at)
    error = is_position - position
    if rotation is None:
        return error
    return np.concatenate([error, _turn(is_rotation, rotation)], axis=1)


def _turn(rotation: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    return rotation_log(rotation @ transpose(wanted))


def residual(
    chain: ClosedChain, q: np.ndarray, position: np.ndarray, rotation: np.ndarray | None
) -> Residual:
    """Returns how far postures q, (K, N) [rad], are from holding the object at K poses.

    The poses are given as to `pose_error`; one pose serves all K.
    """
    at = chain.dynamics.placements(q)
    is_position, is_rotation = chain.object_pose(at)
    (wanted, frame), (tip, tip_rotation) = chain.grasp_pose(at), chain.right_tip(at)
    apart = tip - wanted
    off = is_position - position
    rows = chain.task_rows(rotation is not None)
    task, closure = off @ rows[:, :3].T, chain.pair.gap(frame, apart, tip_rotation)
    if rotation is not None:
        task += _turn(is_rotation, rotation) @ rows[:, 3:].T
    off_plane = np.zeros(len(q))
    if chain.normal is not None:
        off_plane = np.maximum(np.abs(apart @ chain.normal), np.abs(off @ chain.normal))
    error = np.concatenate([task, closure], axis=1)
    return Residual(error, at, is_position, frame, tip, off_plane)


def jacobian(chain: ClosedChain, of: Residual, *, orientation: bool) -> np.ndarray:
    """Returns the derivative of the errors along the joints, (K, r + m, N).

    Args:
        chain: The closed chain.
        of: The errors.
        orientation: Whether the object's orientation is prescribed.
    """
    split, rows, pair = chain.left.n, chain.task_rows(orientation), chain.pair
    columns = of.at.columns
    result = np.zeros((len(columns), len(rows) + chain.m, chain.n))
    task, closure = result[:, : len(rows)], result[:, len(rows) :]
    # the object goes with the left hand
    left = columns[:, :, :split]
    task[:, :, :split] = rows[:, :3] @ at_point(left, of.position)
    if orientation:
        task[:, :, :split] += rows[:, 3:] @ left[:, 3:]
    to_frame = transpose(of.frame)
    closure[...] = pair.blocked[:, :3] @ to_frame @ at_point(columns, of.tip)
    if pair.rotation != "free":
        closure += pair.blocked[:, 3:] @ to_frame @ columns[:, 3:]
    closure[:, :, :split] *= -1.0
    return result


def at_point(columns: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Returns the velocity of points per joint rate, (K, 3, n).

    Args:
        columns: Twist columns (linear at the world's origin; angular), (K, 6, n).
        point: (K, 3) [m].
    """
    across = (point @ _CROSS).reshape(-1, 3, 3)
    moving: np.ndarray = columns[:, :3] + across @ columns[:, 3:]
    return moving
