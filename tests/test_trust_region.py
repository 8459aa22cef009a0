"""One step of the trust region, compared with brute force on problems of either curvature."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.solvers.trust_region import (
    Model,
    QuadraticModel,
    reduce_model,
    trust_region_step,
)


def value(gradient: np.ndarray, hessian: np.ndarray, step: np.ndarray) -> np.ndarray:
    """The quadratic model at steps, (..., size)."""
    return step @ gradient + 0.5 * np.einsum("...i,ij,...j->...", step, hessian, step)


def without_force(gradient: np.ndarray, hessian: np.ndarray, metric: np.ndarray) -> Model:
    nothing = np.zeros(0, dtype=int)
    return reduce_model(gradient, hessian, metric, np.arange(len(gradient)), nothing)


def brute_force(
    gradient: np.ndarray, hessian: np.ndarray, metric: np.ndarray, radius: float
) -> float:
    """Least model value on a disc |M d| <= radius of two unknowns, on a fine polar grid."""
    angle = np.linspace(0.0, 2.0 * np.pi, 4001)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    disc = np.linspace(0.0, radius, 401)[:, None, None] * ring
    steps = np.linalg.solve(metric, disc.reshape(-1, 2).T).T
    return float(np.min(value(gradient, hessian, steps)))


numbers = st.floats(-3, 3).map(lambda number: round(number, 3))


@given(
    st.tuples(numbers, numbers),
    st.tuples(numbers, numbers, numbers),
    st.tuples(st.floats(0.3, 2), st.floats(-1, 1), st.floats(0.3, 2)),
    st.floats(0.05, 4),
)
def test_the_step_is_the_best_of_the_disc(
    gradient: tuple[float, ...],
    curvature: tuple[float, ...],
    root: tuple[float, ...],
    radius: float,
) -> None:
    g = np.array(gradient)
    hessian = np.array([[curvature[0], curvature[1]], [curvature[1], curvature[2]]])
    metric = np.array([[root[0], root[1]], [0.0, root[2]]])
    step = trust_region_step(without_force(g, hessian, metric), radius)
    move, gain, length = step.move, step.gain, step.length
    best = brute_force(g, hessian, metric, radius)
    scale = max(abs(best), 1e-9)
    assert np.linalg.norm(metric @ move) == pytest.approx(length, rel=1e-8, abs=1e-12)
    assert length <= 1.01 * radius
    assert -gain == pytest.approx(float(value(g, hessian, move)), rel=1e-7, abs=1e-9 * scale)
    # the radius is met to a part in a thousand, the grid's own error is below that
    assert -gain <= best + 4e-3 * scale
    assert -gain >= best - 2e-2 * scale


def whole_model(gradient: np.ndarray, hessian: np.ndarray) -> QuadraticModel:
    size = len(gradient)
    return QuadraticModel(gradient, hessian, np.eye(size), slice(0, size), slice(size, size))


def test_inside_the_radius_a_convex_model_takes_newtons_step() -> None:
    generator = np.random.default_rng(1)
    root = generator.normal(size=(6, 6))
    hessian = root.T @ root + 0.1 * np.eye(6)
    gradient = generator.normal(size=6)
    newton = whole_model(gradient, hessian).step(1e3)
    assert newton is not None
    assert newton.convex
    step = trust_region_step(without_force(gradient, hessian, np.eye(6)), 1e3)
    assert np.allclose(step.move, -np.linalg.solve(hessian, gradient), rtol=1e-9)
    assert np.allclose(step.move, newton.move, rtol=1e-9)
    assert step.gain == pytest.approx(newton.gain, rel=1e-9)
    assert step.length == pytest.approx(newton.length, rel=1e-9)


@pytest.mark.parametrize("radius", [0.1, 1e3])
def test_a_tilted_model_is_one_with_another_gradient(radius: float) -> None:
    generator = np.random.default_rng(6)
    root = generator.normal(size=(6, 6))
    hessian = root.T @ root + 0.1 * np.eye(6)
    first, other = generator.normal(size=(2, 6))
    tilted = whole_model(first, hessian).tilted(other).step(radius)
    fresh = whole_model(other, hessian).step(radius)
    assert tilted is not None
    assert fresh is not None
    assert np.allclose(tilted.move, fresh.move, rtol=1e-12)
    assert tilted.gain == pytest.approx(fresh.gain, rel=1e-12)


def test_outside_the_radius_or_without_convexity_the_step_ends_at_it() -> None:
    for hessian in (np.diag([1.0, 0.1]), np.diag([1.0, -0.1])):
        step = whole_model(np.ones(2), hessian).step(0.5)
        assert step is not None
        assert step.length == pytest.approx(0.5, rel=2e-3)
        assert step.convex == (hessian[1, 1] > 0.0)


def test_no_step_without_a_minimum_in_the_multiplier() -> None:
    hessian = np.diag([1.0, -1.0])
    model = QuadraticModel(np.ones(2), hessian, np.eye(1), slice(0, 1), slice(1, 2))
    assert model.step(0.1) is None


@pytest.mark.parametrize("radius", [0.05, 1e3])
def test_a_step_solves_its_own_system_for_another_right_hand_side(radius: float) -> None:
    """The shift that keeps it within the radius is one of the metric, on the motion alone."""
    generator = np.random.default_rng(5)
    root = generator.normal(size=(5, 5))
    hessian, gradient = root.T @ root + 0.3 * np.eye(5), generator.normal(size=5)
    metric = np.triu(generator.normal(size=(3, 3))) + 3.0 * np.eye(3)
    model = QuadraticModel(gradient, hessian, metric, slice(0, 3), slice(3, 5))
    step = model.step(radius)
    assert step is not None
    assert np.allclose(step.solve(-gradient), step.move, rtol=1e-9)
    assert model.length(step.move) == pytest.approx(step.length, rel=1e-9)
    left = gradient + hessian @ step.move
    pull = metric.T @ metric @ step.move[:3]
    shift = -(left[:3] @ pull) / (pull @ pull)
    assert (shift > 1e-3) == (radius < 1.0)
    shifted = hessian.copy()
    shifted[:3, :3] += shift * metric.T @ metric
    right = generator.normal(size=5)
    assert np.allclose(shifted @ step.solve(right), right, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("curvature", [-2.0, -1e-3])
@pytest.mark.parametrize("size", [1e-9, 1e-2, 5.0])
def test_hard_case(curvature: float, size: float) -> None:
    """No slope along the most negative curvature: no shift alone reaches the radius."""
    hessian = np.diag([curvature, 1.0, 3.0])
    gradient = np.array([0.0, size, -size])
    radius = 20.0
    step = trust_region_step(without_force(gradient, hessian, np.eye(3)), radius)
    move, gain = step.move, step.gain
    # Lagrange: with the shift -curvature the other two are known, the first fills the radius
    rest = -gradient[1:] / (np.array([1.0, 3.0]) - curvature)
    first = np.sqrt(radius**2 - rest @ rest)
    wanted = -float(value(gradient, hessian, np.array([first, *rest])))
    assert gain == pytest.approx(wanted, rel=1e-2)
    assert np.linalg.norm(move) == pytest.approx(radius, rel=1e-2)
    assert abs(move[0]) == pytest.approx(first, rel=1e-2)


def test_at_a_saddle_point_the_step_leaves_along_negative_curvature() -> None:
    hessian = np.diag([2.0, -1.0])
    step = trust_region_step(without_force(np.zeros(2), hessian, np.eye(2)), 0.5)
    move, gain, length = step.move, step.gain, step.length
    assert length == pytest.approx(0.5, rel=1e-3)
    assert abs(move[1]) == pytest.approx(0.5, rel=1e-3)
    assert gain == pytest.approx(0.5 * 0.5**2, rel=1e-2)


def test_a_smaller_radius_never_gains_more() -> None:
    generator = np.random.default_rng(3)
    hessian = generator.normal(size=(5, 5))
    model = without_force(generator.normal(size=5), hessian + hessian.T, np.eye(5))
    gains = [trust_region_step(model, radius).gain for radius in (0.1, 0.3, 1.0, 3.0, 10.0)]
    assert all(low < high for low, high in pairwise(gains))


def test_the_multiplier_is_eliminated() -> None:
    """For every motion the multiplier's step is the best one, whatever the motion's curvature."""
    generator = np.random.default_rng(2)
    motion, force = np.array([0, 2, 5]), np.array([1, 3, 4])
    hessian = generator.normal(size=(6, 6))
    hessian = hessian + hessian.T
    hessian[np.ix_(force, force)] += 12.0 * np.eye(3)
    gradient = generator.normal(size=6)
    root = np.triu(generator.normal(size=(3, 3))) + 3.0 * np.eye(3)
    model = reduce_model(gradient, hessian, root, motion, force)
    assert model.values[0] < 0.0, "the example shall have negative curvature"
    for radius in (0.1, 1.0, 10.0):
        step = trust_region_step(model, radius)
        move, gain, length = step.move, step.gain, step.length
        assert -gain == pytest.approx(float(value(gradient, hessian, move)), rel=1e-9)
        assert np.linalg.norm(root @ move[motion]) == pytest.approx(length, rel=1e-9)
        slope = gradient + hessian @ move
        assert np.max(np.abs(slope[force])) < 1e-9
        # first-order condition on the motion: the slope is antiparallel to M'M d
        pull = root.T @ root @ move[motion]
        shift = -(slope[motion] @ pull) / (pull @ pull)
        assert np.max(np.abs(slope[motion] + shift * pull)) < 1e-8 * np.max(np.abs(slope[motion]))
        assert shift >= -model.values[0] * (1.0 - 1e-9)
