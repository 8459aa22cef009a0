"""Replay: torques alone drive Pinocchio's own constrained dynamics where the plan says."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import mechanisms
import numpy as np
import pinocchio as pin
import pytest
from mechanisms import PAIRS, Mechanism, differences
from mechanisms import human_arms as human
from plans import CASES, planned

from planner.assembly import build_chain
from planner.chain import ClosedChain
from planner.equation_of_motion import EquationOfMotion
from planner.holding import static_torque
from planner.planning import plan as make_plan
from planner.replay import (
    TOLERANCE,
    growth_rate,
    replay,
    replay_checks,
    replay_error,
    window_count,
)
from planner.result import Plan
from planner.rig import Rig
from planner.scenario import Scenario


def chain_of(plan: Plan) -> ClosedChain:
    return build_chain(plan.scenario)


@pytest.mark.parametrize("case", [*CASES, "jerk"])
def test_the_papers_plans_arrive(case: str) -> None:
    plan = planned(CASES.get(case, {"criterion.kind": "jerk"}))
    error = replay_error(chain_of(plan), plan)
    assert len(error) == (len(plan.time) + 1) // 2
    assert error[0] < 1e-12
    assert np.max(error) < 1e-6


def test_half_as_many_samples_are_16_times_worse() -> None:
    """The method is of fourth order, so that what is left is the integration's own error."""
    errors = []
    for samples in (41, 81):
        plan = planned({"criterion.kind": "jerk", "solver.samples": samples})
        errors.append(replay_error(chain_of(plan), plan)[-1])
    assert 10.0 < errors[0] / errors[1] < 24.0


def test_other_torques_do_not_arrive() -> None:
    plan = planned()
    chain = chain_of(plan)
    for tau in (1.001 * plan.tau, plan.tau + 1e-3, plan.tau[:, [1, 0, 2, 3]], 0.0 * plan.tau):
        assert replay_error(chain, replace(plan, tau=tau))[-1] > 1e-5
    # with no torque at all nothing moves
    position = replay(chain, replace(plan, tau=0.0 * plan.tau))
    assert np.max(np.abs(position - plan.object_position[0])) < 1e-12


def test_squeezing_does_not_move_the_object() -> None:
    """Torques along Gamma' only press the hands against each other."""
    plan = planned()
    chain = chain_of(plan)
    gamma = chain.loop(chain.dynamics.placements(plan.q)).jacobian()
    squeeze = np.einsum("kmn,m->kn", gamma, np.array([5.0, -3.0]))
    error = replay_error(chain, replace(plan, tau=plan.tau + squeeze))
    assert np.max(np.linalg.norm(squeeze, axis=1)) > 1.0
    assert np.max(error) < 1e-5


def at_rest(mechanism: Mechanism, tau: np.ndarray, duration: float, count: int) -> Plan:
    """A plan to stay where the mechanism is, by constant torques."""
    chain, q = mechanism.chain, mechanism.posture
    still = np.zeros((count, chain.n))
    position, _ = chain.object_pose(chain.dynamics.placements(q[None]))
    return replace(
        planned(),
        duration=duration,
        time=np.linspace(0.0, duration, count),
        q=still + q,
        v=still,
        a=still,
        tau=still + tau,
        object_position=np.broadcast_to(position[0], (count, 3)).copy(),
    )


def test_holding_torques_hold(three_jointed: Mechanism) -> None:
    """Under gravity, without any plan: a motion at rest stays there for a tenth of a second."""
    chain, q = three_jointed.chain, three_jointed.posture
    tau = static_torque(chain, three_jointed.freedoms(q[None]))[0]
    assert np.max(replay_error(chain, at_rest(three_jointed, tau, 0.1, 21))) < 1e-9
    fallen = replay_error(chain, at_rest(three_jointed, 0.0 * tau, 0.1, 21))
    assert fallen[-1] > 1e-2


# ---- pairs ---------------------------------------------------------------------------------------


@lru_cache(maxsize=len(PAIRS))
def lifted(pair: str) -> tuple[ClosedChain, Plan]:
    """Two Pandas that move an object under gravity, and so their hands within the pair."""
    return straight(mechanisms.pandas(pair).override({"solver.samples": 151}))


