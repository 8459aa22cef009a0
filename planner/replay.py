"""Forward replay: the plan's torques, integrated in Pinocchio's own constrained dynamics.

Nothing of the planner's mathematics takes part: Pinocchio closes the loop, see `planner.rig`, and
the classical Runge-Kutta method integrates. Where the object ends up tells whether the torques
really produce the motion.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from planner.chain import ClosedChain
from planner.result import Plan
from planner.rig import Rig


def replay(chain: ClosedChain, plan: Plan, windows: int = 1) -> np.ndarray:
    """Returns the object's positions when the torques drive the arms, (N', 3) [m].

    A Runge-Kutta step spans two samples of the plan, whose torques are used as they are.

    Args:
        chain: The closed chain of the plan's scenario.
        plan: The plan; N' is every second of its samples.
        windows: In how many parts of equal length, to a step, the motion is cut. Each starts from
            the plan's own state; where two of them meet, the position is that of the earlier.
    """
    rig = Rig(chain)
    postures = [plan.q[:1]]
    borders = 2 * np.linspace(0, (len(plan.time) - 1) // 2, windows + 1).round().astype(int)
    step = float(plan.time[2] - plan.time[0])
    for first, last in pairwise(borders):
        part = rig.run(plan.q[first], plan.v[first], plan.tau[first : last + 1], step)
        postures.append(part[1:])
    position, _ = chain.object_pose(chain.dynamics.placements(np.concatenate(postures)))
    return position


def replay_error(chain: ClosedChain, plan: Plan, windows: int = 1) -> np.ndarray:
    """Returns how far the replayed object is from the planned one over time, (N',) [m].

    Args:
        chain: The closed chain of the plan's scenario.
        plan: The plan.
        windows: In how many windows it is replayed, see `replay`.
    """
    with np.errstate(all="ignore"):
        position = replay(chain, plan, windows)
    error: np.ndarray = np.linalg.norm(
        position - plan.object_position[::2][: len(position)], axis=1
    )
    return error
