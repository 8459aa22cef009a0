"""What a transcription needs of a mechanism, and the recursion that suits it."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from peers.task import Task


@dataclass(frozen=True, eq=False)
class Dynamics:
    """A mechanism in CasADi: inverse dynamics, so that the torques are explicit.

    Attributes:
        point: (q, v, a, wrench) to (tau, relative acceleration of the hands).
        gap: q to the offset between the hands, (m,).
        start: q to what must vanish of the object's pose at the start, (r,).
        goal: Likewise at the goal.
        wrench: Rows of a wrench (force; moment) in world axes that the pair transmits, m of them.
    """

    point: ca.Function
    gap: ca.Function
    start: ca.Function
    goal: ca.Function
    wrench: tuple[int, ...]


def make_dynamics(task: Task) -> Dynamics:
    """Returns the cheapest dynamics that cover the task's mechanism."""
    from peers.casadi_planar import is_covered, planar_dynamics
    from peers.casadi_spatial import spatial_dynamics

    return planar_dynamics(task) if is_covered(task) else spatial_dynamics(task)
