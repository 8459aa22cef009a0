"""Tables for the terminal and one picture of everything that was measured."""

from __future__ import annotations

import datetime
import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from peers.measure import Timing

PLANNERS = ("planner, certified", "planner, spectral")
COLOURS = {
    "planner, certified": "#0072b2",
    "planner, spectral": "#009e73",
    "CasADi, IPOPT": "#d55e00",
    "CasADi, fatrop": "#e69f00",
    "plain solve_bvp": "#7f7f7f",
}


@dataclass(frozen=True)
class Series:
    """Times of one method against a size.

    Attributes:
        method: Name.
        sizes: Sizes.
        seconds: Median solve times [s].
        iterations: Iterations.
    """

    method: str
    sizes: tuple[int, ...]
    seconds: tuple[float, ...]
    iterations: tuple[int, ...] = ()

    @property
    def exponent(self) -> float:
        """Slope of the straight line through the logarithms."""
        if len(self.sizes) < 2:
            return float("nan")
        return float(np.polyfit(np.log(self.sizes), np.log(self.seconds), 1)[0])


@dataclass(eq=False)
class Report:
    """Everything that was measured in one run.

    Attributes:
        cases: (title, accuracy, timings).
        joints: Growth with the joints of each arm.
        nodes: Growth with nodes.
    """

    cases: list[tuple[str, float, list[Timing]]] = field(default_factory=list)
    joints: list[Series] = field(default_factory=list)
    nodes: list[Series] = field(default_factory=list)


def machine() -> str:
    """Returns the date and the machine's size, for captions."""
    memory = ""
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        size = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        memory = f", {size / 2**30:.0f} GB"
    packages = ", ".join(f"{name} {version(name)}" for name in ("pin", "casadi", "scipy", "numpy"))
    return (
        f"{datetime.date.today():%d %B %Y}, {os.cpu_count()} cores{memory}, "
        f"{platform.machine()}, one thread, Python {platform.python_version()}, {packages}"
    )


def milliseconds(seconds: float) -> str:
    """Returns a time as text."""
    return f"{1e3 * seconds:.1f}" if seconds < 0.1 else f"{1e3 * seconds:.0f}"


def show_case(console: Console, title: str, accuracy: float, timings: Sequence[Timing]) -> None:
    """Prints one problem at one accuracy, ratios against this planner's certified plan."""
    table = Table(
        title=f"{title}, cost to {accuracy:.0e}: medians of {timings[0].count} runs",
        caption="times in ms; floor: the solve's Pinocchio calls alone; "
        "total: start + build + solve; plan: the whole call, with checks",
    )
    table.add_column("method")
    table.add_column("setting")
    for name in ("start", "build", "solve", "floor", "total", "plan", "error", "it"):
        table.add_column(name, justify="right")
    known = [name for name in PLANNERS if any(timing.method == name for timing in timings)]
    for name in known:
        table.add_column(f"total / {name.split(', ')[1]}", justify="right")
    base = {t.method: t.run.total for t in timings if t.method in known}
    for timing in sorted(timings, key=lambda timing: timing.run.total):
        run = timing.run
        table.add_row(
            timing.method,
            timing.setting,
            milliseconds(run.start),
            milliseconds(run.build) if run.build else "",
            milliseconds(run.solve),
            milliseconds(timing.floor) if timing.floor else "",
            milliseconds(run.total),
            milliseconds(run.whole) if run.whole else "",
            f"{timing.error:.0e}" if run.solved else "not solved",
            str(run.iterations or ""),
            *(f"{run.total / base[name]:.2f}" for name in known),
            style="bold" if timing.method in PLANNERS else "",
        )
    console.print(table)
    _say_targets(console, timings)


def _say_targets(console: Console, timings: Sequence[Timing]) -> None:
    """Prints the ratios that matter in words."""
    peers = [t for t in timings if t.method.startswith("CasADi") and "-O" not in t.method]
    if not peers:
        return
    solve = min(peers, key=lambda t: t.run.solve)
    both = min(peers, key=lambda t: t.run.build + t.run.solve)
    built = both.run.build + both.run.solve
    for timing in (t for t in timings if t.method in PLANNERS):
        console.print(
            f"  {timing.method}: its solve takes {timing.run.solve / solve.run.solve:.2f} times "
            f"the best peer's solve ({solve.method} {solve.setting}); the best peer's build and "
            f"solve ({both.method} {both.setting}) take {built / timing.run.solve:.2f} times it"
        )


