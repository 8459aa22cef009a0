"""From the spectral result to states and costates, and to a mesh that suits them.

Pontryagin's equations read backwards give the costates: n3 = -W d tau/dt, then n2 from
dn3/dt = -B'n2 - V tau, then n1 = -dn2/dt - S' dH/dv.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from planner.boundary_value_problem import BoundaryValueProblem, Guess
from planner.constrained_dynamics import Motion, linearize
from planner.costates import hamiltonian_gradient
from planner.solution import Solution
from planner.solvers.inverse_torques import inverse_torques
from planner.solvers.spectral import SpectralResult
from planner.vectors import transpose

_LOBATTO = np.array([-np.sqrt(3.0 / 7.0), 0.0, np.sqrt(3.0 / 7.0)])
_FEWEST, _MOST = 12, 1500


@dataclass(frozen=True, eq=False)
class States:
    """States and costates as polynomials of the share of the duration.

    Attributes:
        coefficients: Legendre coefficients, (degree + 1, 2 * state_size).
    """

    coefficients: np.ndarray

    def __call__(self, share: np.ndarray, order: int = 0) -> np.ndarray:
        """Returns states and costates, or their derivatives in the share, (K, 2 * state_size)."""
        c = self.coefficients
        if order:
            c = 2.0**order * np.polynomial.legendre.legder(c, order, axis=0)
        values: np.ndarray = np.polynomial.legendre.legval(2.0 * np.asarray(share) - 1.0, c).T
        return values


def spectral_states(problem: BoundaryValueProblem, result: SpectralResult) -> States:
    """Returns states and costates of a spectral result as polynomials."""
    criterion, transport = problem.criterion, problem.transport
    spectral, point = result.problem, result.point
    nodes, degree = spectral.nodes, spectral.degree
    at = point.torques.tangent
    fit, _ = _fit(nodes.u, nodes.weights, degree, degree)
    # what follows from a derivative is known less well: a lower degree fits it
    rough, slope = _fit(nodes.u, nodes.weights, degree - 3, degree)
    x = np.zeros((len(nodes.u), 2 * criterion.state_size))
    x[:, criterion.at_y] = at.q[:, transport.joints.independent]
    x[:, criterion.at_rate] = point.rate
    mu = -criterion.torque_weights * point.torques.tau
    if criterion.torque_is_state:
        x[:, criterion.at_tau] = point.torques.tau
        n3 = -criterion.rate_weights * point.slope
        x[:, criterion.at_n3] = n3
        mu = mu - (slope @ n3) / transport.duration
    coefficients = fit @ x
    coefficients[:, criterion.at_n3] = rough @ x[:, criterion.at_n3]
    n1, n2 = _adjoint(problem, result, mu)
    coefficients[: len(n1), criterion.at_n1] = n1
    coefficients[: len(n2), criterion.at_n2] = n2
    return States(coefficients)


def _adjoint(
    problem: BoundaryValueProblem, result: SpectralResult, mu: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns Legendre coefficients of n1 and n2, (., p) each.

    They solve the adjoint equations, linear in them along a known motion, and B'n2 = mu, as a
    least-squares problem at the nodes: better than differentiating mu twice.
    """
    criterion, transport = problem.criterion, problem.transport
    nodes, torques, duration = result.problem.nodes, result.point.torques, transport.duration
    at, p = torques.tangent, criterion.p
    inertia = torques.load[:, 2]
    reduced = np.linalg.inv(transpose(at.s) @ inertia @ at.s)
    motion = Motion(at, torques.v, inertia, reduced, torques.a, result.point.multiplier)
    linear = linearize(motion, torques.derivatives)
    none = np.zeros((len(mu), p))
    source = hamiltonian_gradient(motion, torques.derivatives, none, criterion.state_cost)
    degree = result.problem.degree - 3
    points = 2.0 * nodes.u - 1.0
    values = np.polynomial.legendre.legvander(points, degree)
    slopes = np.polynomial.legendre.legval(
        points, 2.0 * np.polynomial.legendre.legder(np.eye(degree + 1), 1, axis=0)
    ).T
    count, size = values.shape
    root = np.sqrt(nodes.weights)
    # unknowns and equations are measured as in the scaled boundary value problem
    unit1, unit2 = problem.scale[criterion.at_n1], problem.scale[criterion.at_n2]
    unit3 = problem.scale[criterion.state_size :].max()
    unit3 = (
        problem.scale[criterion.at_n3] if criterion.torque_is_state else np.full(mu.shape[1], unit3)
    )

    def spread(basis: np.ndarray, matrix: np.ndarray) -> np.ndarray:
        """Returns rows (K, i, size, p) of matrix (K, i, p) times a curve on the basis."""
        return basis[:, None, :, None] * matrix[:, :, None, :]

    identity = np.broadcast_to(np.eye(p), (count, p, p))
    blocks = []
    for left, middle, right, unit in (
        (
            spread(slopes, identity) * unit1,
            spread(values, transpose(linear.along_y)) * (unit2 * duration),
            -source.along_y * duration,
            unit1,
        ),
        (
            spread(values, identity) * (unit1 * duration),
            spread(slopes, identity) * unit2
            + spread(values, transpose(linear.along_rate)) * (unit2 * duration),
            -source.along_rate * duration,
            unit2,
        ),
        (
            np.zeros((count, mu.shape[1], size, p)),
            spread(values, transpose(linear.along_torque)) * (unit2 * duration),
            mu * duration,
            unit3,
        ),
    ):
        rows = np.concatenate(
            [part.reshape(count, part.shape[1], -1) for part in (left, middle)], axis=2
        )
        weight = root[:, None] / unit
        blocks.append(
            ((rows * weight[..., None]).reshape(-1, 2 * size * p), (right * weight).ravel())
        )
    matrix = np.vstack([rows for rows, _ in blocks])
    target = np.concatenate([right for _, right in blocks])
    found = np.linalg.lstsq(matrix, target, rcond=1e-12)[0].reshape(2, size, p)
    return found[0] * unit1, found[1] * unit2


