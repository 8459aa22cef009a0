"""What a scenario says that has no effect, in sentences for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from planner.scenario import Scenario


def scenario_remarks(scenario: Scenario) -> tuple[str, ...]:
    """Returns a sentence for every entry that does not apply to what is asked.

    Args:
        scenario: The scenario.
    """
    return (
        *_torques_that_do_not_apply(scenario),
        *_torques_that_let_fall(scenario),
        *_costs_that_do_not_apply(scenario),
        *_postures_that_are_missing(scenario),
    )


def torque_is_state(scenario: Scenario) -> bool:
    """Returns whether the criterion has the torques as states, so that ends can prescribe them."""
    criterion = scenario.criterion
    return criterion.kind == "torque-change" or (
        criterion.kind == "mixed" and criterion.torque_share < 1.0
    )


def _torques_that_do_not_apply(scenario: Scenario) -> list[str]:
    if torque_is_state(scenario):
        return []
    default = type(scenario.boundary.start)()
    given = [
        f"boundary.{end}.{name}"
        for end in ("start", "goal")
        for name in ("torque", "internal_force", "internal_moment")
        if (value := getattr(getattr(scenario.boundary, end), name)) is not None
        and value != getattr(default, name)
    ]
    if not given:
        return []
    verb = "does" if len(given) == 1 else "do"
    return [
        f"{' and '.join(given)} {verb} not apply: with the criterion {scenario.criterion.kind} "
        "the torques at both ends follow from the motion"
    ]


def _torques_that_let_fall(scenario: Scenario) -> list[str]:
    if not torque_is_state(scenario) or not any(scenario.world.gravity):
        return []
    ends = [
        f"boundary.{end}"
        for end in ("start", "goal")
        if getattr(scenario.boundary, end).torque == "zero"
    ]
    if not ends:
        return []
    return [
        f"{' and '.join(ends)} {'asks' if len(ends) == 1 else 'ask'} for zero torque although "
        "gravity acts: unless it acts across the arms' plane, nothing holds them there; static, "
        "rest or a preload do"
    ]


def _costs_that_do_not_apply(scenario: Scenario) -> list[str]:
    criterion = scenario.criterion
    remarks = []
    if criterion.kind != "mixed" and criterion.torque_share != type(criterion)().torque_share:
        remarks.append(
            f"criterion.torque_share does not apply to the criterion {criterion.kind}: only "
            "mixed has shares"
        )
    if criterion.kind == "jerk":
        given = [
            f"criterion.{name}"
            for name in ("speed_cost", "posture_cost")
            if getattr(criterion, name) not in ("auto", 0.0)
        ]
        if given:
            verb = "does" if len(given) == 1 else "do"
            remarks.append(f"{' and '.join(given)} {verb} not apply to the criterion jerk")
    return remarks


def _postures_that_are_missing(scenario: Scenario) -> list[str]:
    if scenario.task.posture != "start":
        return []
    return [
        f'task.posture = "start" holds a start posture near the neutral one: {side}.posture is '
        "not given"
        for side in ("left", "right")
        if getattr(scenario, side).posture is None
    ]
