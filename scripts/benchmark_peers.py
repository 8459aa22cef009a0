#!/usr/bin/env python
"""Times this planner against what one would use instead, in one run, on one thread each.

CasADi with IPOPT and with fatrop (direct collocation, exact Hessians), and SciPy's solve_bvp used
the plain way. Needs the extra `bench`. Sections: paper, growth, pandas.

    python scripts/benchmark_peers.py --section paper --runs 20 --plot peers.png
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Annotated

import typer
from peers.casadi_scheme import Scheme
from peers.choice import Case, Chooser, make_case
from peers.growth import PANDA_COST, planar_pair, two_pandas
from peers.measure import (
    Contestant,
    casadi_contestant,
    measure,
    planner_contestant,
)
from peers.report import PLANNERS, Report, Series, draw, machine, show_case, show_series
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn

import planner

SCENARIO = Path(__file__).resolve().parents[1] / "urdf" / "human_arms" / "transport.toml"
PAPER = (
    ("Torque-change, zero ends", ()),
    ("Torque-change, free end", ("boundary.goal.torque=free",)),
    ("Torque", ("criterion.kind=torque",)),
)
METHODS = ("collocation", "spectral")
PANDA_GRID = {
    2: (8, 10, 14, 20, 26, 32),
    3: (4, 6, 8, 10, 12, 16),
    4: (3, 4, 5, 6, 8, 10, 12),
    5: (2, 3, 4, 5, 6, 8, 10),
    6: (2, 3, 4, 5, 6, 8),
}
# of unit size, so that light links do not spin at no cost: a well-posed problem at every size
GROWTH_CRITERION = {"kind": "torque-change", "weights": "effort", "speed_cost": 0.5}
GROWTH_SCHEME = (8, 4)
NODE_INTERVALS = (8, 16, 32, 64, 128)
NODE_TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)

console = Console(width=None if sys.stdout.isatty() else 150)


def paper(report: Report, accuracies: list[float], runs: int, compiled: str) -> None:
    """Times the paper's three problems at each accuracy."""
    for title, changes in PAPER:
        with _working(f"{title}: reference"):
            chooser = Chooser(make_case(title, planner.load(SCENARIO, changes)))
        console.print(f"\n{title}: reference cost {chooser.case.reference:.9f}")
        for accuracy in accuracies:
            _compete(report, chooser, accuracy, runs, compiled, plain=True)


def pandas(report: Report, accuracies: list[float], runs: int, compiled: str) -> None:
    """Times two Pandas with a rigid grasp under gravity, with unit and with effort weights."""
    for weights in ("unit", "effort"):
        title = f"Two Pandas, rigid grasp, gravity, {weights} weights"
        with tempfile.TemporaryDirectory() as folder:
            with _working(f"{title}: reference"):
                scenario = two_pandas(Path(folder)).override({"criterion.weights": weights})
                case = make_case(title, scenario)
            console.print(f"\n{title}: reference cost {case.reference:.6f}")
            if weights == "unit":
                off = case.reference / PANDA_COST - 1.0
                console.print(f"{off:+.1e} relative to {PANDA_COST}")
            chooser = Chooser(case, PANDA_GRID)
            for accuracy in accuracies:
                _compete(report, chooser, accuracy, runs, compiled, plain=False)


def _compete(
    report: Report, chooser: Chooser, accuracy: float, runs: int, compiled: str, *, plain: bool
) -> None:
    """Chooses everyone's cheapest settings for an accuracy and times them."""
    contestants: list[Contestant] = []
    with _working(f"{chooser.case.title}: choosing settings for {accuracy:.0e}"):
        for method in METHODS:
            contestants += chooser.planner(method, accuracy)
        for solver in ("ipopt", "fatrop"):
            contestants += chooser.casadi(solver, accuracy)
            if compiled:
                contestants += chooser.casadi(solver, accuracy, compiled)
        if plain:
            contestants += chooser.plain(accuracy)
    names = {contestant.method for contestant in contestants}
    for missing in [name for name in PLANNERS if name not in names]:
        console.print(f"[yellow]{missing}: does not reach {accuracy:.0e}[/yellow]")
    if not contestants:
        return
    with _working(f"{chooser.case.title}: {runs} runs of {len(contestants)} settings"):
        timings = measure(contestants, runs, chooser.case.reference)
    show_case(console, chooser.case.title, accuracy, timings)
    report.cases.append((chooser.case.title, accuracy, timings))