def straight(scenario: Scenario) -> tuple[ClosedChain, Plan]:
    """The motion of least jerk, which needs no solver."""
    scenario = scenario.override({"criterion.kind": "jerk"})
    return build_chain(scenario), make_plan(scenario).unwrap()


@pytest.mark.parametrize("pair", PAIRS)
def test_every_pair_in_space_arrives(pair: str) -> None:
    chain, plan = lifted(pair)
    assert chain.m == PAIRS[pair]
    assert np.max(replay_error(chain, plan)) < TOLERANCE
    assert np.max(replay_error(chain, plan, 10)) < 1e-7


@pytest.mark.parametrize(
    ("pair", "axis"), [("prismatic", (0.6, 0.8, 0.0)), ("planar", (1.0, 0.0, 0.0))]
)
def test_planar_arms_may_slide(tmp_path: Path, pair: str, axis: tuple[float, ...]) -> None:
    scenario = mechanisms.planar_arms(tmp_path, pair)
    chain, plan = straight(scenario.override({"grasp.axis": list(axis), "solver.samples": 201}))
    assert chain.planar
    assert chain.m == 2
    assert np.max(replay_error(chain, plan)) < TOLERANCE
    assert np.max(replay_error(chain, plan, 10)) < 1e-7


@pytest.mark.parametrize("pair", PAIRS)
def test_wrong_torques_do_not_arrive_whatever_the_pair(pair: str) -> None:
    chain, plan = lifted(pair)
    wrong = replace(plan, tau=1.02 * plan.tau)
    assert not replay_error(chain, wrong)[-1] < 1e-2  # it may diverge
    assert np.max(replay_error(chain, wrong, 10)) > 1e-3


@pytest.mark.parametrize("other", ["rigid", "spherical", "planar"])
def test_another_pair_does_not_arrive(other: str) -> None:
    _, plan = lifted("cylindrical")
    assert not np.max(replay_error(lifted(other)[0], plan)) < 1e-3


@pytest.mark.parametrize("pair", ["revolute", "cylindrical", "prismatic", "planar"])
def test_passive_joints_follow_the_plan(pair: str) -> None:
    """They close the loop at every sample, and their rates are the slopes of their positions."""
    chain, plan = lifted(pair)
    rig = Rig(chain)
    states = [rig.full_state(q, v) for q, v in zip(plan.q, plan.v, strict=True)]
    passive, rates = (np.array(part)[:, chain.n :] for part in zip(*states, strict=True))
    assert passive.shape[1] == 6 - chain.m
    slope = (passive[2:] - passive[:-2]) / (plan.time[2:] - plan.time[:-2])[:, None]
    assert np.min(np.max(np.abs(rates), axis=0)) > 1e-3
    np.testing.assert_allclose(rates[1:-1], slope, atol=1e-4)
    assert max(open_by(rig, q) for q, _ in states[::30]) < 1e-10


def test_the_constraint_is_closed_where_the_plan_is(mechanism: Mechanism) -> None:
    rig = Rig(mechanism.chain)
    assert open_by(rig, rig.full_state(mechanism.posture, np.zeros(mechanism.chain.n))[0]) < 1e-10


def open_by(rig: Rig, q: np.ndarray) -> float:
    """How far Pinocchio's constraint is from closed [m, rad]."""
    data, work = rig.model.createData(), rig.constraint.createData()
    pin.forwardKinematics(rig.model, data, q)
    rig.constraint.calc(rig.model, data, work)
    place = work.c1Mc2
    if rig.constraint.type == pin.ContactType.CONTACT_3D:
        return float(np.max(np.abs(place.translation)))
    return float(np.max(np.abs(pin.log6(place).vector)))


