"""What is planned: every motion behind the paper's figures 2 to 5 and its statements.

A case is the paper's scenario with some values set over it. Every case is planned once, whoever
asks for it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from planner.errors import InputError
from planner.planning import plan
from planner.result import Plan
from planner.scenario import Scenario, load

Values = Mapping[str, Any]

SCENARIO = Path("urdf/human_arms/transport.toml")
FREE: Values = {"boundary.goal.torque": "free"}
TORQUE: Values = {"criterion.kind": "torque"}
JERK: Values = {"criterion.kind": "jerk"}
# of every plan unless it says otherwise: plans are compared with each other
TOLERANCE = 1e-6
# the mass of the object when the links have none: any other gives the same path
MASSLESS: Values = {"object.mass": 2.0}


@dataclass(frozen=True)
class Case:
    """One curve of a figure.

    Attributes:
        name: Short, fit for a file.
        label: Its name in legends and tables.
        values: What is set over the paper's scenario.
        links: Factor on masses and moments of inertia of the links.
    """

    name: str
    label: str
    values: Values = field(default_factory=dict)
    links: float = 1.0


def preloaded(x: float, y: float) -> Values:
    """Returns a start preloaded with an internal force [N], and free torques at the goal."""
    return {"boundary.start.internal_force": [x, y, 0.0], **FREE}


MASSES = tuple(
    Case(f"mass-{mass}kg", f"{mass} kg", {"object.mass": float(mass)}) for mass in (0, 2, 4, 8)
)
HEAVY = tuple(
    Case(f"mass-{mass}kg", f"{mass} kg", {"object.mass": float(mass)}) for mass in (100, 1000)
)
LIMIT = Case("massless-links", "massless links", MASSLESS, links=0.0)
PRELOADS = (
    Case("preload-0-0-free", "(0, 0) N, free", preloaded(0.0, 0.0)),
    Case("preload-10-10-free", "(10, 10) N, free", preloaded(10.0, 10.0)),
    Case("preload-minus10-minus10-free", "(−10, −10) N, free", preloaded(-10.0, -10.0)),
    Case("torques-zero-zero", "(0, 0) N, (0, 0) N"),
)
CRITERIA = (
    Case("min-torque", "min. torque", TORQUE),
    Case("min-torque-change", "min. torque-change, zero ends"),
    Case("min-torque-change-free", "min. torque-change, free end", FREE),
    Case("min-jerk", "min. jerk", JERK),
)
FIGURES: dict[str, tuple[Case, ...]] = {
    "figure2": (*MASSES, LIMIT),
    "figure3": PRELOADS,
    "figure4": CRITERIA,
    "figure5": CRITERIA,
}


def paper_scenario(path: Path | None = None) -> Scenario:
    """Returns the paper's scenario.

    Args:
        path: Its file; by default that of the checkout that this package stands in, else that
            below the current folder.

    Raises:
        InputError: There is no such file.
    """
    if path is None:
        places = (Path(__file__).parents[2], Path.cwd())
        found = [place / SCENARIO for place in places if (place / SCENARIO).is_file()]
        if not found:
            raise InputError(
                "the paper's scenario is not there",
                source=SCENARIO,
                remedy="run this in a checkout of the project, which holds it",
            )
        path = found[0]
    return load(path)


class Workbench:
    """Plans cases, each once.

    Attributes:
        scenario: The paper's scenario.
        folder: Where URDFs of lighter or heavier links may be written.
    """

    def __init__(self, scenario: Scenario, folder: Path) -> None:
        self.scenario = scenario
        self.folder = folder
        self._plans: dict[str, Plan] = {}

    @property
    def plans(self) -> tuple[Plan, ...]:
        """All plans made so far."""
        return tuple(self._plans.values())

    def plan(self, values: Values | None = None, *, links: float = 1.0) -> Plan:
        """Returns the plan with values set over the paper's scenario, solved to `TOLERANCE`.

        Args:
            values: The values.
            links: Factor on masses and moments of inertia of the links.

        Raises:
            NotSolvedError: There is no plan.
        """
        scenario = self.scenario.override({"solver.tolerance": TOLERANCE, **(values or {})})
        if links != 1.0:
            scenario = scenario.override(self.scaled_links(links))
        key = scenario.model_dump_json()
        if key not in self._plans:
            self._plans[key] = plan(scenario).unwrap()
        return self._plans[key]

    def case(self, case: Case) -> Plan:
        """Returns the plan of a case."""
        return self.plan(case.values, links=case.links)

    def scaled_links(self, factor: float) -> Values:
        """Writes the arms' URDFs with every mass and moment of inertia scaled, and names them."""

        def scaled(found: re.Match[str]) -> str:
            return f'{found[1]}="{float(found[2]) * factor!r}"'

        values = {}
        for side in ("left", "right"):
            source = Path(self.scenario.locate(getattr(self.scenario, side).urdf))
            text = re.sub(r'(<mass value|\bi[xyz][xyz])="([^"]*)"', scaled, source.read_text())
            target = self.folder / f"links_times_{factor:g}_{source.name}"
            target.write_text(text)
            values[f"{side}.urdf"] = str(target)
        return values
