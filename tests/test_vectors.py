"""Batched vector algebra: cross products, least-norm solutions."""

from __future__ import annotations

import numpy as np

from planner.vectors import cross, least_norm, wrap, wrapped_cross


def test_wrapped_cross_products_are_cross_products_and_wrapped_again() -> None:
    generator = np.random.default_rng(0)
    a, b = generator.normal(size=(2, 3, 5, 4))
    found = wrapped_cross(wrap(a), wrap(b))
    np.testing.assert_allclose(found[:3], np.cross(a, b, axis=0), atol=1e-15)
    np.testing.assert_array_equal(found[3:], found[:2])
    np.testing.assert_array_equal(wrap(a)[:3], a)


def test_wrapped_vectors_broadcast() -> None:
    generator = np.random.default_rng(1)
    many, one = generator.normal(size=(3, 6, 4)), generator.normal(size=(3, 6, 1))
    found = wrapped_cross(wrap(many), wrap(one))
    np.testing.assert_allclose(found[:3], np.cross(many, one, axis=0), atol=1e-15)


def test_cross_is_numpys() -> None:
    generator = np.random.default_rng(2)
    a, b = generator.normal(size=(2, 7, 3))
    np.testing.assert_allclose(cross(a, b), np.cross(a, b), atol=1e-15)


def test_least_norm_solutions_are_those_of_the_pseudo_inverse() -> None:
    generator = np.random.default_rng(4)
    matrix, right = generator.normal(size=(6, 3, 8)), generator.normal(size=(6, 3, 2))
    found = least_norm(matrix, right)
    np.testing.assert_allclose(matrix @ found, right, atol=1e-13)
    np.testing.assert_allclose(found, np.linalg.pinv(matrix) @ right, atol=1e-13)


def test_least_norm_of_rows_that_repeat_is_finite() -> None:
    matrix = np.array([[1.0, 2.0, 0.0], [1.0, 2.0, 0.0]])
    found = least_norm(matrix, matrix @ np.ones((3, 1)))
    np.testing.assert_allclose(found[:, 0], [0.6, 1.2, 0.0], atol=1e-12)
