"""Postures of the closed chain: both hands on the object, the object where the task wants it."""

from __future__ import annotations

import numpy as np

from planner.chain import ClosedChain
from planner.posture_equations import ObjectPose, at_point, jacobian, residual
from planner.posture_search import closed_within_limits, newton, newton_step
from planner.reach import unreachable

_ROUNDS = (16, 32, 64)  # random postures that the search starts from, round after round
_Rank = tuple[bool, float, np.ndarray]  # on the other side? how far from the reference? posture
_DRAWN = 5  # closed postures that are moved on to the reference, the nearest ones


def find_posture(
    chain: ClosedChain,
    pose: ObjectPose,
    reference: np.ndarray,
    key: str,
    *,
    seeds: list[np.ndarray] | None = None,
    random_seed: int = 0,
) -> np.ndarray:
    """Returns a closed posture with the object at `pose`, nearest to `reference`, (N,) [rad].

    Newton's method starts from `seeds`, then from the reference. Where it fails, damped least
    squares within the joint limits starts there too, then from random postures. Where arms are as
    many-jointed as their task, a solution on the reference's side of every elbow goes before one
    on the other side.

    Args:
        chain: The closed chain.
        pose: Where the object shall be.
        reference: Posture to stay near, (N,).
        key: Dotted key of the pose, for the message.
        seeds: Postures to start from first.
        random_seed: Seed of the random postures.

    Raises:
        UnreachableError: No posture was found; it says which arm misses how much.
    """
    lower, upper = chain.limits
    first = [np.clip(seed, lower, upper) for seed in (*(seeds or ()), reference)]
    best: _Rank | None = None
    for seed in first:
        q = newton(chain, pose, seed, reference)
        if q is not None:
            sides = branches(chain, np.array([q, reference]))
            best = _better(best, (sides[0] != sides[1], float(np.linalg.norm(q - reference)), q))
            if not best[0]:
                return best[2]
    wanted = branch(chain, reference)
    low, high = np.maximum(lower, reference - np.pi), np.minimum(upper, reference + np.pi)
    generator = np.random.default_rng(random_seed)
    starts = np.array(first)
    for more in _ROUNDS:
        starts = np.concatenate([starts, generator.uniform(low, high, (more, chain.n))])
        found = _unwound(chain, closed_within_limits(chain, pose, starts), reference)
        for q in _drawn(chain, pose, found, reference):
            rank = branch(chain, q) != wanted, float(np.linalg.norm(q - reference)), q
            best = _better(best, rank)
        if best is not None and not best[0]:
            break
        starts = starts[:0]
    if best is None:
        raise unreachable(chain, pose, reference, key)
    return best[2]


def _better(one: _Rank | None, other: _Rank) -> _Rank:
    return other if one is None or other[:2] < one[:2] else one


def _unwound(chain: ClosedChain, found: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Returns the same postures without whole turns away from the reference, (K, N)."""
    axes = chain.dynamics.placements(reference[None]).columns[0, 3:]
    turns = np.round((found - reference) / (2.0 * np.pi)) * np.any(axes != 0.0, axis=0)
    back = found - 2.0 * np.pi * turns
    lower, upper = chain.limits
    return np.where((back >= lower) & (back <= upper), back, found)


def _drawn(
    chain: ClosedChain, pose: ObjectPose, found: np.ndarray, reference: np.ndarray
) -> list[np.ndarray]:
    """Returns closed postures moved towards the reference, as far as they are redundant."""
    if chain.p == len(chain.task_rows(pose.rotation is not None)):
        return list(found)
    distance = np.linalg.norm(found - reference, axis=1)
    result = []
    for q in found[np.argsort(distance)[:_DRAWN]]:
        nearer = newton(chain, pose, q, reference)
        result.append(q if nearer is None else nearer)
    return result


def branch(chain: ClosedChain, q: np.ndarray) -> tuple[int, ...]:
    """Returns on which side of its singularity each arm stands, for arms without redundancy."""
    return branches(chain, q[None])[0]


def branches(chain: ClosedChain, q: np.ndarray) -> list[tuple[int, ...]]:
    """Returns the same of K postures, (K, N)."""
    square = (6,) if chain.normal is None else (2, 3)
    parts = [slice(0, chain.left.n), slice(chain.left.n, chain.n)]
    parts = [part for part, arm in zip(parts, chain.arms, strict=True) if arm.n in square]
    if not parts:
        return [()] * len(q)
    at = chain.dynamics.placements(q)
    sides = []
    for part in parts:
        columns = at.columns[:, :, part]
        if chain.normal is not None:
            point = chain.object_pose(at)[0] if part.start == 0 else chain.right_tip(at)[0]
            rows = chain.task_rows(columns.shape[2] == 3)
            columns = np.concatenate([at_point(columns, point), columns[:, 3:]], axis=1)
            columns = rows @ columns
        sides.append(np.sign(np.linalg.det(columns)).astype(int).tolist())
    return list(zip(*sides, strict=True))


def follow_poses(
    chain: ClosedChain, positions: np.ndarray, rotations: np.ndarray | None, guess: np.ndarray
) -> np.ndarray | None:
    """Returns closed postures that put the object at K poses, by Newton's method from `guess`.

    Redundant joints move as little as possible. None if some pose is not reached, or if two
    neighbours are so far apart that the arms must have changed sides between them.
    """
    q = np.array(guess, dtype=float)
    inner = slice(1, -1)
    rotation = None if rotations is None else rotations[inner]
    for _ in range(20):
        now = residual(chain, q[inner], positions[inner], rotation)
        if np.abs(now.error).max() < 1e-9:
            jumps = np.abs(np.diff(q, axis=0)).max(axis=1)
            return q if jumps.max() < 0.5 + 4.0 * np.median(jumps) else None
        step = newton_step(jacobian(chain, now, orientation=rotation is not None), now.error)
        largest = np.abs(step).max(axis=1, keepdims=True)
        q[inner] += step * np.minimum(1.0, 0.3 / np.maximum(largest, 1e-300))
    return None
