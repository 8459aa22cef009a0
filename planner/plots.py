"""Figures of a plan: the object's path, the torques and the internal force over time.

Each `draw_` function draws into axes that it is given, so plans can share a figure;
[write_plots][planner.plots.write_plots] makes the figure that belongs to one plan.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from planner.arm import Side, read_arm
from planner.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from planner.result import Plan

# Okabe and Ito's colors, told apart with any color vision; their yellow is too light on white.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
SUFFIXES = (".png", ".svg", ".pdf")
FAINT = "#9AA0A8"
# sizes for a figure printed over the width of a page
STYLE: Any = {
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "lines.linewidth": 1.5,
    "lines.solid_capstyle": "round",
    "pdf.fonttype": 42,  # letters stay letters
    "svg.fonttype": "none",
    "svg.hashsalt": "planner",  # the same plan gives the same file
}


def draw_path(ax: Axes, plan: Plan, label: str | None = None, *, postures: bool = True) -> None:
    """Draws the object's path from its start (circle) to its goal (square).

    A path that stays in a plane of two axes of the world is drawn in that plane, to scale, with the
    straight line and, where the arms move in that plane too, their postures at both ends. The
    others are drawn as three displacements [m] over the length of the path [m]; they are straight
    where the path is.

    Args:
        ax: Where to draw. Further plans drawn there take further colors.
        plan: The plan.
        label: Its name in the legend.
        postures: Draw the arms and the straight line, too.
    """
    plane = _plane(plan)
    if plane is None:
        _draw_displacements(ax, plan, label)
        return
    position = plan.object_position[:, plane]
    color = COLORS[sum(line.get_gid() == "path" for line in ax.lines) % len(COLORS)]
    across, up = (f"{'xyz'[axis]} [m]" for axis in plane)
    ax.set(xlabel=across, ylabel=up, aspect="equal")
    ax.set_title("Object path")
    if postures:
        faint: Any = {"color": FAINT, "linewidth": 1.1, "zorder": 1}
        ends: Any = ((0, "arms at the start", (0, (4, 2))), (-1, "arms at the goal", "-"))
        for frame, name, dashes in ends:
            for count, arm in enumerate(_arm_points(plan, frame, plane)):
                ax.plot(*arm.T, linestyle=dashes, label=None if count else name, **faint)
                ax.plot(*arm[:-1].T, "o", markersize=3.5, **faint)
        ax.plot(*position[[0, -1]].T, linestyle=":", label="straight line", **faint)
    ax.plot(*position.T, color=color, label=label, gid="path", zorder=3)
    ax.plot(*position[0], "o", color=color, markerfacecolor="white", markersize=5, zorder=4)
    ax.plot(*position[-1], "s", color=color, markersize=4.5, zorder=4)
    if postures:
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.24), ncols=4)
    elif label:
        ax.legend()


def _draw_displacements(ax: Axes, plan: Plan, label: str | None) -> None:
    position = plan.object_position
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    count = sum(line.get_gid() == "path" for line in ax.lines) // 3
    style = ("-", "--", ":", "-.")[count % 4]
    prefix = f"{label}: " if label else ""
    for axis in range(3):
        moved = position[:, axis] - position[0, axis]
        name = f"{prefix}{'xyz'[axis]}"
        ax.plot(length, moved, style, color=COLORS[axis], label=name, gid="path", zorder=3)
        straight = "straight line" if axis == 2 and not count else None
        ax.plot(length[[0, -1]], moved[[0, -1]], color=FAINT, lw=0.8, label=straight, zorder=1)
    ax.set(xlabel="length of path [m]", ylabel="displacement [m]")
    ax.set_title("Object path")
    ax.legend()


def draw_torques(ax: Axes, plan: Plan) -> None:
    """Draws the joint torques over time, the left arm's solid and the right arm's dashed.

    Args:
        ax: Where to draw.
        plan: The plan.
    """
    half = read_arm(plan.scenario, "left").n
    names, title, columns = list(plan.joint_names), "Joint torques", 1
    if len(names) > 8:
        # two arms of one make share their colors, and so one entry of the legend per joint
        left = [_without_side(name, "left") for name in names[:half]]
        right = [_without_side(name, "right") for name in names[half:]]
        if left == right:
            names, title = left + [""] * half, "Joint torques (left solid, right dashed)"
        else:
            columns = 2
    for joint, name in enumerate(names):
        style: Any = "-" if joint < half else (0, (4, 1.5))
        color = COLORS[(joint if joint < half else joint - half) % len(COLORS)]
        ax.plot(plan.time, plan.tau[:, joint], linestyle=style, color=color, label=name or None)
    _finish_over_time(ax, plan, title, "torque [Nm]", columns)


def _without_side(name: str, side: Side) -> str:
    return name.removeprefix(side).strip("/_.: ")


def draw_internal_force(
    ax: Axes, plan: Plan, label: str | None = None, *, components: bool = True
) -> None:
    """Draws the internal force (left hand minus right hand) over time: magnitude and components.

    Args:
        ax: Where to draw. Further plans drawn there take further colors.
        plan: The plan.
        label: Its name in the legend.
        components: Draw the components in the world, too; those that are zero throughout are
            left out.
    """
    force = plan.internal_force
    magnitude = np.linalg.norm(force, axis=1)
    count = sum(line.get_gid() == "magnitude" for line in ax.lines)
    color = COLORS[count % len(COLORS)] if label or count else "#000000"
    name = label or "magnitude"
    ax.plot(plan.time, magnitude, color=color, label=name, gid="magnitude", zorder=3)
    if components:
        for axis in range(3):
            if np.max(np.abs(force[:, axis])) > 1e-9 * max(1.0, float(magnitude.max())):
                ax.plot(
                    plan.time, force[:, axis], color=COLORS[axis], label="xyz"[axis], linewidth=1.1
                )
    _finish_over_time(ax, plan, "Internal force", "force [N]")


def _finish_over_time(ax: Axes, plan: Plan, title: str, label: str, columns: int = 1) -> None:
    ax.axhline(0.0, color=FAINT, linewidth=0.6, zorder=0)
    ax.set(xlabel="time [s]", ylabel=label, xlim=(plan.time[0], plan.time[-1]))
    ax.set_title(title)
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.02), borderaxespad=0.3, ncols=columns)


def draw(plan: Plan) -> Figure:
    """Returns a figure of two plots: the object's path, and torques and internal force over time.

    Args:
        plan: The plan.
    """
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(8.6, 4.1), layout="constrained")
        rows: Any = [["path", "torques"], ["path", "force"]]
        axes = figure.subplot_mosaic(rows, width_ratios=(1.15, 1.0))
        draw_path(axes["path"], plan)
        draw_torques(axes["torques"], plan)
        draw_internal_force(axes["force"], plan)
        axes["torques"].sharex(axes["force"])
        axes["torques"].tick_params(labelbottom=False)
        axes["torques"].set_xlabel("")
        title = plan.scenario.title or "Plan"
        figure.suptitle(f"{title}: {plan.criterion}, cost {plan.cost:.6g}", fontsize=10.5)
    return figure


def write_plots(plan: Plan, file: Path | str) -> list[Path]:
    """Writes the figure of a plan.

    Args:
        plan: The plan.
        file: Its suffix picks the format: .png, .svg or .pdf. Its folder is made where it is
            missing.

    Returns:
        The files written.

    Raises:
        InputError: The format is not known, or the file cannot be written.
    """
    import matplotlib

    file = Path(file)
    suffix = file.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(
            "plots are not written in this format",
            source=file,
            value=file.suffix,
            remedy=f"end the name in {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}",
        )
    dates = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(suffix)
    figure = draw(plan)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with matplotlib.rc_context(STYLE):
            figure.savefig(file, format=suffix[1:], dpi=200, metadata=dates)
    except OSError as error:
        raise InputError(
            f"cannot be written: {error.strerror}", source=file, remedy="name a writable file"
        ) from None
    return [file]


def _plane(plan: Plan) -> list[int] | None:
    """Returns the two axes of the world that the path moves along, or None where it needs three."""
    extent = np.ptp(plan.object_position, axis=0)
    order = np.argsort(extent, kind="stable")
    if extent[order[0]] > 1e-6 * max(float(extent.max()), 1e-9):
        return None
    if extent[order[1]] > 1e-6 * max(float(extent.max()), 1e-9):
        return sorted(int(axis) for axis in order[1:])
    # a path along one axis (or none): x and y if they hold it, else that axis and z
    return [0, 1] if order[2] != 2 else [0, 2]


def _arm_points(plan: Plan, frame: int, plane: list[int]) -> list[np.ndarray]:
    """Returns each arm's joints and tip in the plane, (n + 1, 2) [m]; nothing if one leaves it.

    Args:
        plan: The plan.
        frame: The sample.
        plane: The plane's two axes.
    """
    normal = np.eye(3)[3 - sum(plane)]
    sides: tuple[Side, Side] = ("left", "right")
    found, first = [], 0
    for side in sides:
        arm = read_arm(plan.scenario, side)
        data = arm.model.createData()
        pin.computeJointJacobians(arm.model, data, plan.q[frame, first : first + arm.n])
        first += arm.n
        if (
            np.max(np.abs(normal @ data.J[:3])) > 1e-9
            or np.max(np.abs(np.cross(normal, data.J[3:].T))) > 1e-9
        ):
            return []
        tip = data.oMi[arm.tip_joint] * arm.tip_placement
        points = [data.oMi[joint].translation for joint in range(1, arm.model.njoints)]
        found.append(np.array([*points, tip.translation])[:, plane])
    return found
