"""The cheapest setting of each method that reaches an accuracy, found by trying."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache

from peers.casadi_collocation import Collocation
from peers.casadi_scheme import Scheme, SolverName
from peers.measure import (
    Contestant,
    Run,
    Timing,
    casadi_contestant,
    plain_contestant,
    planner_contestant,
    reference_cost,
    summary,
)
from peers.task import read_task
from planner.assembly import build_chain
from planner.chain import ClosedChain
from planner.scenario import Scenario

TOLERANCES = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6)
GRID = {
    3: (2, 3, 4, 6, 8, 10, 12, 16, 20),
    4: (2, 3, 4, 5, 6, 8, 10, 12),
    5: (1, 2, 3, 4, 5, 6, 8),
    6: (1, 2, 3, 4, 5, 6),
    8: (1, 2, 3, 4),
    10: (1, 2, 3),
    12: (1, 2),
}
KINDS: dict[SolverName, tuple[tuple[bool, bool], ...]] = {
    # (lifted, scalar); what never won is left out
    "ipopt": ((False, True), (True, True), (True, False)),
    "fatrop": ((False, True), (False, False)),
}


@dataclass(frozen=True, eq=False)
class Case:
    """A problem with its reference cost.

    Attributes:
        title: What it is called.
        scenario: What is asked.
        chain: The loaded model.
        reference: Converged cost.
    """

    title: str
    scenario: Scenario
    chain: ClosedChain
    reference: float


def make_case(title: str, scenario: Scenario) -> Case:
    """Returns a problem with its reference cost."""
    chain = build_chain(scenario)
    return Case(title, scenario, chain, reference_cost(scenario, chain))


class Chooser:
    """Finds the cheapest settings for one case; remembers what was tried."""

    def __init__(self, case: Case, grid: dict[int, tuple[int, ...]] | None = None) -> None:
        self.case = case
        self.grid = grid or GRID
        self._error = cache(self._grid_error)
        self._fastest: dict[tuple[SolverName, float], Scheme] = {}

    def _grid_error(self, intervals: int, degree: int) -> float:
        """Returns the relative error of a grid, solved to the end."""
        task = read_task(self.case.scenario, self.case.chain)
        scheme = Scheme(intervals, degree, lifted=True, scalar=False)
        answer = Collocation(task, scheme, "ipopt", tolerance=1e-9).solve()
        if not answer.solved:
            return float("inf")
        return abs(answer.cost / self.case.reference - 1.0)

    def grids(self, accuracy: float) -> list[tuple[int, int]]:
        """Returns, for each degree, the coarsest grid that reaches the accuracy.

        The next finer one must reach it too: an error that happens to change its sign is luck.
        """
        found = []
        for degree, counts in self.grid.items():
            good = False
            for place, intervals in enumerate(counts):
                before, good = good, self._error(intervals, degree) <= accuracy
                if before and good:
                    found.append((counts[place - 1], degree))
                    break
        return found

    def casadi(self, solver: SolverName, accuracy: float, compiled: str = "") -> list[Contestant]:
        """Returns the settings that solve fastest, and that build and solve fastest.

        Compiled, only what solved fastest before: each trial takes its time.
        """
        grids = sorted(self.grids(accuracy), key=lambda grid: grid[0] * grid[1])[:4]
        schemes = [
            Scheme(intervals, degree, lifted, scalar)
            for intervals, degree in grids
            for lifted, scalar in KINDS[solver]
        ]
        if compiled:
            fastest = self._fastest.get((solver, accuracy))
            schemes = [] if fastest is None else [fastest]
        trials = []
        for scheme in schemes:
            trial = self._trial(scheme, solver, accuracy, compiled)
            if trial is not None:
                trials.append((scheme, *trial))
        if not trials:
            return []
        solves = min(trials, key=lambda trial: trial[2].run.solve)
        both = min(trials, key=lambda trial: trial[2].run.build + trial[2].run.solve)
        self._fastest[solver, accuracy] = solves[0]
        return [solves[1]] if solves is both else [solves[1], both[1]]

    def _trial(
        self, scheme: Scheme, solver: SolverName, accuracy: float, compiled: str
    ) -> tuple[Contestant, Timing] | None:
        """Returns a setting with its timing; with a tighter tolerance where that is what lacks."""
        for tolerance in (accuracy, 0.01 * accuracy):
            contestant = casadi_contestant(self.case.scenario, scheme, solver, tolerance, compiled)
            timing = self._timing(contestant, 1 if compiled else 3)
            if timing.error <= accuracy:
                return contestant, timing
        return None

    def planner(self, method: str, accuracy: float) -> list[Contestant]:
        """Returns this planner with the loosest tolerance that reaches the accuracy."""
        return self._loosest(
            (
                planner_contestant(
                    self.case.scenario.override(
                        {"solver.method": method, "solver.tolerance": tolerance}
                    )
                )
                for tolerance in TOLERANCES
            ),
            accuracy,
        )

    def plain(self, accuracy: float) -> list[Contestant]:
        """Returns plain `solve_bvp` with the loosest tolerance that reaches the accuracy."""
        return self._loosest(
            (plain_contestant(self.case.scenario, tolerance) for tolerance in TOLERANCES),
            accuracy,
        )

    def _loosest(self, contestants: Iterable[Contestant], accuracy: float) -> list[Contestant]:
        for contestant in contestants:
            if self._timing(contestant, 1).error <= accuracy:
                return [contestant]
        return []

    def _timing(self, contestant: Contestant, runs: int) -> Timing:
        runner = contestant.load()
        results: Sequence[Run] = [runner.run() for _ in range(runs)]
        return summary(contestant, results, self.case.reference)
