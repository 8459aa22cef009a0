"""Plans as a whole: what physics and the calculus of variations say of every optimal motion."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mechanisms import arm_urdf, pandas, planar_arms, write
from mechanisms import human_arms as human
from plans import CASES, FREE, TORQUE, ZERO_ENDS, at_share, planned, solved

from planner.assembly import build_chain
from planner.errors import InputError
from planner.planning import plan
from planner.result import Plan
from planner.scenario import Scenario

START, GOAL = np.array([0.1, 0.4, 0.0]), np.array([0.4, 0.3, 0.0])
TORQUE_KIND = {"criterion.kind": "torque"}


def end_slopes(found: Plan, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives in time at both ends, by one-sided differences of fourth order."""
    weights = np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / (12.0 * found.time[1])
    return weights @ values[:5], -weights @ values[:-6:-1]


def second_derivative(found: Plan, values: np.ndarray) -> np.ndarray:
    """Of inner samples, by a central difference of fourth order, (N - 4, .)."""
    step = found.time[1]
    parts = values[:-4], values[1:-3], values[2:-2], values[3:-1], values[4:]
    weights = -1.0, 16.0, -30.0, 16.0, -1.0
    result: np.ndarray = sum(w * part for w, part in zip(weights, parts, strict=True))  # type: ignore[assignment]
    return result / (12.0 * step**2)


# ---- the paper's example -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("case", "position", "torque"),
    [
        ("zero ends", (0.253616, 0.332378), (-0.057857, 0.129595, 0.182929, -0.037825)),
        ("free end", (0.223104, 0.347577), (-0.287883, 0.193053, 0.039013, 0.255045)),
        ("torque", (0.252234, 0.321779), (-0.024002, 0.133636, 0.036572, -0.139117)),
    ],
)
def test_half_way(case: str, position: Any, torque: Any) -> None:
    found = planned(CASES[case])
    assert at_share(found, found.object_position, 0.5)[:2] == pytest.approx(position, abs=2e-6)
    assert at_share(found, found.tau, 0.5) == pytest.approx(torque, abs=2e-6)


def test_torques_at_the_free_end() -> None:
    found = planned(FREE)
    wanted = (0.612515, -0.483686, 1.193622, -0.439441)
    assert found.tau[-1] == pytest.approx(wanted, abs=5e-6)
    # what is free at the end changes no more there
    assert np.max(np.abs(found.tau_rate[-1])) < 1e-6 * np.max(np.abs(found.tau_rate))


def curvature(found: Plan) -> float:
    """Farthest distance of the path from the straight line [m]."""
    way = (GOAL - START) / np.linalg.norm(GOAL - START)
    off = np.cross(way, found.object_position - START)
    return float(np.max(np.linalg.norm(off, axis=1)))


def test_order_of_curvature_and_internal_force() -> None:
    torque, change, free, jerk = (
        planned(values) for values in (TORQUE_KIND, {}, FREE, {"criterion.kind": "jerk"})
    )
    bends = [curvature(found) for found in (torque, change, free)]
    assert bends == pytest.approx([0.0261, 0.0156, 0.0109], abs=6e-5)
    assert curvature(jerk) < 1e-9
    forces = [found.mean_internal_force for found in (jerk, change, free, torque)]
    assert forces == pytest.approx([3.53, 3.40, 3.23, 2.69], abs=6e-3)


# ---- what every plan is --------------------------------------------------------------------------

