"""What the command line prints: progress, the closing table, failures, examinations."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from planner.remarks import scenario_remarks

if TYPE_CHECKING:
    from planner.body import Body
    from planner.chain import ClosedChain
    from planner.examination import ArmFacts, EndFacts, Examination
    from planner.outcome import Failure
    from planner.result import Plan
    from planner.scenario import Scenario
    from planner.solution import Refinement

PIPE_WIDTH = 10_000  # in a file a line stays a line
ALL_LINES = 40  # so many lines of progress are all printed
# check: how it is called, its unit
ACCURACY = {
    "pontryagin_residual": ("Pontryagin residual", "relative"),
    "hamiltonian": ("Hamiltonian drift", "of the range of its terms"),
    "second_variation": ("second variation, least", "of the cost; positive: a minimum"),
    "closure": ("closure", "m, rad"),
    "force_balance": ("force balance", "N"),
    "torque_balance": ("torque balance", "Nm"),
    "end_speed": ("speed at the ends", "rad/s"),
    "replay_end": ("replay error, end", "m"),
    "replay_max": ("replay error, largest", "m"),
    "replay_window": ("replay error, windows", "m"),
    "replay_growth": ("replay error, growth", "1/s"),
}


class Screen(Console):
    """A console that falls silent when its reader goes away, instead of ending the process.

    So `planner plan SCENARIO --out DIR | head` still writes the plan.
    """

    def on_broken_pipe(self) -> None:
        """Lets everything that is still to come go nowhere."""
        self.quiet = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.file.fileno())
        os.close(nowhere)


def screen(*, quiet: bool = False, errors: bool = False) -> Screen:
    """Returns what to print on: colours on a terminal, plain text in a pipe or a file.

    The stream is taken here and now, since solvers may redirect standard output while they run.

    Args:
        quiet: Print nothing.
        errors: Use standard error.
    """
    stream = sys.stderr if errors else sys.stdout
    return Screen(
        file=stream,
        quiet=quiet,
        width=None if stream.isatty() else PIPE_WIDTH,
        markup=False,
        highlight=False,
        emoji=False,
        soft_wrap=True,
    )


class Progress:
    """Prints what is being planned, then a line per mesh refinement, as they come.

    A solve that takes very many of them, or starts again and again, gets every tenth line.
    """

    def __init__(self, terminal: Console, scenario: Scenario) -> None:
        self.terminal = terminal
        self.scenario = scenario
        self.count = 0

    def __call__(self, step: Refinement) -> None:
        """Prints one line."""
        if not self.count:
            header = f"{'nodes':>8}{'residual':>12}{'cost':>16}{'time':>10}  stage"
            self.terminal.print(_heading(self.scenario))
            self.terminal.print(header, style="dim")
        self.count += 1
        if self.count > ALL_LINES and self.count % 10:
            return
        cost = f"{step.cost:.8g}" if np.isfinite(step.cost) else "-"
        self.terminal.print(
            f"{step.nodes:8d}{step.residual:12.1e}{cost:>16}{step.seconds:8.2f} s"
            f"  {step.stage}".rstrip()
        )


def _heading(scenario: Scenario) -> Text:
    title = scenario.title or (scenario.path.name if scenario.path else "Scenario")
    task = f": {scenario.criterion.kind}, {scenario.task.duration:g} s"
    return Text.assemble((title, "bold"), task)


def print_plan(terminal: Console, plan: Plan, *, heading: bool = True) -> None:
    """Prints the closing table of a plan, then what the reader should know."""
    terminal.print(_heading(plan.scenario) if heading else "")
    _print_table(terminal, _plan_table(plan))
    terminal.print()
    warnings = [str(line) for line in plan.checks.get("limits", ())]
    if "replay" in plan.checks:
        warnings.append(str(plan.checks["replay"]))
    _print_lines(terminal, "warning", "yellow", warnings)
    _print_lines(terminal, "note", "cyan", [*scenario_remarks(plan.scenario), *plan.remarks])


def _print_table(terminal: Console, table: Table) -> None:
    """Prints a table without the blanks that pad its last column."""
    with terminal.capture() as captured:
        terminal.print(table, soft_wrap=False)
    for line in captured.get().splitlines():
        terminal.print(Text.from_ansi(line.rstrip()))


def _plan_table(plan: Plan) -> Table:
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column(justify="right", no_wrap=True)
    table.add_column()
    table.add_row(
        Text("cost", "bold"), Text(f"{plan.cost:.8g}", "bold"), f"{plan.criterion}, solved"
    )
    start, goal = plan.object_position[[0, -1]]
    straight = float(np.linalg.norm(goal - start))
    table.add_row("path of the object", f"{plan.path_length:.4f}", f"m, {straight:.4f} m straight")
    size = np.linalg.norm(plan.internal_force, axis=1)
    peak = int(np.argmax(size))
    table.add_row("internal force, mean", f"{plan.mean_internal_force:.3f}", "N, left less right")
    table.add_row("internal force, largest", f"{size[peak]:.3f}", _at("N", plan.time[peak]))
    table.add_row(Text("largest torque", "bold"), "", "")
    for joint, name in enumerate(plan.joint_names):
        k = int(np.argmax(np.abs(plan.tau[:, joint])))
        table.add_row(f"  {name}", f"{plan.tau[k, joint]:.3f}", _at("Nm", plan.time[k]))
    table.add_row(Text("accuracy", "bold"), "", "")
    for check, (name, unit) in ACCURACY.items():
        if check in plan.checks:
            table.add_row(f"  {name}", f"{plan.checks[check]:.1e}", unit)
    solver = plan.solver
    total = solver.get("seconds_total", solver.get("seconds", float("nan")))
    table.add_row(Text("time spent", "bold"), f"{total:.3f}", "s, " + _effort(solver))
    return table


def _at(unit: str, time: float) -> str:
    return f"{unit} at {time:.3f} s"


def _effort(solver: dict[str, object]) -> str:
    parts = [f"{solver.get('method', 'solve')} {solver.get('seconds', 0.0):.3f} s"]
    for key, name in (("nodes", "node"), ("iterations", "Newton iteration")):
        if solver.get(key) is not None:
            parts.append(f"{solver[key]} {name}{'' if solver[key] == 1 else 's'}")
    return ", ".join(parts)


def _print_lines(terminal: Console, word: str, colour: str, lines: Sequence[str]) -> None:
    for line in dict.fromkeys(lines):
        terminal.print(Text.assemble((f"{word}: ", colour), line))


def print_failure(failure: Failure, out: Path | None) -> None:
    """Prints to standard error how a solve ended without a plan, and what to try next.

    Args:
        failure: The failure.
        out: The folder that it was saved in, if any.
    """
    terminal = screen(errors=True)
    terminal.print(Text.assemble(("not solved: ", "red"), (failure.status, "bold")))
    terminal.print(f"  reason  {failure.reason}")
    terminal.print(f"  remedy  {failure.remedy}")
    if out is not None:
        terminal.print(f"  report  {out / 'plan.json'} (no trajectory)")


def print_stale(files: Sequence[Path]) -> None:
    """Warns of pictures of an earlier plan, which a failed solve leaves alone."""
    lines = [f"{file} is of an earlier plan" for file in files]
    _print_lines(screen(errors=True), "warning", "yellow", lines)


def print_examination(terminal: Console, found: Examination) -> None:
    """Prints what `planner check` found: the parts, the closed chain, both ends, and the faults."""
    scenario = found.scenario
    terminal.print(_heading(scenario))
    for arm in found.arms:
        if arm is not None:
            _print_arm(terminal, arm)
    if found.body is not None:
        _print_facts(terminal, "object", _body_facts(found.body))
    if found.chain is not None:
        _print_facts(terminal, "closed chain", _chain_facts(found.chain))
    for end in found.ends:
        _print_facts(terminal, end.name, _end_facts(end))
    terminal.print()
    _print_lines(terminal, "problem", "red", found.problems)
    _print_lines(terminal, "doubt", "yellow", found.doubts)
    if found.possible:
        verdict = "can be planned" + (", with the doubts above" if found.doubts else "")
        terminal.print(Text(verdict, "green"))
    else:
        count = len(found.problems)
        terminal.print(Text(f"cannot be planned: {count} problem{'s'[: count > 1]}", "red"))


def _print_facts(terminal: Console, title: str, rows: Sequence[tuple[str, str]]) -> None:
    terminal.print(Text(f"\n{title}", "bold"))
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in rows:
        table.add_row(f"  {name}", value)
    _print_table(terminal, table)


def _print_arm(terminal: Console, facts: ArmFacts) -> None:
    arm = facts.arm
    origin = arm.model.jointPlacements[1].translation if arm.n else np.zeros(3)
    rows = [
        ("file", str(arm.urdf.path)),
        ("tip", arm.tip),
        ("first joint at", f"{_vector(origin)} m"),
        ("moving mass", f"{facts.mass:g} kg: {_masses(facts.masses)}"),
    ]
    if facts.fixed_masses:
        rows.append(("other links", _masses(facts.fixed_masses)))
    if arm.locked:
        rows.append(("locked joints", ", ".join(arm.locked)))
    _print_facts(terminal, f"{arm.side} arm", rows)
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    for header in ("  joint", "type", "range", "", "speed", "effort", "posture"):
        table.add_column(header, justify="left" if header in ("  joint", "type") else "right")
    for k, name in enumerate(arm.joint_names):
        posture = "" if arm.posture is None else f"{arm.posture[k]:g}"
        lower, upper = _limit(arm.lower[k]), _limit(arm.upper[k])
        speed, effort = _limit(arm.velocity_limit[k]), _limit(arm.effort_limit[k])
        table.add_row(f"  {name}", facts.joint_types[k], lower, upper, speed, effort, posture)
    _print_table(terminal, table)


def _masses(masses: dict[str, float]) -> str:
    return ", ".join(f"{link} {mass:g}" for link, mass in masses.items()) or "none"


def _limit(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "none"


def _vector(values: np.ndarray) -> str:
    # adding zero turns -0 into 0
    return "(" + ", ".join(f"{value + 0.0:.5g}" for value in np.round(values, 9)) + ")"


def _body_facts(body: Body) -> list[tuple[str, str]]:
    moments = np.linalg.eigvalsh(body.inertia)
    return [
        ("file", str(body.urdf.path)),
        ("mass", f"{body.mass:g} kg, centre at {_vector(body.com)} m"),
        ("inertia", f"{_vector(moments)} kg m^2 about its principal axes"),
    ]


def _chain_facts(chain: ClosedChain) -> list[tuple[str, str]]:
    moving = "planar" if chain.planar else "spatial"
    surplus, redundancy = chain.p - chain.r, chain.n - chain.p
    return [
        ("pair", f"{chain.pair.name}, {moving} mechanism"),
        ("joints", f"{chain.n}, each with a motor"),
        ("closure rows m", str(chain.m)),
        ("freedoms p", f"{chain.p} = joints - m"),
        ("task rows r", f"{chain.r} object coordinates prescribed"),
        ("surplus p - r", f"{surplus} ({'redundant arms' if surplus else 'no self-motion'})"),
        ("redundancy N - p", f"{redundancy} (motors beyond the freedoms: internal forces)"),
    ]


def _end_facts(end: EndFacts) -> list[tuple[str, str]]:
    rows = [("object", f"{_vector(end.position)} m")]
    if end.posture is None:
        return [*rows, ("posture", "out of reach")]
    left, right = end.arm_conditions
    return [
        *rows,
        ("posture", f"{_vector(np.round(end.posture, 4))} rad"),
        (
            "condition numbers",
            f"closure {end.closure_condition:.3g}, left arm {left:.3g}, right arm {right:.3g}",
        ),
    ]
