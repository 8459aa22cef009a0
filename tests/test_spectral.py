"""The spectral method: derivatives of its cost, optimality of its motions, and its accuracy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mechanisms import difference, planar_arms
from mechanisms import human_arms as human
from plans import CASES, FREE, minimised, problem_of, solved

from planner import load
from planner.boundary_value_problem import BoundaryValueProblem
from planner.scenario import Scenario
from planner.solvers import descent
from planner.solvers.basis import spline_at_nodes
from planner.solvers.curves import Curves
from planner.solvers.spectral import minimise, resolution
from planner.solvers.spectral_curvature import torque_curvature
from planner.solvers.spectral_derivatives import gradient, normal_equations, torque_bend
from planner.solvers.spectral_problem import Point, SpectralProblem
from planner.solvers.spectral_start import carry_over, project
from planner.solvers.spectral_unknowns import metric

DEGREE = 12
URDF = Path(__file__).parents[1] / "urdf"

HUMAN: dict[str, dict[str, Any]] = {
    "zero ends": {},
    "free end": FREE,
    "rest, static": {"boundary.start.torque": "rest", "boundary.goal.torque": "static"},
    "torque": {"criterion.kind": "torque"},
    "mixed": {
        "criterion.kind": "mixed",
        "criterion.weights": [1.0, 2.0, 0.5, 3.0],
        "criterion.posture_cost": 0.3,
        "criterion.speed_cost": 0.2,
    },
    "gravity and preload": {
        "world.gravity": [0.0, -9.81, 0.0],
        "boundary.start.internal_force": [3.0, -4.0, 0.0],
        "boundary.goal.torque": "static",
    },
    "velocities": {
        "task.start.velocity": [0.2, -0.1, 0.0],
        "task.goal.velocity": [0.1, 0.3, 0.0],
    },
}


def redundant(folder: Path, **values: Any) -> Scenario:
    """Two arms of three joints: postures of the ends are free."""
    return planar_arms(folder, gravity=(0.0, 0.0, 0.0), **values)


@pytest.fixture(scope="module")
def scenarios(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Scenario]:
    folder = tmp_path_factory.mktemp("arms")
    found = {name: human(values) for name, values in HUMAN.items()}
    found["free postures"] = redundant(folder)
    found["free postures, static and rest"] = redundant(
        folder, boundary={"start": {"torque": "static"}, "goal": {"torque": "rest"}}
    )
    found["held start, speed cost"] = redundant(folder, criterion={"speed_cost": 0.5}).override(
        {"task.posture": "start", "boundary.goal.internal_force": [1.0, 2.0, 0.0]}
    )
    return found


NAMES = [
    *HUMAN,
    "free postures",
    "free postures, static and rest",
    "held start, speed cost",
]


def somewhere(problem: BoundaryValueProblem, seed: int = 0) -> tuple[SpectralProblem, Point]:
    """An iterate off the optimum, its multiplier away from zero."""
    spectral = SpectralProblem(problem.transport, problem.criterion, problem.coordinates, DEGREE)
    transport = problem.transport
    nodes = len(spectral.nodes.u)
    near = spline_at_nodes(transport.share, transport.guess, nodes)
    point = spectral.evaluate(np.zeros(spectral.size), spectral.ends.guessed, near)
    assert point is not None
    move = 0.3 * directions(spectral, point, 1, seed)[0]
    point = spectral.moved(point, move)
    assert point is not None
    return spectral, point


def directions(spectral: SpectralProblem, point: Point, count: int, seed: int = 1) -> np.ndarray:
    """Random steps that change the motion by a radian per duration or less, (count, size)."""
    generator = np.random.default_rng(seed)
    root = metric(spectral, point)
    # postures of both ends may move together, which hardly changes the speeds
    root = root + 0.3 * np.eye(len(root)) * np.trace(root) / len(root)
    result = np.zeros((count, spectral.size))
    for row in result:
        motion = generator.normal(size=len(root))
        row[spectral.motion] = np.linalg.solve(root, motion) / np.linalg.norm(motion)
        row[spectral.force] = generator.normal(size=spectral.size - len(root))
    return result


def cost_along(spectral: SpectralProblem, point: Point, move: np.ndarray, time: float) -> float:
    moved = spectral.moved(point, time * move)
    assert moved is not None
    return moved.cost


@pytest.mark.parametrize("name", NAMES)
def test_gradient_and_hessian(scenarios: dict[str, Scenario], name: str) -> None:
    spectral, point = somewhere(problem_of(scenarios[name]))
    slope_at, matrix = normal_equations(spectral, point)
    hessian = matrix + torque_curvature(spectral, point)
    np.testing.assert_allclose(gradient(spectral, point), slope_at, rtol=1e-8, atol=1e-9)
    assert np.max(np.abs(hessian - hessian.T)) < 1e-6 * np.max(np.abs(hessian))
    for move in directions(spectral, point, 4):

        def cost(time: float, move: np.ndarray = move) -> np.ndarray:
            return np.array(cost_along(spectral, point, move, time))

        def slope(time: float, cost: Any = cost) -> np.ndarray:
            return difference(lambda later: cost(time + later), 3e-3)

        assert slope_at @ move == pytest.approx(float(slope(0.0)), rel=2e-6)
        second = float(difference(slope, 3e-3))
        # the Hessian is made of forward differences, and the ends' of second ones
        assert move @ hessian @ move == pytest.approx(second, rel=2e-4)


@pytest.mark.parametrize("name", ["zero ends", "torque", "mixed"])
def test_gauss_newton_alone_is_not_the_hessian(scenarios: dict[str, Scenario], name: str) -> None:
    """What the curvature adds is no trifle: without it the test above would fail."""
    spectral, point = somewhere(problem_of(scenarios[name]))
    _, matrix = normal_equations(spectral, point)
    extra = torque_curvature(spectral, point)
    moves = directions(spectral, point, 4)
    share = [abs(move @ extra @ move) / abs(move @ matrix @ move) for move in moves]
    assert max(share) > 1e-3


@pytest.mark.parametrize("name", ["zero ends", "torque", "mixed", "free postures"])
def test_the_torques_bend_along_a_step(scenarios: dict[str, Scenario], name: str) -> None:
    """Their second derivative along it, seen by the gradient's own inner product."""
    spectral, point = somewhere(problem_of(scenarios[name]))
    step, other = directions(spectral, point, 2, seed=7)
    share, width = 1e-3, 1e-3

    def moved(move: np.ndarray) -> Point:
        there = spectral.moved(point, move)
        assert there is not None
        return spectral.closed(there)

    def torques(move: np.ndarray) -> np.ndarray:
        return moved(move).torques.tau

    point = spectral.closed(point)
    near = moved(share * step)
    ends = torques(width * step) + torques(-width * step)
    second = (ends - 2.0 * point.torques.tau) / width**2
    along = (torques(width * other) - torques(-width * other)) / (2.0 * width)
    criterion = spectral.criterion
    weight = spectral.nodes.weights[:, None] * spectral.transport.duration
    wanted = float((weight * criterion.torque_weights * second * along).sum())
    if criterion.torque_is_state:
        slopes = spectral.derivative @ second, spectral.derivative @ along
        wanted += float((weight * criterion.rate_weights * slopes[0] * slopes[1]).sum())
    assert torque_bend(spectral, point, near, step, share) @ other == pytest.approx(
        wanted, rel=5e-3
    )


