"""Statements of section 4.2: what mass, preload and criterion do to path and internal force."""

from __future__ import annotations

import numpy as np

from planner.reproduction.cases import CRITERIA, HEAVY, LIMIT, MASSES, PRELOADS, Workbench
from planner.reproduction.findings import Finding, Table, Verdict, descending
from planner.reproduction.measures import (
    CENTIMETRES,
    costs,
    curvature,
    internal_force_size,
    line_distance,
)
from planner.result import Plan

SECTION = "4.2"
# of the path's length: straighter than this counts as a line
_LINE = 1e-6
# relative: averages within it count as comparable
_COMPARABLE = 0.1


def mass_findings(bench: Workbench) -> list[Finding]:
    """Returns findings on the object's mass and on the limit of massless links."""
    cases = (*MASSES, *HEAVY, LIMIT)
    plans = [bench.case(case) for case in cases]
    bends = [curvature(plan) for plan in plans]
    table = Table(
        ("object", "largest distance from the line [cm]", "path over line [%]", "cost [Nm²/s]"),
        tuple(
            (case.label, f"{bend * CENTIMETRES:.3f}", f"{_detour(plan):.3f}", f"{plan.cost:.8g}")
            for case, plan, bend in zip(cases, plans, bends, strict=True)
        ),
    )
    further = zip(HEAVY, bends[len(MASSES) :], strict=False)
    light = Finding(
        SECTION,
        "Where the object is light against the links, the path is curved.",
        Verdict.of(bends[0] > 0.1 * plans[0].path_length),
        f"Without any object the path leaves the straight line by {bends[0] * CENTIMETRES:.2f} cm, "
        f"{100 * bends[0] / plans[0].path_length:.0f} % of its length (figure 2).",
    )
    straighter = Finding(
        SECTION,
        "With a heavier object the path comes closer to the straight line.",
        Verdict.of(descending(bends)),
        "Largest distance from the line: "
        + ", ".join(f"{bend * CENTIMETRES:.2f} cm" for bend in bends[: len(MASSES)])
        + " at "
        + ", ".join(case.label for case in MASSES)
        + "; with "
        + ", ".join(f"{case.label} it is {bend * CENTIMETRES:.2f} cm" for case, bend in further)
        + ".",
        (table,),
    )
    limit = bends[-1]
    other = bench.plan({"object.mass": 50.0}, links=0.0)
    same = float(np.max(np.abs(other.q - plans[-1].q)))
    never = Finding(
        SECTION,
        "Even in the limit of massless links, least torque-change is not least jerk: the path "
        "does not become the straight line.",
        Verdict.of(limit > _LINE * plans[-1].path_length and bends[-2] > limit),
        f"With links of no mass at all the path stays {limit * CENTIMETRES:.4f} cm off the line; "
        f"1000 kg on the real links gives {bends[-2] * CENTIMETRES:.4f} cm. The mass itself no "
        f"longer matters there: between 2 and 50 kg no joint angle differs by more than "
        f"{same:.1e} rad. Masses and moments of inertia of these links are exactly zero.",
    )
    return [light, straighter, never]


def _detour(plan: Plan) -> float:
    ends = plan.object_position[[0, -1]]
    return 100.0 * (plan.path_length / float(np.linalg.norm(ends[1] - ends[0])) - 1.0)


def _side(plan: Plan) -> str:
    """Returns the side of the straight line on which a path goes farthest from it."""
    distance = line_distance(plan)
    return "left" if distance[np.argmax(np.abs(distance))] > 0.0 else "right"


def preload_findings(bench: Workbench) -> list[Finding]:
    """Returns findings on an internal force at the start."""
    plans = [bench.case(case) for case in PRELOADS]
    unloaded, loaded = plans[0], plans[1:3]
    moving = max(float(np.max(np.abs(plan.a[0]))) for plan in loaded)
    starts = [float(np.max(np.abs(plan.tau[0]))) for plan in loaded]
    rows = []
    for case, plan in zip(PRELOADS, plans, strict=True):
        distance = line_distance(plan) * CENTIMETRES
        torque = ", ".join(f"{value + 0.0:.3f}" for value in np.round(plan.tau[0], 9))
        rows.append(
            (
                case.label,
                f"{distance[np.argmax(np.abs(distance))]:.3f}",
                f"({torque})",
                f"{np.linalg.norm(plan.internal_force[-1]):.3f}",
                f"{plan.mean_internal_force:.3f}",
                f"{plan.cost:.7g}",
            )
        )
    table = Table(
        (
            "preload, goal",
            "farthest from the line [cm]",
            "torques at the start [Nm]",
            "internal force at the goal [N]",
            "its mean [N]",
            "cost [Nm²/s]",
        ),
        tuple(rows),
    )
    isometric = Finding(
        SECTION,
        "A grasp can be preloaded: torques at the start that hold an internal force and move "
        "nothing.",
        Verdict.of(moving < 1e-6 and min(starts) > 0.0),
        f"The two preloads take torques of up to {min(starts):.3f} and {max(starts):.3f} Nm at the "
        f"start, where no joint accelerates by more than {moving:.1e} rad/s².",
    )
    apart = [
        float(np.max(np.linalg.norm(plan.object_position - unloaded.object_position, axis=1)))
        for plan in loaded
    ]
    shape = Finding(
        SECTION,
        "The preload changes the shape of the path greatly.",
        Verdict.of(min(apart) > 0.2 * curvature(unloaded)),
        f"Against no preload the object is elsewhere by up to {apart[0] * CENTIMETRES:.2f} cm with "
        f"(10, 10) N and {apart[1] * CENTIMETRES:.2f} cm with (−10, −10) N; the path without "
        f"preload leaves the line by {curvature(unloaded) * CENTIMETRES:.2f} cm, to its "
        f"{_side(unloaded)}; with (10, 10) N it goes farthest to the {_side(loaded[0])}, with "
        f"(−10, −10) N to the {_side(loaded[1])} (figure 3).",
        (table,),
    )
    stiffness = Finding(
        SECTION,
        "The preload acts through the apparent stiffness that the system starts with.",
        Verdict.UNTESTED,
        "This is an interpretation; the model has no stiffness that could be computed.",
    )
    return [isometric, shape, stiffness]


