"""What is said of a pose that the arms do not reach: which arm misses it, and by how much."""

from __future__ import annotations

import numpy as np

from planner.arm import Arm
from planner.chain import ClosedChain
from planner.errors import UnreachableError
from planner.posture_equations import ObjectPose


def unreachable(
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
