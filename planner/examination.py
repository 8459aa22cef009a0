"""What can be said of a scenario before it is planned: its parts, its sizes, what is doubtful.

It goes on after a fault where that is possible, so that one look names as many as it can.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from planner.arm import Arm, Side, read_arm, urdf_path
from planner.assembly import build_chain
from planner.body import Body, object_path, read_object
from planner.chain import ClosedChain
from planner.conditioning import NEAR_SINGULAR, SINGULAR, arm_conditions, closure_condition
from planner.criteria import joint_weights
from planner.errors import InputError, ScenarioError, UnreachableError
from planner.inverse_kinematics import find_posture
from planner.posture_equations import ObjectPose
from planner.remarks import scenario_remarks
from planner.transport import Transport, make_transport, reference_posture
from planner.urdf_review import Review, review_urdf

if TYPE_CHECKING:
    from planner.scenario import Scenario

SIDES: tuple[Side, Side] = ("left", "right")


@dataclass(frozen=True, eq=False)
class ArmFacts:
    """One arm.

    Attributes:
        arm: The arm.
        joint_types: Type of each of its joints in the URDF.
        masses: Masses [kg] of the links that its joints move.
        fixed_masses: Masses [kg] of the URDF's other links.
    """

    arm: Arm
    joint_types: tuple[str, ...]
    masses: dict[str, float]
    fixed_masses: dict[str, float]

    @property
    def mass(self) -> float:
        """What its joints move, without the object [kg]."""
        return sum(self.masses.values())


@dataclass(frozen=True, eq=False)
class EndFacts:
    """The start or the goal.

    Attributes:
        name: "start" or "goal".
        position: The object's position there, (3,) [m].
        posture: A closed posture, (N,) [rad]; None if it cannot be reached.
        closure_condition: Condition number of the closure's Jacobian there.
        arm_conditions: Likewise of each arm's Jacobian at its hand, lengths over its reach.
    """

    name: str
    position: np.ndarray
    posture: np.ndarray | None
    closure_condition: float = float("nan")
    arm_conditions: tuple[float, float] = (float("nan"), float("nan"))


@dataclass(frozen=True, eq=False)
class Examination:
    """All of it. What could not be read is None, and a problem says why.

    Attributes:
        scenario: What was examined.
        arms: Facts on the left and the right arm.
        body: The object.
        chain: The closed chain.
        ends: Start and goal; empty without a chain.
        problems: What makes planning impossible, each a line.
        doubts: What should be looked at, each a line.
    """

    scenario: Scenario
    arms: tuple[ArmFacts | None, ArmFacts | None]
    body: Body | None
    chain: ClosedChain | None
    ends: tuple[EndFacts, ...]
    problems: tuple[str, ...]
    doubts: tuple[str, ...]

    @property
    def possible(self) -> bool:
        """Whether planning can be tried."""
        return not self.problems


class _Findings:
    """Lines, each once."""

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self.problems: dict[str, None] = {}
        self.doubts: dict[str, None] = {}

    def problem(self, error: InputError) -> None:
        """Adds an error, with the scenario's file in front if it names none."""
        line = str(error)
        named = error.source is not None or self.path is None
        self.problems[line if named else f"{self.path}: {line}"] = None

    def doubt(self, line: str) -> None:
        self.doubts[line] = None


def examine(scenario: Scenario) -> Examination:
    """Returns what can be said of a scenario before it is planned.

    Args:
        scenario: The scenario, which is valid in itself.
    """
    found = _Findings(scenario.path)
    reviews = {name: _review(scenario, name, found) for name in (*SIDES, "object")}
    arms = tuple(_arm(scenario, side, reviews[side], found) for side in SIDES)
    body: Body | None = None
    chain: ClosedChain | None = None
    ends: tuple[EndFacts, ...] = ()
    try:
        body = read_object(scenario)
    except InputError as error:
        found.problem(error)
    if body is not None and all(arms) and not found.problems:
        try:
            chain = build_chain(scenario)
        except InputError as error:
            found.problem(error)
    if chain is not None:
        ends = _ends(scenario, chain, found)
        try:
            joint_weights(scenario, chain)
        except ScenarioError as error:
            found.problem(error)
    for remark in scenario_remarks(scenario):
        found.doubt(remark)
    return Examination(
        scenario=scenario,
        arms=(arms[0], arms[1]),
        body=body,
        chain=chain,
        ends=ends,
        problems=tuple(found.problems),
        doubts=tuple(found.doubts),
    )


def _review(scenario: Scenario, name: str, found: _Findings) -> Review | None:
    try:
        path = object_path(scenario) if name == "object" else urdf_path(scenario, name)  # type: ignore[arg-type]
    except InputError as error:
        found.problem(error)
        return None
    packages = scenario.robot.packages if scenario.robot else ()
    review = review_urdf(path, packages, scenario.directory)
    found.problems |= dict.fromkeys(review.problems)
    # an object may well be a point mass, a link of an arm hardly
    doubts = [text for text in review.doubts if name != "object" or "point mass" not in text]
    found.doubts |= dict.fromkeys(doubts)
    return review