EVERY: dict[str, dict[str, Any]] = {
    "zero ends": {},
    "free end": FREE,
    "free start": {"boundary.start.torque": "free"},
    "rest, static": {"boundary.start.torque": "rest", "boundary.goal.torque": "static"},
    "numbers": {
        "boundary.start.torque": [0.1, -0.2, 0.3, -0.1],
        "boundary.goal.torque": [-0.4, 0.2, 0.1, 0.0],
    },
    "preload at start": {"boundary.start.internal_force": [10.0, 10.0, 0.0]},
    "preload at goal": {"boundary.goal.internal_force": [-10.0, 5.0, 0.0]},
    "preloads of 100 N": {
        "boundary.start.internal_force": [100.0, -100.0, 0.0],
        "boundary.goal.internal_force": [-100.0, 100.0, 0.0],
    },
    "velocities": {
        "task.start.velocity": [0.1, -0.2, 0.0],
        "task.goal.velocity": [0.2, 0.1, 0.0],
    },
    "torque": TORQUE_KIND,
    "torque, velocities": TORQUE_KIND
    | {"task.start.velocity": [0.0, 0.3, 0.0], "task.goal.velocity": [-0.2, 0.1, 0.0]},
    "mixed": {"criterion.kind": "mixed"},
    "effort": {"criterion.weights": "effort"},
    "gravity": {
        "world.gravity": [0.0, -9.81, 0.0],
        "boundary.start.torque": "static",
        "boundary.goal.torque": "rest",
    },
    "gravity and preload": {
        "world.gravity": [0.0, -9.81, 0.0],
        "boundary.start.internal_force": [20.0, -5.0, 0.0],
        "boundary.goal.torque": "static",
    },
    "gravity, torque": TORQUE_KIND | {"world.gravity": [3.0, -9.81, 0.0]},
    "no mass": {"object.mass": 0.0},
    "1000 kg": {"object.mass": 1000.0},
    "0.05 s": {"task.duration": 0.05},
    "20 s": {"task.duration": 20.0},
    "20 s with preload": {
        "task.duration": 20.0,
        "boundary.start.internal_force": [10.0, 10.0, 0.0],
    },
    "elsewhere": {"task.start.xyz": [-0.05, 0.3, 0.0], "task.goal.xyz": [0.5, 0.2, 0.0]},
    "heavy torque": TORQUE_KIND | {"object.mass": 1000.0, "task.duration": 0.05},
}
# arms pressed together give way sideways: in 20 s the least error grows beyond all bounds
UNSTABLE = "20 s with preload"


@pytest.mark.parametrize("name", EVERY)
def test_the_object_goes_from_start_to_goal(name: str) -> None:
    found = planned(EVERY[name])
    task = found.scenario.task
    assert np.allclose(found.object_position[0], task.start.xyz, atol=1e-9)
    assert np.allclose(found.object_position[-1], task.goal.xyz, atol=1e-9)
    pace = np.max(np.abs(found.v))
    for slope, end in zip(
        end_slopes(found, found.object_position), (task.start, task.goal), strict=True
    ):
        assert np.allclose(slope, end.velocity, atol=1e-4 * pace)
    for place, end in ((0, task.start), (-1, task.goal)):
        if not any(end.velocity):
            assert np.max(np.abs(found.v[place])) < 1e-9 * pace


@pytest.mark.parametrize("name", EVERY)
def test_the_torques_at_the_ends_are_as_asked_for(name: str) -> None:
    found = planned(EVERY[name])
    if found.criterion == "torque":
        assert np.max(np.abs(found.tau[[0, -1]])) > 0.0, "free: torque is no state"
        return
    chain = build_chain(found.scenario)
    size = np.max(np.abs(found.tau))
    boundary = found.scenario.boundary
    for place, given in ((0, boundary.start), (-1, boundary.goal)):
        tau, gamma = found.tau[place], chain.loop(chain.dynamics.placements(found.q)).jacobian()
        moves = bool(np.max(np.abs(found.v[place])) > 1e-6)
        if given.internal_force is not None:
            assert np.allclose(found.internal_force[place], given.internal_force, atol=1e-8 * size)
            assert np.max(np.abs(found.a[place])) < 1e-7 * np.max(np.abs(found.a))
        elif given.torque == "zero":
            assert np.max(np.abs(tau)) < 1e-9 * size
        elif given.torque == "free":
            assert np.max(np.abs(found.tau_rate[place])) < 1e-6 * np.max(np.abs(found.tau_rate))
        elif given.torque == "rest":
            assert np.max(np.abs(found.a[place])) < 1e-7 * np.max(np.abs(found.a))
            # the internal wrench is free there: its torques change no more
            inner = gamma[place] @ found.tau_rate[place]
            assert np.max(np.abs(inner)) < 1e-6 * np.max(np.abs(found.tau_rate))
        elif given.torque == "static":
            assert not moves
            assert np.max(np.abs(found.a[place])) < 1e-7 * np.max(np.abs(found.a))
            # least norm: nothing along the internal directions
            assert np.max(np.abs(gamma[place] @ tau)) < 1e-9 * size
        else:
            assert np.allclose(tau, given.torque, atol=1e-9)


