"""The task made concrete: start and goal postures, end conditions, and a straight-line guess."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
import pinocchio as pin

from planner.chain import ClosedChain
from planner.errors import ScenarioError
from planner.holding import Preload, refuse_untransmitted
from planner.independent_joints import choose_joints
from planner.constrained_dynamics import Joints
from planner.inverse_kinematics import ObjectPose, find_posture, follow_poses

if TYPE_CHECKING:
    from planner.scenario import Scenario

TorqueRule = Literal["given", "free", "static", "rest", "preload"]
SAMPLES = 33


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


def make_transport(scenario: Scenario, chain: ClosedChain) -> Transport:
    """Returns the motion that a scenario asks for.

    Raises:
        UnreachableError: Start or goal cannot be reached.
        ScenarioError: End conditions do not fit the chain.
    """
    reference = reference_posture(scenario, chain)
    start_pose, goal_pose = (_pose(scenario, end) for end in ("start", "goal"))
    start_q = find_posture(
        chain, start_pose, reference, "task.start.xyz", random_seed=scenario.solver.seed
    )
    redundant = chain.p > chain.r
    goal_q = find_posture(
        chain,
        goal_pose,
        start_q if redundant else reference,
        "task.goal.xyz",
        seeds=[start_q],
        random_seed=scenario.solver.seed,
    )
    start = _end(
        scenario, chain, "start", start_pose, start_q, held=scenario.task.posture == "start"
    )
    goal = _end(scenario, chain, "goal", goal_pose, goal_q, held=False)
    share, guess, straight = straight_line(chain, start, goal, scenario.task.duration)
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


def straight_positions(start: End, goal: End, share: np.ndarray, duration: float) -> np.ndarray:
    """Returns positions of the minimum-jerk motion between the ends, (K, 3) [m].

    It is the quintic with the ends' velocities and no acceleration there: a straight line if
    those are zero.
    """
    x0, x1 = start.pose.position, goal.pose.position
    u = share[:, None]
    line = x0 + (x1 - x0) * quintic(share)[:, None]
    leave = u * (1.0 - u) ** 3 * (1.0 + 3.0 * u)
    arrive = -(1.0 - u) * u**3 * (1.0 + 3.0 * (1.0 - u))
    result: np.ndarray = line + duration * (leave * start.velocity + arrive * goal.velocity)
    return result


def straight_rotations(start: End, goal: End, share: np.ndarray) -> np.ndarray | None:
    """Returns rotations that turn at the profile's pace between the ends, (K, 3, 3)."""
    first, last = start.pose.rotation, goal.pose.rotation
    if first is None or last is None:
        return None
    turn = pin.log3(first.T @ last)
    return np.array([first @ pin.exp3(turn * part) for part in quintic(share)])


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
    positions = straight_positions(start, goal, share, duration)
    rotations = straight_rotations(start, goal, share)
    followed = follow_poses(chain, positions, rotations, mixed)
    if followed is not None:
        return share, followed, True
    joints = choose_joints(chain, np.array([start.posture, goal.posture]))
    closed, _, good = chain.close(mixed, joints.dependent)
    return share, (closed if good.all() else mixed), False


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
