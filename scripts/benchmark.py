#!/usr/bin/env python
"""Times the planner on the paper's torque-change problem and says where the time goes.

    python scripts/benchmark.py --runs 20 --set object.mass=8

Prints medians for the loosest tolerance that gives the cost to 1e-6, how many times the time of
the same Pinocchio calls alone that is, and a profile by phase.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from peers.profiling import Profile, pinocchio_seconds, profiled
from rich.console import Console
from rich.table import Table

SCENARIO = Path(__file__).resolve().parents[1] / "urdf" / "human_arms" / "transport.toml"
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
REFERENCE_TOLERANCE = 1e-7
console = Console(width=None if sys.stdout.isatty() else 120)


def main(
    scenario: Annotated[Path, typer.Argument(help="scenario")] = SCENARIO,
    set_: Annotated[list[str] | None, typer.Option("--set", help="key=value")] = None,
    runs: Annotated[int, typer.Option(min=1, help="runs that count")] = 20,
    accuracy: Annotated[float, typer.Option(help="relative error of the cost")] = 1e-6,
) -> None:
    """Times the planner and prints a profile by phase."""
    import planner

    base = planner.load(scenario, set_ or [])
    reference = _reference(base)
    console.print(f"{base.title or scenario}: {base.criterion.kind}, cost {reference:.9f}")
    for method in ("collocation", "spectral"):
        chosen = base.override({"solver.method": method})
        tolerance = _loosest(chosen, reference, accuracy)
        if tolerance is None:
            console.print(f"[yellow]{method}: no tolerance gives the cost to {accuracy:.0e}")
            continue
        _report(method, chosen.override({"solver.tolerance": tolerance}), reference, runs)


def _reference(base: Any) -> float:
    """Returns the cost at a tight tolerance, whose error is far below 1e-6."""
    import planner

    tight = {"solver.tolerance": REFERENCE_TOLERANCE, "solver.max_nodes": 20000}
    return planner.plan(base.override(tight)).unwrap().cost


def _loosest(base: Any, reference: float, accuracy: float) -> float | None:
    """Returns the loosest tolerance that gives the cost to an accuracy."""
    import planner

    for tolerance in TOLERANCES:
        found = planner.plan(base.override({"solver.tolerance": tolerance}))
        if found.solved and abs(found.cost / reference - 1.0) <= accuracy:
            return tolerance
    return None


def _report(method: str, scenario: Any, reference: float, runs: int) -> None:
    """Prints times, their ratio to Pinocchio's own, and the profile."""
    import time
    from statistics import median, quantiles

    import planner

    seconds, found = [], None
    for turn in range(runs + 2):
        began = time.perf_counter()
        found = planner.plan(scenario).unwrap()
        if turn >= 2:
            seconds.append(time.perf_counter() - began)
    profile = profiled(lambda: planner.plan(scenario), max(3, runs // 4))
    alone = pinocchio_seconds(profile.calls)
    whole = median(seconds)
    spread = quantiles(seconds, n=4) if runs > 1 else [whole] * 3
    console.print(
        f"\n[bold]{method}[/bold], tolerance {scenario.solver.tolerance:.0e}, "
        f"{found.solver['nodes']} nodes, error of the cost {abs(found.cost / reference - 1.0):.1e}"
    )
    console.print(
        f"  plan: median {1e3 * whole:.1f} ms of {runs} runs, quartiles {1e3 * spread[0]:.1f} "
        f"and {1e3 * spread[2]:.1f} ms"
    )
    console.print(
        f"  Pinocchio: {sum(call.count for call in profile.calls)} calls, alone "
        f"{1e3 * alone:.2f} ms; the plan takes {whole / alone:.1f} times that"
    )
    _table(profile)


def _table(profile: Profile) -> None:
    table = Table(caption="ms a plan, each phase without those inside it; profiling adds a little")
    for name in ("phase", "time", "share", "of it calling Pinocchio", "calls"):
        table.add_column(name, justify="left" if name == "phase" else "right")
    total = sum(phase.seconds for phase in profile.phases)
    for phase in profile.phases:
        table.add_row(
            phase.name,
            f"{1e3 * phase.seconds:.2f}",
            f"{phase.seconds / total:.0%}",
            f"{1e3 * phase.pinocchio:.2f}" if phase.pinocchio else "",
            str(phase.count),
        )
    table.add_section()
    inside = sum(phase.pinocchio for phase in profile.phases)
    table.add_row("all", f"{1e3 * total:.2f}", "100%", f"{1e3 * inside:.2f}", "")
    console.print(table)


if __name__ == "__main__":
    typer.run(main)