@pytest.mark.parametrize("name", EVERY)
def test_both_methods_agree(name: str) -> None:
    """The direct method knows nothing of costates and transversality: so the ends are optimal."""
    certified = planned(EVERY[name])
    direct = planned(EVERY[name] | {"solver.method": "spectral"})
    assert direct.cost == pytest.approx(certified.cost, rel=3e-6)
    assert certified.checks["agreement"] < 3e-6
    assert certified.checks["pontryagin_residual"] <= 1e-4
    assert certified.remarks == ()


@pytest.mark.parametrize("name", EVERY)
def test_the_motion_is_physical(name: str) -> None:
    found = planned(EVERY[name])
    assert found.checks["closure"] < 1e-8
    assert found.checks["hamiltonian"] < 1e-5
    if name != UNSTABLE:
        assert found.checks["replay_end"] < 1e-4
    chain = build_chain(found.scenario)
    size = np.max(np.abs(found.hand_force_left))
    assert found.checks["force_balance"] < 1e-9 * max(size, 1.0)
    # the object's positions differentiated anew: Newton's law for what was seen to move
    acceleration = second_derivative(found, found.object_position)
    wanted = chain.body.mass * (acceleration - chain.gravity)
    given = (found.hand_force_left + found.hand_force_right)[2:-2]
    assert np.max(np.abs(given - wanted)) < 2e-3 * max(np.max(np.abs(given)), size)
    # and the samples of velocity and acceleration are derivatives of the postures
    for values, rates in ((found.q, found.v), (found.v, found.a), (found.tau, found.tau_rate)):
        slope = np.gradient(values, found.time, axis=0, edge_order=2)
        assert np.max(np.abs(slope - rates)) < 2e-3 * np.max(np.abs(rates))


@pytest.mark.parametrize("name", ["zero ends", "free end", "torque", "1000 kg", "velocities"])
def test_closure_and_hamiltonian_between_the_samples_too(name: str) -> None:
    solution = solved(EVERY[name])
    share = np.linspace(0.0, 1.0, 2001)
    x, at = solution.evaluate(share)
    chain = solution.problem.transport.chain
    gap = chain.gap(chain.dynamics.placements(at.tangent.q))
    assert np.max(np.abs(gap)) < 1e-8
    terms = solution.problem.criterion.hamiltonian(
        at, x, solution.problem.transport.joints.independent
    )
    drift = np.ptp(terms.sum(axis=1))
    assert drift < 1e-5 * np.ptp(terms)
    # it is the sum that is constant, none of the terms is
    assert np.min(np.ptp(terms[:, :3], axis=0)) > 0.01 * np.ptp(terms)


@pytest.mark.parametrize("name", ["zero ends", "torque", "mixed", "gravity", "effort"])
def test_the_cost_is_the_integral_of_what_is_seen(name: str) -> None:
    found = planned(EVERY[name])
    chain = build_chain(found.scenario)
    weights = np.ones(chain.n)
    if name == "effort":
        weights = 1.0 / chain.both("effort_limit")
    rate, torque = 0.5 * (found.tau_rate**2) @ weights, 0.5 * (found.tau**2) @ weights
    share = {"torque": 1.0, "mixed": 0.5}.get(name, 0.0)
    running = (1.0 - share) * rate + share * torque
    assert np.trapezoid(running, found.time) == pytest.approx(found.cost, rel=1e-4)


