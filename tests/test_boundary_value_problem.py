"""The scaled boundary value problem: its Jacobians, and that scaling makes tasks look alike."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mechanisms import Mechanism, difference, differences
from mechanisms import human_arms as human
from plans import FREE, problem_of, solved, transport_of

from planner.boundary_value_problem import BoundaryValueProblem
from planner.solving import make_problem
from planner.transport import make_transport

KINDS: dict[str, dict[str, Any]] = {
    "torque-change": {},
    "torque": {"criterion.kind": "torque"},
    "mixed": {"criterion.kind": "mixed", "criterion.speed_cost": 0.2},
}
ENDS: dict[str, dict[str, Any]] = {
    "zero, free": FREE,
    "static, rest": {"boundary.start.torque": "static", "boundary.goal.torque": "rest"},
    "preloads": {
        "boundary.start.internal_force": [5.0, -3.0, 0.0],
        "boundary.goal.internal_force": [1.0, 2.0, 0.0],
    },
    "rest, numbers": {
        "boundary.start.torque": "rest",
        "boundary.goal.torque": [0.1, -0.2, 0.3, -0.4],
    },
}


def of(mechanism: Mechanism, values: dict[str, Any]) -> BoundaryValueProblem:
    """The mechanism's problem with other values, its chain built before."""
    scenario = mechanism.scenario.override(values)
    return make_problem(scenario, make_transport(scenario, mechanism.chain))


def states_near_the_guess(problem: BoundaryValueProblem, count: int = 4) -> tuple:
    """Shares with both ends, and scaled states and costates of order one."""
    guess = problem.straight_guess
    share = np.linspace(0.0, 1.0, count)
    x = np.array([np.interp(share, guess.share, column) for column in guess.x.T]).T
    z = problem.scaled(x)
    z[problem.criterion.p :] += np.random.default_rng(0).normal(size=z[problem.criterion.p :].shape)
    return share, z


def blocks(problem: BoundaryValueProblem) -> list[slice]:
    criterion = problem.criterion
    places = [criterion.at_y, criterion.at_rate, criterion.at_n1, criterion.at_n2]
    if criterion.torque_is_state:
        places += [criterion.at_tau, criterion.at_n3]
    return places


@pytest.mark.parametrize("kind", KINDS)
def test_jacobian_is_the_derivative_of_the_right_side(mechanism: Mechanism, kind: str) -> None:
    problem = of(mechanism, KINDS[kind])
    share, z = states_near_the_guess(problem)
    found = problem.jacobian(share, z)
    wanted = differences(
        lambda d: problem.right_side(share, z + d[:, None]), len(z), 2e-3
    ).transpose(0, 2, 1)
    assert np.all(np.isfinite(wanted))
    for row in blocks(problem):
        for column in blocks(problem):
            block, should = found[row, column], wanted[row, column]
            # second derivatives are forward differences; Newton's method needs no more
            assert np.max(np.abs(block - should)) < 3e-5 * max(1.0, np.max(np.abs(should)))


@pytest.mark.parametrize("ends", ENDS)
def test_boundary_jacobian_is_the_derivative_of_the_conditions(
    mechanism: Mechanism, ends: str
) -> None:
    values = dict(ENDS[ends])
    if "rest, numbers" in ends:
        values["boundary.goal.torque"] = [0.1] * mechanism.chain.n
    if ends == "preloads" and mechanism.chain.normal is None:
        values["boundary.start.internal_moment"] = [0.1, 0.2, -0.3]
    problem = of(mechanism, values)
    _, z = states_near_the_guess(problem, 2)
    start, goal = z[:, 0], z[:, 1]
    at_start, at_goal = problem.boundary_jacobian(start, goal)
    size = problem.criterion.state_size
    assert problem.boundary(start, goal).shape == (2 * size,)
    for along in np.random.default_rng(1).normal(size=(6, 2 * size)):
        for found, place in ((at_start, (1.0, 0.0)), (at_goal, (0.0, 1.0))):

            def moved(t: float, along: np.ndarray = along, place: Any = place) -> np.ndarray:
                return problem.boundary(start + t * place[0] * along, goal + t * place[1] * along)

            wanted = difference(moved, 1e-3)
            assert np.max(np.abs(found @ along - wanted)) < 1e-5 * np.max(np.abs(wanted))
    # each end has as many conditions as there are states, all of them independent
    assert np.linalg.matrix_rank(at_start[:size], tol=1e-6) == size
    assert np.linalg.matrix_rank(at_goal[size:], tol=1e-6) == size
    assert not at_start[size:].any()
    assert not at_goal[:size].any()


