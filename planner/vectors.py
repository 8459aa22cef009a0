"""Batched vector algebra over the last axis."""

from __future__ import annotations

import numpy as np

# sine times axis, and cosine plus 1/2, both twice, from a rotation matrix's entries row by row
_TWICE = np.zeros((9, 4))
_TWICE[[7, 2, 3], [0, 1, 2]] = 1.0
_TWICE[[5, 6, 1], [0, 1, 2]] = -1.0
_TWICE[[0, 4, 8], 3] = 1.0


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns a x b over the last axis of broadcast arrays, (..., 3).

    NumPy's own `cross` spends more time on its generality than on these small arrays.
    """
    a0, a1, a2 = a[..., 0], a[..., 1], a[..., 2]
    b0, b1, b2 = b[..., 0], b[..., 1], b[..., 2]
    first = a1 * b2 - a2 * b1
    result = np.empty((*first.shape, 3))
    result[..., 0] = first
    result[..., 1] = a2 * b0 - a0 * b2
    result[..., 2] = a0 * b1 - a1 * b0
    return result


def wrap(vectors: np.ndarray) -> np.ndarray:
    """Returns vectors, components first, with the first two repeated behind, (3, ...) to (5, ...).

    So wrapped, a cross product of many vectors takes two products of slices, see `wrapped_cross`.
    """
    result = np.empty((5, *vectors.shape[1:]))
    result[:3] = vectors
    result[3:] = vectors[:2]
    return result


def wrapped_cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns a x b of wrapped vectors, (5, ...), that broadcast."""
    first = a[1:4] * b[2:5]
    first -= a[2:5] * b[1:4]
    result = np.empty((5, *first.shape[1:]))
    result[:3] = first
    result[3:] = first[:2]
    return result


def rotation_log(rotation: np.ndarray) -> np.ndarray:
    """Returns the rotation vectors of rotation matrices, (..., 3, 3) to (..., 3) [rad]."""
    twice = rotation.reshape(*rotation.shape[:-2], 9) @ _TWICE
    sine, cosine = twice[..., :3], twice[..., 3] - 1.0
    size = np.sqrt((sine * sine).sum(axis=-1))
    # no turn at all has no sine either, whatever its factor
    factor = np.arctan2(size, cosine) / np.maximum(size, 1e-300)
    result: np.ndarray = sine * factor[..., None]
    far = cosine < -1.0
    if far.any():
        # towards a half turn the axis is lost in the difference of the off-diagonal entries
        from scipy.spatial.transform import Rotation

        result[far] = Rotation.from_matrix(rotation[far]).as_rotvec()
    return result


def matvec(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Returns matrix @ vector over a batch, (..., i, j) and (..., j) to (..., i)."""
    return (matrix @ vector[..., None])[..., 0]


def least_norm(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Returns the shortest solutions of matrix @ x = right over a batch, (..., j, k).

    Args:
        matrix: Rows independent of each other, (..., i, j).
        right: (..., i, k).
    """
    square = matrix @ transpose(matrix)
    try:
        share = np.linalg.solve(square, right)
    except np.linalg.LinAlgError:
        share = np.linalg.pinv(square) @ right
    result: np.ndarray = transpose(matrix) @ share
    return result


def transpose(matrix: np.ndarray) -> np.ndarray:
    """Returns the transposes of a batch of matrices, as a view."""
    return matrix.mT
