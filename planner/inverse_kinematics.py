"""Postures of the closed chain: both hands on the object, the object where the task wants it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.arm import Arm
from planner.chain import ClosedChain
from planner.equation_of_motion import Placements
from planner.errors import UnreachableError
from planner.vectors import matvec, rotation_log, transpose

TOLERANCE = 1e-11
_STEPS = 60
_SEEDS = 40


@dataclass(frozen=True, eq=False)
class ObjectPose:
    """Where the object shall be.

    Attributes:
        position: (3,) [m].
        rotation: (3, 3); None if the task leaves the orientation open.
    """

    position: np.ndarray
    rotation: np.ndarray | None


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
    turn = rotation_log(is_rotation @ transpose(np.broadcast_to(rotation, is_rotation.shape)))
    return np.concatenate([error, turn], axis=1)


def _system(
    chain: ClosedChain, q: np.ndarray, position: np.ndarray, rotation: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Returns task and closure errors and their Jacobian, (K, r + m) and (K, r + m, N)."""
    at = chain.dynamics.placements(q)
    error = pose_error(chain, at, position, rotation)
    rows = chain.task_rows(rotation is not None)
    task = chain.object_jacobian(at)
    jacobian = np.concatenate([rows @ task, chain.closure_columns(at, np.arange(chain.n))], axis=1)
    return np.concatenate([error @ rows[:, : error.shape[1]].T, chain.gap(at)], axis=1), jacobian


def _off_plane(chain: ClosedChain, q: np.ndarray, position: np.ndarray) -> float:
    """Returns how far a planar mechanism holds the object from where it cannot move it [m]."""
    if chain.normal is None:
        return 0.0
    at = chain.dynamics.placements(q[None])
    apart = chain.right_tip(at)[0] - chain.grasp_pose(at)[0]
    lift = chain.object_pose(at)[0] - position
    return float(np.max(np.abs(np.concatenate([apart, lift]) @ chain.normal)))