def criterion_findings(bench: Workbench) -> list[Finding]:
    """Returns findings on the four motions of figures 4 and 5."""
    plans = [bench.case(case) for case in CRITERIA]
    torque, change, free, jerk = plans
    bends = [curvature(plan) for plan in plans]
    forces = [plan.mean_internal_force for plan in plans]
    spent = [costs(plan) for plan in plans]
    table = Table(
        (
            "motion",
            "largest distance from the line [cm]",
            "mean internal force [N]",
            "largest [N]",
            "½∫\\|τ\\|² [Nm²s]",
            "½∫\\|dτ/dt\\|² [Nm²/s]",
            "½∫\\|jerk\\|² [m²/s⁵]",
        ),
        tuple(
            (
                case.label,
                f"{bend * CENTIMETRES:.4f}",
                f"{force:.4f}",
                f"{internal_force_size(plan).max():.3f}",
                *(f"{value:.6g}" for value in cost),
            )
            for case, plan, bend, force, cost in zip(
                CRITERIA, plans, bends, forces, spent, strict=True
            )
        ),
    )
    differ = float(np.max(np.linalg.norm(change.object_position - free.object_position, axis=1)))
    goal = ", ".join(f"{value:.3f}" for value in free.tau[-1])
    ends = Finding(
        SECTION,
        "Least torque-change gives another curve when the torques at the goal are left free.",
        Verdict.of(differ > 1e-3),
        f"The object is elsewhere by up to {differ * CENTIMETRES:.2f} cm, and the motion ends with "
        f"torques ({goal}) Nm.",
    )
    order = Finding(
        SECTION,
        "From the most curved to the straightest: least torque, torque-change with zero ends, "
        "torque-change with a free end, jerk, which is straight.",
        Verdict.of(descending(bends) and bends[-1] < _LINE),
        "Largest distance from the line: "
        + " > ".join(f"{bend * CENTIMETRES:.2f} cm" for bend in bends)
        + " (figure 4).",
        (table,),
    )
    energy = Finding(
        SECTION,
        "Least torque is also least energy, where motors lose power as the square of torque.",
        Verdict.of(min(spent)[0] == spent[0][0]),
        "That loss is the criterion itself up to a factor. Of the four motions the least-torque "
        f"one has the least, {spent[0][0]:.6f} Nm²s, the others {spent[1][0]:.4f}, "
        f"{spent[2][0]:.4f} and {spent[3][0]:.4f}. (The other costs in the table compare only "
        "motions with the same ends: least torque and the free end need not be without torque or "
        "acceleration there.)",
    )
    lowest = Finding(
        SECTION,
        "Least torque has the lowest average internal force, least jerk the highest.",
        Verdict.of(min(forces) == forces[0] and max(forces) == forces[3]),
        f"Means over time: jerk {jerk.mean_internal_force:.2f} N, torque-change with zero ends "
        f"{change.mean_internal_force:.2f} N, with a free end {free.mean_internal_force:.2f} N, "
        f"torque {torque.mean_internal_force:.2f} N (figure 5).",
    )
    ratio = forces[1] / forces[2]
    alike = Finding(
        SECTION,
        "Both torque-change motions have average internal forces of about the same size.",
        Verdict.of(abs(ratio - 1.0) < _COMPARABLE),
        f"{forces[1]:.3f} N against {forces[2]:.3f} N: {100 * (ratio - 1):.1f} % apart, where the "
        f"highest of the four is {100 * (forces[3] / forces[0] - 1):.0f} % above the lowest.",
    )
    return [ends, order, energy, lowest, alike]