# ---- symmetries ----------------------------------------------------------------------------------


@pytest.mark.parametrize("values", [{}, TORQUE_KIND, {"criterion.kind": "mixed"}])
def test_reversed(values: dict[str, Any]) -> None:
    """There and back are one path: the motion runs backwards, under the same torques."""
    forth = planned(values)
    back = planned(values | {"task.start.xyz": GOAL.tolist(), "task.goal.xyz": START.tolist()})
    assert back.cost == pytest.approx(forth.cost, rel=2e-6)
    assert np.max(np.abs(back.q[::-1] - forth.q)) < 3e-5
    assert np.max(np.abs(back.v[::-1] + forth.v)) < 3e-4
    assert np.max(np.abs(back.tau[::-1] - forth.tau)) < 1e-3


def test_reversed_with_its_ends() -> None:
    """A free goal becomes a free start, and a preload stays with its place; gravity is even."""
    there = {"task.start.xyz": GOAL.tolist(), "task.goal.xyz": START.tolist()}
    assert planned(there | {"boundary.start.torque": "free"}).cost == pytest.approx(
        planned(FREE).cost, rel=2e-6
    )
    gravity = {"world.gravity": [0.0, -9.81, 0.0]}
    force = [12.0, -4.0, 0.0]
    forth = planned(
        gravity | {"boundary.start.internal_force": force, "boundary.goal.torque": "rest"}
    )
    back = planned(
        gravity | there | {"boundary.goal.internal_force": force, "boundary.start.torque": "rest"}
    )
    assert back.cost == pytest.approx(forth.cost, rel=2e-6)
    assert np.max(np.abs(back.q[::-1] - forth.q)) < 3e-5


def test_seen_in_a_mirror() -> None:
    """Both arms are alike: the mirrored task has the mirrored plan, the hands swapped."""
    plain = planned(FREE)
    values = FREE | {
        "task.start.xyz": [0.35, 0.4, 0.0],
        "task.goal.xyz": [0.05, 0.3, 0.0],
        "left.posture": [np.pi - 1.75, -0.97],
        "right.posture": [np.pi - 2.25, 1.64],
    }
    swapped = planned(values)
    assert swapped.cost == pytest.approx(plain.cost, rel=2e-6)
    wanted = plain.object_position * [-1.0, 1.0, 1.0] + [0.45, 0.0, 0.0]
    assert np.max(np.abs(swapped.object_position - wanted)) < 3e-5
    assert np.max(np.abs(swapped.tau + plain.tau[:, [2, 3, 0, 1]])) < 1e-3
    force = swapped.internal_force + plain.internal_force * [-1.0, 1.0, 1.0]
    assert np.max(np.abs(force)) < 1e-2


def test_turned_and_shifted() -> None:
    """Where the table stands in the room does not matter, gravity turned along or none."""
    angle, shift = 0.7, np.array([0.3, -0.2, 0.0])
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )

    def moved(point: np.ndarray) -> list[float]:
        return (turn @ point + shift).tolist()

    ends = {"boundary.start.torque": "static", "boundary.goal.torque": "static"}
    gravity = np.array([0.0, -9.81, 0.0])
    plain = planned(ends | {"world.gravity": gravity.tolist()})
    other = planned(
        ends
        | {
            "world.gravity": (turn @ gravity).tolist(),
            "left.base.xyz": moved(np.zeros(3)),
            "right.base.xyz": moved(np.array([0.45, 0.0, 0.0])),
            "left.base.rpy": [0.0, 0.0, angle],
            "right.base.rpy": [0.0, 0.0, angle],
            "task.start.xyz": moved(START),
            "task.goal.xyz": moved(GOAL),
        }
    )
    assert other.cost == pytest.approx(plain.cost, rel=1e-6)
    assert np.max(np.abs(other.q - plain.q)) < 1e-5
    assert np.allclose(other.object_position, plain.object_position @ turn.T + shift, atol=1e-5)
    assert np.max(np.abs(other.hand_force_right - plain.hand_force_right @ turn.T)) < 1e-2


