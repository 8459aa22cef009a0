"""The command line: what it prints, what it writes, how it ends."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plans import planned

import planner
from planner import cli, planning
from planner.outcome import failure
from planner.places import PLOT_SUFFIXES
from planner.result import Plan
from planner.solution import Refinement
from planner.terminal import Progress, print_plan, screen

ROOT = Path(__file__).resolve().parents[1]
TRANSPORT = ROOT / "urdf" / "human_arms" / "transport.toml"


@pytest.fixture
def run(capfd, monkeypatch):
    """Runs the command in this process; returns status, standard output, standard error."""

    def run_planner(*arguments):
        monkeypatch.setattr(sys, "argv", ["planner", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return (ended.value.code or 0, *capfd.readouterr())

    return run_planner


@pytest.fixture
def no_viewer(monkeypatch):
    """Collects what would be shown instead of showing it."""
    shown = []

    def show(self, *, open_browser=True, block=True):
        shown.append((self, open_browser))

    monkeypatch.setattr(Plan, "show", show)
    return shown


def process(*arguments, **options):
    """Runs the command in a process of its own, away from the project's folder."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "planner", *map(str, arguments)]
    return subprocess.Popen(command, env=environment, text=True, **options)


# ---- plan ----------------------------------------------------------------------------------------


def test_plan_prints_progress_and_a_table(run, tmp_path):
    status, out, err = run("plan", TRANSPORT, "--out", tmp_path / "out")
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert lines[0] == "Two planar arms, 2 kg object: torque-change, 1 s"
    assert lines[1].split() == ["nodes", "residual", "cost", "time", "stage"]
    end = lines.index("")
    steps = [line.split() for line in lines[2:end]]
    assert steps
    starts = {line.index(" s ") for line in lines[2:end]}
    assert len(starts) == 1  # columns stand one under the other
    for nodes, residual, cost, seconds, unit, stage in steps:
        assert stage in ("spectral", "collocation")
        assert int(nodes) > 0
        assert float(residual) > 0.0
        assert np.isfinite(float(cost))
        assert float(seconds) >= 0.0
        assert unit == "s"
    table = "\n".join(lines[end:])
    for words in (
        "cost",
        "16.811",
        "path of the object",
        "internal force, mean",
        "internal force, largest",
        "left_shoulder",
        "right_elbow",
        "Pontryagin residual",
        "Hamiltonian drift",
        "closure",
        "force balance",
        "replay error",
        "time spent",
        f"plan  {tmp_path / 'out' / 'plan.json'}, {tmp_path / 'out' / 'trajectory.npz'}",
    ):
        assert words in table, words
    assert "\x1b" not in out
    assert all(line == line.rstrip() for line in lines)


def test_long_progress_is_thinned_out(capsys):
    show = Progress(screen(), planner.load(TRANSPORT))
    for count in range(1000):
        show(Refinement(count, 1e-3, float("nan"), 0.1))
    lines = capsys.readouterr().out.splitlines()
    assert 100 < len(lines) < 200
    assert lines[-1].split() == ["999", "1.0e-03", "-", "0.10", "s"]


def test_plan_writes_what_is_asked_for(run, tmp_path, no_viewer):
    out, page, plot = (tmp_path / name for name in ("new/out", "page/m.html", "plot/p.svg"))
    settings = ("--set", "object.mass=1", "--set", "boundary.goal.torque=free")
    status, text, _ = run(
        "plan", TRANSPORT, *settings, "--out", out, "--html", page, "--plot", plot, "--view"
    )
    assert status == 0
    content = json.loads((out / "plan.json").read_text())
    assert content["status"] == "solved"
    assert content["scenario"]["object"]["mass"] == 1.0
    assert content["scenario"]["boundary"]["goal"]["torque"] == "free"
    assert Plan.load(out).cost == content["cost"]
    assert page.read_text().startswith("<!DOCTYPE html>")
    assert "<svg" in plot.read_text()
    assert str(page) in text
    assert str(plot) in text
    assert [opened for _, opened in no_viewer] == [True]


