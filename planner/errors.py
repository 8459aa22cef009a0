"""Errors that the planner raises for input it cannot use.

A solve that fails is no error: it ends in a [Failure][planner.outcome.Failure]
with a name, a reason and a remedy.
"""

from __future__ import annotations

from pathlib import Path


class PlannerError(Exception):
    """Root of every error that this package raises on purpose."""


class InputError(PlannerError):
    """Something that the user gave cannot be used.

    The message is one line: where, what, which value, and what would be valid.

    Attributes:
        problem: What is wrong.
        source: The file at fault, if there is one.
        key: The dotted key or the named element at fault, if there is one.
        value: The value found there.
        remedy: What would be valid.
    """

    def __init__(
        self,
        problem: str,
        *,
        source: Path | str | None = None,
        key: str | None = None,
        value: object = None,
        remedy: str | None = None,
    ) -> None:
        self.problem = problem
        self.source = None if source is None else Path(source)
        self.key = key
        self.value = value
        self.remedy = remedy
        super().__init__(self._line())

    def _line(self) -> str:
        where = [str(part) for part in (self.source, self.key) if part is not None]
        line = ": ".join([*where, self.problem])
        if self.value is not None:
            shown = repr(self.value)
            line += f" (got {shown if len(shown) <= 80 else shown[:77] + '...'})"
        if self.remedy:
            line += f"; {self.remedy}"
        return " ".join(line.split())


class ScenarioError(InputError):
    """The scenario file, or a value set over it, is not valid."""


class ModelError(InputError):
    """A URDF, or what the scenario says of it, does not describe a usable mechanism."""


class UnreachableError(InputError):
    """The two hands cannot hold the object where the scenario asks for it."""
