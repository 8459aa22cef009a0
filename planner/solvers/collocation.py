"""Collocation: SciPy's `solve_bvp` on the scaled problem, with its exact Jacobian.

`solve_bvp` is a fourth-order collocation method with Newton's method on every mesh and residual
control between meshes: today's form of the finite-difference method of section 4.1.
"""

from __future__ import annotations

import contextlib
import io
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import solve_bvp

from planner.blas import one_blas_thread
from planner.boundary_value_problem import BoundaryValueProblem, Guess
from planner.outcome import Failure, failure
from planner.solution import ProgressCallback, Refinement, Solution, integrate_cost

if TYPE_CHECKING:
    from planner.scenario import Scenario

INITIAL_NODES = 21


class _RefinementReader(io.TextIOBase):
    """Turns the table that `solve_bvp` prints, a line per mesh, into refinements.

    The callback runs with the standard output that was; what it raises is kept and raised again
    after the solve, so that it is not taken for the solver's.
    """

    def __init__(self, problem: BoundaryValueProblem, progress: ProgressCallback | None) -> None:
        self.problem = problem
        self.progress = progress
        self.began = time.perf_counter()
        self.seen: list[Refinement] = []
        self.error: BaseException | None = None
        self._output = sys.stdout

    def write(self, text: str) -> int:
        for line in text.splitlines():
            columns = line.split()
            if len(columns) == 5 and columns[0].isdigit():
                step = Refinement(
                    nodes=int(columns[3]),
                    residual=float(columns[1]),
                    cost=self.problem.cost_so_far(),
                    seconds=time.perf_counter() - self.began,
                    stage="collocation",
                )
                self.seen.append(step)
                if self.progress is not None and self.error is None:
                    self._call(step)
        return len(text)

    def _call(self, step: Refinement) -> None:
        assert self.progress is not None
        try:
            with contextlib.redirect_stdout(self._output):
                self.progress(step)
        except Exception as error:
            self.error = error
            raise


def solve_collocation(
    problem: BoundaryValueProblem,
    *,
    tolerance: float,
    max_nodes: int,
    guess: Guess | None = None,
    jacobian: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
    progress: ProgressCallback | None = None,
    scenario: Scenario | None = None,
) -> Solution | Failure:
    """Returns the solution of the boundary value problem, or how the solve ended without one.

    Args:
        problem: The scaled problem.
        tolerance: Bound on the relative residual of the differential equations.
        max_nodes: Bound on the nodes of the mesh.
        guess: States and costates to start from; the straight line with zero costates if None.
        jacobian: Derivatives of the equations for Newton's method; the exact ones if None.
        progress: Called once per mesh.
        scenario: Named in a failure.
    """
    began = time.perf_counter()
    share, start = _mesh(problem, guess, max_nodes)
    reader = _RefinementReader(problem, progress)
    problem.boundary_calls = 0
    problem.ask_for(tolerance)
    with one_blas_thread(), contextlib.redirect_stdout(reader):
        try:
            found = solve_bvp(
                problem.right_side,
                problem.boundary,
                share,
                start,
                fun_jac=problem.jacobian if jacobian is None else jacobian,
                bc_jac=problem.boundary_jacobian,
                tol=tolerance,
                max_nodes=max_nodes,
                verbose=2,
            )
        except (ValueError, RuntimeError, np.linalg.LinAlgError) as error:
            if reader.error is not None:
                raise
            return _lost_or_singular(problem, scenario, str(error))
    seconds = time.perf_counter() - began
    residual = float(np.max(found.rms_residuals))
    evidence = {"nodes": len(found.x), "rms_residual": residual, "seconds": seconds}
    if found.status == 2 or not np.all(np.isfinite(found.y)):
        return _lost_or_singular(problem, scenario, found.message, **evidence)
    if found.status == 1 and residual < 10.0:
        return failure(
            "mesh-full",
            f"{len(found.x)} nodes leave a residual of {residual:.1e}, above {tolerance:.1e}, and "
            f"solver.max_nodes = {max_nodes} allows no finer mesh",
            scenario,
            **evidence,
        )
    if found.status != 0:
        return failure(
            "no-descent",
            f"Newton's method no longer reduces the residual, which stands at {residual:.1e}",
            scenario,
            **evidence,
        )

    def states(at: np.ndarray) -> np.ndarray:
        return problem.physical(found.sol(at))

    return Solution(
        problem=problem,
        method="collocation",
        mesh=found.x,
        states=states,
        cost=integrate_cost(problem, found.x, states),
        known_residual=residual,
        # one call looks at the shape; every mesh takes one before its first step and after its last
        iterations=problem.boundary_calls - 1 - 2 * len(reader.seen),
        refinements=tuple(reader.seen),
        seconds=seconds,
    )


def _mesh(
    problem: BoundaryValueProblem, guess: Guess | None, max_nodes: int
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the first mesh and scaled states on it."""
    if guess is not None:
        return guess.share, problem.scaled(guess.x)
    guess = problem.straight_guess
    share = np.linspace(0.0, 1.0, min(INITIAL_NODES, max_nodes))
    x = np.array([np.interp(share, guess.share, column) for column in guess.x.T]).T
    return share, problem.scaled(x)


def _lost_or_singular(
    problem: BoundaryValueProblem, scenario: Scenario | None, message: str, **evidence: object
) -> Failure:
    if problem.lost is not None:
        at = problem.lost * problem.transport.duration
        return failure(
            "closure-lost",
            f"closure lost at t = {at:.3f} s: there the arms no longer reach each other",
            scenario,
            time=at,
            **evidence,
        )
    return failure(
        "singular-jacobian",
        f"the Newton matrix is singular ({message.strip().rstrip('.').lower()})",
        scenario,
        **evidence,
    )
