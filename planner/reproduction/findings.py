"""What became of a statement of the paper: a verdict with the numbers behind it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise


class Verdict(StrEnum):
    """How a statement fares."""

    SUPPORTED = "supported"
    CONDITION = "supported with a condition"
    CONTRADICTED = "contradicted"
    UNTESTED = "not tested"

    @staticmethod
    def of(holds: bool) -> Verdict:
        """Returns supported or contradicted."""
        return Verdict.SUPPORTED if holds else Verdict.CONTRADICTED


@dataclass(frozen=True)
class Table:
    """Numbers with the names of their columns, units included.

    Attributes:
        header: Names of the columns.
        rows: Cells as text.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def markdown(self) -> str:
        """Returns the table in Markdown: the first column to the left, the others to the right."""
        lines = [self.header, (":--", *("--:" for _ in self.header[1:])), *self.rows]
        return "\n".join(f"| {' | '.join(line)} |" for line in lines)

    def plain(self, indent: int = 0) -> str:
        """Returns the table as aligned text."""
        lines = (self.header, *self.rows)
        first, *others = (max(map(len, column)) for column in zip(*lines, strict=True))
        rows = []
        for name, *cells in lines:
            numbers = [f"  {cell:>{width}}" for cell, width in zip(cells, others, strict=True)]
            rows.append(" " * indent + name.ljust(first) + "".join(numbers))
        return "\n".join(rows)


@dataclass(frozen=True)
class Finding:
    """A statement of the paper and what was computed about it.

    Attributes:
        section: The paper's section.
        claim: The statement, in other words than the paper's.
        verdict: How it fares.
        evidence: A sentence or two with the numbers that decide.
        tables: More numbers.
        on_screen: Whether the command line shows evidence and tables, too.
    """

    section: str
    claim: str
    verdict: Verdict
    evidence: str
    tables: tuple[Table, ...] = ()
    on_screen: bool = False


def descending(values: list[float]) -> bool:
    """Returns whether each value is larger than the next."""
    return all(first > second for first, second in pairwise(values))


def tiny(value: float) -> str:
    """Returns a number whose order of magnitude matters."""
    return f"{value:.1e}" if value else "0"
