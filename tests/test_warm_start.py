"""From the spectral motion to costates and a mesh, compared with the boundary value solution."""

from __future__ import annotations

import numpy as np
import pytest
from mechanisms import human_arms as human
from plans import CASES, minimised, problem_of, solved

from planner.solution import Solution
from planner.solvers.collocation import solve_collocation
from planner.solvers.warm_start import (
    MotionJacobian,
    adapted_mesh,
    spectral_solution,
    spectral_states,
    warm_start,
)

TIGHT = {"solver.tolerance": 1e-7, "solver.max_nodes": 5000}
SHARE = np.linspace(0.0, 1.0, 51)


@pytest.mark.parametrize("case", CASES)
def test_states_and_costates_are_those_of_the_boundary_value_problem(case: str) -> None:
    problem = problem_of(human(CASES[case]))
    wanted = problem.scaled(solved(CASES[case] | TIGHT).states(SHARE))
    criterion = problem.criterion

    def worst(tail: float, places: list[slice]) -> float:
        states = spectral_states(problem, minimised(problem, tail=tail))
        off = np.abs(problem.scaled(states(SHARE)) - wanted)
        return max(float(off[place].max() / np.abs(wanted[place]).max()) for place in places)

    motion = [criterion.at_y, criterion.at_rate]
    costates = [criterion.at_n1, criterion.at_n2]
    if criterion.torque_is_state:
        motion.append(criterion.at_tau)
        costates.append(criterion.at_n3)
    assert worst(7e-4, motion) < 1e-3
    # costates come of derivatives: less is known of them, and more at a higher degree
    assert worst(7e-4, costates) < 2e-2
    assert worst(1e-6, costates) < 1e-4


def test_states_are_polynomials_with_their_derivatives() -> None:
    problem = problem_of(human())
    states = spectral_states(problem, minimised(problem))
    step, share = 1e-3, np.array([0.2, 0.5, 0.7])
    for order in (0, 1, 3):
        around = [states(share + k * step, order) for k in (-2, -1, 1, 2)]
        slope = (around[0] - 8 * around[1] + 8 * around[2] - around[3]) / (12 * step)
        wanted = states(share, order + 1)
        assert np.max(np.abs(slope - wanted)) < 1e-4 * np.max(np.abs(wanted))


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-7])
def test_the_mesh_suits_the_tolerance(tolerance: float) -> None:
    """A cubic through exact values and slopes leaves a residual that the mesh keeps in bounds."""
    sharp = 12.0

    def curve(share: np.ndarray, order: int) -> np.ndarray:
        bump = np.polynomial.Polynomial([0.0, sharp])(share - 0.7)
        values = [
            np.tanh(bump),
            sharp / np.cosh(bump) ** 2,
        ]
        if order < 2:
            return values[order][:, None]
        assert order == 4
        t = np.tanh(bump)
        return (sharp**4 * (1 - t**2) * (16 * t - 24 * t**3))[:, None]

    grid = np.linspace(0.0, 1.0, 401)
    mesh = adapted_mesh(curve(grid, 1), curve(grid, 4), tolerance)
    assert mesh[0] == 0.0
    assert mesh[-1] == 1.0
    assert np.all(np.diff(mesh) > 0.0)
    width = np.diff(mesh)
    for part in (0.25, 0.5, 0.8):
        at = mesh[:-1] + part * width
        value, slope = curve(mesh, 0)[:, 0], curve(mesh, 1)[:, 0]
        rise = (value[1:] - value[:-1]) / width
        cubic = (
            slope[:-1] * (1 - 4 * part + 3 * part**2)
            + slope[1:] * (3 * part**2 - 2 * part)
            + 6 * rise * part * (1 - part)
        )
        true = curve(at, 1)[:, 0]
        assert np.max(np.abs(cubic - true) / (1 + np.abs(true))) < tolerance
    # nodes are where the curve is: closer together at the step than far from it
    inner, outer = width[np.abs(mesh[:-1] - 0.7) < 0.1], width[mesh[:-1] < 0.3]
    assert inner.mean() < outer.mean()


def test_a_tighter_tolerance_takes_more_nodes_by_the_third_root() -> None:
    problem = problem_of(human())
    result = minimised(problem)
    counts = [len(warm_start(problem, result, tolerance)[0].share) for tolerance in (1e-3, 1e-6)]
    assert 5.0 < counts[1] / counts[0] < 16.0


def test_the_guess_samples_the_states() -> None:
    problem = problem_of(human())
    result = minimised(problem)
    guess, states = warm_start(problem, result, 1e-4)
    assert guess.cost == result.cost
    assert np.array_equal(guess.x, states(guess.share))
    assert guess.share[0] == 0.0
    assert guess.share[-1] == 1.0


@pytest.mark.parametrize("case", CASES)
def test_the_spectral_solution_moves_as_its_torques_demand(case: str) -> None:
    """Its states meet the equation of motion exactly, its costates as well as they are known."""
    problem = problem_of(human(CASES[case]))
    result = minimised(problem)
    solution = spectral_solution(problem, result)
    share = np.linspace(0.02, 0.98, 49)
    step = 1e-3
    slope = sum(
        weight * (solution.states(share + k * step) - solution.states(share - k * step))
        for k, weight in ((1, 45.0), (2, -9.0), (3, 1.0))
    ) / (60.0 * step * problem.transport.duration)
    x, at = solution.evaluate(share)
    criterion = problem.criterion
    accelerations = at.motion.a[:, problem.transport.joints.independent]
    if criterion.torque_is_state:
        assert np.max(np.abs(slope[:, criterion.at_rate] - accelerations)) < 1e-6
        control = -x[:, criterion.at_n3] / criterion.rate_weights
        assert np.max(np.abs(slope[:, criterion.at_tau] - control)) < 1e-2 * np.max(np.abs(control))
    else:
        size = np.max(np.abs(accelerations))
        assert np.max(np.abs(slope[:, criterion.at_rate] - accelerations)) < 1e-2 * size
    assert solution.cost == result.cost
    assert solution.residual < 1e-2


@pytest.mark.parametrize("case", CASES)
def test_the_jacobian_along_the_motion_is_that_of_the_equations(case: str) -> None:
    """A few samples of it resolve it as they resolve the states, ends included."""
    problem = problem_of(human(CASES[case]))
    _, states = warm_start(problem, minimised(problem), 1e-4)
    share = np.linspace(0.0, 1.0, 81)
    z = problem.scaled(states(share))
    exact = problem.jacobian(share, z)
    known = MotionJacobian(problem, states)(share, z)
    size = np.abs(exact).max(axis=2, keepdims=True)
    assert np.max(np.abs(known - exact) / (1e-3 + size)) < 5e-3


def test_newton_converges_as_with_the_exact_jacobian() -> None:
    problem = problem_of(human())
    guess, states = warm_start(problem, minimised(problem), 1e-4)
    settings = {"tolerance": 1e-4, "max_nodes": 2000, "guess": guess}
    whole = solve_collocation(problem, **settings)
    interpolated = solve_collocation(problem, jacobian=MotionJacobian(problem, states), **settings)
    assert isinstance(whole, Solution)
    assert isinstance(interpolated, Solution)
    assert interpolated.iterations == whole.iterations
    assert len(interpolated.mesh) == len(whole.mesh)
    assert interpolated.cost == pytest.approx(whole.cost, rel=1e-10)
