"""The checks of a plan: good ones pass, and every fault is found by the check made for it."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from mechanisms import human_arms as human
from plans import CASES, planned, solved

from planner.assembly import build_chain
from planner.chain import ClosedChain
from planner.checks import exceeded_limits, hamiltonian_drift, verify
from planner.result import Plan

LIMITS = {
    "closure": 1e-8,
    "end_speed": 1e-9,
    "force_balance": 1e-9,
    "torque_balance": 1e-9,
    "replay_end": 1e-4,
    "replay_max": 1e-4,
}


@lru_cache(maxsize=1)
def chain() -> ClosedChain:
    return build_chain(human())


def faults(plan: Plan) -> set[str]:
    """Names of the checks that do not pass."""
    checks = verify(chain(), plan, None)
    return {name for name, limit in LIMITS.items() if checks[name] > limit}


@pytest.mark.parametrize("case", [*CASES, "jerk"])
def test_the_papers_plans_pass(case: str) -> None:
    plan = planned(CASES.get(case, {"criterion.kind": "jerk"}))
    assert faults(plan) == set()
    assert plan.checks["limits"] == []
    assert 1.0 < plan.checks["condition"] < 3.0
    if case == "jerk":  # no boundary value problem, nothing to certify
        assert not {"hamiltonian", "pontryagin_residual"} & set(plan.checks)
        return
    assert plan.checks["hamiltonian"] < 1e-5
    assert plan.checks["pontryagin_residual"] < 1e-4
    assert plan.checks["agreement"] < 1e-6


def test_a_posture_off_closure_is_found() -> None:
    plan = planned()
    q = plan.q.copy()
    q[200, 1] += 1e-5
    checks = verify(chain(), replace(plan, q=q), None)
    # the left hand's lever arm from the elbow is 0.33 m
    assert checks["closure"] == pytest.approx(0.33e-5, rel=0.02)


def test_speed_at_an_end_is_found_unless_it_is_asked_for() -> None:
    plan = planned()
    for place in (0, -1):
        v = plan.v.copy()
        v[place, 2] = -0.01
        assert verify(chain(), replace(plan, v=v), None)["end_speed"] == pytest.approx(0.01)
    moving = planned({"task.goal.velocity": [0.2, 0.0, 0.0]})
    assert np.max(np.abs(moving.v[-1])) > 0.1
    assert verify(chain(), moving, None)["end_speed"] < 1e-9


def test_forces_that_do_not_move_the_object_are_found() -> None:
    plan = planned()
    force = plan.hand_force_left.copy()
    force[100] += [0.0, 1e-4, 0.0]
    checks = verify(chain(), replace(plan, hand_force_left=force), None)
    assert checks["force_balance"] == pytest.approx(1e-4, rel=1e-6)
    # the arm is loaded by it too
    assert 1e-6 < checks["torque_balance"] < 1e-4


def test_a_force_shifted_between_the_hands_is_found_by_their_torques() -> None:
    plan = planned()
    shift = np.array([1e-3, 0.0, 0.0])
    squeezed = replace(
        plan,
        hand_force_left=plan.hand_force_left + shift,
        hand_force_right=plan.hand_force_right - shift,
    )
    assert faults(squeezed) == {"torque_balance"}


def test_other_torques_are_found() -> None:
    plan = planned()
    found = faults(replace(plan, tau=1.01 * plan.tau))
    assert {"torque_balance", "replay_end", "replay_max"} <= found
    assert "closure" not in found


def test_torques_two_percent_off_are_found_within_a_tenth_of_the_motion() -> None:
    plan = planned()
    assert "replay_window" not in plan.checks  # the replay of the whole motion says more
    checks = verify(chain(), replace(plan, tau=1.02 * plan.tau), None)
    assert 1e-5 < checks["replay_window"] < 0.1 * checks["replay_max"]
    assert checks["replay"].startswith("the torques do not produce the motion")


def test_another_mass_is_found() -> None:
    heavier = planned({"object.mass": 2.1})
    found = faults(heavier)  # checked against the chain that carries 2 kg
    assert {"force_balance", "replay_end"} <= found


def test_hamiltonian_drift_of_a_motion_that_is_no_solution() -> None:
    good = solved()
    criterion = good.problem.criterion

    def spoilt(share: np.ndarray) -> np.ndarray:
        x = good.states(share)
        x[:, criterion.at_n2] *= (1.0 + 0.01 * share)[:, None]
        return x

    assert hamiltonian_drift(good) < 1e-6
    assert hamiltonian_drift(replace(good, states=spoilt)) > 1e-4


def test_exceeded_limits_name_joint_time_and_limit() -> None:
    plan = planned()
    assert exceeded_limits(chain(), plan) == []
    q, v, tau = plan.q.copy(), plan.v.copy(), plan.tau.copy()
    upper, speed = chain().both("upper")[1], chain().both("velocity_limit")[2]
    effort = chain().both("effort_limit")[3]
    q[100, 1] = upper + 0.25
    v[300, 2] = -speed - 1.0
    tau[50, 3] = effort + 2.0
    lines = exceeded_limits(chain(), replace(plan, q=q, v=v, tau=tau))
    assert len(lines) == 3
    position, pace, torque = lines
    assert position.startswith(f"{plan.joint_names[1]}: position {upper + 0.25:.3f} rad")
    assert f"t = {plan.time[100]:.3f} s" in position
    assert f"limit {upper:.3f}" in position
    assert pace.startswith(f"{plan.joint_names[2]}: speed {-speed - 1.0:.3f} rad/s")
    assert f"limit {-speed:.3f}" in pace
    assert torque.startswith(f"{plan.joint_names[3]}: torque {effort + 2.0:.3f} Nm")


def test_heavy_loads_exceed_the_effort_limit() -> None:
    plan = planned({"object.mass": 1000.0})
    assert any("torque" in line for line in plan.checks["limits"])