@pytest.mark.parametrize(("values", "power"), [({}, 5), (FREE, 5), (TORQUE_KIND, 3)])
@pytest.mark.parametrize("duration", [0.05, 0.4, 20.0])
def test_duration(values: dict[str, Any], power: int, duration: float) -> None:
    """Without gravity the arms do the same at another pace: q(t T1/T2), torques as T^-2."""
    plain, other = planned(values), planned(values | {"task.duration": duration})
    assert other.cost * duration**power == pytest.approx(plain.cost, rel=1e-8)
    assert np.max(np.abs(other.q - plain.q)) < 1e-6
    assert np.max(np.abs(other.tau * duration**2 - plain.tau)) < 1e-5


def test_duration_with_gravity_is_no_mere_pace() -> None:
    values = {
        "world.gravity": [0.0, -9.81, 0.0],
        "boundary.start.torque": "static",
        "boundary.goal.torque": "static",
    }
    plain, slow = planned(values), planned(values | {"task.duration": 2.0})
    assert abs(slow.cost * 2.0**5 / plain.cost - 1.0) > 0.5
    # slowly enough, only the weight is left to be carried: cost as 1/T
    first, second = (planned(values | {"task.duration": duration}) for duration in (10.0, 20.0))
    assert first.cost / second.cost == pytest.approx(2.0, rel=0.1)


def test_mass() -> None:
    """Heavier costs more; far beyond the arms' own mass, with the square of it."""
    masses = (0.0, 0.5, 2.0, 8.0, 100.0, 1000.0)
    costs = [planned({"object.mass": mass}).cost for mass in masses]
    assert all(low < high for low, high in pairwise(costs))
    assert costs[-1] / costs[-2] == pytest.approx(100.0, rel=0.06)
    massless = planned({"object.mass": 0.0})
    total = massless.hand_force_left + massless.hand_force_right
    assert np.max(np.abs(total)) < 1e-9
    # paths straighten with mass, but not to a line in the limit
    bends = [curvature(planned({"object.mass": mass})) for mass in (0.0, 2.0, 8.0, 1000.0)]
    assert all(high > low for high, low in pairwise(bends))
    assert bends[-1] > 1e-3


@pytest.mark.parametrize("force", [[0.0, 0.0], [10.0, 10.0], [-10.0, -10.0], [-100.0, 100.0]])
def test_preload(force: list[float]) -> None:
    found = planned({"boundary.start.internal_force": [*force, 0.0]})
    assert found.internal_force[0, :2] == pytest.approx(force, abs=1e-8)
    if not any(force):
        assert found.cost == pytest.approx(ZERO_ENDS, rel=1e-6)
    else:
        assert found.cost > ZERO_ENDS


# ---- criteria and weights ------------------------------------------------------------------------


@pytest.mark.parametrize("values", [{}, TORQUE_KIND])
def test_weights(values: dict[str, Any]) -> None:
    plain = planned(values)
    assert planned(values | {"criterion.weights": "unit"}).cost == plain.cost
    assert planned(values | {"criterion.weights": [1.0] * 4}).cost == plain.cost
    threefold = planned(values | {"criterion.weights": [3.0] * 4})
    assert threefold.cost == pytest.approx(3.0 * plain.cost, rel=1e-9)
    assert np.max(np.abs(threefold.q - plain.q)) < 1e-7
    effort = planned(values | {"criterion.weights": "effort"})
    limits = build_chain(human()).both("effort_limit")
    numbers = planned(values | {"criterion.weights": (1.0 / limits).tolist()})
    assert effort.cost == pytest.approx(numbers.cost, rel=1e-12)


def test_a_dear_joint_does_less() -> None:
    plain, dear = planned(), planned({"criterion.weights": [1.0, 1.0, 50.0, 1.0]})
    used = [np.trapezoid(found.tau_rate**2, found.time, axis=0) for found in (plain, dear)]
    assert used[1][2] < 0.3 * used[0][2]
    assert used[1].sum() > used[0].sum(), "by unit weights the plain motion is the best"
    assert 50.0 * plain.cost > dear.cost > plain.cost


