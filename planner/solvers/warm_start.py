"""From the spectral result to states and costates, and to a mesh that suits them.

Pontryagin's equations read backwards give the costates: n3 = -W d tau/dt, then n2 from
dn3/dt = -B'n2 - V tau, then n1 = -dn2/dt - S' dH/dv.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from planner.boundary_value_problem import BoundaryValueProblem, Guess
from planner.constrained_dynamics import Motion, linearize
from planner.costates import hamiltonian_gradient
from planner.solution import Solution
from planner.solvers.basis import (
    gauss_nodes,
    legendre_analysis,
    legendre_at_nodes,
    legendre_on_grid,
    legendre_values,
)
from planner.solvers.inverse_torques import inverse_torques
from planner.solvers.spectral import SpectralResult
from planner.vectors import transpose

_GRID = 201  # samples of the curves on which the mesh is made
_FEWEST, _MOST = 12, 1500
_SAMPLES = 1.4  # per degree of the states: the Jacobian's along the motion
# rms of (1 - 2s) s (1 - s) / 12 with the weights of a Lobatto rule: slope error of a cubic through
# exact ends per fourth derivative and cubed interval
_CUBIC = np.sqrt(49.0 / 90.0) * np.sqrt(3.0 / 7.0) / 84.0


@dataclass(frozen=True, eq=False)
class States:
    """States and costates as polynomials of the share of the duration.

    Attributes:
        coefficients: Legendre coefficients, (degree + 1, 2 * state_size).
    """

    coefficients: np.ndarray

    def __call__(self, share: np.ndarray, order: int = 0) -> np.ndarray:
        """Returns states and costates, or their derivatives in the share, (K, 2 * state_size)."""
        return legendre_values(np.asarray(share), len(self.coefficients) - 1, order) @ (
            self.coefficients
        )


def spectral_states(problem: BoundaryValueProblem, result: SpectralResult) -> States:
    """Returns states and costates of a spectral result as polynomials."""
    criterion, transport = problem.criterion, problem.transport
    spectral, point = result.problem, result.point
    degree, count = spectral.degree, len(spectral.nodes.u)
    # what follows from a derivative is known less well: a lower degree fits it
    rough = degree - 3
    coefficients = np.zeros((degree + 1, 2 * criterion.state_size))
    fit = legendre_analysis(count, degree)
    coefficients[:, criterion.at_y] = fit @ point.torques.tangent.q[:, transport.joints.independent]
    coefficients[:, criterion.at_rate] = fit @ point.rate
    mu = -criterion.torque_weights * point.torques.tau
    if criterion.torque_is_state:
        coefficients[:, criterion.at_tau] = fit @ point.torques.tau
        n3 = legendre_analysis(count, rough) @ (-criterion.rate_weights * point.slope)
        coefficients[: rough + 1, criterion.at_n3] = n3
        mu = mu - legendre_at_nodes(count, rough, 1) @ n3 / transport.duration
    n1, n2 = _adjoint(problem, result, mu, rough)
    coefficients[: rough + 1, criterion.at_n1] = n1
    coefficients[: rough + 1, criterion.at_n2] = n2
    return States(coefficients)


def _adjoint(
    problem: BoundaryValueProblem, result: SpectralResult, mu: np.ndarray, degree: int
) -> tuple[np.ndarray, np.ndarray]:
    """Returns Legendre coefficients of n1 and n2, (degree + 1, p) each.

    They solve the adjoint equations, linear in them along a known motion, and B'n2 = mu, as a
    least-squares problem at the nodes: better than differentiating mu twice.
    """
    criterion, transport = problem.criterion, problem.transport
    nodes, torques, duration = result.problem.nodes, result.point.torques, transport.duration
    at, p, count = torques.tangent, criterion.p, len(nodes.u)
    reduced = np.linalg.inv(transpose(at.s) @ torques.load[:, 2] @ at.s)
    motion = Motion(at, torques.v, torques.load[:, 2], reduced, torques.a, torques.multiplier)
    linear = linearize(motion, torques.derivatives)
    source = hamiltonian_gradient(
        motion, torques.derivatives, np.zeros((count, p)), criterion.state_cost
    )
    values = legendre_at_nodes(count, degree, 0)[:, None, None]
    slopes = legendre_at_nodes(count, degree, 1)[:, None, None]
    # unknowns and equations are measured as in the scaled boundary value problem
    unit1, unit2 = problem.scale[criterion.at_n1], problem.scale[criterion.at_n2]
    unit3 = np.full(mu.shape[1], problem.scale[criterion.state_size :].max())
    if criterion.torque_is_state:
        unit3 = problem.scale[criterion.at_n3]
    along = np.concatenate([linear.along_y, linear.along_rate, linear.along_torque], axis=2)
    matrix = np.zeros((count, along.shape[2], 2, p, degree + 1))
    joint = np.arange(p)
    matrix[:, joint, 0, joint] = (slopes * unit1[:, None])[:, 0]
    matrix[:, p + joint, 0, joint] = (values * (duration * unit1)[:, None])[:, 0]
    matrix[:, :, 1] = (transpose(along) * (duration * unit2))[..., None] * values
    matrix[:, p + joint, 1, joint] += (slopes * unit2[:, None])[:, 0]
    right = np.concatenate([-source.along_y, -source.along_rate, mu], axis=1) * duration
    weight = np.sqrt(nodes.weights)[:, None] / np.concatenate([unit1, unit2, unit3])
    matrix *= weight[..., None, None, None]
    found = _least_squares(matrix.reshape(right.size, -1), (right * weight).ravel())
    found = found.reshape(2, p, degree + 1)
    return found[0].T * unit1, found[1].T * unit2


def _least_squares(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Returns the least-squares solution, from the normal equations where these will do.

    In its units the problem is well conditioned (some thousands on arms of seven joints): the
    normal equations give ten digits in a seventh of a pivoted QR's time.
    """
    _, found, status = scipy.linalg.lapack.dposv(matrix.T @ matrix, matrix.T @ right, lower=1)
    if status:
        found = scipy.linalg.lstsq(matrix, right, cond=1e-12, check_finite=False)[0]
    result: np.ndarray = found
    return result