def test_two_pandas_need_no_second_derivatives(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps that follow the valley's bend lead from the straight line to the optimum."""

    def refuse(*_: object) -> np.ndarray:
        raise AssertionError("the exact Hessian was asked for")

    monkeypatch.setattr(descent, "torque_curvature", refuse)
    problem = problem_of(load(URDF / "two_pandas" / "lift.toml"))
    found = minimise(problem.transport, problem.criterion, problem.coordinates, tolerance=1e-7)
    assert found is not None
    assert found.converged
    assert found.cost == pytest.approx(320.848418, rel=2e-6)
    assert found.iterations <= 20


def test_a_matrix_that_serves_twice_leads_to_the_same_motion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """After short steps that gain what they shall, the Gauss-Newton matrix is not formed anew."""
    formed: list[float] = []

    def counted(problem: SpectralProblem, point: Point) -> tuple[np.ndarray, np.ndarray]:
        formed.append(point.cost)
        return normal_equations(problem, point)

    def found() -> tuple[int, int, float, np.ndarray]:
        formed.clear()
        result = minimised(problem_of(human()), tolerance=1e-13, tail=1e-5)
        q = result.curves.y(np.linspace(0.0, 1.0, 50))
        return len(formed), result.iterations, result.cost, q

    monkeypatch.setattr(descent, "normal_equations", counted)
    matrices, steps, cost, motion = found()
    monkeypatch.setattr(descent, "_STEADY", 0.0)
    all_matrices, all_steps, same_cost, same_motion = found()
    assert matrices < steps
    assert all_matrices == all_steps
    assert cost == pytest.approx(same_cost, rel=1e-11)
    assert np.max(np.abs(motion - same_motion)) < 1e-6


@pytest.mark.parametrize("name", [*HUMAN, "held start, speed cost"])
def test_no_feasible_perturbation_lowers_the_cost(
    scenarios: dict[str, Scenario], name: str
) -> None:
    problem = problem_of(scenarios[name])
    result = minimised(problem)
    spectral, best = result.problem, result.point
    size = 1e-2
    for move in directions(spectral, best, 40):
        up, down = (cost_along(spectral, best, move, sign * size) for sign in (1.0, -1.0))
        assert min(up, down) > best.cost * (1.0 - 1e-11)
        rise, tilt = 0.5 * (up + down) - best.cost, 0.5 * (up - down)
        assert rise > 0.0
        # the first-order part is nothing beside what the tolerance leaves
        assert abs(tilt) < 3e-2 * rise + 2e-6 * best.cost


@pytest.mark.parametrize("name", CASES)
def test_the_minimum_is_stationary(name: str) -> None:
    """The predicted gain of one more Newton step is below the tolerance."""
    result = minimised(problem_of(human(CASES[name])))
    spectral, best = result.problem, result.point
    slope, matrix = normal_equations(spectral, best)
    hessian = matrix + torque_curvature(spectral, best)
    assert np.linalg.eigvalsh(hessian)[0] > 0.0
    gain = 0.5 * slope @ np.linalg.solve(hessian, slope)
    assert gain < 1e-9 * best.cost


def test_accuracy_grows_with_the_degree() -> None:
    """Against shooting-accurate collocation; the cost converges much faster than the motion."""
    reference = solved({"solver.tolerance": 1e-7, "solver.max_nodes": 5000}).cost
    problem = problem_of(human())
    errors = []
    for tail in (1e-2, 7e-4, 1e-5):
        result = minimised(problem, tail=tail)
        assert result.tail < tail
        errors.append((result.degree, abs(result.cost / reference - 1.0)))
    degrees, sizes = zip(*errors, strict=True)
    assert degrees[0] <= degrees[1] < degrees[2]
    assert sizes[1] < 1e-6
    assert sizes[2] < 1e-8


def test_a_degree_that_does_not_suffice_is_not_converged(monkeypatch: pytest.MonkeyPatch) -> None:
    from planner.solvers import spectral

    monkeypatch.setattr(spectral, "FIRST_DEGREE", 8)
    monkeypatch.setattr(spectral, "LAST_DEGREE", 10)
    problem = problem_of(human())
    result = minimise(problem.transport, problem.criterion, problem.coordinates)
    assert result is not None
    assert not result.converged
    assert "tail" in result.message
    assert resolution(result.problem, result.point) == result.tail


def test_starting_from_the_result_takes_next_to_no_steps() -> None:
    problem = problem_of(human())
    first = minimised(problem)
    again = minimised(problem_of(human()), start=first.curves)
    assert again.iterations < first.iterations
    assert again.iterations <= 2
    assert again.cost == pytest.approx(first.cost, rel=1e-9)


def test_progress_tells_of_every_step() -> None:
    seen: list[Any] = []
    result = minimised(problem_of(human()), progress=seen.append)
    assert tuple(seen) == result.refinements
    assert len(seen) == result.iterations
    costs = [step.cost for step in seen]
    assert costs[-1] == pytest.approx(result.cost, rel=1e-9)
    assert all(step.stage == "spectral" for step in seen)


def test_no_start_can_be_closed() -> None:
    """Joints of the guess apart from each other beyond repair: no motion, and no exception."""
    from dataclasses import replace

    from planner.solving import make_problem

    scenario = human()
    transport = problem_of(scenario).transport
    apart = np.array([np.pi, np.pi, 0.0, np.pi])
    broken = replace(
        transport,
        guess=np.broadcast_to(apart, transport.guess.shape).copy(),
        start=replace(transport.start, posture=apart),
        goal=replace(transport.goal, posture=apart),
    )
    problem = make_problem(scenario, transport)
    problem.coordinates.remember(broken.share, broken.guess)
    with np.errstate(all="ignore"):
        assert minimise(broken, problem.criterion, problem.coordinates) is None


def test_iterates_are_closed_and_meet_the_ends() -> None:
    values = {
        "task.start.velocity": [0.2, -0.1, 0.0],
        "boundary.goal.torque": [0.1, -0.2, 0.3, -0.1],
    }
    problem = problem_of(human(values))
    spectral, point = somewhere(problem)
    chain = problem.transport.chain

    def gap(at: Point) -> float:
        return float(np.max(np.abs(chain.gap(chain.dynamics.placements(at.torques.tangent.q)))))

    assert gap(point) < 1e-8
    # a step takes along what gap the iterate before it had left
    near = spectral.moved(point, 1e-4 * directions(spectral, point, 1)[0])
    assert near is not None
    assert gap(near) < 1e-11
    curves = spectral.curves(point)
    ends = np.array([0.0, 1.0])
    y, rate = curves.y(ends), curves.y(ends, 1) / problem.transport.duration
    at, _ = problem.coordinates.tangent(ends, y)
    velocity = np.einsum("kij,kj->ki", chain.object_jacobian(at.at) @ at.s, rate)
    assert np.allclose(velocity[0, :3], [0.2, -0.1, 0.0], atol=1e-12)
    assert np.allclose(velocity[1, :3], 0.0, atol=1e-12)
    position, _ = chain.object_pose(at.at)
    assert np.allclose(position, [[0.1, 0.4, 0.0], [0.4, 0.3, 0.0]], atol=1e-11)
    from planner.solvers.inverse_torques import inverse_torques

    tau = inverse_torques(
        chain,
        problem.transport.joints,
        at,
        rate,
        curves.y(ends, 2) / problem.transport.duration**2,
        curves.multiplier(ends),
    ).tau
    assert np.allclose(tau[0], 0.0, atol=1e-10)
    assert np.allclose(tau[1], [0.1, -0.2, 0.3, -0.1], atol=1e-10)


def test_curves_derivatives() -> None:
    generator = np.random.default_rng(0)
    curves = Curves(generator.normal(size=(9, 2)), generator.normal(size=(7, 3)))
    share, step = np.array([0.2, 0.6]), 1e-3
    for function in (curves.y, curves.multiplier):
        for order in (0, 1):
            around = [function(share + k * step, order) for k in (-2, -1, 1, 2)]
            slope = (around[0] - 8 * around[1] + 8 * around[2] - around[3]) / (12 * step)
            assert np.allclose(slope, function(share, order + 1), rtol=1e-6, atol=1e-6)


def test_projected_curves_are_found_again() -> None:
    problem = problem_of(human(FREE))
    spectral, point = somewhere(problem)
    curves, u = spectral.curves(point), spectral.nodes.u
    found, motion = project(spectral, point.ends, curves.y(u)), spectral.places[0]
    assert np.allclose(found[motion], point.x[motion], rtol=1e-6, atol=1e-8)
    assert not found[spectral.force].any()


def test_curves_are_carried_over_to_their_own_ends_unchanged() -> None:
    spectral, point = somewhere(problem_of(human(FREE)))
    found = carry_over(spectral, spectral.curves(point))
    assert np.allclose(found, point.x, rtol=1e-6, atol=1e-8)