def test_plan_without_places_writes_nothing(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run("plan", TRANSPORT, "--quiet") == (0, "", "")
    assert list(tmp_path.iterdir()) == []


def test_a_motion_that_cannot_do_without_feedback_is_warned_of(capsys):
    plan = planned()
    words = "the motion is unstable without feedback"
    found = {"replay": words, "replay_window": 3e-9, "replay_growth": 11.3}
    print_plan(screen(), replace(plan, checks=plan.checks | found))
    out = capsys.readouterr().out
    assert f"warning: {words}" in out
    rows = [line.split() for line in out.splitlines() if "replay error" in line]
    assert ["replay", "error,", "windows", "3.0e-09", "m"] in rows
    assert ["replay", "error,", "growth", "1.1e+01", "1/s"] in rows


def test_notes_and_warnings(run):
    _, out, _ = run(
        "plan", TRANSPORT, "--set", "criterion.kind=torque", "--set", "boundary.goal.torque=free"
    )
    assert "note: boundary.goal.torque does not apply" in out
    _, out, _ = run("plan", TRANSPORT, "--set", "object.mass=500")
    assert "warning: left_shoulder: torque " in out


# ---- a solve that fails --------------------------------------------------------------------------

TOO_FEW = ("--set", "solver.max_nodes=25", "--set", "solver.tolerance=1e-9")
COLD = ("--set", "solver.start=line")


def test_failure_is_told_and_leaves_no_trajectory(run, tmp_path, no_viewer):
    out, page, plot = (tmp_path / name for name in ("out", "m.html", "p.png"))
    assert run("plan", TRANSPORT, "--out", out, "--quiet")[0] == 0
    assert (out / "trajectory.npz").exists()
    page.write_text("an earlier one")
    status, _, err = run(
        "plan", TRANSPORT, *TOO_FEW, *COLD, "--out", out, "--html", page, "--plot", plot, "--view"
    )
    assert status == 1
    assert err.startswith("not solved: mesh-full\n")
    assert "reason  " in err
    assert "remedy  allow more nodes (--set solver.max_nodes=" in err
    assert f"warning: {page} is of an earlier plan" in err
    assert not (out / "trajectory.npz").exists()
    content = json.loads((out / "plan.json").read_text())
    assert content["status"] == "mesh-full"
    assert content["reason"]
    assert content["remedy"]
    assert page.read_text() == "an earlier one"
    assert not plot.exists()
    assert no_viewer == []
    # and what is left cannot be shown
    status, _, err = run("show", out)
    assert status == 2
    assert "that solve ended with mesh-full" in err


def test_failure_without_a_folder_writes_nothing(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run("plan", TRANSPORT, *TOO_FEW, *COLD)[0] == 1
    assert list(tmp_path.iterdir()) == []


def test_every_failure_ends_with_status_1(run, monkeypatch):
    def plan(scenario, progress):
        return failure("closure-lost", "the arms lost the object at t = 0.4 s", scenario)

    monkeypatch.setattr(planning, "plan", plan)
    status, out, err = run("plan", TRANSPORT, "-q")
    assert (status, out) == (1, "")
    assert "closure-lost" in err
    assert "0.4 s" in err


def test_a_bug_shows_its_traceback(monkeypatch):
    def plan(scenario, progress):
        raise ZeroDivisionError

    monkeypatch.setattr(planning, "plan", plan)
    monkeypatch.setattr(sys, "argv", ["planner", "plan", str(TRANSPORT)])
    with pytest.raises(ZeroDivisionError):
        cli.main()


# ---- show ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    folder = tmp_path_factory.mktemp("saved")
    planner.plan(planner.load(TRANSPORT)).unwrap().save(folder)
    return folder


def test_show_opens_the_viewer(run, saved, no_viewer):
    status, out, _ = run("show", saved)
    assert status == 0
    assert "16.811" in out
    run("show", saved, "--no-browser", "-q")
    assert [opened for _, opened in no_viewer] == [True, False]


def test_show_writes_instead(run, saved, tmp_path, no_viewer):
    page, plot = tmp_path / "m.html", tmp_path / "p.png"
    assert run("show", saved, "--html", page, "--plot", plot)[0] == 0
    assert page.exists()
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert no_viewer == []
    run("show", saved, "--html", page, "--view")
    assert len(no_viewer) == 1


# ---- check ---------------------------------------------------------------------------------------


def test_check_of_the_example(run):
    status, out, err = run("check", TRANSPORT)
    assert (status, err) == (0, "")
    rows = {line[:20].strip(): line for line in out.splitlines()}
    assert "left_upper_arm 0.9" in out
    for words in ("closure rows m    2", "freedoms p        2", "task rows r       2"):
        assert any(words in line for line in rows.values()), words
    assert "surplus p - r     0" in out
    assert "redundancy N - p  2" in out
    assert out.endswith("\ncan be planned\n")


def test_check_of_what_cannot_be_planned(run):
    status, out, err = run(
        "check", TRANSPORT, "--set", "left.tip=palm", "--set", "object.urdf=none.urdf"
    )
    assert (status, err) == (2, "")
    problems = [line for line in out.splitlines() if line.startswith("problem: ")]
    assert len(problems) == 2
    assert "palm" in out
    assert "none.urdf" in out
    assert out.endswith("cannot be planned: 2 problems\n")


# ---- the program itself --------------------------------------------------------------------------


def test_version(run):
    assert run("--version") == (0, f"planner {planner.__version__}\n", "")


@pytest.mark.parametrize(
    "arguments",
    [
        ["plan"],
        ["plam", TRANSPORT],
        ["plan", TRANSPORT, "--ouf", "x"],
        ["plan", TRANSPORT, "again"],
        ["plan", TRANSPORT, "--set"],
    ],
)
def test_usage_errors(run, arguments):
    status, out, err = run(*arguments)
    assert (status, out) == (2, "")
    assert "Traceback" not in err


def test_help_is_quick():
    code = (
        "import sys; sys.argv = ['planner', '--help']\n"
        "from planner import cli\n"
        "try: cli.main()\n"
        "except SystemExit as ended: assert not ended.code\n"
        "heavy = {'numpy', 'scipy', 'pinocchio', 'matplotlib', 'meshcat', 'yourdfpy', 'pydantic'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    for command in ("plan", "show", "check", "--version"):
        assert command in done.stdout


def test_plot_formats_are_those_that_are_drawn():
    from planner.plots import SUFFIXES

    assert PLOT_SUFFIXES == SUFFIXES


def test_titles_that_the_terminal_cannot_write(run, tmp_path, monkeypatch):
    title = 'title="[bold]手[/bold] :smile:"'
    assert "[bold]手[/bold] :smile:" in run("check", TRANSPORT, "--set", title)[1]
    with process(
        "check", TRANSPORT, "--set", title, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as child:
        assert child.communicate()[1] == ""
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    with process("check", TRANSPORT, "--set", title, stdout=subprocess.PIPE) as child:
        assert "[bold]?[/bold] :smile:" in child.communicate()[0]
        assert child.returncode == 0


def test_a_reader_that_goes_away_does_not_stop_the_plan(tmp_path):
    out = tmp_path / "out"
    with process(
        "plan", TRANSPORT, "--out", out, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as child:
        child.stdout.close()
        err = child.stderr.read()
        assert child.wait(60) == 0, err
    assert err == ""
    assert Plan.load(out).solved


def test_interrupt_is_quiet(run, monkeypatch):
    def plan(scenario, progress):
        raise KeyboardInterrupt

    monkeypatch.setattr(planning, "plan", plan)
    assert run("plan", TRANSPORT) == (130, "", "")


def test_interrupt_of_a_process(tmp_path):
    settings = ("--set", "solver.tolerance=1e-10", "--set", "solver.max_nodes=900000")
    with process(
        "plan", TRANSPORT, *settings, *COLD, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as child:
        child.stdout.readline()  # it solves now
        time.sleep(0.05)
        child.send_signal(signal.SIGINT)
        _, err = child.communicate(timeout=60)
    assert child.returncode == 130
    assert err == ""


def test_colours_only_on_a_terminal(capsys, monkeypatch):
    screen().print("x", style="red")
    assert capsys.readouterr().out == "x\n"
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    screen().print("x", style="red")
    assert "\x1b[31m" in capsys.readouterr().out
