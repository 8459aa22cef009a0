"""Criteria: what a motion is optimal in, one file each."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from planner.chain import ClosedChain
from planner.costates import StateCost
from planner.criteria.base import Criterion
from planner.criteria.mixed import Mixed
from planner.criteria.torque import Torque
from planner.criteria.torque_change import TorqueChange
from planner.errors import ScenarioError

if TYPE_CHECKING:
    from planner.scenario import Scenario

__all__ = ["Criterion", "Mixed", "Torque", "TorqueChange", "joint_weights", "make_criterion"]


def joint_weights(scenario: Scenario, chain: ClosedChain) -> np.ndarray:
    """Returns one weight per joint, (N,): one, the inverse of its effort limit, or as given.

    Effort weights spare the joints that can give little. They are the default for redundant arms,
    whose light wrists would otherwise bear what the shoulders could.

    Raises:
        ScenarioError: The numbers given do not fit the joints, or a joint has no effort limit.
    """
    given = scenario.criterion.weights
    if given == "auto":
        limits = chain.both("effort_limit")
        given = "effort" if chain.redundant and np.isfinite(limits).all() else "unit"
    if given == "unit":
        return np.ones(chain.n)
    if given == "effort":
        limits = chain.both("effort_limit")
        if not np.isfinite(limits).all():
            without = [
                name
                for name, limit in zip(chain.joint_names, limits, strict=True)
                if not np.isfinite(limit)
            ]
            raise ScenarioError(
                f"effort weights need an effort limit on every joint; {without} have none",
                source=scenario.path,
                key="criterion.weights",
                value="effort",
                remedy='add <limit effort="..."/> to the URDF, or give one number per joint',
            )
        weights: np.ndarray = 1.0 / limits
        return weights
    weights = np.array(given, dtype=float)
    if len(weights) != chain.n:
        raise ScenarioError(
            f"has {len(weights)} weights for {chain.n} joints",
            source=scenario.path,
            key="criterion.weights",
            value=list(given),
            remedy=f"give one per joint: {', '.join(chain.joint_names)}",
        )
    return weights


def make_criterion(
    scenario: Scenario,
    chain: ClosedChain,
    reference: np.ndarray,
    *,
    speed_cost: float | None = None,
) -> Criterion | None:
    """Returns the criterion to be minimised; None for jerk, whose motion is known beforehand.

    Args:
        scenario: The scenario.
        chain: Its closed chain.
        reference: Posture that a posture cost refers to, (N,) [rad].
        speed_cost: Weight of the squared joint speeds in place of the scenario's.

    Raises:
        ScenarioError: The weights do not fit the joints.
    """
    given = scenario.criterion
    if given.kind == "jerk":
        return None
    weights = joint_weights(scenario, chain)
    speed = 0.0 if given.speed_cost == "auto" else float(given.speed_cost)
    if speed_cost is not None:
        speed = speed_cost
    state_cost = None
    if speed > 0.0 or given.posture_cost > 0.0:
        state_cost = StateCost(speed, given.posture_cost, reference)
    none = np.zeros(chain.n)
    if given.kind == "torque":
        return Torque(chain.n, chain.p, np.empty(0), weights, state_cost)
    if given.kind == "mixed" and given.torque_share == 1.0:
        return Torque(chain.n, chain.p, np.empty(0), weights, state_cost)
    if given.kind == "mixed":
        share = given.torque_share
        return Mixed(chain.n, chain.p, (1.0 - share) * weights, share * weights, state_cost)
    return TorqueChange(chain.n, chain.p, weights, none, state_cost)
