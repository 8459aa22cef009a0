"""Kinematic pairs: which motions between the hands they block, in space and in a plane."""

from __future__ import annotations

import mechanisms
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.assembly import build_chain
from planner.errors import ModelError
from planner.pairs import across, make_pair

AXIS = st.tuples(*[st.floats(-3.0, 3.0)] * 3).filter(lambda axis: np.linalg.norm(axis) > 1e-2)
Z = np.array([0.0, 0.0, 1.0])


def twist(linear: np.ndarray, angular: np.ndarray) -> np.ndarray:
    return np.concatenate([linear, angular])


def allowed(pair: str, axis: np.ndarray) -> list[np.ndarray]:
    """A basis of the motions that a pair leaves free, from its definition."""
    none, (first, second) = np.zeros(3), across(axis)
    turn, slide = twist(none, axis), twist(axis, none)
    return {
        "revolute": [turn],
        "spherical": [twist(none, unit) for unit in np.eye(3)],
        "cylindrical": [turn, slide],
        "prismatic": [slide],
        "planar": [turn, twist(first, none), twist(second, none)],
        "rigid": [],
    }[pair]


@given(axis=AXIS)
def test_axes_across_complete_a_right_handed_frame(axis: tuple[float, float, float]) -> None:
    unit = np.array(axis) / np.linalg.norm(axis)
    frame = np.vstack([across(unit), unit])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame) == pytest.approx(1.0)


def test_axes_across_z_are_x_and_y() -> None:
    np.testing.assert_array_equal(across(Z), np.eye(3)[:2])


@pytest.mark.parametrize("name", mechanisms.PAIRS)
@given(axis=AXIS)
def test_a_pair_blocks_all_but_its_own_freedoms(
    name: str, axis: tuple[float, float, float]
) -> None:
    unit = np.array(axis) / np.linalg.norm(axis)
    pair = make_pair(name, np.array(axis), None)
    assert pair.m == mechanisms.PAIRS[name] == 6 - len(allowed(name, unit))
    np.testing.assert_allclose(pair.axis, unit)
    np.testing.assert_allclose(pair.blocked @ pair.blocked.T, np.eye(pair.m), atol=1e-12)
    for motion in allowed(name, unit):
        np.testing.assert_allclose(pair.blocked @ motion, 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "axis", "rotation"),
    [
        ("revolute", Z, "axis"),
        ("spherical", Z, "free"),
        ("cylindrical", Z, "axis"),
        ("prismatic", Z, "blocked"),
        ("planar", Z, "axis"),
        ("rigid", Z, "blocked"),
    ],
)
def test_rotation_that_is_left(name: str, axis: np.ndarray, rotation: str) -> None:
    assert make_pair(name, axis, None).rotation == rotation


@pytest.mark.parametrize(
    ("name", "axis", "m", "rotation"),
    [
        ("revolute", (0, 0, 1), 2, "free"),
        ("spherical", (0, 0, 1), 2, "free"),
        ("cylindrical", (0, 0, 1), 2, "free"),
        ("rigid", (0, 0, 1), 3, "blocked"),
        ("prismatic", (1, 0, 0), 2, "blocked"),
        ("prismatic", (0.6, 0.8, 0), 2, "blocked"),
        ("prismatic", (0, 0, 1), 3, "blocked"),
        ("planar", (1, 0, 0), 2, "blocked"),
    ],
)
def test_of_planar_arms_only_the_motions_in_their_plane_count(
    name: str, axis: tuple[float, ...], m: int, rotation: str
) -> None:
    pair = make_pair(name, np.array(axis, dtype=float), Z)
    assert (pair.m, pair.rotation) == (m, rotation)
    np.testing.assert_allclose(pair.blocked @ pair.blocked.T, np.eye(m), atol=1e-12)
    # nothing across the plane is blocked, since nothing can move there
    np.testing.assert_allclose(pair.blocked[:, [2, 3, 4]], 0.0, atol=1e-12)
    for motion in allowed(name, np.array(axis, dtype=float)):
        if not np.any(motion[[2, 3, 4]]):
            np.testing.assert_allclose(pair.blocked @ motion, 0.0, atol=1e-12)


def test_rows_of_a_tilted_plane_lie_in_it() -> None:
    normal = np.array([0.0, 0.6, 0.8])
    pair = make_pair("rigid", normal, normal)
    assert pair.m == 3
    np.testing.assert_allclose(pair.blocked[:, :3] @ normal, 0.0, atol=1e-12)
    np.testing.assert_allclose(
        pair.blocked[:, 3:], np.outer(pair.blocked[:, 3:] @ normal, normal), atol=1e-12
    )


def test_planar_arms_with_a_planar_pair_in_their_plane_do_not_hold_anything() -> None:
    scenario = mechanisms.human_arms({"grasp.pair": "planar"})
    with pytest.raises(ModelError, match=r"transport\.toml: grasp\.pair: .*; ") as caught:
        build_chain(scenario)
    assert "\n" not in str(caught.value)


def test_a_hinge_of_planar_arms_must_stand_upright_on_their_plane() -> None:
    scenario = mechanisms.human_arms({"grasp.axis": [0.0, 1.0, 0.0]})
    with pytest.raises(ModelError, match=r"grasp\.axis: .*choose \[0\.0, 0\.0, 1\.0\]"):
        build_chain(scenario)
    assert build_chain(mechanisms.human_arms({"grasp.axis": [0.0, 0.0, -2.0]})).m == 2


def test_a_pair_must_leave_the_task_its_freedoms() -> None:
    """Two firm hands leave two-jointed arms one freedom, the object's position needs two."""
    scenario = mechanisms.human_arms({"grasp.pair": "rigid"})
    with pytest.raises(ModelError, match=r"grasp\.pair: .* 1 freedoms.* 2 coordinates"):
        build_chain(scenario)
