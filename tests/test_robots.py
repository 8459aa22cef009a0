"""Robots that people have, from their own URDF: every scenario that is shipped gives a plan."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest

from planner import load, plan
from planner.assembly import build_chain
from planner.body import read_object
from planner.posture_equations import pose_error
from planner.transport import make_transport

URDF = Path(__file__).parents[1] / "urdf"
FILES = sorted(path for path in URDF.glob("*/*.toml") if path.parent.name != "human_arms")
NAMES = [path.relative_to(URDF).with_suffix("").as_posix() for path in FILES]
REFERENCE = 320.848418
BOUNDS = {
    "closure": 1e-6,
    "force_balance": 1e-5,
    "torque_balance": 1e-5,
    "end_speed": 1e-6,
    "pontryagin_residual": 1e-4,
    "hamiltonian": 1e-4,
    "replay_max": 1e-3,
}


def test_every_robot_that_was_promised_has_a_scenario() -> None:
    assert {path.parent.name for path in FILES} >= {
        "two_pandas",
        "two_ur5",
        "baxter",
        "tiago_dual",
        "talos",
    }


@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_both_hands_hold_the_object_at_start_and_goal(path: Path) -> None:
    scenario = load(path)
    chain = build_chain(scenario)
    transport = make_transport(scenario, chain)
    assert chain.pair.name == "rigid"
    assert chain.m == 6
    assert np.linalg.norm(chain.gravity) == pytest.approx(9.81)
    assert 1.0 <= chain.body.mass <= 5.0
    for end in (transport.start, transport.goal):
        at = chain.dynamics.placements(end.posture[None])
        assert np.max(np.abs(chain.gap(at))) < 1e-9
        error = pose_error(chain, at, end.pose.position, end.pose.rotation)
        assert np.max(np.abs(error)) < 1e-9
        assert np.all(end.posture >= chain.both("lower") - 1e-9)
        assert np.all(end.posture <= chain.both("upper") + 1e-9)
    # the posture in the file closes the chain: it is what the reader sees, not only a seed
    reference = transport.reference
    np.testing.assert_allclose(transport.start.posture, reference, atol=2e-3)


@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_the_object_is_as_heavy_everywhere(path: Path) -> None:
    body = read_object(load(path))
    shape = ElementTree.parse(body.urdf.path).find("link/visual/geometry")
    assert shape is not None
    box, cylinder = shape.find("box"), shape.find("cylinder")
    if box is not None:
        squares = np.array([float(side) for side in box.get("size", "").split()]) ** 2
        moments = body.mass / 12.0 * (squares.sum() - squares)
    else:
        assert cylinder is not None
        radius, length = (float(cylinder.get(key, "")) for key in ("radius", "length"))
        across = body.mass / 12.0 * (3.0 * radius**2 + length**2)
        moments = np.array([across, 0.5 * body.mass * radius**2, across])  # it lies along y
    np.testing.assert_allclose(body.com, 0.0)
    np.testing.assert_allclose(body.inertia, np.diag(moments), rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_a_shipped_scenario_gives_a_certified_plan(path: Path) -> None:
    found = plan(load(path)).unwrap()
    wrong = {name: found.checks[name] for name, most in BOUNDS.items() if found.checks[name] > most}
    assert not wrong
    assert found.checks["condition"] < 100.0
    if found.scenario.title != "Two Pandas lift a box":  # the reference case is faster than it may
        assert found.checks["limits"] == []
    else:
        assert found.cost < REFERENCE * (1.0 + 1e-5)


@pytest.mark.slow
def test_the_reference_case_costs_what_an_independent_solution_costs() -> None:
    found = plan(load(URDF / "two_pandas" / "lift.toml")).unwrap()
    assert found.cost == pytest.approx(REFERENCE, rel=1e-5)
    assert found.checks["spectral_cost"] == pytest.approx(REFERENCE, rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pair", "axis"),
    [
        ("revolute", (0.0, 1.0, 0.0)),
        ("cylindrical", (0.0, 1.0, 0.0)),
        ("prismatic", (0.0, 1.0, 0.0)),
        ("planar", (1.0, 0.0, 0.0)),
    ],
)
def test_hands_that_may_move_on_the_object_carry_it_where_planned(
    pair: str, axis: tuple[float, ...]
) -> None:
    values = {"grasp.pair": pair, "grasp.axis": list(axis)}
    found = plan(load(URDF / "two_pandas" / "lift.toml", values)).unwrap()
    assert found.checks["replay_max"] < 1e-6
    assert found.cost < 1.1 * REFERENCE


@pytest.mark.slow
def test_a_slow_lift_cannot_do_without_feedback() -> None:
    found = plan(load(URDF / "talos" / "bar.toml", {"task.duration": 2.0})).unwrap()
    assert found.checks["torque_balance"] < 1e-9
    assert found.checks["replay_window"] < 1e-7
    assert found.checks["replay_growth"] == pytest.approx(11.4, abs=0.3)  # whatever the duration
    assert "unstable without feedback" in found.checks["replay"]