def adapted_mesh(
    slopes: np.ndarray, fourth: np.ndarray, tolerance: float, *, margin: float = 0.08
) -> np.ndarray:
    """Returns a mesh on which cubic collocation keeps its residual below the tolerance.

    The residual of a cubic through exact values and slopes grows with the cube of an interval
    times the fourth derivative: nodes are spread so that this is the same everywhere.

    Args:
        slopes: Scaled states' derivatives at evenly spaced shares from 0 to 1, (K, .).
        fourth: Their fourth derivatives there.
        tolerance: Relative residual allowed.
        margin: Share of it to aim for.
    """
    density = np.cbrt(np.sqrt((fourth**2 / (1.0 + np.abs(slopes)) ** 2).sum(axis=1)))
    density = np.maximum(density, 0.1 * np.max(density))
    mass = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    mass /= len(density) - 1
    intervals = mass[-1] * np.cbrt(_CUBIC / (margin * tolerance))
    count = int(np.clip(np.ceil(intervals), _FEWEST, _MOST)) + 1 if np.isfinite(intervals) else 40
    mesh = np.interp(np.linspace(0.0, mass[-1], count), mass, np.linspace(0.0, 1.0, len(density)))
    mesh[0], mesh[-1] = 0.0, 1.0
    return mesh


class MotionJacobian:
    """The equations' exact Jacobian along a known motion, interpolated from a few samples.

    Beside the solution it changes no more than the states do: the samples that resolve these
    give it to a part in a thousand, and Newton's method converges as with the whole.
    """

    def __init__(self, problem: BoundaryValueProblem, states: States) -> None:
        """Takes the motion's states and costates; evaluates at Gauss nodes."""
        count = int(np.ceil(_SAMPLES * (len(states.coefficients) - 1)))
        u = gauss_nodes(count).u
        values = problem.jacobian(u, problem.scaled(states(u)))
        self._shape = values.shape[:2]
        self._coefficients = values.reshape(-1, count) @ legendre_analysis(count, count - 1).T

    def __call__(self, share: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Returns d(dz/ds)/dz on the motion, (., ., K), wherever the scaled states z are."""
        values = self._coefficients @ legendre_values(share, self._coefficients.shape[1] - 1).T
        return values.reshape(*self._shape, len(share))


def warm_start(
    problem: BoundaryValueProblem, result: SpectralResult, tolerance: float
) -> tuple[Guess, States]:
    """Returns the guess for collocation on its adapted mesh, and the polynomials it samples."""
    states = spectral_states(problem, result)
    criterion = problem.criterion
    # what is differentiated often is known too roughly to tell where nodes are needed
    told = criterion.at_tau if criterion.torque_is_state else criterion.at_n2
    columns = np.r_[criterion.at_y, criterion.at_rate, told]
    scaled = (states.coefficients / problem.scale)[:, columns]
    degree = len(scaled) - 1
    slopes, fourth = (legendre_on_grid(_GRID, degree, order) @ scaled for order in (1, 4))
    mesh = adapted_mesh(slopes, fourth, tolerance)
    return Guess(mesh, states(mesh), result.cost), states


def spectral_solution(problem: BoundaryValueProblem, result: SpectralResult) -> Solution:
    """Returns the spectral result as a solution: states from its curves, costates as fitted.

    Its residual is that of the adjoint equations with these costates, whose differentiation
    costs accuracy that the motion itself has; collocation gives the certificate.
    """
    criterion, transport = problem.criterion, problem.transport
    duration, curves = transport.duration, result.curves
    known: list[States] = []

    def states(share: np.ndarray) -> np.ndarray:
        if not known:  # only who asks for states needs the costates
            known.append(spectral_states(problem, result))
        x = known[0](share)
        y, rate = curves.y(share), curves.y(share, 1) / duration
        x[:, criterion.at_y], x[:, criterion.at_rate] = y, rate
        if criterion.torque_is_state:
            at, _ = problem.coordinates.tangent(share, y)
            acceleration = curves.y(share, 2) / duration**2
            torques = inverse_torques(
                transport.chain,
                transport.joints,
                at,
                rate,
                acceleration,
                curves.multiplier(share),
            )
            x[:, criterion.at_tau] = torques.tau
        return x

    return Solution(
        problem=problem,
        method="spectral",
        mesh=np.linspace(0.0, 1.0, 41),
        states=states,
        cost=result.cost,
        known_residual=None,
        iterations=result.iterations,
        refinements=result.refinements,
        seconds=result.seconds,
        evidence={"spectral_degree": float(result.degree), "spectral_tail": result.tail},
        second_variation=result.second_variation,
    )
