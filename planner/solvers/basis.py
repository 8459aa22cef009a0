"""Polynomials on [0, 1] with prescribed ends, and operators on Gauss nodes; all cached.

A curve is a sum of two parts: a polynomial that takes the values (and derivatives) prescribed at
either end, and polynomials of higher degree that vanish there, on Legendre's. The latter are
orthonormal in a chosen derivative, so that the normal equations of smooth problems stay well
conditioned at any degree.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre
from scipy.interpolate import CubicSpline


@dataclass(frozen=True, eq=False)
class Nodes:
    """Gauss-Legendre nodes on [0, 1].

    Attributes:
        u: Nodes, (K,).
        weights: Quadrature weights, (K,).
        derivative: Differentiation matrix of the polynomial through the nodes, (K, K).
    """

    u: np.ndarray
    weights: np.ndarray
    derivative: np.ndarray


@lru_cache(maxsize=64)
def gauss_nodes(count: int) -> Nodes:
    """Returns the `count` Gauss nodes with weights and differentiation matrix."""
    points, weights = legendre.leggauss(count)
    u = 0.5 * (points + 1.0)
    values, slopes = (legendre_values(u, count - 1, order) for order in (0, 1))
    return Nodes(u, 0.5 * weights, np.linalg.solve(values.T, slopes.T).T)


@lru_cache(maxsize=64)
def _derivative_coefficients(degree: int, order: int) -> np.ndarray:
    """Returns derivatives in u of Legendre's polynomials as sums of them, columns."""
    result: np.ndarray = 2.0**order * legendre.legder(np.eye(degree + 1), order, axis=0)
    return result


def legendre_values(u: np.ndarray, degree: int, order: int = 0) -> np.ndarray:
    """Returns derivatives in u of Legendre's polynomials on [0, 1], (K, degree + 1)."""
    points = 2.0 * u - 1.0
    if not order:
        return legendre.legvander(points, degree)
    columns = _derivative_coefficients(degree, order)
    result: np.ndarray = legendre.legvander(points, len(columns) - 1) @ columns
    return result


@lru_cache(maxsize=64)
def legendre_at_nodes(count: int, degree: int, order: int) -> np.ndarray:
    """Returns `legendre_values` at the `count` Gauss nodes."""
    return legendre_values(gauss_nodes(count).u, degree, order)


@lru_cache(maxsize=64)
def legendre_on_grid(count: int, degree: int, order: int) -> np.ndarray:
    """Returns `legendre_values` at `count` evenly spaced points from 0 to 1."""
    return legendre_values(np.linspace(0.0, 1.0, count), degree, order)


@dataclass(frozen=True, eq=False)
class Basis:
    """Polynomials of one degree with a number of prescribed values at either end.

    Attributes:
        degree: Degree.
        ends: How many values (value, slope, second derivative) are prescribed at start and goal.
        smooth: Order of the derivative in which the free polynomials are orthonormal.
        coefficients: Legendre coefficients, (degree + 1, conditions + free): first those that
            carry the end values, in order, then the free ones, which vanish at the ends.
    """

    degree: int
    ends: tuple[int, int]
    smooth: int
    coefficients: np.ndarray

    @property
    def key(self) -> tuple[int, int, int, int]:
        """What `make_basis` makes it of."""
        return self.degree, *self.ends, self.smooth

    @property
    def conditions(self) -> int:
        """Number of prescribed values."""
        return sum(self.ends)

    @property
    def free(self) -> int:
        """Number of free coefficients."""
        return self.degree + 1 - self.conditions

    def values(self, u: np.ndarray, order: int = 0) -> np.ndarray:
        """Returns the polynomials' derivatives at u, (K, conditions + free)."""
        return legendre_values(np.asarray(u), self.degree, order) @ self.coefficients