def growth(report: Report, runs: int, joints: list[int]) -> None:
    """Times planar pairs of ever more joints, then the paper's problem on ever more nodes."""
    rows: dict[str, list[tuple[int, float, int]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for count in joints:
            extra = {"criterion": GROWTH_CRITERION}
            scenario = planar_pair(Path(folder), count, count, **extra)
            with _working(f"Two planar arms of {count} joints"):
                _grow(rows, make_case(f"{count} joints", scenario), count, runs)
    report.joints = _series(rows)
    show_series(console, "Two planar arms of 2 to 7 joints each", "joints", report.joints)
    case = make_case("nodes", planner.load(SCENARIO))
    rows = {}
    with _working("Growth with nodes"):
        contestants = [
            casadi_contestant(case.scenario, Scheme(k, 3, lifted), solver, 1e-8)
            for k in NODE_INTERVALS
            for solver, lifted in (("ipopt", True), ("fatrop", False))
        ]
        for tolerance in NODE_TOLERANCES:
            solver = {"solver.tolerance": tolerance, "solver.start": "line"}
            contestants.append(planner_contestant(case.scenario.override(solver)))
        for timing in measure(contestants, runs, case.reference):
            size = timing.run.size * (1 if timing.method in PLANNERS else 3)
            row = (size, timing.run.solve, timing.run.iterations)
            rows.setdefault(timing.method, []).append(row)
    report.nodes = _series(rows)
    show_series(console, "The paper's problem, ever more nodes", "nodes", report.nodes)


def _grow(rows: dict[str, list[tuple[int, float, int]]], case: Case, count: int, runs: int) -> None:
    """Adds the solve times of one size; says who failed or found another minimum."""
    intervals, degree = GROWTH_SCHEME
    contestants = [
        planner_contestant(case.scenario.override({"solver.method": method})) for method in METHODS
    ]
    contestants += [
        casadi_contestant(case.scenario, Scheme(intervals, degree, lifted), solver, 1e-6)
        for solver, lifted in (("ipopt", True), ("fatrop", False))
    ]
    for timing in measure(contestants, runs, case.reference):
        run = timing.run
        if not run.solved:
            console.print(f"[yellow]{count} joints: {timing.method} does not solve it[/yellow]")
            continue
        rows.setdefault(timing.method, []).append((count, run.solve, run.iterations))
        if timing.error > 1e-3:
            console.print(
                f"[yellow]{count} joints: {timing.method} ends at {run.cost:.6f}, the reference "
                f"is {case.reference:.6f}[/yellow]"
            )


def _series(rows: dict[str, list[tuple[int, float, int]]]) -> list[Series]:
    result = []
    for method, values in rows.items():
        sizes, seconds, iterations = zip(*values, strict=True)
        result.append(Series(method, sizes, seconds, iterations))
    return result


def _working(text: str) -> Progress:
    """Returns a line that shows what is being done, on terminals only."""
    line = Progress(
        SpinnerColumn(), TextColumn("{task.description}"), console=console, transient=True
    )
    line.add_task(text)
    return line


def main(
    section: Annotated[list[str] | None, typer.Option(help="paper, growth, pandas")] = None,
    runs: Annotated[int, typer.Option(min=1, help="runs of each setting")] = 20,
    accuracy: Annotated[
        list[float] | None, typer.Option(help="relative errors of the cost to be reached")
    ] = None,
    joints: Annotated[list[int] | None, typer.Option(help="joints of each arm in growth")] = None,
    plot: Annotated[Path | None, typer.Option(help="picture to write")] = None,
    compiled: Annotated[
        str, typer.Option(help='also compile the peers\' functions, e.g. "-O1": takes minutes')
    ] = "",
) -> None:
    """Times this planner against CasADi (IPOPT, fatrop) and plain solve_bvp."""
    report = Report()
    chosen = section or ["paper", "growth", "pandas"]
    console.print(machine())
    if "paper" in chosen:
        paper(report, accuracy or [1e-3, 1e-4, 1e-6], runs, compiled)
    if "growth" in chosen:
        growth(report, runs, joints or [2, 3, 4, 5, 6, 7])
    if "pandas" in chosen:
        pandas(report, accuracy or [1e-3, 1e-4, 1e-5], runs, compiled)
    if plot is not None:
        draw(report, plot)
        console.print(f"Picture: {plot}")


if __name__ == "__main__":
    typer.run(main)
