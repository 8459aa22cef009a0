"""Numbers and curves taken from plans: how straight a path is, how large forces are, what costs."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from scipy.integrate import simpson
from scipy.interpolate import CubicSpline

from planner.result import Plan

CENTIMETRES = 100.0


def line_distance(plan: Plan) -> np.ndarray:
    """Returns the object's distance from the straight line, left of it positive, (N,) [m]."""
    way, gone = _from_start(plan)
    return (way[0] * gone[:, 1] - way[1] * gone[:, 0]) / np.linalg.norm(way)


def line_progress(plan: Plan) -> np.ndarray:
    """Returns how far the object has come along the straight line, (N,) [m]."""
    way, gone = _from_start(plan)
    return gone @ way / np.linalg.norm(way)


def _from_start(plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    position = plan.object_position[:, :2]
    return position[-1] - position[0], position - position[0]


def curvature(plan: Plan) -> float:
    """Returns the largest distance of the object from the straight line [m]."""
    return float(np.max(np.abs(line_distance(plan))))


def internal_force_size(plan: Plan) -> np.ndarray:
    """Returns the magnitude of the internal force, (N,) [N]."""
    size: np.ndarray = np.linalg.norm(plan.internal_force, axis=1)
    return size


def costs(plan: Plan) -> tuple[float, float, float]:
    """Returns what a motion costs by each criterion, with unit weights.

    They are half the integrals of the squared torques [Nm^2 s], of their squared rates [Nm^2/s]
    and of the object's squared jerk [m^2/s^5]. The jerk is taken from the hand forces, so the
    object must have a mass.
    """
    mass = plan.scenario.object.mass
    assert mass, "the object's acceleration is taken from the forces on it"
    force = (plan.hand_force_left + plan.hand_force_right) / mass
    jerk = CubicSpline(plan.time, force)(plan.time, 1)
    torque, change, jerked = (
        float(0.5 * simpson((values**2).sum(axis=1), x=plan.time))
        for values in (plan.tau, plan.tau_rate, jerk)
    )
    return torque, change, jerked


def write_curve(plan: Plan, file: Path) -> None:
    """Writes a plan's curves over time as CSV; the unit ends the name of a column.

    Args:
        plan: The plan.
        file: The file to write.
    """
    columns = {
        "time_s": plan.time,
        "x_m": plan.object_position[:, 0],
        "y_m": plan.object_position[:, 1],
        "distance_from_line_m": line_distance(plan),
        "internal_force_x_N": plan.internal_force[:, 0],
        "internal_force_y_N": plan.internal_force[:, 1],
        "internal_force_N": internal_force_size(plan),
    }
    columns |= {
        f"torque_{name}_Nm": plan.tau[:, joint] for joint, name in enumerate(plan.joint_names)
    }
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        for row in np.column_stack(list(columns.values())):
            writer.writerow(f"{value:.12g}" for value in row)
