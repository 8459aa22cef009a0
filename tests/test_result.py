"""The plan: what it holds, and that it comes back from disk as it was."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import planner
from planner.result import ARRAYS, Plan

ROOT = Path(__file__).resolve().parents[1]
TRANSPORT = ROOT / "urdf" / "human_arms" / "transport.toml"


@pytest.fixture(scope="module")
def plan():
    return planner.plan(planner.load(TRANSPORT)).unwrap()


@pytest.fixture(scope="module")
def folder(plan, tmp_path_factory):
    return plan.save(tmp_path_factory.mktemp("plan"))


def test_shapes(plan):
    samples, joints = plan.scenario.solver.samples, len(plan.joint_names)
    assert plan.time.shape == (samples,)
    assert plan.time[0] == 0.0
    assert plan.time[-1] == plan.duration == plan.scenario.task.duration
    for name in ("q", "v", "a", "tau", "tau_rate"):
        assert getattr(plan, name).shape == (samples, joints), name
    for name in ("object_position", "hand_force_left", "hand_force_right", "internal_force"):
        assert getattr(plan, name).shape == (samples, 3), name
    assert plan.object_rotation.shape == (samples, 3, 3)
    assert plan.adjoint.shape[0] == samples
    assert np.array_equal(plan.internal_force, plan.hand_force_left - plan.hand_force_right)


def test_rates_are_derivatives(plan):
    for name, rate in (("q", "v"), ("v", "a"), ("tau", "tau_rate")):
        wanted = getattr(plan, rate)
        step = np.gradient(getattr(plan, name), plan.time, axis=0, edge_order=2)
        assert np.max(np.abs(step - wanted)) < 1e-3 * np.max(np.abs(wanted)), name


def test_scalars(plan):
    assert plan.path_length > np.linalg.norm(plan.object_position[-1] - plan.object_position[0])
    size = np.linalg.norm(plan.internal_force, axis=1)
    assert size.min() < plan.mean_internal_force < size.max()
    for name in ("nodes", "iterations", "rms_residual", "seconds"):
        assert plan.solver[name] >= 0, name
    assert plan.unwrap() is plan


def test_load_returns_what_was_saved(plan, folder):
    back = Plan.load(folder)
    for name in ARRAYS:
        assert np.array_equal(getattr(back, name), getattr(plan, name)), name
    for name in ("criterion", "cost", "duration", "solver", "checks", "remarks", "joint_names"):
        assert getattr(back, name) == getattr(plan, name), name
    assert back.scenario.resolved() == plan.scenario.resolved()


def test_a_loaded_scenario_plans_again(plan, folder, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)  # its paths are absolute
    again = planner.plan(Plan.load(folder).scenario).unwrap()
    assert again.cost == pytest.approx(plan.cost, rel=1e-9)


def test_plan_json(plan, folder):
    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    content = json.loads((folder / "plan.json").read_text(), parse_constant=refuse)
    assert content["status"] == "solved"
    assert content["cost"] == plan.cost
    assert {"criterion", "duration", "solver", "checks", "versions", "scenario"} <= set(content)
    assert {"python", "pin", "numpy", "scipy"} <= set(content["versions"])


def test_trajectory_needs_no_pickles_and_no_planner(folder):
    code = (
        "import sys, numpy\n"
        "with numpy.load(sys.argv[1], allow_pickle=False) as arrays:\n"
        "    shapes = {name: arrays[name].shape for name in arrays.files}\n"
        "    kinds = {arrays[name].dtype.kind for name in arrays.files}\n"
        "assert kinds == {'f', 'U'}, kinds\n"
        "assert shapes['joint_names'] == (4,) and shapes['tau'][1] == 4, shapes\n"
    )
    file = str(folder / "trajectory.npz")
    subprocess.run([sys.executable, "-I", "-c", code, file], check=True)
    with np.load(file) as arrays:
        assert set(ARRAYS) == set(arrays.files)


def test_save_makes_the_folder_and_replaces_an_older_plan(plan, tmp_path):
    target = tmp_path / "a" / "b"
    assert plan.save(str(target)) == target
    assert plan.save(target) == target
    assert sorted(path.name for path in target.iterdir()) == ["plan.json", "trajectory.npz"]


@pytest.mark.parametrize(
    "spoil",
    [
        lambda folder: (folder / "trajectory.npz").unlink(),
        lambda folder: (folder / "trajectory.npz").write_bytes(b"no archive"),
        lambda folder: (folder / "trajectory.npz").write_bytes(b""),
        lambda folder: (folder / "trajectory.npz").write_bytes(
            (folder / "trajectory.npz").read_bytes()[:1000]
        ),
        lambda folder: np.savez(folder / "trajectory.npz", time=np.zeros(3)),
        lambda folder: np.savez(folder / "trajectory.npz", time=np.array([{}], dtype=object)),
        lambda folder: (folder / "plan.json").write_text('{"status": "solved"}'),
        lambda folder: (folder / "plan.json").write_text("[]"),
        lambda folder: (folder / "plan.json").write_bytes(b"\xff\xfe"),
        lambda folder: (folder / "plan.json").unlink(),
    ],
)
def test_a_damaged_plan_is_refused(folder, tmp_path, spoil):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    spoil(copy)
    with pytest.raises(planner.InputError, match="copy"):
        Plan.load(copy)
