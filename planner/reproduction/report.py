"""The report: every statement with its verdict and numbers, the figures, what it rests on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from planner.reproduction.cases import FIGURES, Workbench
from planner.reproduction.findings import Finding, Table, Verdict
from planner.result import versions

CAPTIONS = {
    "figure2": "Object paths of least torque-change for objects of different mass, torques zero at "
    "both ends. The curve for massless links is the limit of heavy objects; the paper has it in "
    "words only.",
    "figure3": "Object paths of least torque-change for preloads (Fx, Fy) of the grasp at the "
    "start; at the goal the torques are free or, in one case, zero. 2 kg.",
    "figure4": "Object paths of least torque, torque-change and jerk. 2 kg.",
    "figure5": "Magnitude of the internal force, left hand's force less right hand's, for the "
    "motions of figure 4.",
}
_CHECKS = {
    "closure": ("hands apart", "m"),
    "force_balance": ("hand forces against the object's mass times acceleration", "N"),
    "torque_balance": ("torques against each arm's own dynamics and its hand's load", "Nm"),
    "end_speed": ("joint speed at the ends", "rad/s"),
    "replay_end": ("object at the end when the torques are replayed in Pinocchio", "m"),
    "hamiltonian": ("drift of the Hamiltonian, of the range of its terms", ""),
    "pontryagin_residual": ("relative residual of Pontryagin's equations", ""),
}
_INTRODUCTION = """\
# The paper's figures and statements, computed again

Žefran and Kumar, *Optimal trajectories and force distribution for cooperating arms*, sections 4
to 5: each statement in other words, what came of it, and the numbers behind that. Every number was
computed when this report was written, except for the reference values, which are marked as such.

The paper gives lengths and masses of the links but not their centres of mass and moments of
inertia. Here the links are uniform slender rods and the elbows point outwards. The paper prints no
numbers beside its curves, so curves cannot be compared digit by digit; its statements can.
"""


def write_report(
    folder: Path,
    bench: Workbench,
    findings: Sequence[Finding],
    references: tuple[bool, Table],
    *,
    seconds: float,
) -> Path:
    """Writes `report.md`.

    Args:
        folder: Where figures and curves are, and the report goes.
        bench: All plans.
        findings: What became of the statements.
        references: Whether the reference values are met, and the comparison.
        seconds: Time that everything took [s].

    Returns:
        The report.
    """
    parts = [
        _INTRODUCTION,
        _summary(findings),
        _figures(),
        "## Statements\n",
        *(_detail(number, finding) for number, finding in enumerate(findings, start=1)),
        _references(*references),
        _basis(bench, seconds),
    ]
    file = folder / "report.md"
    file.write_text("\n".join(parts), encoding="utf-8")
    return file


def tally(findings: Sequence[Finding]) -> str:
    """Returns how many statements got which verdict, in words."""
    counts = Counter(finding.verdict for finding in findings)
    return ", ".join(f"{counts[verdict]} {verdict}" for verdict in Verdict if counts[verdict])


def _summary(findings: Sequence[Finding]) -> str:
    lines = [f"Of {len(findings)} statements: **{tally(findings)}**.\n"]
    lines += ["| | section | statement | verdict |", "| --: | :-- | :-- | :-- |"]
    for number, finding in enumerate(findings, start=1):
        verdict = finding.verdict.value
        if finding.verdict is not Verdict.SUPPORTED:
            verdict = f"**{verdict}**"
        link = f"[{number}](#statement-{number})"
        lines.append(f"| {link} | {finding.section} | {finding.claim} | {verdict} |")
    return "\n".join(lines) + "\n"


def _figures() -> str:
    parts = ["## Figures\n"]
    for name, cases in FIGURES.items():
        number = name.removeprefix("figure")
        links = ", ".join(f"[{case.label}](curves/{name}-{case.name}.csv)" for case in cases)
        parts.append(f"![Figure {number}]({name}.png)\n")
        parts.append(
            f"**Figure {number}.** {CAPTIONS[name]} ([SVG]({name}.svg); curves: {links})\n"
        )
    return "\n".join(parts)


def _detail(number: int, finding: Finding) -> str:
    parts = [
        f"### Statement {number}\n",
        f"Section {finding.section}: {finding.claim}\n",
        f"**{finding.verdict.value.capitalize()}.** {finding.evidence}\n",
        *(table.markdown() + "\n" for table in finding.tables),
    ]
    return "\n".join(parts)


def _references(met: bool, table: Table) -> str:
    verdict = (
        "All are met to one unit of their last digit."
        if met
        else "**Not all are met to one unit of their last digit.**"
    )
    return "\n".join(
        [
            "## Reference values\n",
            f"Known from two other formulations of the same problem. {verdict}\n",
            table.markdown() + "\n",
        ]
    )


def _basis(bench: Workbench, seconds: float) -> str:
    rows = []
    for name, (meaning, unit) in _CHECKS.items():
        values = [float(plan.checks[name]) for plan in bench.plans if name in plan.checks]
        if values:
            rows.append((meaning, f"{max(values):.1e} {unit}".strip(), f"{len(values)}"))
    table = Table(("what is checked", "worst", "plans"), tuple(rows))
    used = ", ".join(f"{name} {version}" for name, version in versions().items())
    return "\n".join(
        [
            "## What this rests on\n",
            f"{len(bench.plans)} plans, each checked from its samples; they reach from 0.1 to 10 s "
            "and from 0 to 1000 kg, hence the range of forces.\n",
            table.markdown() + "\n",
            f"Made in {seconds:.0f} s with {used}.\n",
        ]
    )
