"""Collocation: its start, its mesh, what it reports, and every way in which it ends."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from mechanisms import human_arms as human
from plans import CASES, FREE, TORQUE, ZERO_ENDS, problem_of, solved

from planner.blas import one_blas_thread
from planner.boundary_value_problem import Guess
from planner.independent_joints import Coordinates
from planner.outcome import Failure
from planner.solution import Refinement, Solution, integrate_cost
from planner.solvers.collocation import INITIAL_NODES, solve_collocation

COSTS = {"zero ends": ZERO_ENDS, "free end": 7.344975, "torque": TORQUE}


def from_the_line(values: dict[str, Any], **settings: Any) -> Solution | Failure:
    settings = {"tolerance": 1e-4, "max_nodes": 2000} | settings
    return solve_collocation(problem_of(human(values)), **settings)


@pytest.mark.parametrize("case", CASES)
def test_the_straight_line_with_zero_costates_suffices(case: str) -> None:
    found = from_the_line(CASES[case], tolerance=1e-5)
    assert isinstance(found, Solution)
    assert found.cost == pytest.approx(COSTS[case], rel=1e-6)
    assert found.residual <= 1e-5
    assert found.mesh[0] == 0.0
    assert found.mesh[-1] == 1.0


def test_a_tighter_tolerance_is_kept_and_more_exact() -> None:
    exact = solved({"solver.tolerance": 1e-8, "solver.max_nodes": 9000}).cost
    errors, nodes = [], []
    for tolerance in (1e-2, 1e-4, 1e-6):
        found = from_the_line({}, tolerance=tolerance)
        assert isinstance(found, Solution)
        assert found.residual <= tolerance
        errors.append(abs(found.cost / exact - 1.0))
        nodes.append(len(found.mesh))
    assert nodes[0] < nodes[1] < nodes[2]
    assert errors[0] > errors[1] > errors[2]
    assert errors[1] < 1e-6


def test_iterations_count_newton_steps() -> None:
    """A start at the solution takes one step at most; the straight line several."""
    solution = solved(FREE)
    problem = solution.problem
    share = solution.mesh
    guess = Guess(share, solution.states(share), solution.cost)
    again = solve_collocation(problem, tolerance=1e-4, max_nodes=2000, guess=guess)
    assert isinstance(again, Solution)
    assert again.iterations <= 1
    assert np.array_equal(again.mesh, share)
    line = from_the_line(FREE)
    assert isinstance(line, Solution)
    assert line.iterations > 4


def test_progress_is_a_line_per_mesh(capsys: pytest.CaptureFixture[str]) -> None:
    seen: list[Refinement] = []

    def listen(step: Refinement) -> None:
        seen.append(step)
        print(f"mesh of {step.nodes}")  # noqa: T201

    found = from_the_line({}, progress=listen)
    assert isinstance(found, Solution)
    assert tuple(seen) == found.refinements
    assert seen[0].nodes == INITIAL_NODES
    assert seen[-1].nodes == len(found.mesh)
    assert seen[-1].residual == pytest.approx(found.residual, rel=0.01)
    assert seen[-1].cost == pytest.approx(found.cost, rel=1e-5)
    assert {step.stage for step in seen} == {"collocation"}
    seconds = [step.seconds for step in seen]
    assert seconds == sorted(seconds)
    # what the listener prints arrives; what SciPy prints does not
    lines = capsys.readouterr().out.splitlines()
    assert lines == [f"mesh of {step.nodes}" for step in seen]


class StopError(ValueError):
    """ValueError is among what SciPy's solver raises itself."""


@pytest.mark.parametrize("error", [StopError, RuntimeError, KeyboardInterrupt])
def test_what_the_callback_raises_is_raised_again(error: type[BaseException]) -> None:
    def stop(_: Refinement) -> None:
        raise error("enough")

    before = sys.stdout
    with pytest.raises(error, match="enough"):
        from_the_line({}, progress=stop)
    assert sys.stdout is before


def test_mesh_full() -> None:
    found = from_the_line({}, tolerance=1e-7, max_nodes=60)
    assert isinstance(found, Failure)
    assert found.status == "mesh-full"
    assert "max_nodes = 60" in found.reason
    assert "max_nodes" in found.remedy
    assert found.evidence["nodes"] <= 60
    assert found.evidence["rms_residual"] > 1e-7


def test_closure_lost() -> None:
    """A guess whose hands are apart from the middle on."""
    problem = problem_of(human())
    guess = problem.straight_guess
    x = guess.x.copy()
    apart = np.array([np.pi, np.pi, 0.0, np.pi])[problem.transport.joints.independent]
    x[guess.share > 0.45, : problem.criterion.p] = apart
    found = solve_collocation(
        problem, tolerance=1e-4, max_nodes=200, guess=Guess(guess.share, x, guess.cost)
    )
    assert isinstance(found, Failure)
    assert found.status == "closure-lost"
    assert 0.4 < found.evidence["time"] < 0.6
    assert f"t = {found.evidence['time']:.3f} s" in found.reason


def test_singular_jacobian(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = problem_of(human())
    nothing = np.zeros((16, 16))
    monkeypatch.setattr(problem, "boundary_jacobian", lambda *_: (nothing, nothing))
    found = solve_collocation(problem, tolerance=1e-4, max_nodes=200)
    assert isinstance(found, Failure)
    assert found.status == "singular-jacobian"
    assert "solver.start" in found.remedy


def test_cost_is_integrated_exactly_between_nodes() -> None:
    """Against the trapezoidal rule on a fine grid."""
    solution = solved()
    share = np.linspace(0.0, 1.0, 4001)
    x = solution.states(share)
    n3 = x[:, solution.problem.criterion.at_n3]
    wanted = np.trapezoid(0.5 * (n3**2).sum(axis=1), share)
    found = integrate_cost(solution.problem, solution.mesh, solution.states)
    assert found == pytest.approx(float(wanted), rel=1e-6)
    assert found == solution.cost


def test_one_blas_thread() -> None:
    from threadpoolctl import threadpool_info, threadpool_limits

    def threads() -> list[int]:
        return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]

    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        with one_blas_thread():
            assert set(threads()) == {1}
        assert threads() == before


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6])
def test_the_chain_is_closed_far_more_finely_than_the_residual_asks(
    monkeypatch: pytest.MonkeyPatch, tolerance: float
) -> None:
    """Left at 1e-9 m, gaps alone kept a light arm's residual above 1e-6, on any mesh."""
    gaps: list[float] = []
    right = Coordinates.close

    def watched(self: Coordinates, share: np.ndarray, y: np.ndarray) -> Any:
        gaps.append(self.tolerance)
        return right(self, share, y)

    monkeypatch.setattr(Coordinates, "close", watched)
    found = from_the_line({}, tolerance=tolerance)
    assert isinstance(found, Solution)
    assert found.residual <= tolerance
    assert max(gaps) == pytest.approx(1e-5 * tolerance)
