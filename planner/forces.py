"""Forces and moments that each hand applies to the object, from the motion and the multiplier."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.chain import ClosedChain
from planner.closure import Loop, LoopOrder
from planner.constrained_dynamics import Motion
from planner.equation_of_motion import Placements
from planner.vectors import cross, matvec, transpose, wrap, wrapped_cross


@dataclass(frozen=True, eq=False)
class ObjectMotion:
    """Motion of the object for K samples, world axes.

    Attributes:
        position: Origin of its frame, (K, 3) [m].
        rotation: (K, 3, 3).
        lever: From the frame's origin to the centre of mass, (K, 3) [m].
        angular_velocity: (K, 3) [rad/s].
        acceleration: Of the centre of mass, (K, 3) [m/s^2].
        angular_acceleration: (K, 3) [rad/s^2].
    """

    position: np.ndarray
    rotation: np.ndarray
    lever: np.ndarray
    angular_velocity: np.ndarray
    acceleration: np.ndarray
    angular_acceleration: np.ndarray


@dataclass(frozen=True, eq=False)
class HandForces:
    """What the hands apply to the object, world axes; moments about the object's frame.

    Attributes:
        left_force: (K, 3) [N].
        right_force: (K, 3) [N].
        left_moment: (K, 3) [Nm].
        right_moment: (K, 3) [Nm].
    """

    left_force: np.ndarray
    right_force: np.ndarray
    left_moment: np.ndarray
    right_moment: np.ndarray


def object_twist(chain: ClosedChain, at: Placements, point: np.ndarray) -> Loop:
    """Returns the left arm as a chain from the base to a point of the object, (K, 3) [m]."""
    count, split = len(point), chain.left.n
    angular = wrap(at.columns[:, 3:, :split].transpose(1, 0, 2))
    linear = wrapped_cross(angular, wrap(point.T)[..., None])
    linear += wrap(at.columns[:, :3, :split].transpose(1, 0, 2))
    world = np.broadcast_to(np.eye(3), (count, 3, 3))
    return Loop(linear, angular, world, np.eye(6), LoopOrder(np.arange(split)))


def object_motion(chain: ClosedChain, at: Placements, v: np.ndarray, a: np.ndarray) -> ObjectMotion:
    """Returns the object's motion under joint velocity v and acceleration a, (K, N) each."""
    position, rotation = chain.object_pose(at)
    lever = rotation @ chain.body.com
    left = slice(0, chain.left.n)
    arm = object_twist(chain, at, position + lever)
    jacobian = arm.jacobian()
    both = matvec(jacobian, a[:, left]) + arm.bias(v[:, left])
    return ObjectMotion(
        position=position,
        rotation=rotation,
        lever=lever,
        angular_velocity=matvec(jacobian[:, 3:], v[:, left]),
        acceleration=both[:, :3],
        angular_acceleration=both[:, 3:],
    )


def hand_forces(chain: ClosedChain, motion: Motion) -> HandForces:
    """Returns the hands' forces: the right one's from eq. 2, the left one's from Newton's law."""
    at = motion.tangent
    body = object_motion(chain, at.at, motion.v, motion.a)
    point, _ = chain.right_tip(at.at)
    on_hand = at.loop.wrench(motion.multiplier)
    right_force = -on_hand[:, :3]
    right_moment = -on_hand[:, 3:] + cross(point - body.position, right_force)
    force = chain.body.mass * (body.acceleration - chain.gravity)
    inertia = body.rotation @ chain.body.inertia @ transpose(body.rotation)
    spin = body.angular_velocity
    moment = matvec(inertia, body.angular_acceleration) + cross(spin, matvec(inertia, spin))
    moment = moment + cross(body.lever, force)
    return HandForces(
        left_force=force - right_force,
        right_force=right_force,
        left_moment=moment - right_moment,
        right_moment=right_moment,
    )