def test_no_criterion_is_better_at_what_another_minimises() -> None:
    change, torque = planned(FREE | {"boundary.start.torque": "free"}), planned(TORQUE_KIND)
    zero, jerk = planned(), planned({"criterion.kind": "jerk"})

    def spent(found: Plan) -> float:
        return float(0.5 * np.trapezoid((found.tau**2).sum(axis=1), found.time))

    assert spent(torque) == pytest.approx(TORQUE, rel=1e-4)
    for other in (change, zero, jerk, planned(FREE)):
        assert spent(other) > TORQUE * (1.0 + 1e-3)


def test_mixed_reaches_from_torque_change_to_torque() -> None:
    def mixed(share: float) -> float:
        return planned({"criterion.kind": "mixed", "criterion.torque_share": share}).cost

    assert mixed(0.0) == pytest.approx(ZERO_ENDS, rel=1e-6)
    assert mixed(1.0) == pytest.approx(TORQUE, rel=1e-6)
    shares = np.array([0.0, 0.25, 0.5, 0.9, 0.99, 0.999, 0.9999])
    costs = np.array([mixed(share) for share in shares])
    # the least of a sum is no less than the sum of what is least, and concave in the share
    assert np.all(costs[1:] > (1.0 - shares[1:]) * ZERO_ENDS + shares[1:] * TORQUE)
    slopes = np.diff(costs) / np.diff(shares)
    assert np.all(np.diff(slopes) < 0.0)
    # zero torques at the ends cost a boundary layer whose width is the root of what is left
    gaps = costs[-2:] - TORQUE
    assert gaps[0] / gaps[1] == pytest.approx(np.sqrt(10.0), rel=0.2)


# ---- other arms ----------------------------------------------------------------------------------


def unequal(folder: Path) -> Scenario:
    """Arms of other lengths and masses than the paper's, unlike each other."""
    left = write(folder / "left.urdf", arm_urdf((0.35, 0.3), (1.5, 0.6)))
    right = write(folder / "right.urdf", arm_urdf((0.25, 0.4), (0.7, 1.3)))
    return human(
        {
            "left.urdf": str(left),
            "right.urdf": str(right),
            "object.mass": 3.7,
            "task.duration": 0.8,
            "task.start.xyz": [0.05, 0.35, 0.0],
            "task.goal.xyz": [0.35, 0.42, 0.0],
        }
    )


@pytest.mark.parametrize("kind", ["torque-change", "torque", "jerk", "mixed"])
def test_other_arms(tmp_path: Path, kind: str) -> None:
    found = plan(unequal(tmp_path).override({"criterion.kind": kind})).unwrap()
    assert found.checks["closure"] < 1e-8
    assert found.checks["replay_end"] < 1e-6
    if kind != "jerk":
        assert found.checks["agreement"] < 1e-6
        assert found.checks["hamiltonian"] < 1e-5


def test_arms_joined_at_another_height_than_zero() -> None:
    """Planar arms need not lie in the plane z = 0."""
    lifted = {
        f"{key}.xyz": [x, y, 0.7]
        for key, (x, y) in {
            "left.base": (0.0, 0.0),
            "right.base": (0.45, 0.0),
            "task.start": (0.1, 0.4),
            "task.goal": (0.4, 0.3),
        }.items()
    }
    found = planned(lifted)
    assert found.cost == pytest.approx(ZERO_ENDS, rel=1e-6)
    assert np.allclose(found.object_position[:, 2], 0.7, atol=1e-12)


