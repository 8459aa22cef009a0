"""What `planner reproduce` shows: a progress bar, then the verdicts and where the files are."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

if TYPE_CHECKING:
    from rich.console import Console


def show_reproduction(folder: Path | str, console: Console | None = None) -> Path:
    """Reproduces the paper with a progress bar and prints what came of it.

    Args:
        folder: Where figures, curves and report go.
        console: Where to print; standard output if None.

    Returns:
        The report.

    Raises:
        InputError: The paper's scenario is not there.
        NotSolvedError: One of the motions could not be planned.
        OSError: The folder cannot be written.
    """
    from planner.reproduction import reproduce_findings
    from planner.reproduction.findings import Verdict
    from planner.reproduction.report import tally
    from planner.terminal import screen

    console = console or screen()
    columns = (
        TextColumn("{task.description:<18}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("", total=None)

        def advance(label: str, done: int, total: int) -> None:
            bar.update(task, description=label, completed=done, total=total)

        report, findings = reproduce_findings(folder, progress=advance)
    for number, finding in enumerate(findings, start=1):
        mark = "" if finding.verdict is Verdict.SUPPORTED else f" [{finding.verdict}]"
        console.print(f"{number:3d}  {finding.section:<4} {finding.claim}{mark}")
        if finding.on_screen:
            console.print(f"     {finding.evidence}")
            for table in finding.tables:
                console.print(table.plain(indent=5))
    console.print(f"{len(findings)} statements: {tally(findings)}")
    console.print(f"report  {report}")
    return report
