"""The task made concrete: start and goal postures, end conditions, and a straight-line guess."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
import pinocchio as pin

from planner.chain import ClosedChain
from planner.constrained_dynamics import Joints
from planner.errors import ScenarioError
from planner.holding import Preload, refuse_untransmitted
from planner.independent_joints import choose_joints
from planner.inverse_kinematics import find_posture, follow_poses
from planner.posture_equations import ObjectPose

if TYPE_CHECKING:
    from planner.scenario import Scenario

TorqueRule = Literal["given", "free", "static", "rest", "preload"]
SAMPLES = 25
_QUINTIC = np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])
# from coefficients of a polynomial of fifth degree to those of its derivatives of order 0 to 3
_RATES = np.array([np.linalg.matrix_power(np.diag(np.arange(1.0, 6.0), 1), k) for k in range(4)])


@dataclass(frozen=True, eq=False)
class End:
    """What holds at the start or at the goal.

    Attributes:
        name: "start" or "goal".
        pose: Where the object is.
        posture: A closed posture there, (N,) [rad].
        held: Whether the arms must take exactly that posture.
        velocity: Object's velocity, (3,) [m/s].
        torque_rule: How the torques are prescribed.
        torque: Prescribed torques, (N,) [Nm], where the rule is "given".
        preload: The preload, where the rule is "preload".
    """

    name: str
    pose: ObjectPose
    posture: np.ndarray
    held: bool
    velocity: np.ndarray
    torque_rule: TorqueRule
    torque: np.ndarray
    preload: Preload | None


@dataclass(frozen=True, eq=False)
class Transport:
    """One motion to be planned.

    Attributes:
        chain: The closed chain.
        joints: Independent and dependent joints.
        start: Start.
        goal: Goal.
        duration: [s].
        reference: Posture given in the scenario, (N,) [rad].
        share: Shares of the duration at which the guess is known, (K,).
        guess: Closed postures along the guess, (K, N) [rad].
        straight: Whether the guess takes the object along a straight line.
    """

    chain: ClosedChain
    joints: Joints
    start: End
    goal: End
    duration: float
    reference: np.ndarray
    share: np.ndarray
    guess: np.ndarray
    straight: bool


def make_transport(
    scenario: Scenario, chain: ClosedChain, *, near: np.ndarray | None = None
) -> Transport:
    """Returns the motion that a scenario asks for.

    Args:
        scenario: The scenario.
        chain: Its closed chain.
        near: Postures of a motion of the same arms, evenly spaced in time, (K, N) [rad], whose
            ends and path serve as guess; None for the straight line.

    Raises:
        UnreachableError: Start or goal cannot be reached.
        ScenarioError: End conditions do not fit the chain.
    """
    reference = reference_posture(scenario, chain)
    start_pose, goal_pose = (_pose(scenario, end) for end in ("start", "goal"))
    if near is not None and near.shape[1:] != (chain.n,):
        near = None  # of other arms: whoever asked for it is told so later
    held = scenario.task.posture == "start"
    start_q = find_posture(
        chain,
        start_pose,
        reference if near is None or held else near[0],
        "task.start.xyz",
        random_seed=scenario.solver.seed,
    )
    goal_q = find_posture(
        chain,
        goal_pose,
        near[-1] if near is not None else (start_q if chain.redundant else reference),
        "task.goal.xyz",
        seeds=[start_q],
        random_seed=scenario.solver.seed,
    )
    start = _end(scenario, chain, "start", start_pose, start_q, held=held)
    goal = _end(scenario, chain, "goal", goal_pose, goal_q, held=False)
    line = None if near is None else shifted(chain, start_q, goal_q, near)
    straight = line is None
    if line is None:
        share, guess, straight = straight_line(chain, start, goal, scenario.task.duration)
    else:
        share, guess = line
    return Transport(
        chain=chain,
        joints=choose_joints(chain, guess),
        start=start,
        goal=goal,
        duration=float(scenario.task.duration),
        reference=reference,
        share=share,
        guess=guess,
        straight=straight,
    )


def reference_posture(scenario: Scenario, chain: ClosedChain) -> np.ndarray:
    """Returns the posture given for both arms, or the one nearest to zero within limits, (N,)."""
    parts = []
    for arm in chain.arms:
        rest = np.clip(np.zeros(arm.n), arm.lower, arm.upper)
        parts.append(rest if arm.posture is None else arm.posture)
    return np.concatenate(parts)


def quintic(share: np.ndarray) -> np.ndarray:
    """Returns the minimum-jerk profile from 0 to 1, at rest at both ends."""
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


@dataclass(frozen=True, eq=False)
class StraightMotion:
    """The object's minimum-jerk motion at K shares of the duration.

    Attributes:
        position: (K, 3) [m].
        rotation: (K, 3, 3); None if the orientation is not prescribed at both ends.
        twist: Velocity (linear; angular) in world axes, (K, 6).
        acceleration: Likewise, (K, 6).
        jerk: Of the position, (K, 3) [m/s^3].
    """

    position: np.ndarray
    rotation: np.ndarray | None
    twist: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray


def straight_motion(start: End, goal: End, share: np.ndarray, duration: float) -> StraightMotion:
    """Returns the quintic between the ends, with their velocities and no acceleration there.

    It is a straight line if the velocities are zero. The orientation turns about a fixed axis.
    """
    way = goal.pose.position - start.pose.position
    first, last = start.velocity * duration, goal.velocity * duration
    coefficients = np.array(
        [
            start.pose.position,
            first,
            np.zeros(3),
            10.0 * way - 6.0 * first - 4.0 * last,
            -15.0 * way + 8.0 * first + 7.0 * last,
            6.0 * way - 3.0 * first - 3.0 * last,
        ]
    )
    powers = share[:, None] ** np.arange(6.0)
    rates = _RATES / duration ** np.arange(4.0)[:, None, None]
    position, velocity, acceleration, jerk = powers @ (rates @ coefficients)
    twist, twist_rate = np.zeros((2, len(share), 6))
    twist[:, :3], twist_rate[:, :3] = velocity, acceleration
    rotation = None
    before, after = start.pose.rotation, goal.pose.rotation
    if before is not None and after is not None:
        turn = pin.log3(before.T @ after)
        rotation = before @ np.array([pin.exp3(turn * part) for part in quintic(share)])
        pace = powers @ (rates[1:3] @ _QUINTIC[:, None])
        twist[:, 3:], twist_rate[:, 3:] = pace * (before @ turn)
    return StraightMotion(position, rotation, twist, twist_rate, jerk)


def straight_line(
    chain: ClosedChain, start: End, goal: End, duration: float
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Returns shares of the duration, closed postures there, and whether the object goes straight.

    Where the straight line cannot be followed, joints are interpolated and closed instead; where
    that fails too, the guess is left as the interpolation.
    """
    share = np.linspace(0.0, 1.0, SAMPLES)
    blend = quintic(share)[:, None]
    mixed = start.posture + (goal.posture - start.posture) * blend
    line = straight_motion(start, goal, share, duration)
    followed = follow_poses(chain, line.position, line.rotation, mixed)
    if followed is not None:
        return share, followed, True
    joints = choose_joints(chain, np.array([start.posture, goal.posture]))
    closed, _, good = chain.close(mixed, joints.dependent)
    return share, (closed if good.all() else mixed), False


