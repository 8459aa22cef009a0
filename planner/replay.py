"""Forward replay: the plan's torques, integrated in Pinocchio's own constrained dynamics.

Nothing of the planner's mathematics takes part: Pinocchio closes the loop, see `planner.rig`, and
the classical Runge-Kutta method integrates. Where the object ends up tells whether the torques
really produce the motion.

A motion that is unstable without feedback, as arms under gravity often are, amplifies the least
error until it says nothing of the torques any more. So a replay that does not arrive is done again
in short windows, each of which starts where the plan is.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from planner.chain import ClosedChain
from planner.result import Plan
from planner.rig import Rig

TOLERANCE = 1e-4  # m: what a replay that arrives may miss the plan by
_WINDOWS = 10
_LONGEST_WINDOW = 0.2  # s: arms that fall do not amplify errors much within that time
_SMALL = 1e-2  # m: errors up to this size grow in proportion to themselves


def replay_checks(chain: ClosedChain, plan: Plan) -> dict[str, Any]:
    """Returns what the replay says of a plan, by name.

    `replay_end` and `replay_max` [m], the object's error at the end and the largest one, unless it
    diverges. Where it does, or exceeds the tolerance, also `replay_window` [m], the largest error
    within any window; `replay`, what that means, in words; and `replay_growth` [1/s], the rate at
    which small errors grow if the motion is unstable.
    """
    error = _finite(replay_error(chain, plan))
    largest = float(np.max(error))
    checks: dict[str, Any] = {}
    if np.isfinite(largest):
        checks |= {"replay_end": float(error[-1]), "replay_max": largest}
    if largest <= TOLERANCE:
        return checks
    count = window_count(plan)
    span = f"{plan.duration / count:.2g} s"
    within = float(np.max(_finite(replay_error(chain, plan, count))))
    if np.isfinite(within):
        checks["replay_window"] = within
    # what torques that are wrong by as much all the time would make of it, if nothing amplified it
    steady = within * count**2
    if within > TOLERANCE or largest <= 10.0 * steady:
        off = f"{within:.1e} m off" if np.isfinite(within) else "lost"
        checks["replay"] = (
            f"the torques do not produce the motion: started from the plan's own state they have "
            f"the object {off} within {span} (or solver.samples are too few to replay it)"
        )
        return checks
    growth = growth_rate(error, 2.0 * float(plan.time[1]), 10.0 * within)
    pace = ""
    if growth is not None:
        checks["replay_growth"] = growth
        pace = f", small errors grow tenfold every {np.log(10.0) / growth:.2g} s"
    checks["replay"] = (
        f"the motion is unstable without feedback{pace}: started from the plan's own state the "
        f"torques keep the object within {within:.1e} m of the plan for {span}, but not to the end"
    )
    return checks


def _finite(error: np.ndarray) -> np.ndarray:
    """Returns errors, infinite ones in place of what is no number."""
    return np.nan_to_num(error, nan=np.inf, posinf=np.inf)


def window_count(plan: Plan) -> int:
    """Returns in how many windows the motion is cut: ten, or more if these would be too long.

    None is shorter than a step.
    """
    wanted = max(_WINDOWS, int(np.ceil(plan.duration / _LONGEST_WINDOW)))
    return min(wanted, (len(plan.time) - 1) // 2)


def growth_rate(error: np.ndarray, step: float, noise: float) -> float | None:
    """Returns the mean rate at which an error grows while it is small, but no mere noise [1/s].

    Args:
        error: The error over time, (K,) [m].
        step: Time between two of them [s].
        noise: Error up to which other causes than growth may prevail [m].

    Returns:
        None if the error leaves the noise and is large at the next moment.
    """
    large = np.flatnonzero(~(error < _SMALL))
    last = int(large[0]) - 1 if len(large) else len(error) - 1
    first = int(np.flatnonzero(error[: last + 1] <= max(noise, error[0]))[-1])
    if error[first] <= 0.0 or error[last] <= error[first]:
        return None
    return float(np.log(error[last] / error[first]) / (step * (last - first)))


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