def _newton_step(jacobian: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Returns the least joint steps that cancel the errors to first order, (K, N)."""
    if jacobian.shape[-1] == jacobian.shape[-2]:
        try:
            return -np.linalg.solve(jacobian, error[..., None])[..., 0]
        except np.linalg.LinAlgError:
            pass
    return -matvec(np.linalg.pinv(jacobian, rcond=1e-8), error)


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

    Newton's method starts from `seeds`, then from the reference, then from random postures.
    Where arms are as many-jointed as their task, a solution on the reference's side of every
    elbow goes before one on the other side.

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
    lower, upper = chain.both("lower"), chain.both("upper")
    low, high = np.maximum(lower, reference - np.pi), np.minimum(upper, reference + np.pi)
    generator = np.random.default_rng(random_seed)
    wanted = branch(chain, reference)
    best: tuple[bool, float, np.ndarray] | None = None
    first = [*(seeds or []), reference]
    for attempt in range(len(first) + _SEEDS):
        seed = first[attempt] if attempt < len(first) else generator.uniform(low, high)
        q = _nearest(chain, pose, np.clip(seed, lower, upper), reference, lower, upper)
        if q is not None:
            other_side = branch(chain, q) != wanted
            rank = (other_side, float(np.linalg.norm(q - reference)), q)
            if best is None or rank[:2] < best[:2]:
                best = rank
            if not other_side and attempt < len(first):
                break
        if best is not None and not best[0] and attempt >= len(first) + 4:
            break
    if best is None:
        raise _unreachable(chain, pose, reference, key)
    return best[2]


def _nearest(
    chain: ClosedChain,
    pose: ObjectPose,
    seed: np.ndarray,
    reference: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
) -> np.ndarray | None:
    """Returns the closed posture reached from `seed`, moved towards `reference` where free."""
    held = np.zeros(chain.n, dtype=bool)
    q = seed
    for _ in range(4):  # each round holds the joints that left their limits
        found = _newton(chain, pose, q, reference, held)
        if found is None:
            return None
        outside = (found < lower - 1e-9) | (found > upper + 1e-9)
        if not outside.any():
            return found
        if (held & outside).any() or chain.p <= chain.r:
            return None
        held |= outside
        q = np.clip(found, lower, upper)
    return None


def _newton(
    chain: ClosedChain,
    pose: ObjectPose,
    seed: np.ndarray,
    reference: np.ndarray,
    held: np.ndarray,
) -> np.ndarray | None:
    q = seed.copy()
    free = ~held
    redundant = chain.p > chain.r
    for _ in range(_STEPS):
        error, jacobian = (
            part[0] for part in _system(chain, q[None], pose.position, pose.rotation)
        )
        size = np.max(np.abs(error))
        move, rest = np.zeros(chain.n), 0.0
        if redundant or held.any():
            inverse = np.linalg.pinv(jacobian[:, free], rcond=1e-8)
            away = (reference - q)[free]
            slide = away - inverse @ (jacobian[:, free] @ away) if redundant else 0.0 * away
            rest = float(np.max(np.abs(slide), initial=0.0))
            move[free] = slide - inverse @ error
        else:
            move = _newton_step(jacobian, error)
        if size < TOLERANCE and rest < 1e-9:
            break
        q += move * min(1.0, 0.5 / max(np.max(np.abs(move)), 1e-300))
    if not size < TOLERANCE or _off_plane(chain, q, pose.position) > 1e-9:
        return None
    return q


def branch(chain: ClosedChain, q: np.ndarray) -> tuple[int, ...]:
    """Returns on which side of its singularity each arm stands, for arms without redundancy."""
    at = chain.dynamics.placements(q[None])
    sides = []
    for part in (slice(0, chain.left.n), slice(chain.left.n, chain.n)):
        columns = at.columns[0][:, part]
        if chain.normal is None:
            square = columns if columns.shape[1] == 6 else None
        else:
            point = (chain.object_pose(at) if part.start == 0 else chain.right_tip(at))[0][0]
            moving = columns[:3] + np.cross(columns[3:], point, axis=0)
            plane = chain.task_rows(False)[:, :3] @ moving
            square = {2: plane, 3: np.vstack([plane, chain.normal @ columns[3:]])}.get(
                columns.shape[1]
            )
        if square is not None:
            sides.append(int(np.sign(np.linalg.det(square))))
    return tuple(sides)


def follow_poses(
    chain: ClosedChain, positions: np.ndarray, rotations: np.ndarray | None, guess: np.ndarray
) -> np.ndarray | None:
    """Returns closed postures that put the object at K poses, by Newton's method from `guess`.

    Redundant joints move as little as possible. None if some pose is not reached, or if two
    neighbours are so far apart that the arms must have changed sides between them.
    """
    q = np.array(guess, dtype=float)
    inner = slice(1, -1)
    for _ in range(20):
        rotation = None if rotations is None else rotations[inner]
        error, jacobian = _system(chain, q[inner], positions[inner], rotation)
        size = np.max(np.abs(error), axis=1)
        if np.max(size) < 1e-9:
            jumps = np.max(np.abs(np.diff(q, axis=0)), axis=1)
            return q if np.max(jumps) < 0.5 + 4.0 * np.median(jumps) else None
        step = _newton_step(jacobian, error)
        largest = np.max(np.abs(step), axis=1, keepdims=True)
        q[inner] += step * np.minimum(1.0, 0.3 / np.maximum(largest, 1e-300))
    return None


def _unreachable(
    chain: ClosedChain, pose: ObjectPose, reference: np.ndarray, key: str
) -> UnreachableError:
    """Returns the error that says which arm misses the pose, and by how much."""
    rotation = np.eye(3) if pose.rotation is None else pose.rotation
    grasp = chain.grasp_in_object.translation
    targets = {"left": pose.position, "right": pose.position + rotation @ grasp}
    if pose.rotation is None and np.any(grasp):
        del targets["right"]
    missing = {}
    for arm in chain.arms:
        if arm.side in targets:
            point = (arm.tip_placement if arm.side == "right" else chain.object_in_left).translation
            part = slice(0, chain.left.n) if arm.side == "left" else slice(chain.left.n, chain.n)
            missing[arm.side] = _missing(arm, point, targets[arm.side], reference[part])
    where = np.round(pose.position, 4).tolist()
    far = {side: distance for side, distance in missing.items() if distance > 1e-6}
    if far:
        text = " and ".join(f"the {side} arm misses it by {d:.4f} m" for side, d in far.items())
        return UnreachableError(
            f"the object's position cannot be reached: {text}",
            key=key,
            value=where,
            remedy="move it closer to the bases, or the bases closer to it",
        )
    return UnreachableError(
        "each arm reaches the object alone, but both together cannot hold it there within their "
        "joint limits",
        key=key,
        value=where,
        remedy="check grasp.xyz and grasp.rpy, the pair, the height of the bases, the limits, "
        "and the postures that seed the search",
    )


def _missing(arm: Arm, point: np.ndarray, target: np.ndarray, seed: np.ndarray) -> float:
    """Returns how far one arm's point stays from the target at best, alone [m]."""
    import pinocchio as pin
    from scipy.optimize import least_squares

    data = arm.model.createData()

    def error(q: np.ndarray) -> np.ndarray:
        pin.forwardKinematics(arm.model, data, q)
        result: np.ndarray = data.oMi[arm.tip_joint].act(point) - target
        return result

    generator = np.random.default_rng(0)
    low = np.maximum(arm.lower, -np.pi)
    high = np.minimum(arm.upper, np.pi)
    best = np.inf
    for attempt in range(12):
        start = np.clip(seed, low, high) if attempt == 0 else generator.uniform(low, high)
        start = np.clip(start, low + 1e-9, high - 1e-9)
        found = least_squares(error, start, bounds=(low - 1e-8, high + 1e-8), xtol=1e-10)
        best = min(best, float(np.linalg.norm(found.fun)))
        if best < 1e-7:
            break
    return best