@lru_cache(maxsize=256)
def make_basis(degree: int, start: int, goal: int, smooth: int) -> Basis:
    """Returns a basis whose free polynomials are orthonormal in their derivative `smooth`.

    Args:
        degree: Degree, at least start + goal - 1.
        start: Number of values prescribed at 0: value, slope, second derivative.
        goal: Likewise at 1.
        smooth: Order of the derivative in which they are orthonormal.
    """
    ends = np.vstack(
        [
            *(legendre_values(np.array([0.0]), degree, order) for order in range(start)),
            *(legendre_values(np.array([1.0]), degree, order) for order in range(goal)),
            np.zeros((0, degree + 1)),
        ]
    )
    count = start + goal
    # the carrying polynomials have the least degree that can take the values
    carrying = np.zeros((degree + 1, count))
    carrying[:count] = np.linalg.inv(ends[:, :count]) if count else np.zeros((0, 0))
    null = np.linalg.qr(ends.T, mode="complete")[0][:, count:] if count else np.eye(degree + 1)
    nodes = gauss_nodes(degree + 1)
    root = np.sqrt(nodes.weights)[:, None]
    slopes = root * (legendre_values(nodes.u, degree, smooth) @ null)
    size = np.abs(slopes).max() if slopes.size else 1.0
    # what the derivative does not see (low powers, where ends are free) is measured by value
    plain = 1e-3 * size * root * (legendre_values(nodes.u, degree) @ null)
    _, values, rows = np.linalg.svd(np.vstack([slopes, plain]), full_matrices=False)
    free = null @ rows.T / values
    # smooth ones first: decay along the columns then tells the resolution
    order = np.argsort(-values)[::-1]
    return Basis(degree, (start, goal), smooth, np.hstack([carrying, free[:, order]]))


@lru_cache(maxsize=64)
def legendre_analysis(count: int, degree: int) -> np.ndarray:
    """Returns the map from values at the `count` Gauss nodes to Legendre coefficients, (., K)."""
    nodes = gauss_nodes(count)
    values = legendre.legvander(2.0 * nodes.u - 1.0, degree)
    result: np.ndarray = (values * nodes.weights[:, None] * (2.0 * np.arange(degree + 1) + 1.0)).T
    return result


@lru_cache(maxsize=64)
def legendre_fit(share: bytes, degree: int) -> np.ndarray:
    """Returns the least-squares fit of Legendre coefficients to values at shares, (., K).

    Args:
        share: Shares of the duration, (K,), as bytes.
        degree: Degree of the fit, below K.
    """
    return np.linalg.pinv(legendre_values(np.frombuffer(share), degree))


@lru_cache(maxsize=64)
def _spline_operator(knots: bytes, count: int) -> np.ndarray:
    share = np.frombuffer(knots)
    return CubicSpline(share, np.eye(len(share)))(gauss_nodes(count).u)


def spline_at_nodes(share: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Returns the cubic spline through values at shares of the duration at the Gauss nodes."""
    result: np.ndarray = _spline_operator(share.tobytes(), count) @ values
    return result


@lru_cache(maxsize=256)
def fit_at_nodes(degree: int, start: int, goal: int, smooth: int, count: int) -> np.ndarray:
    """Returns the least-squares fit of a basis's free coefficients to values at the Gauss nodes.

    Shape (free, K); what the ends carry must be taken off the values before.
    """
    root = np.sqrt(gauss_nodes(count).weights)[:, None]
    basis = make_basis(degree, start, goal, smooth)
    free = basis_at_nodes(degree, start, goal, smooth, count, 1)[0, :, basis.conditions :]
    return np.linalg.pinv(root * free, rcond=1e-14) * root.T


@lru_cache(maxsize=256)
def basis_at_nodes(
    degree: int, start: int, goal: int, smooth: int, count: int, orders: int
) -> np.ndarray:
    """Returns a basis's derivatives of orders 0 to `orders` - 1 at the Gauss nodes.

    Shape (orders, K, conditions + free).
    """
    basis = make_basis(degree, start, goal, smooth)
    u = gauss_nodes(count).u
    return np.array([basis.values(u, order) for order in range(orders)])