def test_redundant_arms_with_free_postures(tmp_path: Path) -> None:
    """Both hands firm on a bar: transversality leaves no gain in another start or goal posture."""
    free = plan(planar_arms(tmp_path, "rigid", gravity=(0.0, 0.0, 0.0))).unwrap()
    assert free.checks["agreement"] < 1e-5
    assert free.checks["replay_end"] < 1e-4
    assert free.checks["hamiltonian"] < 1e-5
    chain = build_chain(free.scenario)
    assert chain.p > chain.r
    # the posture that was found, held at the start, costs the same; another one costs more
    n = chain.left.n
    held = {"task.posture": "start", "left.posture": None, "right.posture": None}
    for bend, dearer in ((0.0, False), (0.15, True)):
        q = free.q[0] + bend * np.array([1.0, -1.0, 0.5, 0.0, 0.0, 0.0])
        values = held | {"left.posture": q[:n].tolist(), "right.posture": q[n:].tolist()}
        other = plan(free.scenario.override(values)).unwrap()
        if dearer:
            assert other.cost > free.cost * (1.0 + 1e-5)
        else:
            assert other.cost == pytest.approx(free.cost, rel=1e-4)


def test_free_postures_where_the_torques_depend_on_them(tmp_path: Path) -> None:
    """The torques of a preload turn with the posture, and rest asks for no acceleration there.

    Transversality has a term for either; the direct method, which has none, is the judge.
    """
    scenario = planar_arms(tmp_path, "rigid", gravity=(0.0, 0.0, 0.0)).override(
        {
            "boundary.start.internal_force": [8.0, -6.0, 0.0],
            "boundary.goal.torque": "rest",
            "criterion.speed_cost": 0.05,
        }
    )
    certified = plan(scenario).unwrap()
    fine = {"solver.method": "spectral", "solver.tolerance": 1e-6}
    direct = plan(scenario.override(fine)).unwrap()
    assert certified.cost == pytest.approx(direct.cost, rel=1e-6)
    assert certified.internal_force[0] == pytest.approx([8.0, -6.0, 0.0], abs=1e-6)
    assert np.max(np.abs(certified.a[-1])) < 1e-6 * np.max(np.abs(certified.a))
    for place in (0, -1):
        assert np.max(np.abs(certified.q[place] - direct.q[place])) < 2e-4


@pytest.mark.slow
def test_two_pandas(tmp_path: Path) -> None:
    """Redundant arms with a rigid grasp under gravity: the reference cost, or a lower one."""
    box = write(
        tmp_path / "box.urdf",
        '<robot name="box"><link name="box"><inertial><mass value="2"/>'
        f'<inertia ixx="{2 * 0.37 / 12}" iyy="{2 * 0.02 / 12}" izz="{2 * 0.37 / 12}" '
        'ixy="0" ixz="0" iyz="0"/></inertial></link></robot>',
    )
    posture = [0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4]
    scenario = pandas(thing=box)
    chain = build_chain(scenario)
    position, _ = chain.object_pose(chain.dynamics.placements(np.array([posture + posture])))
    start, way = position[0], np.array([0.0, 0.2, 0.2])
    scenario = scenario.override(
        {
            "task": {
                "start": {"xyz": start.tolist(), "rpy": [0.0, 0.0, 0.0]},
                "goal": {"xyz": (start + way).tolist(), "rpy": [0.0, 0.0, 0.0]},
                "duration": 1.0,
                "posture": "start",
            },
            "boundary.start.internal_force": [0.0, 0.0, 0.0],
            "boundary.goal.torque": "rest",
            "criterion.weights": "unit",
            "criterion.speed_cost": 0.0,
        }
    )
    found = plan(scenario)
    assert isinstance(found, Plan), found
    assert found.cost < 320.848418 * (1.0 + 1e-5)
    assert found.checks["closure"] < 1e-6
    assert found.checks["force_balance"] < 1e-5
    assert found.checks["replay_max"] < 1e-3
    assert found.checks["pontryagin_residual"] < 1e-4
    assert found.checks["agreement"] < 1e-5


@pytest.mark.parametrize("name", ["transport.toml", Path("transport.toml")])
def test_a_file_is_no_scenario(name: Any) -> None:
    with pytest.raises(InputError, match=r"transport\.toml.*planner\.load"):
        plan(name)
