"""Motions to start from: those of a plan made before, other joints' curves, random detours."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from planner.constrained_dynamics import Tangent
from planner.errors import InputError
from planner.independent_joints import choose_joints
from planner.solvers.basis import legendre_fit
from planner.solvers.curves import Curves
from planner.transport import Transport
from planner.vectors import cross

if TYPE_CHECKING:
    from planner.result import Plan

_SAMPLES = 4  # per degree, closer together towards the ends, as a fit of that degree needs them
_DEGREE = 18
_FAR = 0.1  # of the largest singular value: well away from a singularity
_BETTER = 3.0  # times farther from a singularity, or the joints stay as they are


def fit_curves(
    transport: Transport,
    share: np.ndarray,
    q: np.ndarray,
    multiplier: np.ndarray | None,
    degree: int = _DEGREE,
) -> Curves:
    """Returns polynomials through a motion, for the transport's independent joints.

    Args:
        transport: Whose joints they are for.
        share: Shares of the duration, (K,).
        q: Postures, (K, N) [rad].
        multiplier: lambda, (K, m); None for zero.
        degree: Degree, unless the samples are too few.
    """
    degree = min(degree, len(share) - 1)
    if multiplier is None:
        multiplier = np.zeros((len(share), transport.chain.m))
    y = q[:, transport.joints.independent]
    fit = legendre_fit(np.asarray(share, dtype=float).tobytes(), degree)
    return Curves(fit @ y, fit @ multiplier)


def curves_of_plan(transport: Transport, plan: Plan) -> Curves:
    """Returns the polynomials of a plan, to start a similar task from.

    Args:
        transport: The task to be started.
        plan: A plan of the same arms, perhaps with another object, goal or duration.

    Raises:
        InputError: The plan is of other arms.
    """
    chain = transport.chain
    if plan.joint_names != chain.joint_names:
        raise InputError(
            "the plan to start from is of other arms",
            value=list(plan.joint_names),
            remedy=f"it must have the joints {', '.join(chain.joint_names)}",
        )
    degree = int(plan.checks.get("spectral_degree", _DEGREE))
    share = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, _SAMPLES * degree))
    every = np.unique(np.rint(share * (len(plan.time) - 1)).astype(int))
    q = plan.q[every]
    at = chain.dynamics.placements(q)
    position, _ = chain.object_pose(at)
    point, _ = chain.right_tip(at)
    force = plan.hand_force_right[every]
    moment = plan.hand_moment_right[every] - cross(point - position, force)
    multiplier = -chain.loop(at).multiplier(np.concatenate([force, moment], axis=1))
    return fit_curves(transport, plan.time[every] / plan.duration, q, multiplier, degree)


def with_better_joints(transport: Transport, share: np.ndarray, at: Tangent) -> Transport | None:
    """Returns the task with independent joints that suit a motion better, if any do so clearly.

    Args:
        transport: The task.
        share: Shares of the duration, (K,).
        at: Freedoms along the motion, (K).
    """
    gamma, q = at.gamma, at.q
    # norms bound singular values: most motions need none of these
    largest = (gamma[:, :, transport.joints.dependent] ** 2).sum(axis=(1, 2)).max()
    if _FAR**2 * largest * (at.inverse**2).sum(axis=(1, 2)).max() < 1.0:
        return None
    mine = np.linalg.svd(gamma[:, :, transport.joints.dependent], compute_uv=False)
    if np.min(mine[:, -1]) > _FAR * np.max(mine[:, 0]):
        return None
    other = choose_joints(transport.chain, q)
    its = np.linalg.svd(gamma[:, :, other.dependent], compute_uv=False)
    if np.min(its[:, -1]) < _BETTER * np.min(mine[:, -1]):
        return None
    return replace(transport, joints=other, share=np.array(share), guess=np.array(q))


def detour(transport: Transport, generator: np.random.Generator, size: float) -> Curves:
    """Returns a random motion around the guess, its ends moved where postures are free.

    Args:
        transport: The task.
        generator: Source of the numbers.
        size: Typical distance from the guess [rad].
    """
    independent = transport.joints.independent
    share = transport.share
    waves = np.arange(0, 4)
    shape = np.cos(np.pi * share[:, None] * waves)
    way = shape @ (generator.normal(size=(len(waves), len(independent))) / (1.0 + waves)[:, None])
    held_start, held_goal = transport.start.held, transport.goal.held
    if held_start:
        way = way - way[:1] * (1.0 - share[:, None])
    if held_goal:
        way = way - way[-1:] * share[:, None]
    q = transport.guess.copy()
    q[:, independent] += size * way
    return fit_curves(transport, share, q, None)
