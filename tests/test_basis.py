"""Polynomials with prescribed ends, and operators on Gauss nodes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from planner.solvers.basis import (
    basis_at_nodes,
    fit_at_nodes,
    gauss_nodes,
    legendre_analysis,
    legendre_at_nodes,
    legendre_fit,
    legendre_on_grid,
    make_basis,
    spline_at_nodes,
)

ENDS = [(0, 0), (1, 0), (2, 2), (3, 2), (2, 3), (3, 3), (0, 1)]


@pytest.mark.parametrize("count", [1, 2, 5, 17, 60])
def test_quadrature_is_exact_up_to_degree_2k_minus_1(count: int) -> None:
    nodes = gauss_nodes(count)
    assert nodes.weights.sum() == pytest.approx(1.0, rel=1e-14)
    for power in (0, count, 2 * count - 1):
        assert nodes.weights @ nodes.u**power == pytest.approx(1.0 / (power + 1), rel=1e-12)
    # and no further: the error at degree 2 K is the square of the nodes' polynomial
    if count <= 5:
        power = 2 * count
        assert nodes.weights @ nodes.u**power != pytest.approx(1.0 / (power + 1), rel=1e-9)


@pytest.mark.parametrize("count", [2, 9, 34])
def test_differentiation_matrix_is_exact_on_polynomials(count: int) -> None:
    nodes = gauss_nodes(count)
    for power in (0, 1, count - 1):
        wanted = power * nodes.u ** max(power - 1, 0)
        assert np.max(np.abs(nodes.derivative @ nodes.u**power - wanted)) < 1e-10 * count**2


@pytest.mark.parametrize("ends", ENDS)
@pytest.mark.parametrize("degree", [7, 20, 44])
def test_carrying_polynomials_take_the_end_values_and_the_free_ones_vanish_there(
    ends: tuple[int, int], degree: int
) -> None:
    basis = make_basis(degree, *ends, 3)
    assert basis.conditions == sum(ends)
    assert basis.free == degree + 1 - sum(ends)
    rows = [basis.values(np.array([0.0]), order) for order in range(ends[0])]
    rows += [basis.values(np.array([1.0]), order) for order in range(ends[1])]
    if not rows:
        return
    found = np.vstack(rows)
    wanted = np.hstack([np.eye(basis.conditions), np.zeros((basis.conditions, basis.free))])
    # a second derivative at an end is of the size degree^4
    assert np.max(np.abs(found - wanted)) < 1e-13 * degree**4


@pytest.mark.parametrize("ends", [(2, 2), (3, 3)])
@pytest.mark.parametrize(("smooth", "degree"), [(1, 12), (1, 40), (1, 60), (3, 8)])
def test_free_polynomials_are_orthonormal_in_their_derivative(
    ends: tuple[int, int], smooth: int, degree: int
) -> None:
    products = products_of_derivatives(ends, smooth, degree)
    assert np.max(np.abs(products - np.eye(len(products)))) < 1e-3


@pytest.mark.parametrize("degree", [20, 40, 60])
def test_free_polynomials_stay_well_conditioned_where_values_count_too(degree: int) -> None:
    sizes = np.linalg.eigvalsh(products_of_derivatives((2, 2), 3, degree))
    assert sizes[-1] <= 1.0 + 1e-9
    # powers of the share would be at 1e-40
    assert sizes[0] > 1e-6


def products_of_derivatives(ends: tuple[int, int], smooth: int, degree: int) -> np.ndarray:
    """Inner products of the free polynomials' derivatives."""
    basis = make_basis(degree, *ends, smooth)
    nodes = gauss_nodes(degree + 1)
    slopes = basis.values(nodes.u, smooth)[:, basis.conditions :]
    products: np.ndarray = slopes.T @ (nodes.weights[:, None] * slopes)
    return products


def test_free_polynomials_are_a_basis_where_their_derivative_sees_none_of_low_powers() -> None:
    basis = make_basis(10, 0, 0, 3)
    values = basis.values(gauss_nodes(11).u)
    assert basis.free == 11
    assert np.linalg.matrix_rank(values, tol=1e-9 * np.abs(values).max()) == 11


