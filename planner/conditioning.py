"""How far the arms and the closed chain stand from a singularity, as condition numbers."""

from __future__ import annotations

import numpy as np

from planner.chain import ClosedChain

NEAR_SINGULAR = 100.0  # an elbow within some 2 degrees of being stretched
SINGULAR = 1e8


def closure_condition(chain: ClosedChain, q: np.ndarray) -> np.ndarray:
    """Returns the condition number of the closure's Jacobian at closed postures, (K,).

    Args:
        chain: The closed chain.
        q: Postures, (K, N) [rad].
    """
    return _condition(chain.loop(chain.dynamics.placements(q)).jacobian())


def arm_conditions(chain: ClosedChain, q: np.ndarray) -> tuple[float, float]:
    """Returns the condition number of each arm's Jacobian at its hand, lengths over its reach.

    Args:
        chain: The closed chain.
        q: One posture, (N,) [rad].
    """
    at = chain.dynamics.placements(q[None])
    points = (chain.object_pose(at)[0][0], chain.right_tip(at)[0][0])
    parts = (slice(0, chain.left.n), slice(chain.left.n, chain.n))
    found = []
    for arm, point, part in zip(chain.arms, points, parts, strict=True):
        columns = at.columns[0][:, part]
        moving = columns[:3] + np.cross(columns[3:], point, axis=0)
        reach = max(float(np.max(np.linalg.norm(moving, axis=0))), 1e-12)
        # an arm with too few joints to turn its hand at will is asked for positions alone
        rows = chain.task_rows(orientation=arm.n >= (3 if chain.planar else 6))
        found.append(float(_condition(rows @ np.vstack([moving / reach, columns[3:]])[None])[0]))
    return found[0], found[1]


def _condition(jacobians: np.ndarray) -> np.ndarray:
    values = np.linalg.svd(jacobians, compute_uv=False)
    result: np.ndarray = values[:, 0] / np.maximum(values[:, -1], 1e-300)
    return result