def test_the_papers_problem_has_16_equations_and_that_of_torque_8() -> None:
    assert len(problem_of(human()).scale) == 16
    assert len(problem_of(human({"criterion.kind": "torque"})).scale) == 8


@pytest.mark.parametrize("kind", ["torque-change", "torque"])
@pytest.mark.parametrize("ends", ENDS)
def test_duration_does_not_change_the_scaled_problem(kind: str, ends: str) -> None:
    """Without gravity a motion in another time is the same one with other units."""
    values = {"criterion.kind": kind}
    if "preload" not in ends and "numbers" not in ends:  # these do not scale with the duration
        values |= ENDS[ends]
    first, second = (
        problem_of(human(values | {"task.duration": duration})) for duration in (1.0, 0.05)
    )
    share, z = states_near_the_guess(first)
    a, b = first.right_side(share, z), second.right_side(share, z)
    assert np.max(np.abs(a - b)) < 1e-9 * np.max(np.abs(a))
    a, b = first.jacobian(share, z), second.jacobian(share, z)
    assert np.max(np.abs(a - b)) < 1e-4 * np.max(np.abs(a))
    a, b = first.boundary(z[:, 0], z[:, -1]), second.boundary(z[:, 0], z[:, -1])
    assert np.max(np.abs(a - b)) < 1e-9 * np.max(np.abs(a))


@pytest.mark.parametrize(
    "values",
    [
        {"object.mass": 0.0},
        {"object.mass": 1000.0},
        {"task.duration": 0.05},
        {"task.duration": 20.0},
        {"boundary.start.internal_force": [100.0, 100.0, 0.0]},
        {"criterion.weights": [1e6] * 4},
    ],
)
def test_scaled_solutions_are_of_order_one(values: dict[str, Any]) -> None:
    solution = solved(values)
    z = solution.problem.scaled(solution.states(np.linspace(0.0, 1.0, 101)))
    size = np.max(np.abs(z), axis=1)
    assert np.max(size) < 30.0
    for place in blocks(solution.problem):
        assert np.max(size[place]) > 1e-3


def test_scaling_there_and_back() -> None:
    problem = problem_of(human({"object.mass": 50.0}))
    _, z = states_near_the_guess(problem)
    assert np.allclose(problem.scaled(problem.physical(z)), z, rtol=1e-14)
    assert problem.physical(z).shape == z.T.shape


def test_where_the_chain_cannot_close_the_equations_say_so() -> None:
    problem = problem_of(human())
    share, z = states_near_the_guess(problem, 5)
    problem.right_side(share, z)
    assert problem.lost is None
    away = z.copy()
    # elbows turned back to back: whichever joints are independent, the hands cannot meet
    q = np.array([np.pi, np.pi, 0.0, np.pi])
    away[: problem.criterion.p, 2] = q[problem.transport.joints.independent]
    slope = problem.right_side(share, away)
    assert np.isnan(slope[:, 2]).any()
    assert np.isfinite(slope[:, [0, 1, 3, 4]]).all()
    assert problem.lost == pytest.approx(share[2])
    problem.right_side(share, z)
    assert problem.lost is None
    problem.right_side(share, away)
    assert problem.lost == pytest.approx(share[2])