def _arm(
    scenario: Scenario, side: Side, review: Review | None, found: _Findings
) -> ArmFacts | None:
    try:
        arm = read_arm(scenario, side)
    except InputError as error:
        found.problem(error)
        return None
    review = review or Review(arm.urdf.path)
    masses = review.carried_by(arm.joint_names)
    _doubt_arm(arm, review, masses, found)
    return ArmFacts(
        arm=arm,
        joint_types=tuple(review.joint_types.get(name, "") for name in arm.joint_names),
        masses=masses,
        fixed_masses={link: m for link, m in review.masses.items() if link not in masses},
    )


def _doubt_arm(arm: Arm, review: Review, masses: dict[str, float], found: _Findings) -> None:
    where = f"{arm.urdf.path}: "
    for limit, name in ((arm.effort_limit, "effort"), (arm.velocity_limit, "speed")):
        without = [j for j, x in zip(arm.joint_names, limit, strict=True) if np.isinf(x)]
        if without:
            found.doubt(f"{where}no {name} limit on {', '.join(without)}")
    for joint in arm.joint_names:
        if not any(joint in review.ancestors(link) for link in masses):
            found.doubt(f"{where}joint {joint} moves no link that has a mass")
    if arm.posture is None:
        found.doubt(
            f"{arm.side}.posture is not given: the elbow's side is left to the search from the "
            "neutral posture"
        )
        return
    outside = (arm.posture < arm.lower) | (arm.posture > arm.upper)
    for k in np.flatnonzero(outside):
        found.doubt(
            f"{arm.side}.posture: {arm.joint_names[k]} at {arm.posture[k]:g} is outside its range "
            f"{arm.lower[k]:.4g} to {arm.upper[k]:.4g}"
        )


def _ends(scenario: Scenario, chain: ClosedChain, found: _Findings) -> tuple[EndFacts, ...]:
    """Returns start and goal; what is wrong with them goes to `found`."""
    try:
        transport = _transport(scenario, chain, found)
    except UnreachableError as error:
        before = len(found.problems)
        ends = tuple(_alone(scenario, chain, name, found) for name in ("start", "goal"))
        if len(found.problems) == before:  # each within reach, but not one from the other
            found.problem(error)
        return ends
    if not transport.straight:
        found.doubt(
            "the object cannot go along the straight line from start to goal: the solve begins "
            "from an interpolation of the joints"
        )
    ends = tuple(
        _end(chain, end.name, end.pose.position, end.posture, found)
        for end in (transport.start, transport.goal)
    )
    conditions = closure_condition(chain, transport.guess)
    worst = int(np.argmax(conditions))
    if conditions[worst] > NEAR_SINGULAR > max(end.closure_condition for end in ends):
        found.doubt(
            f"the closed chain comes near a singularity on the way, {transport.share[worst]:.0%} "
            f"of the duration into the first guess: condition number {conditions[worst]:.3g}"
        )
    return ends


def _transport(scenario: Scenario, chain: ClosedChain, found: _Findings) -> Transport:
    """Returns the motion asked for, without the end conditions that do not fit.

    Raises:
        UnreachableError: Start or goal cannot be reached.
    """
    aside: set[str] = set()
    while True:
        try:
            return make_transport(scenario, chain)
        except ScenarioError as error:
            if error.key is None or error.key in aside:
                raise
            found.problem(error)
            # without that entry the next one shows
            aside.add(error.key)
            scenario = scenario.override({error.key: None})


def _alone(scenario: Scenario, chain: ClosedChain, name: str, found: _Findings) -> EndFacts:
    """Returns one end, whether or not the other one can be reached."""
    import pinocchio as pin

    given = getattr(scenario.task, name)
    position = np.array(given.xyz, dtype=float)
    rotation = None if given.rpy is None else pin.rpy.rpyToMatrix(*given.rpy)
    try:
        posture = find_posture(
            chain,
            ObjectPose(position, rotation),
            reference_posture(scenario, chain),
            f"task.{name}.xyz",
            random_seed=scenario.solver.seed,
        )
    except UnreachableError as error:
        found.problem(error)
        return EndFacts(name, position, None)
    return _end(chain, name, position, posture, found)


def _end(
    chain: ClosedChain, name: str, position: np.ndarray, posture: np.ndarray, found: _Findings
) -> EndFacts:
    arms = arm_conditions(chain, posture)
    closure = float(closure_condition(chain, posture[None])[0])
    for what, condition in (
        ("the left arm", arms[0]),
        ("the right arm", arms[1]),
        ("the closed chain", closure),
    ):
        if condition > NEAR_SINGULAR:
            found.doubt(
                f"{what} stands {'at' if condition > SINGULAR else 'near'} a singularity at the "
                f"{name} (condition number {condition:.3g}): move the {name} or choose another "
                "posture"
            )
    return EndFacts(name, position, posture, closure, arms)