def show_series(console: Console, title: str, label: str, series: Sequence[Series]) -> None:
    """Prints how solve times grow."""
    sizes = sorted({size for one in series for size in one.sizes})
    common = len(sizes) <= 8
    table = Table(title=title, caption="solve times in ms (iterations)")
    table.add_column("method")
    if common:
        for size in sizes:
            table.add_column(f"{size} {label}", justify="right")
    else:
        table.add_column(f"{label}: ms", justify="right")
    table.add_column("exponent", justify="right")
    for one in series:
        cells = {
            size: milliseconds(seconds) + (f" ({steps})" if steps else "")
            for size, seconds, steps in zip(
                one.sizes, one.seconds, one.iterations or (0,) * len(one.sizes), strict=True
            )
        }
        if common:
            row = [cells.get(size, "-") for size in sizes]
        else:
            row = [", ".join(f"{size}: {text}" for size, text in cells.items())]
        table.add_row(one.method, *row, f"{one.exponent:.2f}")
    console.print(table)


def draw(report: Report, path: Path) -> None:
    """Writes the picture: time to accuracy for each problem, then growth."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import NullFormatter

    titles = list(dict.fromkeys(title for title, _, _ in report.cases))
    growth = [
        (name, label, series)
        for name, label, series in (
            ("Growth with joints", "joints of each arm", report.joints),
            ("Growth with nodes", "nodes", report.nodes),
        )
        if series
    ]
    count = len(titles) + len(growth)
    if not count:
        return
    columns = min(count, 3)
    rows = -(-count // columns)
    figure, grid = plt.subplots(
        rows, columns, figsize=(4.6 * columns, 3.7 * rows), squeeze=False, layout="constrained"
    )
    axes = list(grid.ravel())
    for title, ax in zip(titles, axes, strict=False):
        _draw_case(ax, title, report)
    for (name, label, series), ax in zip(growth, axes[len(titles) :], strict=False):
        for one in series:
            ax.loglog(
                one.sizes,
                np.multiply(one.seconds, 1e3),
                "o-",
                ms=4,
                color=COLOURS.get(one.method),
                label=f"{one.method} (exponent {one.exponent:.1f})",
            )
        ax.set(title=name, xlabel=label, ylabel="solve [ms]")
        ax.set_xticks(sorted(series[0].sizes), [str(size) for size in sorted(series[0].sizes)])
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.legend(fontsize=7)
    for ax in axes[:count]:
        ax.grid(alpha=0.3, which="both")
    for ax in axes[count:]:
        ax.set_visible(False)
    if titles:
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    figure.suptitle(machine(), fontsize=7)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def _draw_case(ax: Any, title: str, report: Report) -> None:
    lines: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for name, accuracy, timings in report.cases:
        if name != title:
            continue
        for method in dict.fromkeys(timing.method for timing in timings):
            mine = [timing.run for timing in timings if timing.method == method]
            total = min(run.build + run.solve for run in mine)
            lines.setdefault((method, "build and solve"), []).append((accuracy, total))
            if any(run.build for run in mine):
                solve = min(run.solve for run in mine)
                lines.setdefault((method, "solve alone"), []).append((accuracy, solve))
    for (method, what), points in lines.items():
        accuracies, seconds = zip(*points, strict=True)
        built = any(key == (method, "solve alone") for key in lines)
        ax.loglog(
            accuracies,
            np.multiply(seconds, 1e3),
            "o--" if what == "solve alone" else "o-",
            ms=4,
            color=COLOURS.get(method),
            label=f"{method}, {what}" if built else method,
        )
    ax.invert_xaxis()
    ax.set(title=title, xlabel="relative error of the cost", ylabel="time from the start [ms]")
