"""Squeezes without bound: why minimum torque change may have no optimum.

A squeeze that stays the same changes no torque. Where neither end prescribes it and it loads some
joints alike all along (an internal moment about the parallel axes of two wrists and two bases, for
one), it may grow without bound: the harder the hands squeeze, the smaller the turns of the object
that balance any other load, and the cost falls towards a limit that no motion attains.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from planner.boundary_value_problem import BoundaryValueProblem
from planner.constrained_dynamics import pseudo_inverse_torque
from planner.outcome import Failure, failure
from planner.solvers.spectral import SpectralResult

if TYPE_CHECKING:
    from planner.scenario import Scenario

_SQUEEZE = 1e3  # times the torques that the motion needs: beyond all that a plan may ask for


def unbounded_squeeze(
    scenario: Scenario, problem: BoundaryValueProblem, result: SpectralResult
) -> Failure | None:
    """Returns the failure of a motion that squeezes the object beyond all measure, else None.

    Args:
        scenario: What is asked.
        problem: Its problem.
        result: Where the spectral method ended, before it converged.
    """
    if np.any(problem.criterion.torque_weights):
        return None
    torques = result.point.torques
    needed = float(np.max(np.abs(pseudo_inverse_torque(torques.tangent.s, torques.tau))))
    reached = float(np.max(np.abs(torques.tau)))
    if not reached > _SQUEEZE * max(needed, 1e-9):
        return None
    return failure(
        "unbounded-squeeze",
        "the cost falls the further, the harder the hands squeeze the object: the torques reached "
        f"{reached:.2g} Nm where the motion needs {needed:.2g} Nm; a constant squeeze costs "
        "nothing in torque change, and neither end prescribes one",
        scenario,
        cost=result.cost,
        torque=reached,
        torque_needed=needed,
    )