def shifted(
    chain: ClosedChain, start: np.ndarray, goal: np.ndarray, near: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Returns shares and closed postures of a known motion moved to other ends.

    None if it cannot be closed there.

    Args:
        chain: The closed chain.
        start: Start posture, (N,).
        goal: Goal posture, (N,).
        near: The known motion, evenly spaced in time, (K, N).
    """
    every = np.unique(np.linspace(0, len(near) - 1, SAMPLES).astype(int))
    share = every / (len(near) - 1)
    path = near[every]
    path = path + (1.0 - share[:, None]) * (start - path[0]) + share[:, None] * (goal - path[-1])
    joints = choose_joints(chain, path)
    closed, _, good = chain.close(path, joints.dependent)
    return (share, closed) if good.all() else None


def _pose(scenario: Scenario, end: str) -> ObjectPose:
    given = getattr(scenario.task, end)
    rotation = None if given.rpy is None else pin.rpy.rpyToMatrix(*given.rpy)
    return ObjectPose(np.array(given.xyz, dtype=float), rotation)


def _end(
    scenario: Scenario,
    chain: ClosedChain,
    name: str,
    pose: ObjectPose,
    posture: np.ndarray,
    *,
    held: bool,
) -> End:
    given = getattr(scenario.boundary, name)
    velocity = np.array(getattr(scenario.task, name).velocity, dtype=float)
    determined = chain.p == len(chain.task_rows(pose.rotation is not None))
    if np.any(velocity) and not (held or determined):
        raise ScenarioError(
            "a velocity is prescribed where the posture is free",
            source=scenario.path,
            key=f"task.{name}.velocity",
            value=velocity.tolist(),
            remedy="set it to zero: only arms without redundancy, or a start posture that is "
            'held (task.posture = "start"), can take one',
        )
    rule: TorqueRule = "given"
    torque, preload = np.zeros(chain.n), None
    if given.internal_force is not None or given.internal_moment is not None:
        rule = "preload"
        preload = Preload(
            np.array(given.internal_force or (0.0, 0.0, 0.0)),
            np.array(given.internal_moment or (0.0, 0.0, 0.0)),
        )
        refuse_untransmitted(chain, name, preload)
    elif given.torque in ("free", "static", "rest"):
        rule = given.torque
    elif given.torque != "zero":
        torque = np.array(given.torque, dtype=float)
        if len(torque) != chain.n:
            raise ScenarioError(
                f"has {len(torque)} torques for {chain.n} joints",
                source=scenario.path,
                key=f"boundary.{name}.torque",
                value=list(given.torque),
                remedy=f"give one per joint: {', '.join(chain.joint_names)}",
            )
    return End(name, pose, posture, held or determined, velocity, rule, torque, preload)
