"""Problems that grow: planar arms with 2 to 7 joints each, and the two Pandas."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from planner.assembly import build_chain
from planner.scenario import Scenario

LENGTH, MASS = 0.6, 2.0  # of a whole arm [m, kg], as the paper's
PANDA = "package://example-robot-data/robots/panda_description/urdf/panda.urdf"
PANDA_POSTURE = [0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4]
PANDA_COST = 320.848418  # torque-change, unit weights, from two formulations apart


def planar_urdf(joints: int) -> str:
    """Returns the URDF of an arm of equal slender links hinged about z."""
    length, mass = LENGTH / joints, MASS / joints
    moment = mass * length**2 / 12.0
    parts = ['<link name="base"/>']
    parent, at = "base", 0.0
    for place in range(joints):
        parts.append(
            f'<joint name="joint{place}" type="revolute"><origin xyz="{at!r} 0 0"/>'
            f'<parent link="{parent}"/><child link="link{place}"/><axis xyz="0 0 1"/>'
            f'<limit lower="-6.28" upper="6.28" effort="{60.0 - 40.0 * place / joints!r}" '
            f'velocity="20"/></joint><link name="link{place}"><inertial>'
            f'<origin xyz="{length / 2.0!r} 0 0"/><mass value="{mass!r}"/>'
            f'<inertia ixx="{moment / 50.0!r}" ixy="0" ixz="0" iyy="{moment!r}" iyz="0" '
            f'izz="{moment!r}"/></inertial></link>'
        )
        parent, at = f"link{place}", length
    parts.append(
        f'<joint name="wrist" type="fixed"><origin xyz="{at!r} 0 0"/><parent link="{parent}"/>'
        '<child link="hand"/></joint><link name="hand"/>'
    )
    return f'<robot name="planar{joints}">{"".join(parts)}</robot>'


def _body_urdf(mass: float, moments: tuple[float, float, float]) -> str:
    ixx, iyy, izz = moments
    return (
        f'<robot name="object"><link name="object"><inertial><mass value="{mass!r}"/>'
        f'<inertia ixx="{ixx!r}" ixy="0" ixz="0" iyy="{iyy!r}" iyz="0" izz="{izz!r}"/>'
        "</inertial></link></robot>"
    )


def _write(path: Path, text: str) -> str:
    path.write_text(text)
    return str(path)


def planar_pair(
    folder: Path, left: int, right: int, pair: str = "revolute", **extra: Any
) -> Scenario:
    """Returns the paper's transport by arms with more, shorter links.

    The start posture is held, evenly bent; the goal posture is free. Unit weights, torques zero at
    both ends; without another cost, so that all solve the same plain problem.

    Args:
        folder: Where URDF files are written.
        left: Joints of the left arm.
        right: Joints of the right arm.
        pair: Kinematic pair between the hands, revolute or rigid.
        extra: More sections of the scenario.
    """
    arms: dict[str, dict[str, Any]] = {
        side: {
            "urdf": _write(folder / f"{side}{joints}.urdf", planar_urdf(joints)),
            "tip": "hand",
            "base": {"xyz": [base, 0.0, 0.0]},
            "posture": _bent(joints, turn, np.array([0.1 - base, 0.4])),
        }
        for side, joints, base, turn in (("left", left, 0.0, -1.0), ("right", right, 0.45, 1.0))
    }
    # as they stand at the start the hands fit a rigid grasp
    turn = sum(arms["right"]["posture"]) - sum(arms["left"]["posture"])
    arms["right"]["grasp"] = {"rpy": [0.0, 0.0, float(np.arctan2(np.sin(turn), np.cos(turn)))]}
    return Scenario.from_resolved(
        {
            **arms,
            "object": {"urdf": _write(folder / "mass.urdf", _body_urdf(2.0, (0.0, 0.0, 0.0)))},
            "grasp": {"pair": pair},
            "world": {"gravity": [0.0, 0.0, 0.0]},
            "task": {
                "start": {"xyz": [0.1, 0.4, 0.0]},
                "goal": {"xyz": [0.4, 0.3, 0.0]},
                "duration": 1.0,
                "posture": "start" if left + right > 4 else "free",
            },
            "criterion": {"kind": "torque-change", "weights": "unit", "speed_cost": 0.0},
            **extra,
        }
    )


def _bent(joints: int, turn: float, hand: np.ndarray) -> list[float]:
    """Returns the posture whose links lie evenly bent between base and hand."""
    low, high = 1e-6, 2.0 * np.pi / joints

    def reach(bend: float) -> np.ndarray:
        angles = turn * bend * np.arange(joints)
        return LENGTH / joints * np.array([np.cos(angles).sum(), np.sin(angles).sum()])

    wanted = float(np.linalg.norm(hand))
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.linalg.norm(reach(middle)) > wanted else (low, middle)
    tip = reach(low)
    first = np.arctan2(hand[1], hand[0]) - np.arctan2(tip[1], tip[0])
    return [float(first), *([turn * float(low)] * (joints - 1))]


def two_pandas(folder: Path, **extra: Any) -> Scenario:
    """Returns the reference case: two Pandas lift a box of 2 kg with a rigid grasp, under gravity.

    Args:
        folder: Where the object's URDF is written.
        extra: More sections of the scenario.
    """
    size = np.array([0.1, 0.6, 0.1])
    squares = 2.0 / 12.0 * (np.sum(size**2) - size**2)
    moments = (float(squares[0]), float(squares[1]), float(squares[2]))

    def side(sign: float) -> dict[str, Any]:
        return {
            "urdf": PANDA,
            "tip": "panda_hand_tcp",
            "base": {"xyz": [0.0, 0.3 * sign, 0.0]},
            "posture": PANDA_POSTURE,
            "grasp": {"xyz": [0.0, 0.3 * sign, 0.0], "rpy": [np.pi, 0.0, 0.0]},
        }

    sections: dict[str, Any] = {
        "left": side(1.0),
        "right": side(-1.0),
        "object": {"urdf": _write(folder / "box.urdf", _body_urdf(2.0, moments))},
        "grasp": {"pair": "rigid"},
        "world": {"gravity": [0.0, 0.0, -9.81]},
        "task": {"start": {"xyz": [0.3, 0.0, 0.5]}, "goal": {"xyz": [0.3, 0.2, 0.7]}},
        "criterion": {"kind": "torque-change", "weights": "unit", "speed_cost": 0.0},
        "boundary": {
            "start": {"internal_force": [0.0, 0.0, 0.0], "internal_moment": [0.0, 0.0, 0.0]},
            "goal": {"torque": "rest"},
        },
    }
    sections["task"]["duration"] = 1.0
    chain = build_chain(Scenario.from_resolved(sections))
    position, rotation = chain.object_pose(
        chain.dynamics.placements(np.array([PANDA_POSTURE + PANDA_POSTURE]))
    )
    turn = [float(angle) for angle in pin.rpy.matrixToRpy(rotation[0])]
    away = position[0] + [0.0, 0.2, 0.2]
    sections["task"] |= {
        "start": {"xyz": position[0].tolist(), "rpy": turn},
        "goal": {"xyz": away.tolist(), "rpy": turn},
        "posture": "start",
    }
    return Scenario.from_resolved(sections | extra)
