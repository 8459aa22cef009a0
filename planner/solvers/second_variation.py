"""Whether an extremal motion is a minimum: the second derivative of its cost along any change.

Pontryagin's conditions hold at saddle points too. Among polynomials the second variation is a
matrix, the exact Hessian, and its least eigenvalue tells the two apart.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from planner.solvers.spectral_curvature import torque_curvature
from planner.solvers.spectral_derivatives import normal_equations
from planner.solvers.spectral_problem import Point, SpectralProblem
from planner.solvers.spectral_unknowns import metric
from planner.solvers.trust_region import reduce_model


def least_second_variation(problem: SpectralProblem, point: Point) -> tuple[float, np.ndarray]:
    """Returns the least second variation of the cost, relative to it, and the change it belongs to.

    It is per square of the change's size, the root mean square of postures [rad] and speeds [rad
    per duration] together; the multiplier follows as it costs least. Positive: every small change
    makes the motion dearer. Negative: the change returned, of size one, makes it cheaper.

    Args:
        problem: The minimisation.
        point: Where it ended.

    Raises:
        scipy.linalg.LinAlgError: The cost has no minimum in the multiplier.
    """
    slope, matrix = normal_equations(problem, point)
    hessian = matrix + torque_curvature(problem, point)
    if not np.all(np.isfinite(hessian)):
        raise scipy.linalg.LinAlgError("the second derivatives are not finite")
    root = metric(problem, point)
    model = reduce_model(slope, hessian, root, problem.motion, problem.force)
    change = np.empty(problem.size)
    change[problem.motion] = model.vectors[:, 0]
    change[problem.force] = model.force_follow @ model.vectors[:, 0]
    return float(model.values[0]) / max(point.cost, 1e-300), change
