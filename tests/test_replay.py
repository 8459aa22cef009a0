"""Replay: torques alone drive Pinocchio's own constrained dynamics where the plan says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import Mechanism, planar_arms, settle
from mechanisms import human_arms as human
from plans import CASES, planned

from planner.assembly import build_chain
from planner.chain import ClosedChain
from planner.holding import static_torque
from planner.replay import can_replay, constraint_model, replay, replay_error
from planner.result import Plan


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


def test_holding_torques_hold(three_jointed: Mechanism) -> None:
    """Under gravity, without any plan: a motion at rest stays there for a tenth of a second."""
    chain, q = three_jointed.chain, three_jointed.posture
    tau = static_torque(chain, three_jointed.freedoms(q[None]))[0]
    count = 21
    still = np.zeros((count, chain.n))
    plan = planned()
    position, _ = chain.object_pose(chain.dynamics.placements(q[None]))
    at_rest = replace(
        plan,
        time=np.linspace(0.0, 0.1, count),
        q=still + q,
        v=still,
        a=still,
        tau=still + tau,
        object_position=np.broadcast_to(position[0], (count, 3)).copy(),
    )
    assert np.max(replay_error(chain, at_rest)) < 1e-9
    fallen = replay_error(chain, replace(at_rest, tau=still))
    assert fallen[-1] > 1e-2


@pytest.mark.parametrize(("pair", "can"), [("rigid", True), ("revolute", True)])
def test_planar_pairs_can_be_replayed(tmp_path, pair: str, can: bool) -> None:  # type: ignore[no-untyped-def]
    assert can_replay(build_chain(planar_arms(tmp_path, pair))) is can


def test_the_constraint_is_closed_where_the_plan_is(mechanism: Mechanism) -> None:
    import pinocchio as pin

    chain = mechanism.chain
    if not can_replay(chain):
        with pytest.raises(ValueError, match="no constraint model"):
            constraint_model(chain)
        return
    constraint = constraint_model(chain)
    model = chain.dynamics.model
    data, ours = model.createData(), constraint.createData()
    pin.forwardKinematics(model, data, mechanism.posture)
    constraint.calc(model, data, ours)
    assert np.max(np.abs(ours.c1Mc2.translation)) < 1e-10
    if constraint.type == pin.ContactType.CONTACT_6D:
        assert np.max(np.abs(pin.log3(ours.c1Mc2.rotation))) < 1e-10


def test_pairs_without_a_constraint_model_are_refused(tmp_path) -> None:  # type: ignore[no-untyped-def]
    from mechanisms import pandas

    mechanism = settle(pandas("prismatic"))
    assert not can_replay(mechanism.chain)
    with pytest.raises(ValueError, match="prismatic"):
        constraint_model(mechanism.chain)


def test_unmoving_plan_is_replayed_at_its_place() -> None:
    plan = planned(
        {"task.goal.xyz": [0.1, 0.4, 0.0], "criterion.kind": "jerk", "solver.samples": 11}
    )
    assert plan.cost == 0.0
    assert np.max(replay_error(build_chain(human()), plan)) < 1e-10
