#!/usr/bin/env python
"""Times a second plan, of a changed scenario, that starts from the first.

Every run is a session of its own, in a new process: the first plan pays for what Python, SciPy and
the planner load and keep, the second starts from it. So that the two can be told apart, the changed
scenario is then planned from scratch, and from the first plan once more, in the warm process.

    python scripts/benchmark_second.py --runs 20 [urdf/two_pandas/lift.toml ...] [--set key=value]
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from statistics import median
from typing import Annotated, Any

import typer
from peers.worker import Worker
from rich.console import Console
from rich.table import Table

SCENARIO = Path(__file__).resolve().parents[1] / "urdf" / "human_arms" / "transport.toml"
CHANGES = ("mass", "goal", "duration")
PHASES = ("first", "second", "scratch", "again")
console = Console(width=None if sys.stdout.isatty() else 130)


@dataclass
class Session:
    """One session: a scenario, then a changed one."""

    scenario: Path
    values: list[str]
    change: str
    known: dict[str, Any] = field(default_factory=dict)

    def load(self) -> None:
        """Reads the scenario, which both plans need."""
        import planner

        self.known["base"] = planner.load(self.scenario, self.values)

    def first(self) -> float:
        """Returns the seconds that the first plan takes."""
        plan, seconds = _timed(self.known["base"])
        self.known |= {"plan": plan, "changed": _changed(plan.scenario, self.change)}
        return seconds

    def second(self) -> float:
        """Returns the seconds that the changed scenario takes from the first plan on."""
        _, seconds = _timed(self.known["changed"], start=self.known["plan"])
        return seconds

    def scratch(self) -> float:
        """Returns the seconds that it takes without the first plan, everything loaded."""
        _, seconds = _timed(self.known["changed"])
        return seconds

    def again(self) -> float:
        """Returns the seconds of a second plan, everything loaded."""
        return self.second()


def _timed(scenario: Any, **how: Any) -> tuple[Any, float]:
    import planner

    began = time.perf_counter()
    plan = planner.plan(scenario, **how).unwrap()
    return plan, time.perf_counter() - began


def _changed(scenario: Any, change: str) -> Any:
    """Returns the scenario with a fifth more mass, a goal 2 cm off, or a tenth more time."""
    if change == "mass":
        return scenario.override({"object.mass": 1.2 * (scenario.object.mass or 2.0)})
    if change == "duration":
        return scenario.override({"task.duration": 1.1 * scenario.task.duration})
    goal = list(scenario.task.goal.xyz)
    return scenario.override({"task.goal.xyz": [goal[0] - 0.02, *goal[1:]]})


def session(scenario: Path, values: list[str], change: str) -> dict[str, float]:
    """Returns the seconds of each phase of one session, in a process of its own."""
    with Worker(partial(Session, scenario, values, change)) as worker:
        worker.ask("load")
        return {phase: worker.ask(phase) for phase in PHASES}


def main(
    scenarios: Annotated[list[Path] | None, typer.Argument(help="scenarios")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="key=value")] = None,
    runs: Annotated[int, typer.Option(min=1, help="sessions for each change")] = 20,
) -> None:
    """Times sessions and prints medians in ms."""
    table = Table(caption=f"medians of {runs} sessions, ms of the whole call planner.plan")
    for name in ("scenario", "change", "first", "second", "second / first"):
        table.add_column(name, justify="left" if name in ("scenario", "change") else "right")
    for name in ("warm: scratch", "from the plan", "ratio"):
        table.add_column(name, justify="right")
    for path in scenarios or [SCENARIO]:
        for change in CHANGES:
            every = [session(path, set_ or [], change) for _ in range(runs)]
            first, second, scratch, again = (
                1e3 * median(one[phase] for one in every) for phase in PHASES
            )
            times = f"{first:.0f}", f"{second:.0f}", f"{second / first:.2f}"
            warm = f"{scratch:.0f}", f"{again:.0f}", f"{again / scratch:.2f}"
            table.add_row(f"{path.parent.name}/{path.stem}", change, *times, *warm)
        table.add_section()
    console.print(table)


if __name__ == "__main__":
    typer.run(main)