@given(
    st.sampled_from(ENDS),
    st.lists(st.floats(-1, 1), min_size=9, max_size=9),
)
def test_every_polynomial_of_the_degree_is_on_the_basis(
    ends: tuple[int, int], coefficients: list[float]
) -> None:
    curve = np.polynomial.Polynomial(coefficients, domain=[-1, 1])
    basis = make_basis(8, *ends, 1)
    u = np.linspace(0.0, 1.0, 30)
    known = [curve.deriv(k)(0.0) if k else curve(0.0) for k in range(ends[0])]
    known += [curve.deriv(k)(1.0) if k else curve(1.0) for k in range(ends[1])]
    values = basis.values(u)
    rest = curve(u) - values[:, : basis.conditions] @ np.array(known)
    free = values[:, basis.conditions :]
    found = np.linalg.lstsq(free, rest, rcond=None)[0]
    assert np.max(np.abs(free @ found - rest)) < 1e-9


@given(st.integers(0, 3))
def test_derivatives_are_those_of_the_values(order: int) -> None:
    basis = make_basis(9, 2, 1, 3)
    step, u = 1e-3, np.array([0.2, 0.5, 0.77])
    around = [basis.values(u + k * step, order) for k in (-2, -1, 1, 2)]
    slope = (around[0] - 8 * around[1] + 8 * around[2] - around[3]) / (12 * step)
    wanted = basis.values(u, order + 1)
    assert np.max(np.abs(slope - wanted)) < 1e-7 * np.max(np.abs(wanted))


def test_operators_at_the_nodes_are_kept() -> None:
    first = basis_at_nodes(20, 2, 2, 3, 34, 3)
    assert basis_at_nodes(20, 2, 2, 3, 34, 3) is first
    u = gauss_nodes(34).u
    for order, values in enumerate(first):
        assert np.array_equal(values, make_basis(20, 2, 2, 3).values(u, order))


def test_splines_and_fits_at_the_nodes_are_those_of_scipy_and_numpy() -> None:
    share = np.sort(np.random.default_rng(0).uniform(0.05, 0.95, 12))
    share[[0, -1]] = 0.0, 1.0
    values = np.random.default_rng(1).normal(size=(12, 3))
    u = gauss_nodes(17).u
    wanted = CubicSpline(share, values)(u)
    np.testing.assert_allclose(spline_at_nodes(share, values, 17), wanted, atol=1e-12)
    fit = legendre_fit(share.tobytes(), 6) @ values
    wanted = np.polynomial.legendre.legfit(2.0 * share - 1.0, values, 6)
    np.testing.assert_allclose(fit, wanted, atol=1e-10)


@pytest.mark.parametrize("order", [0, 1, 4])
def test_legendre_values_are_those_of_numpy(order: int) -> None:
    coefficients = np.random.default_rng(order).normal(size=(12, 2))
    u = np.linspace(0.0, 1.0, 9)
    derived = 2.0**order * np.polynomial.legendre.legder(coefficients, order)
    wanted = np.polynomial.legendre.legval(2.0 * u - 1.0, derived).T
    size = np.abs(wanted).max()
    np.testing.assert_allclose(
        legendre_on_grid(9, 11, order) @ coefficients, wanted, atol=1e-12 * size
    )
    nodes = gauss_nodes(14).u
    wanted = np.polynomial.legendre.legval(2.0 * nodes - 1.0, derived).T
    found = legendre_at_nodes(14, 11, order) @ coefficients
    np.testing.assert_allclose(found, wanted, atol=1e-12 * size)


def test_legendre_analysis_finds_a_polynomials_coefficients() -> None:
    coefficients = np.random.default_rng(0).normal(size=(10, 2))
    values = legendre_at_nodes(15, 9, 0) @ coefficients
    np.testing.assert_allclose(legendre_analysis(15, 9) @ values, coefficients, atol=1e-12)


def test_free_coefficients_are_found_from_values_at_the_nodes() -> None:
    basis = make_basis(14, 2, 3, 3)
    free = np.random.default_rng(0).normal(size=(basis.free, 2))
    values = basis.values(gauss_nodes(20).u)[:, basis.conditions :] @ free
    np.testing.assert_allclose(fit_at_nodes(*basis.key, 20) @ values, free, rtol=1e-8, atol=1e-8)
