"""Contestants, and how they are timed: in turns, each in a process of its own, on one thread."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from statistics import median

from peers.casadi_collocation import Collocation
from peers.casadi_scheme import Scheme, SolverName
from peers.plain_bvp import PlainProblem
from peers.profiling import pinocchio_seconds, profiled
from peers.task import Task, read_task
from peers.worker import Worker
from planner import planning
from planner.assembly import build_chain
from planner.chain import ClosedChain
from planner.scenario import Scenario
from planner.transport import make_transport


@dataclass(frozen=True)
class Run:
    """One way from the loaded model to the solution, times in seconds.

    Attributes:
        start: Start and goal postures and the straight line.
        build: Writing down the problem and its derivatives; none where nothing is built.
        solve: The solve.
        cost: Cost found.
        solved: Whether it says that it solved the problem.
        iterations: Iterations.
        size: Nodes, intervals or coefficients.
        whole: The planner's whole call with forces, samples and checks; 0 for the others.
    """

    start: float
    build: float
    solve: float
    cost: float
    solved: bool
    iterations: int = 0
    size: int = 0
    whole: float = 0.0

    @property
    def total(self) -> float:
        """From the loaded model to the solution."""
        return self.start + self.build + self.solve


@dataclass(frozen=True)
class Runner:
    """A contestant with its model loaded.

    Attributes:
        run: Runs it once.
        floor: Gives the time of the solve's Pinocchio calls with nothing around them [s].
    """

    run: Callable[[], Run]
    floor: Callable[[], float] | None = None


@dataclass(frozen=True)
class Contestant:
    """A method with all its settings.

    Attributes:
        method: Name.
        setting: What was chosen for it.
        load: Loads the model, in whatever process is to run it.
    """

    method: str
    setting: str
    load: Callable[[], Runner]


@dataclass(frozen=True)
class Timing:
    """Medians over all runs of a contestant.

    Attributes:
        method: Name.
        setting: What was chosen for it.
        run: Medians.
        error: Relative error of the cost.
        count: Number of runs.
        floor: Time of the solve's Pinocchio calls alone [s]; 0 where there are none.
    """

    method: str
    setting: str
    run: Run
    error: float
    count: int
    floor: float = 0.0


def planner_contestant(scenario: Scenario) -> Contestant:
    """Returns this planner with the scenario's solver settings."""
    solver = scenario.solver
    name = "planner, certified" if solver.method == "collocation" else f"planner, {solver.method}"
    setting = f"tolerance {solver.tolerance:.0e}"
    return Contestant(name, setting, partial(_planner_runner, scenario))


def _planner_runner(scenario: Scenario) -> Runner:
    chain = build_chain(scenario)

    def run() -> Run:
        planning.solve(scenario, make_transport(scenario, chain))  # as for the peers, see there
        began = time.perf_counter()
        transport = make_transport(scenario, chain)
        ready = time.perf_counter()
        found = planning.solve(scenario, transport)
        solved = time.perf_counter()
        plan = planning.plan(scenario, chain=chain)
        ended = time.perf_counter()
        return Run(
            start=ready - began,
            build=0.0,
            solve=solved - ready,
            cost=getattr(plan, "cost", float("nan")),
            solved=plan.solved,
            iterations=getattr(found, "iterations", 0),
            size=len(getattr(found, "mesh", ())),
            whole=ended - solved,
        )

    def floor() -> float:
        transport = make_transport(scenario, chain)
        return pinocchio_seconds(profiled(lambda: planning.solve(scenario, transport), 1).calls)

    return Runner(run, floor)


def casadi_contestant(
    scenario: Scenario,
    scheme: Scheme,
    solver: SolverName,
    tolerance: float,
    compiled: str = "",
) -> Contestant:
    """Returns direct collocation in CasADi; what is compiled is built once for all its runs."""
    name = {"ipopt": "CasADi, IPOPT", "fatrop": "CasADi, fatrop"}[solver]
    load = partial(_casadi_runner, scenario, scheme, solver, tolerance, compiled)
    return Contestant(name + (f" ({compiled})" if compiled else ""), str(scheme), load)


