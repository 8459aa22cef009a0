"""The paper's figures 2 to 5 and its statements, computed again.

[reproduce][planner.reproduction.reproduce] plans every motion, draws the figures, writes the curves
and a report that says of each statement what came of it.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from planner.reproduction.findings import Finding

__all__ = ["Progress", "reproduce", "reproduce_findings"]

# what is being done, how many steps are done, how many there are
Progress = Callable[[str, int, int], None]

LEGENDS = {"figure2": "object", "figure3": "preload at start, at goal", "figure4": "criterion"}


def reproduce(
    folder: Path | str, *, progress: Progress | None = None, scenario: Path | None = None
) -> Path:
    """Writes figures 2 to 5 (PNG, SVG), their curves (CSV) and `report.md`.

    Args:
        folder: Where; made if it is missing.
        progress: Called before every step and after the last.
        scenario: The paper's scenario; by default the one of this checkout.

    Returns:
        The report.

    Raises:
        InputError: The paper's scenario is not there.
        NotSolvedError: One of the motions could not be planned.
        OSError: The folder cannot be written.
    """
    return reproduce_findings(folder, progress=progress, scenario=scenario)[0]


def reproduce_findings(
    folder: Path | str, *, progress: Progress | None = None, scenario: Path | None = None
) -> tuple[Path, list[Finding]]:
    """Does what [reproduce][planner.reproduction.reproduce] does; returns the findings, too."""
    from planner.reproduction import mechanics, numerics, shooting_study, simulations
    from planner.reproduction.cases import FIGURES, Workbench, paper_scenario
    from planner.reproduction.figures import draw_forces, draw_paths, write_figure
    from planner.reproduction.measures import write_curve
    from planner.reproduction.references import reference_table
    from planner.reproduction.report import write_report

    began = time.perf_counter()
    folder = Path(folder)
    curves = folder / "curves"
    curves.mkdir(parents=True, exist_ok=True)
    findings: list[Finding] = []
    with tempfile.TemporaryDirectory() as scratch:
        bench = Workbench(paper_scenario(scenario), Path(scratch))

        def figure(name: str) -> None:
            plans = {case.label: bench.case(case) for case in FIGURES[name]}
            for case in FIGURES[name]:
                write_curve(plans[case.label], curves / f"{name}-{case.name}.csv")
            legend = LEGENDS.get(name)
            drawn = draw_forces(plans) if legend is None else draw_paths(plans, legend)
            write_figure(drawn, folder / name)

        studies: list[tuple[str, Callable[[Workbench], list[Finding]]]] = [
            ("the mechanism", mechanics.structure_findings),
            ("durations", mechanics.scaling_findings),
            ("reversed motions", mechanics.reversal_findings),
            ("equations", mechanics.count_findings),
            ("fixed meshes", numerics.mesh_findings),
            ("robustness", numerics.robustness_findings),
            ("shooting", shooting_study.shooting_findings),
            ("masses", simulations.mass_findings),
            ("preloads", simulations.preload_findings),
            ("criteria", simulations.criterion_findings),
            ("time", numerics.time_findings),
        ]
        total, done = len(FIGURES) + len(studies) + 1, 0

        def step(label: str) -> None:
            nonlocal done
            if progress is not None:
                progress(label, done, total)
            done += 1

        for name in FIGURES:
            step(name.replace("figure", "figure "))
            figure(name)
        for label, study in studies:
            step(label)
            findings += study(bench)
        step("reference values")
        references = reference_table(bench)
        report = write_report(
            folder, bench, findings, references, seconds=time.perf_counter() - began
        )
        if progress is not None:
            progress("done", total, total)
    return report, findings