def _fit(
    u: np.ndarray, weights: np.ndarray, degree: int, rows: int
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the fit of Legendre coefficients to values at the nodes, and the fit's slope there.

    The fit has the given degree, its coefficients are filled up with zeros to `rows` + 1.
    """
    points = 2.0 * u - 1.0
    vandermonde = np.polynomial.legendre.legvander(points, degree)
    fit = np.zeros((rows + 1, len(u)))
    fit[: degree + 1] = (vandermonde * weights[:, None] * (2.0 * np.arange(degree + 1) + 1.0)).T
    slopes = np.polynomial.legendre.legval(
        points, 2.0 * np.polynomial.legendre.legder(np.eye(rows + 1), 1, axis=0)
    ).T
    return fit, slopes @ fit


def adapted_mesh(
    scaled: Callable[[np.ndarray, int], np.ndarray], tolerance: float, *, margin: float = 0.12
) -> np.ndarray:
    """Returns a mesh on which cubic collocation keeps its residual below the tolerance.

    The residual of a cubic through exact values and slopes grows with the cube of an interval
    times the fourth derivative: nodes are spread so that this is the same everywhere.

    Args:
        scaled: Gives scaled states' derivatives of some order at shares, (K, .).
        tolerance: Relative residual allowed.
        margin: Share of it to aim for.
    """
    fine = np.linspace(0.0, 1.0, 401)
    slopes, fourth = scaled(fine, 1), scaled(fine, 4)
    density = np.sqrt((fourth**2 / (1.0 + np.abs(slopes)) ** 2).sum(axis=1)) ** (1.0 / 3.0)
    density = np.maximum(density, 0.1 * np.max(density))
    count = 40
    for _ in range(6):
        mass = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
        mesh = np.interp(np.linspace(0.0, mass[-1], count), mass, fine)
        residual = _cubic_residual(scaled, mesh)
        ratio = residual / (margin * tolerance)
        if 0.7 < ratio <= 1.0 or not np.isfinite(ratio):
            break
        wanted = int(np.ceil((count - 1) * (1.05 * ratio) ** (1.0 / 3.0))) + 1
        new = int(np.clip(wanted, _FEWEST, _MOST))
        if new == count:
            break
        count = new
    mesh[0], mesh[-1] = 0.0, 1.0
    return mesh


def _cubic_residual(scaled: Callable[[np.ndarray, int], np.ndarray], mesh: np.ndarray) -> float:
    """Returns the largest relative residual of the cubic through values and slopes at the nodes."""
    width = np.diff(mesh)[:, None]
    value, slope = scaled(mesh, 0), scaled(mesh, 1)
    rise = (value[1:] - value[:-1]) / width
    squares = np.zeros(len(width))
    for place, weight in zip(_LOBATTO, (49.0 / 90.0, 32.0 / 45.0, 49.0 / 90.0), strict=True):
        part = 0.5 * (place + 1.0)
        cubic = (
            slope[:-1] * (1.0 - 4.0 * part + 3.0 * part**2)
            + slope[1:] * (3.0 * part**2 - 2.0 * part)
            + 6.0 * rise * part * (1.0 - part)
        )
        true = scaled(mesh[:-1] + part * width[:, 0], 1)
        off = (cubic - true) / (1.0 + np.abs(true))
        squares += weight * (off**2).sum(axis=1)
    return float(np.max(np.sqrt(0.5 * squares)))


def warm_start(
    problem: BoundaryValueProblem, result: SpectralResult, tolerance: float
) -> tuple[Guess, States]:
    """Returns the guess for collocation on its adapted mesh, and the polynomials it samples."""
    states = spectral_states(problem, result)
    criterion = problem.criterion
    # what is differentiated often is known too roughly to tell where nodes are needed
    told = criterion.at_tau if criterion.torque_is_state else criterion.at_n2
    columns = np.r_[criterion.at_y, criterion.at_rate, told]

    def scaled(share: np.ndarray, order: int) -> np.ndarray:
        return (states(share, order) / problem.scale)[:, columns]

    mesh = adapted_mesh(scaled, tolerance)
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
    )
