"""Reference values: known from two other formulations of the problem, not computed here.

They hold for uniform slender links, elbows outwards, 2 kg and 1 s, to all digits given. They are
the only numbers in a report that are not computed when it is written.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.reproduction.cases import CRITERIA, Case, Workbench
from planner.reproduction.findings import Table
from planner.result import Plan

TOLERANCE = 1e-7
_LAST_DIGIT = 1e-6  # all values have six decimals


@dataclass(frozen=True)
class Reference:
    """Known values of one motion.

    Attributes:
        case: The motion.
        cost: Its cost.
        middle: The object's position at half time, x and y [m].
        torques: The torques at half time [Nm].
        last_torques: Those at the end [Nm], where known.
    """

    case: Case
    cost: float
    middle: tuple[float, ...]
    torques: tuple[float, ...]
    last_torques: tuple[float, ...] = ()


_TORQUE, _CHANGE, _FREE, _ = CRITERIA
REFERENCES = (
    Reference(_CHANGE, 16.811305, (0.253616, 0.332378), (-0.057857, 0.129595, 0.182929, -0.037825)),
    Reference(
        _FREE,
        7.344975,
        (0.223104, 0.347577),
        (-0.287883, 0.193053, 0.039013, 0.255045),
        (0.612515, -0.483686, 1.193622, -0.439441),
    ),
    Reference(_TORQUE, 0.271566, (0.252234, 0.321779), (-0.024002, 0.133636, 0.036572, -0.139117)),
)


def reference_table(bench: Workbench) -> tuple[bool, Table]:
    """Returns whether the reference values are met to their last digit, and the comparison."""
    rows, met = [], True
    for reference in REFERENCES:
        plan = bench.plan({**reference.case.values, "solver.tolerance": TOLERANCE})
        for name, known, found in _pairs(reference, plan):
            difference = found - known
            met = met and bool(np.max(np.abs(difference)) <= _LAST_DIGIT)
            rows.append(
                (
                    f"{reference.case.label}: {name}",
                    _list(known),
                    _list(found),
                    f"{np.max(np.abs(difference)):.1e}",
                )
            )
    header = ("quantity", "reference", "computed", "largest difference")
    return met, Table(header, tuple(rows))


def _pairs(reference: Reference, plan: Plan) -> list[tuple[str, np.ndarray, np.ndarray]]:
    half = len(plan.time) // 2
    assert np.isclose(plan.time[half], plan.duration / 2.0)
    pairs: list[tuple[str, tuple[float, ...], object]] = [
        ("cost", (reference.cost,), (plan.cost,)),
        ("object at half time [m]", reference.middle, plan.object_position[half, :2]),
        ("torques at half time [Nm]", reference.torques, plan.tau[half]),
    ]
    if reference.last_torques:
        pairs.append(("torques at the end [Nm]", reference.last_torques, plan.tau[-1]))
    return [(name, np.array(known), np.asarray(found)) for name, known, found in pairs]


def _list(values: np.ndarray) -> str:
    return ", ".join(f"{value:.6f}" for value in values)