def test_how_the_object_is_split_over_the_weld_does_not_matter(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Not even if all there is lies on the hinge's axis: a point mass, on a hand without mass."""
    chain, plan = lifted("revolute")
    model = chain.dynamics.model.copy()
    left = model.getJointId("left/panda_joint7")
    grasp = (chain.object_in_left * chain.grasp_in_object).translation
    model.inertias[left] = pin.Inertia(2.0, grasp, np.zeros((3, 3)))
    bare = replace(chain, dynamics=EquationOfMotion(model, left, chain.n))
    for other in (chain, bare):
        ends = []
        for ball in ((1e-3, 0.1), (1e-2, 0.05)):
            monkeypatch.setattr("planner.rig._BALL", ball)
            rig = Rig(other)
            whole = pin.computeTotalMass(other.dynamics.model)
            assert pin.computeTotalMass(rig.model) == pytest.approx(whole)
            ends.append(rig.run(plan.q[70], plan.v[70], plan.tau[70:91], 1e-3)[-1])
        assert np.max(np.abs(ends[0] - plan.q[70])) > 1e-3
        np.testing.assert_allclose(ends[0], ends[1], atol=1e-9)


# ---- motions that are unstable without feedback --------------------------------------------------


def test_a_long_motion_under_gravity_is_lost_but_not_its_windows(tmp_path: Path) -> None:
    scenario = mechanisms.planar_arms(tmp_path)
    chain, plan = straight(scenario.override({"task.duration": 4.0, "solver.samples": 201}))
    checks = replay_checks(chain, plan)
    assert checks.get("replay_max", np.inf) > 0.1
    assert checks["replay_window"] < 1e-6
    assert checks["replay"].startswith("the motion is unstable without feedback")
    # torques that are wrong are told from those that are not, however unstable the motion
    checks = replay_checks(chain, replace(plan, tau=1.02 * plan.tau))
    assert checks["replay_window"] > 1e-4
    assert checks["replay"].startswith("the torques do not produce the motion")
    assert "replay_growth" not in checks


def test_torques_that_are_slightly_wrong_do_not_pass_for_instability() -> None:
    """Without gravity nothing falls: what is off at the end is the torques' own error."""
    plan = planned()
    for factor in (1.001, 1.02):
        checks = replay_checks(chain_of(plan), replace(plan, tau=factor * plan.tau))
        assert checks["replay_max"] > TOLERANCE
        assert checks["replay"].startswith("the torques do not produce the motion")


def test_a_replay_that_arrives_needs_no_windows() -> None:
    plan = planned()
    assert set(replay_checks(chain_of(plan), plan)) == {"replay_end", "replay_max"}


def test_errors_grow_at_the_rate_of_the_fastest_fall(three_jointed: Mechanism) -> None:
    """Arms at rest, held up by constant torques: the linearised motion has a known fastest mode."""
    chain, q = three_jointed.chain, three_jointed.posture
    tau = static_torque(chain, three_jointed.freedoms(q[None]))
    independent = three_jointed.joints.independent

    def pull(along: np.ndarray) -> np.ndarray:
        moved = three_jointed.shifted(q[None], along[None])
        still = np.zeros((1, chain.p))
        return three_jointed.move(moved, still, tau).a[0, independent]

    stiffness = differences(pull, chain.p, 1e-3)
    fastest = np.max(np.sqrt(np.linalg.eigvals(stiffness).astype(complex)).real)
    checks = replay_checks(chain, at_rest(three_jointed, tau[0], 6.0, 1201))
    assert checks["replay_window"] < 1e-12
    assert checks["replay_growth"] == pytest.approx(fastest, rel=0.05)
    assert f"tenfold every {np.log(10.0) / fastest:.1f}" in checks["replay"]


def test_growth_is_that_of_an_error_between_noise_and_a_centimetre() -> None:
    time = np.linspace(0.0, 2.0, 201)
    error = np.minimum(1e-9 + 1e-10 * np.exp(12.0 * time), 0.5)
    error[-20:] = np.nan
    assert growth_rate(error, 0.01, 1e-7) == pytest.approx(12.0, rel=0.01)
    assert growth_rate(np.array([0.0, 1.0, np.nan]), 0.01, 1e-7) is None


@pytest.mark.parametrize(
    ("duration", "samples", "count"),
    [(1.0, 501, 10), (2.0, 501, 10), (8.0, 501, 40), (0.1, 501, 10), (8.0, 11, 5)],
)
def test_windows_are_short(duration: float, samples: int, count: int) -> None:
    still = replace(planned(), duration=duration, time=np.linspace(0.0, duration, samples))
    assert window_count(still) == count


def test_unmoving_plan_is_replayed_at_its_place() -> None:
    plan = planned(
        {"task.goal.xyz": [0.1, 0.4, 0.0], "criterion.kind": "jerk", "solver.samples": 11}
    )
    assert plan.cost == 0.0
    assert np.max(replay_error(build_chain(human()), plan)) < 1e-10
