"""The paper's figures 2 to 5, drawn with the functions that draw every plan."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from planner.plots import COLORS, FAINT, STYLE, draw_internal_force, draw_path
from planner.reproduction.measures import CENTIMETRES, line_distance, line_progress
from planner.result import Plan

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# told apart in grey, too
DASHES: Any = ("-", (0, (6, 1.5)), (0, (3, 1.2)), (0, (6, 1.5, 1.2, 1.5)), (0, (1.2, 1.2)))
INK = "#333333"
_FORMATS = (".png", ".svg")


def draw_paths(plans: Mapping[str, Plan], title: str) -> Figure:
    """Returns a figure of object paths: with the arms, enlarged, and as distance from the line.

    Args:
        plans: Plans of one task by their names in the legend.
        title: What the legend lists.
    """
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 3.8), layout="constrained")
        rows: Any = [["arms", "paths"], ["legend", "distance"]]
        axes = figure.subplot_mosaic(rows, width_ratios=(1.0, 1.25), height_ratios=(1.15, 1.0))
        legend = axes.pop("legend")
        legend.set_axis_off()
        _draw_arms(axes["arms"], plans)
        _draw_enlarged(axes["paths"], plans)
        _draw_distance(axes["distance"], plans)
        for letter, ax in zip("abc", axes.values(), strict=True):
            ax.set_title(f"({letter}) {ax.get_title('left')}")
        handles, labels = axes["arms"].get_legend_handles_labels()
        order = sorted(range(len(labels)), key=lambda k: labels[k] not in plans)
        legend.legend(
            [handles[k] for k in order],
            [labels[k] for k in order],
            loc="center",
            ncols=1 if max(map(len, plans)) > 20 else 2,
            handlelength=3.0,
            title=title,
            alignment="left",
        )
    return figure


def _draw_arms(ax: Axes, plans: Mapping[str, Plan]) -> None:
    for count, (label, plan) in enumerate(plans.items()):
        draw_path(ax, plan, label, postures=count == 0)
    _style(ax, "path")
    _mark_ends(ax, plans)
    ax.set_title("arms and object paths")
    _remove_legend(ax)
    for side in ("left", "right"):
        x, y, _ = getattr(next(iter(plans.values())).scenario, side).base.xyz
        ax.plot(x, y, "^", color=INK, markersize=7, zorder=5)
        ax.annotate(
            f"{side} base", (x, y), (0, -6), textcoords="offset points", ha="center", va="top"
        )
    ax.update_datalim([(0.0, -0.08)])  # room for the names of the bases
    ax.autoscale_view()
    ax.set_adjustable("datalim")


def _draw_enlarged(ax: Axes, plans: Mapping[str, Plan]) -> None:
    for plan in plans.values():
        draw_path(ax, plan, postures=False)
    ends = next(iter(plans.values())).object_position[[0, -1]]
    ax.plot(ends[:, 0], ends[:, 1], linestyle=":", color=FAINT, linewidth=1.1, zorder=1)
    _style(ax, "path")
    _mark_ends(ax, plans)
    ax.annotate("start", tuple(ends[0, :2]), (7, 1), textcoords="offset points")
    ax.annotate("goal", tuple(ends[1, :2]), (0, 6), textcoords="offset points", ha="center")
    ax.set_title("object paths, enlarged")
    ax.set_adjustable("datalim")
    ax.locator_params(axis="y", nbins=5)


def _mark_ends(ax: Axes, plans: Mapping[str, Plan]) -> None:
    """Covers the ends' marks, which have the last curve's color, by such of no curve's color."""
    start, goal = next(iter(plans.values())).object_position[[0, -1], :2]
    ax.plot(*start, "o", color=INK, markerfacecolor="white", markersize=5, zorder=6)
    ax.plot(*goal, "s", color=INK, markersize=5, zorder=6)


def _draw_distance(ax: Axes, plans: Mapping[str, Plan]) -> None:
    ax.axhline(0.0, linestyle=":", color=FAINT, linewidth=1.1, zorder=1)
    for color, plan in zip(COLORS, plans.values(), strict=False):
        progress, distance = line_progress(plan), line_distance(plan)
        ax.plot(progress * CENTIMETRES, distance * CENTIMETRES, color=color, gid="path", zorder=3)
    _style(ax, "path")
    ax.set(xlabel="way along the straight line [cm]", ylabel="distance [cm]")
    ax.set_title("distance from the straight line (left of it: +)")


def draw_forces(plans: Mapping[str, Plan]) -> Figure:
    """Returns a figure of the magnitude of the internal force over time.

    Args:
        plans: Plans by their names in the legend, to which the mean over time is added.
    """
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 3.0), layout="constrained")
        ax = figure.subplots()
        for label, plan in plans.items():
            mean = plan.mean_internal_force
            draw_internal_force(ax, plan, f"{label}\n(mean {mean:.2f} N)", components=False)
        _style(ax, "magnitude")
        ax.set(ylabel="internal force, magnitude [N]")
        ax.set_ylim(0.0, 1.08 * max(line.get_ydata().max() for line in _curves(ax, "magnitude")))
        ax.set_title("")
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), handlelength=3.0, labelspacing=0.9)
    return figure


def _curves(ax: Axes, gid: str) -> list[Any]:
    return [line for line in ax.lines if line.get_gid() == gid]


def _style(ax: Axes, gid: str) -> None:
    """Gives every curve its own dashes besides its color."""
    for line, dashes in zip(_curves(ax, gid), DASHES, strict=False):
        line.set_linestyle(dashes)
        line.set_dash_capstyle("butt")


def _remove_legend(ax: Axes) -> None:
    legend = ax.get_legend()
    if legend is not None:
        legend.remove()


def write_figure(figure: Figure, stem: Path) -> list[Path]:
    """Writes a figure as PNG and as SVG.

    Args:
        figure: The figure.
        stem: The file's path without suffix.
    """
    import matplotlib

    files = []
    for suffix in _FORMATS:
        file = stem.with_suffix(suffix)
        # no date: the same plans give the same file
        metadata = {"Date": None} if suffix == ".svg" else None
        with matplotlib.rc_context(STYLE):
            figure.savefig(file, format=suffix[1:], dpi=250, metadata=metadata)
        files.append(file)
    return files
