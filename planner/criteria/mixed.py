"""A weighted sum of torque-change and torque: smooth, and sparing with effort."""

from __future__ import annotations

from dataclasses import dataclass

from planner.criteria.torque_change import TorqueChange


@dataclass(frozen=True, eq=False)
class Mixed(TorqueChange):
    """L = 1/2 u'W u + 1/2 tau'V tau: the equations of torque-change with one more term."""

    @property
    def name(self) -> str:
        """The criterion's name in a scenario."""
        return "mixed"