def _casadi_runner(
    scenario: Scenario, scheme: Scheme, solver: SolverName, tolerance: float, compiled: str
) -> Runner:
    chain = build_chain(scenario)
    built: list[Collocation] = []

    def run() -> Run:
        began = time.perf_counter()
        task = read_task(scenario, chain)
        read = time.perf_counter() - began
        if not (compiled and built):
            built[:] = [Collocation(task, scheme, solver, tolerance=tolerance, compiled=compiled)]
        built[0].solve()  # the second solve counts, of everyone: the first one finds cold caches
        answer = built[0].solve()
        return Run(
            start=read + answer.guess,
            build=answer.build,
            solve=answer.solve,
            cost=answer.cost,
            solved=answer.solved,
            iterations=answer.iterations,
            size=scheme.intervals,
        )

    return Runner(run)


def plain_contestant(scenario: Scenario, tolerance: float) -> Contestant:
    """Returns `solve_bvp` used the plain way."""
    load = partial(_plain_runner, scenario, tolerance)
    return Contestant("plain solve_bvp", f"tolerance {tolerance:.0e}", load)


def _plain_runner(scenario: Scenario, tolerance: float) -> Runner:
    chain = build_chain(scenario)

    def run() -> Run:
        began = time.perf_counter()
        problem = PlainProblem(read_task(scenario, chain))
        read = time.perf_counter() - began
        problem.solve(tolerance)
        answer = problem.solve(tolerance)
        return Run(
            start=read,
            build=0.0,
            solve=answer.solve,
            cost=answer.cost,
            solved=answer.solved,
            size=answer.nodes,
        )

    return Runner(run)


def measure(
    contestants: Sequence[Contestant], runs: int, reference: float, budget: float = 60.0
) -> list[Timing]:
    """Returns the medians of each contestant, all taking turns so that ratios hold.

    Each has a process of its own: in a heap full of the others' graphs the same solve takes up to
    twice as long.

    Args:
        contestants: Whom to time.
        runs: Runs of each, after one that does not count. Who does not solve the problem is not
            run again.
        reference: Cost to which errors refer.
        budget: Seconds after which a contestant has fewer runs, but at least one that counts.
    """
    seen: list[list[Run]] = []
    left: list[int] = []
    with ExitStack() as stack:
        workers = [stack.enter_context(Worker(contestant.load)) for contestant in contestants]
        for worker in workers:
            began = time.perf_counter()
            first: Run = worker.ask("run")
            seconds = time.perf_counter() - began
            seen.append([first])
            left.append(max(1, min(runs, int(budget / seconds))) if first.solved else 0)
        for turn in range(max(left, default=0)):
            for place, worker in enumerate(workers):
                if turn >= left[place]:
                    continue
                if turn == 0:
                    seen[place].clear()
                seen[place].append(worker.ask("run"))
        floors = [
            worker.ask("floor") if results[-1].solved else None
            for worker, results in zip(workers, seen, strict=True)
        ]
    return [
        replace(summary(contestant, results, reference), floor=floor or 0.0)
        for contestant, results, floor in zip(contestants, seen, floors, strict=True)
    ]


def summary(contestant: Contestant, runs: Sequence[Run], reference: float) -> Timing:
    """Returns the medians of a contestant's runs."""
    times = {
        name: median(getattr(run, name) for run in runs)
        for name in ("start", "build", "solve", "whole")
    }
    typical = replace(runs[-1], **times, solved=all(run.solved for run in runs))
    error = abs(typical.cost / reference - 1.0) if typical.solved else float("inf")
    return Timing(contestant.method, contestant.setting, typical, error, len(runs))


def reference_cost(scenario: Scenario, chain: ClosedChain) -> float:
    """Returns the cost on a fine grid, by the peers' own means: the planner has no part in it.

    Raises:
        RuntimeError: The two finest grids do not agree.
    """
    task: Task = read_task(scenario, chain)
    schemes = (Scheme(10, 6, lifted=True, scalar=False), Scheme(13, 6, lifted=True, scalar=False))
    answers = [Collocation(task, scheme, "ipopt", tolerance=1e-9).solve() for scheme in schemes]
    costs = [answer.cost for answer in answers if answer.solved]
    if len(costs) < 2 or abs(costs[0] / costs[1] - 1.0) > 1e-7:
        raise RuntimeError(f"no converged reference: {answers}")
    return costs[-1]