def test_a_kept_evaluation_is_as_closed_as_asked_and_the_callers_array_his_own() -> None:
    problem = problem_of(human())
    share, z = states_near_the_guess(problem, 5)
    x = problem.physical(z)
    x[:, problem.criterion.at_y] += 0.01
    chain = problem.transport.chain

    def gap(closure: float) -> float:
        at = problem.evaluate(share, x, closure).tangent.at
        return float(np.max(np.abs(chain.gap(at))))

    assert 1e-11 < gap(1e-3) < 1e-3
    assert gap(1e-12) < 1e-11
    assert gap(1e-3) < 1e-11, "the better of those kept"
    asked = x.copy()
    kept = problem.evaluate(share, x)
    wanted = kept.tau.copy(), kept.n2.copy()
    x[:] = 0.0
    again = problem.evaluate(share, asked)
    np.testing.assert_array_equal(again.tau, wanted[0])
    np.testing.assert_array_equal(again.n2, wanted[1])


def test_the_straight_guess_moves_the_object_along_the_line() -> None:
    problem = problem_of(human())
    guess, chain = problem.straight_guess, problem.transport.chain
    q, _, closed = problem.coordinates.close(guess.share, guess.x[:, problem.criterion.at_y])
    assert closed.all()
    position, _ = chain.object_pose(chain.dynamics.placements(q))
    start, goal = position[0], position[-1]
    assert np.allclose(start, [0.1, 0.4, 0.0], atol=1e-9)
    assert np.allclose(goal, [0.4, 0.3, 0.0], atol=1e-9)
    off = np.cross((goal - start) / np.linalg.norm(goal - start), position - start)
    assert np.max(np.abs(off)) < 1e-9
    assert not guess.x[:, problem.criterion.state_size :].any(), "costates start at zero"


def test_remembered_motions_are_where_closure_is_sought() -> None:
    """The other elbow closes the chain too; which one is found is where it was last."""
    problem = problem_of(human())
    share, z = states_near_the_guess(problem, 6)
    y = problem.physical(z)[:, problem.criterion.at_y]
    q, _, _ = problem.coordinates.close(share, y)
    problem.coordinates.remember(share, q)
    again, _, closed = problem.coordinates.close(share, y)
    assert closed.all()
    assert np.allclose(again, q, atol=1e-10)


def test_cost_so_far_is_that_of_the_last_mesh() -> None:
    solution = solved()
    problem = problem_of(human())
    assert problem.cost_so_far() == problem.straight_guess.cost
    share = np.linspace(0.0, 1.0, 201)
    problem.right_side(share, problem.scaled(solution.states(share)))
    assert problem.cost_so_far() == pytest.approx(solution.cost, rel=1e-6)
    # samples within intervals, as collocation's middle points, are no mesh
    inner = 0.5 * (share[1:] + share[:-1])
    problem.right_side(inner, 0.5 * problem.scaled(solution.states(inner)))
    assert problem.cost_so_far() == pytest.approx(solution.cost, rel=1e-6)


def test_the_solution_meets_equations_and_conditions() -> None:
    solution = solved()
    problem = solution.problem
    ends = problem.scaled(solution.states(np.array([0.0, 1.0])))
    assert np.max(np.abs(problem.boundary(ends[:, 0], ends[:, 1]))) < 1e-9
    share = np.linspace(0.01, 0.99, 99)
    step = 1e-4
    around = [problem.scaled(solution.states(share + k * step)) for k in (-1, 1)]
    slope = (around[1] - around[0]) / (2 * step)
    off = slope - problem.right_side(share, problem.scaled(solution.states(share)))
    assert np.max(np.abs(off) / (1.0 + np.abs(slope))) < 1e-3


def test_transport_without_way_still_scales() -> None:
    """Start and goal alike: nothing moves, and nothing is divided by zero."""
    here = {"task.goal.xyz": [0.1, 0.4, 0.0]}
    problem = problem_of(human(here))
    assert np.all(np.isfinite(problem.scale))
    assert np.all(problem.scale > 0.0)
    assert transport_of(human(here)).guess.std(axis=0).max() < 1e-12
