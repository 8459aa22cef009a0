"""Torques that hold the closed chain at rest: least norm, or with a preload between the hands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.chain import ClosedChain
from planner.constrained_dynamics import Tangent, pseudo_inverse_torque
from planner.errors import ScenarioError
from planner.vectors import cross, matvec, transpose


@dataclass(frozen=True, eq=False)
class Preload:
    """Internal wrench: what the left hand applies to the object less what the right hand does.

    Attributes:
        force: F = F_left - F_right in world axes, (3,) [N].
        moment: Likewise about the object's frame, (3,) [Nm].
    """

    force: np.ndarray
    moment: np.ndarray


def gravity_torque(chain: ClosedChain, q: np.ndarray) -> np.ndarray:
    """Returns G(q) with the whole object on the left hand, (K, N) [Nm]."""
    still = np.zeros_like(q)
    return chain.dynamics.inverse_dynamics(q, still, still)


def static_torque(chain: ClosedChain, at: Tangent) -> np.ndarray:
    """Returns the least-norm torques that hold the postures, (K, N) [Nm].

    All torques that hold it have the same share in the range of S: that share is the shortest.
    """
    return pseudo_inverse_torque(at.s, gravity_torque(chain, at.q))


def preload_torque(chain: ClosedChain, at: Tangent, preload: Preload) -> np.ndarray:
    """Returns the torques that hold the postures with a preload between the hands, (K, N) [Nm].

    Each hand carries half the object's weight, and plus or minus half the internal wrench. What
    the pair cannot transmit of the right hand's half weight stays with the left hand.
    """
    position, rotation = chain.object_pose(at.at)
    point, _ = chain.right_tip(at.at)
    weight = -chain.body.mass * chain.gravity
    force = np.broadcast_to(0.5 * (weight - preload.force), position.shape)
    lever = rotation @ chain.body.com
    moment = 0.5 * (cross(lever, np.broadcast_to(weight, lever.shape)) - preload.moment)
    at_point = moment - cross(point - position, force)
    # the hand feels the opposite of what it applies
    multiplier = -at.loop.multiplier(np.concatenate([force, at_point], axis=1))
    return gravity_torque(chain, at.q) - matvec(transpose(at.gamma), multiplier)


def refuse_untransmitted(chain: ClosedChain, end: str, preload: Preload) -> None:
    """Refuses a preload that the pair cannot transmit.

    Raises:
        ScenarioError: The pair leaves motions free along which the preload would act.
    """
    linear, angular = chain.pair.blocked[:, :3], chain.pair.blocked[:, 3:]
    rows = (3, 3) if chain.normal is None else (2, 1)
    blocked = [int(np.linalg.matrix_rank(part)) if part.size else 0 for part in (linear, angular)]
    for name, vector, need, have in (
        ("internal_force", preload.force, rows[0], blocked[0]),
        ("internal_moment", preload.moment, rows[1], blocked[1]),
    ):
        if np.any(vector) and have < need:
            raise ScenarioError(
                f"a {chain.pair.name} pair cannot transmit it",
                key=f"boundary.{end}.{name}",
                value=vector.tolist(),
                remedy="set it to zero or use a pair that transmits it, such as rigid",
            )
    if chain.normal is not None:
        out = abs(float(chain.normal @ preload.force))
        if out > 1e-9:
            raise ScenarioError(
                "has a component across the plane in which the arms move",
                key=f"boundary.{end}.internal_force",
                value=preload.force.tolist(),
                remedy="the joints carry no force there: set that component to zero",
            )
