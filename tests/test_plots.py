"""Figures of a plan: what they show, how it is labelled, and what may go wrong with the file."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from planner import plots
from planner import scenario as scenarios
from planner.errors import InputError

ROOT = Path(__file__).resolve().parents[1]
TRANSPORT = ROOT / "urdf" / "human_arms" / "transport.toml"


@pytest.fixture
def plan():
    scenario = scenarios.load(TRANSPORT)
    time = np.linspace(0.0, 1.0, 21)
    s = time[:, None]
    posture = np.array([*scenario.left.posture, *scenario.right.posture])
    force = np.hstack([3.0 * np.sin(np.pi * s), 2.0 * np.sin(2.0 * np.pi * s), 0.0 * s])
    bend = s * (1.0 - s) * [0.0, 0.2, 0.0]
    return SimpleNamespace(
        scenario=scenario,
        criterion="torque-change",
        cost=16.811305,
        duration=1.0,
        joint_names=("left_shoulder", "left_elbow", "right_shoulder", "right_elbow"),
        time=time,
        q=posture + 0.3 * s,
        tau=np.sin(np.pi * s * [1.0, 2.0, 3.0, 4.0]),
        object_position=np.array([0.1, 0.4, 0.0]) + s * [0.3, -0.1, 0.0] + bend,
        internal_force=force,
    )


def axes():
    return Figure().subplots()


def lines(ax, gid):
    return [line for line in ax.lines if line.get_gid() == gid]


def test_importing_the_plots_is_cheap():
    code = "import sys, planner.plots; print('matplotlib' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.strip() == "False", done.stderr


def test_path_in_its_plane(plan):
    ax = axes()
    plots.draw_path(ax, plan)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x [m]", "y [m]")
    assert ax.get_aspect() == 1.0
    (path,) = lines(ax, "path")
    assert path.get_xydata() == pytest.approx(plan.object_position[:, :2])
    named = {text.get_text() for text in ax.get_legend().get_texts()}
    assert named == {"arms at the start", "arms at the goal", "straight line"}


def test_path_in_another_plane_is_drawn_there(plan):
    plan.object_position = plan.object_position[:, [0, 2, 1]]
    ax = axes()
    plots.draw_path(ax, plan)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x [m]", "z [m]")
    named = {text.get_text() for text in ax.get_legend().get_texts()}
    assert named == {"straight line"}  # the arms do not lie in that plane


def test_arms_end_where_the_hands_are(plan):
    reach = plots._arm_points(plan, 0, [0, 1])
    assert [len(arm) for arm in reach] == [3, 3]
    assert reach[0][0] == pytest.approx([0.0, 0.0])
    assert reach[1][0] == pytest.approx([0.45, 0.0])
    for arm in reach:
        assert np.linalg.norm(np.diff(arm, axis=0), axis=1) == pytest.approx([0.27, 0.33])


def test_spatial_path_is_drawn_over_its_length(plan):
    plan.object_position = plan.object_position + plan.time[:, None] ** 2 * [0.0, 0.0, 0.1]
    ax = axes()
    plots.draw_path(ax, plan)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("length of path [m]", "displacement [m]")
    drawn = lines(ax, "path")
    assert [line.get_label() for line in drawn] == ["x", "y", "z"]
    moved = np.array([line.get_ydata() for line in drawn]).T
    assert moved == pytest.approx(plan.object_position - plan.object_position[0])
    chord = np.linalg.norm(plan.object_position[-1] - plan.object_position[0])
    assert drawn[0].get_xdata()[-1] >= chord


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_path_along_one_axis(plan, axis):
    plan.object_position = 0.3 + np.outer(plan.time, np.eye(3)[axis])
    ax = axes()
    plots.draw_path(ax, plan)
    assert "xyz"[axis] in ax.get_xlabel() + ax.get_ylabel()


def test_several_paths_share_axes_and_differ_in_color(plan):
    ax = axes()
    for label in ("2 kg", "4 kg", "8 kg"):
        plots.draw_path(ax, plan, label, postures=False)
    drawn = lines(ax, "path")
    assert len({to_hex(line.get_color()) for line in drawn}) == 3
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["2 kg", "4 kg", "8 kg"]


def test_torques(plan):
    ax = axes()
    plots.draw_torques(ax, plan)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time [s]", "torque [Nm]")
    shown = {line.get_label(): line for line in ax.lines if line.get_label() in plan.joint_names}
    assert set(shown) == set(plan.joint_names)
    for column, name in enumerate(plan.joint_names):
        assert shown[name].get_ydata() == pytest.approx(plan.tau[:, column])
    assert shown["left_elbow"].get_linestyle() != shown["right_elbow"].get_linestyle()


def test_internal_force_leaves_out_what_is_zero(plan):
    ax = axes()
    plots.draw_internal_force(ax, plan)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time [s]", "force [N]")
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["magnitude", "x", "y"]
    (magnitude,) = lines(ax, "magnitude")
    assert magnitude.get_ydata() == pytest.approx(np.linalg.norm(plan.internal_force, axis=1))


def test_several_internal_forces(plan):
    ax = axes()
    for label in ("jerk", "torque"):
        plots.draw_internal_force(ax, plan, label, components=False)
    assert len({to_hex(line.get_color()) for line in lines(ax, "magnitude")}) == 2


def test_figure_has_both_plots(plan):
    figure = plots.draw(plan)
    titles = [ax.get_title(loc="left") for ax in figure.axes]
    assert titles == ["Object path", "Joint torques", "Internal force"]
    for ax in figure.axes:
        assert "[" in ax.get_ylabel()
    assert "16.8113" in figure.get_suptitle()


@pytest.mark.parametrize(
    ("name", "magic"), [("a.png", b"\x89PNG"), ("a.svg", b"<?xml"), ("new/A.PDF", b"%PDF")]
)
def test_file_is_written_in_its_format(plan, tmp_path, name, magic):
    assert plots.write_plots(plan, tmp_path / name) == [tmp_path / name]
    assert (tmp_path / name).read_bytes().startswith(magic)


def test_same_plan_gives_the_same_file(plan, tmp_path):
    for name in ("a.svg", "b.svg"):
        plots.write_plots(plan, tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_writing_leaves_matplotlib_as_it_was(plan, tmp_path):
    import matplotlib

    before = dict(matplotlib.rcParams)
    plots.write_plots(plan, tmp_path / "a.png")
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize("name", ["plot.xyz", "plot", "plot.tiff"])
def test_unknown_format_names_the_known_ones(plan, tmp_path, name):
    with pytest.raises(InputError, match=r"\.png, \.svg or \.pdf"):
        plots.write_plots(plan, tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_file_that_cannot_be_written_is_bad_input(plan, tmp_path):
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        plots.write_plots(plan, tmp_path / "folder.png")
